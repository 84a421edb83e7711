"""A simulated study is reproducible, read by others, and consistent with its truth."""

import os

import c3d
import numpy as np
import pandas as pd
import pytest

from hbm.coordinates import COORDINATES
from hbm.signals.resampling import resample
from pipeline.io.c3d.read import read_c3d
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import WRENCH, simulate_study

SMALL = Protocol(
    conditions=("baseline", "sway"),
    subjects=1,
    baseline_s=8.0,
    waits_s=(12.0,),
    calibration="square_sway_60s_3mps",
    beside_s=0.0,
)
TINY = SMALL.model_copy(update={"conditions": ("baseline",), "baseline_s": 2.0})


def simulated(folder, jobs=1, keep=False, **changes):
    changes = {"protocol": SMALL} | changes
    return simulate_study(folder, Setting(**changes), jobs=jobs, keep=keep)


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("lab") / "study")


@pytest.fixture(scope="module", params=["baseline", "sway"])
def trial(request, study):
    name = f"sub01_{request.param}"
    return read_c3d(study / f"{name}.c3d"), pd.read_parquet(study / "truth" / f"{name}.parquet")


@pytest.mark.slow
def test_equal_seeds_give_equal_files_in_any_number_of_processes_and_other_seeds_others(tmp_path):
    first = contents(simulated(tmp_path / "1", protocol=TINY))
    assert contents(simulated(tmp_path / "2", protocol=TINY, jobs=2)) == first
    other = contents(simulated(tmp_path / "3", protocol=TINY, seed=2))
    assert other.keys() == first.keys()
    differ = {name for name in first if other[name] != first[name]}
    assert differ == {name for name in first if name.endswith((".c3d", ".parquet", ".csv"))} | {
        "truth/setting.toml"
    }


@pytest.mark.slow
def test_of_a_study_that_is_there_only_what_is_missing_is_written(tmp_path):
    """Whether deleted or never written; a file that its owner changed stays as it is."""
    folder = simulated(tmp_path / "lab", protocol=TINY)
    whole = contents(folder)
    gone = ("calibration.c3d", "truth/sub01_baseline.parquet", "study.toml")
    for name in gone:
        (folder / name).unlink()
    changed = whole["sub01.toml"] + b'[trials.sway]\nexclude = "ill"\n'
    (folder / "sub01.toml").write_bytes(changed)
    os.utime(folder / "sub01_baseline.c3d", (1, 1))
    steps = []
    simulate_study(
        folder, Setting(protocol=TINY), lambda *step: steps.append(step), jobs=1, keep=True
    )
    assert contents(folder) == whole | {"sub01.toml": changed}
    assert (folder / "sub01_baseline.c3d").stat().st_mtime == 1
    assert steps == [("calibration.c3d", 1, 2), ("sub01_baseline.c3d", 2, 2)]


@pytest.mark.parametrize("name", ["sub01_sway", "calibration"])
def test_an_independent_reader_reads_the_same_from_every_file(study, name):
    ours = read_c3d(study / f"{name}.c3d", "left,back,up")
    with (study / f"{name}.c3d").open("rb") as file:
        reader = c3d.Reader(file)
        frames = list(reader.read_frames(copy=True))
        labels = tuple(label.strip() for label in reader.point_labels)
        channels = [label.strip() for label in reader.analog_labels]
    points = np.array([p[:, :3] for _, p, _ in frames]) / 1000
    points[np.array([p[:, 3] < 0 for _, p, _ in frames])] = np.nan
    analog = np.concatenate([a for *_, a in frames], axis=1)
    assert (reader.point_rate, reader.analog_rate) == (100, 1000)
    assert labels == ours.markers.names
    lab = points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(lab, ours.markers.position, atol=1e-6)
    for channel in ours.analog.names:
        theirs = analog[channels.index(channel)]
        np.testing.assert_allclose(ours.analog.channel(channel), theirs, rtol=1e-5, atol=1e-6)


def test_the_truth_is_complete_and_satisfies_the_equations_of_motion(trial):
    recording, truth = trial
    np.testing.assert_allclose(truth["time"], recording.markers.time, atol=1e-9)
    assert set(COORDINATES) <= set(truth.columns)
    assert np.isfinite(truth.to_numpy()).all()
    residual = truth[[f"residual_{name}" for name in WRENCH]]
    assert residual.abs().to_numpy().max() < 1e-6
    weight = PERSONS[0].mass_kg * 9.81
    vertical = truth["left_fz"] + truth["right_fz"]
    assert vertical[200:].mean() == pytest.approx(weight, rel=0.01)


def test_plates_measure_the_feet_and_the_treadmills_own_wrench(trial):
    """Forces in the platform's frame, which sway does not rotate."""
    recording, truth = trial
    feet = sum(truth[[f"{side}_f{a}" for a in "xyz"]].to_numpy() for side in ("left", "right"))
    machine = sum(truth[[f"artefact_{k}_f{a}" for a in "xyz"]].to_numpy() for k in (1, 2))
    time = recording.markers.time
    found = sum(resample(p.time, p.wrench, time)[:, :3] for p in recording.plates)
    error = np.sqrt(np.mean((found - feet - machine)[50:-50] ** 2, axis=0))
    assert (error < 15).all()  # delay 3 ms, cross-talk, zero error and noise of the plates
    assert np.abs(machine[:100]).max() < 1  # at rest nothing shakes it, afterwards people do
    assert recording.source.stem != "sub01_sway" or np.abs(machine[:, 1]).max() > 800


def test_true_events_are_where_the_force_under_a_foot_passes_20_n(trial, study):
    """They stand in the folder of the truth, and none in the recording."""
    recording, truth = trial
    assert recording.events == ()
    table = pd.read_csv(study / "truth" / f"{recording.source.stem}_events.csv")
    assert len(table) > 30
    time = truth["time"].to_numpy()
    for (side, label), rows in table.groupby(["side", "event"]):
        above = truth[f"{side}_fz"].to_numpy() > 20
        before, after = (above[1:], above[:-1]) if label == "foot_off" else (above[:-1], above[1:])
        frames = np.flatnonzero(~before & after)
        assert len(rows) == len(frames)
        assert ((rows["time_s"] >= time[frames]) & (rows["time_s"] <= time[frames + 1])).all()
