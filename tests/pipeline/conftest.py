"""What tests of readers share: C3D files made to order, and a standing subject."""

import struct

import numpy as np
import pytest

from hbm.markers import Markers
from pipeline.config.study import read_study
from pipeline.io.c3d.parameters import parameter_section
from pipeline.io.recording import Plate
from pipeline.run.run import run_study
from pipeline.trial.process import process_trial
from pipeline.trial.study_files import read_study_laboratory
from tests.pipeline import lab
from tests.pipeline.fake_results import without_figures

BLOCK = 512
SURFACE = ((0.85, -0.25), (-0.85, -0.25), (-0.85, 0.25), (0.85, 0.25))


@pytest.fixture
def raw_c3d(tmp_path):
    """Write any parameters and samples as an Intel C3D file, right or wrong.

    ``header`` replaces its words, such as ``{"points": 4}``; ``absent`` names parameters to leave
    out, such as ``"ANALOG:SCALE"``.
    """

    def write(
        points,
        analog=None,
        *,
        scale=-1.0,
        rate=100.0,
        first_frame=1,
        header=None,
        absent=(),
        **groups,
    ):
        n_frames, n_points, _ = points.shape
        analog = np.zeros((n_frames, 1, 0)) if analog is None else analog
        per_frame, channels = analog.shape[1:]
        members = {
            "POINT": {
                "USED": np.array([n_points]),
                "FRAMES": np.array([n_frames % 65536]),
                "SCALE": np.array([float(scale)]),
                "RATE": np.array([rate]),
                "UNITS": "mm",
            },
            "ANALOG": {
                "USED": np.array([channels]),
                "RATE": np.array([rate * per_frame]),
                "GEN_SCALE": np.array([1.0]),
                "SCALE": np.ones(channels),
                "OFFSET": np.zeros(channels, int),
                "UNITS": ["V"] * channels,
                "LABELS": [f"A{k}" for k in range(channels)],
            },
        }
        for name, content in groups.items():
            members[name] = members.get(name, {}) | content
        for group, _, name in (each.partition(":") for each in absent):
            del members[group][name]
        data_block = 2 + -(-len(parameter_section(members, 0)) // BLOCK)
        words = {
            "points": n_points,
            "analog": channels * per_frame,
            "first": first_frame,
            "last": (first_frame + n_frames - 1) % 65536,
            "gap": 0,
            "scale": scale,
            "data_block": data_block,
            "per_frame": per_frame,
            "rate": rate,
        } | (header or {})
        block = struct.pack("<BBHHHHHfHHf", 2, 0x50, *words.values())
        section = parameter_section(members, data_block)
        samples = np.hstack([points.reshape(n_frames, -1), analog.reshape(n_frames, -1)])
        path = tmp_path / "made_to_order.c3d"
        path.write_bytes(
            block.ljust(BLOCK, b"\0")
            + section.ljust((data_block - 2) * BLOCK, b"\0")
            + samples.astype("<f4" if scale < 0 else "<i2").tobytes()
        )
        return path

    return write


@pytest.fixture
def subject():
    """Markers of a subject who stands 0.1 m left of the origin, faces forward, and breathes."""
    places = {
        "LASIS": (0.1, 0.2, 1.0),
        "RASIS": (0.1, 0.0, 1.0),
        "LHEE": (-0.1, 0.2, 0.05),
        "RHEE": (-0.1, 0.0, 0.05),
        "LMT2": (0.1, 0.2, 0.05),
        "RMT2": (0.1, 0.0, 0.05),
    }
    time = np.arange(50) / 100
    position = np.tile(np.array(list(places.values())), (len(time), 1, 1))
    position[..., 2] += 0.005 * np.sin(2 * np.pi * time)[:, None]
    return Markers(time, tuple(places), position)


@pytest.fixture
def plates():
    """Two force plates side by side, z down like most, ten samples per frame, 350 N each."""
    rng = np.random.default_rng(0)
    time = np.arange(500) / 1000
    rotation = np.diag([1.0, -1.0, -1.0])
    wrench = np.array([0, 0, -350, 0, 0, 0]) + rng.normal(size=(2, 500, 6))
    return tuple(
        Plate(
            number=k + 1,
            time=time,
            wrench_in_plate=wrench[k],
            rotation=rotation,
            center=(0, y, 0),
            corners=[(x, y + dy, 0) for x, dy in SURFACE],
        )
        for k, y in enumerate((0.25, -0.25))
    )


@pytest.fixture(scope="session")
def walker(tmp_path_factory):
    """A virtual walker's recording of 12 s, on a treadmill that stands still."""
    return lab.walk(tmp_path_factory.mktemp("walker"))


@pytest.fixture(scope="session")
def moving_study(tmp_path_factory):
    """Folder of a small study on a moving platform; tests that change it take a copy."""
    return lab.write_study(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="session")
def study(moving_study):
    """That study as it is read."""
    return read_study(moving_study)


@pytest.fixture(scope="session")
def laboratory(moving_study):
    """Its laboratory, with the calibration."""
    return read_study_laboratory(read_study(moving_study))


@pytest.fixture(scope="session")
def processed(moving_study):
    """One processed trial of that study: pitch, as measured and compensated."""
    return process_trial(read_study(moving_study), "sub01", "pitch")


@pytest.fixture(scope="session")
def finished(moving_study, tmp_path_factory):
    """Results of an undisturbed run of that study, all six trials; tests change copies only."""
    out = tmp_path_factory.mktemp("results")
    outcomes = list(run_study(read_study(moving_study), out))
    assert [outcome.state for outcome in outcomes] == ["done"] * 6
    return out


@pytest.fixture
def undrawn():
    """Reports without figures of the study and comparisons of curves, which are not looked at."""
    with without_figures():
        yield


@pytest.fixture
def plain_pages(monkeypatch):
    """Pages of laboratories without figures, which are not looked at."""
    monkeypatch.setattr("pipeline.report.laboratory._of_recording", lambda *given: [])


@pytest.fixture
def everything(raw_c3d):
    """A file with a gap, channels at three samples a frame, events; frames count from 11."""
    rng = np.random.default_rng(2)
    points = rng.normal(500, 400, size=(20, 5, 4)) * [1, 1, 1, 0]
    points[4:7, 2] = (0, 0, 0, -1)
    return raw_c3d(
        points,
        rng.normal(size=(20, 3, 8)),
        first_frame=11,
        POINT={"LABELS": list("ABCDE")},
        ANALOG={"OFFSET": np.arange(8), "SCALE": rng.normal(size=8), "GEN_SCALE": np.array([0.3])},
        EVENT={
            "USED": np.array([2]),
            "CONTEXTS": ["Left", "Right"],
            "LABELS": ["Foot Strike", "Foot Off"],
            "TIMES": np.array([[0.0, 0], [0.05, 0.1]]),
        },
    )
