"""Long, broken, unusual and damaged C3D files give a Recording or one line of error."""

import struct
from datetime import timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.io.c3d.parameters import floats
from pipeline.io.c3d.read import read_c3d

ezc3d = pytest.importorskip("ezc3d", reason="ezc3d has no wheel for this system")

AXES = "forward,left,up"
MAX_CHARACTERS = 300
"""Of a refusal: a line or two of a terminal."""
SAMPLES = {
    "DEC_INT.C3D": None,
    "Empty.c3d": "the file is empty",
    "Gait.c3d": None,
    "LICENSE": "not a C3D file",
    "MACsample.c3d": r"header scales points by 0.0551.*POINT:SCALE says 0.0215",
    "TYPE-2.C3D": None,
    "TYPE-4.C3D": None,
    "bad_parameter_section.c3d": "the parameter section is broken",
    "parameterOverflow.c3d": "no marker is ever visible: export the file again",
    "pc_int.c3d": None,
    "phasespace_sample.c3d": "no length unit is stated",
    "sgi_real.c3d": None,
    "type1.C3D": "force plate 1: channel Px1: unknown length unit 'N'",
}


def assert_read_or_refused(path):
    """Read the file, or check that it is refused in one line that names it."""
    refusal = ""
    try:
        read_c3d(path, AXES)
    except (ValueError, OSError) as error:
        refusal = str(error)
    assert refusal.isprintable()
    assert len(refusal) < MAX_CHARACTERS
    assert not refusal or refusal.startswith(path.name)


@pytest.mark.parametrize(("name", "refusal"), SAMPLES.items())
def test_every_sample_file_is_read_or_refused_in_one_line(shared_data, name, refusal):
    path = shared_data / "c3d_samples" / name
    if refusal is None:
        assert read_c3d(path).markers.names
        return
    with pytest.raises(ValueError, match=refusal) as caught:
        read_c3d(path)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < MAX_CHARACTERS


@pytest.mark.parametrize(
    "content",
    [b"", b"\2", b"\2\x50" + bytes(200), b"PK\3\4" + bytes(5000), b"\2\x50" + bytes(5000)],
)
def test_files_that_are_no_c3d_are_refused(tmp_path, content):
    path = tmp_path / "trial.c3d"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"trial\.c3d: (the file is empty|not a C3D file)"):
        read_c3d(path)


@pytest.mark.parametrize("n_frames", [65535, 65536, 70000])
@pytest.mark.parametrize("counted_by", ["started_over", "saturated", "trial", "long_frames"])
def test_no_frame_is_lost_where_16_bits_cannot_count_them(raw_c3d, n_frames, counted_by):
    points = np.zeros((n_frames, 2, 4))
    points[..., 0] = np.arange(n_frames)[:, None]
    points[:, 1, 2] = 1500
    extra = {
        "started_over": {},
        "saturated": {"POINT": {"FRAMES": np.array([65535])}},
        "trial": {
            "TRIAL": {
                "ACTUAL_START_FIELD": np.array([1, 0]),
                "ACTUAL_END_FIELD": np.array([n_frames % 65536, n_frames // 65536]),
            }
        },
        "long_frames": {"POINT": {"LONG_FRAMES": np.array([float(n_frames)])}},
    }[counted_by]
    extra["POINT"] = {"LABELS": ["A", "B"], **extra.get("POINT", {})}
    path = raw_c3d(points, **extra)
    if counted_by == "saturated":
        content = bytearray(path.read_bytes())
        content[8:10] = struct.pack("<H", 65535)
        path.write_bytes(content)
    position = read_c3d(path, AXES).markers.position
    assert len(position) == n_frames
    assert position[-1, 0, 0] == pytest.approx((n_frames - 1) / 1000)


def test_a_long_file_of_ezc3d_is_read_to_its_end_with_or_without_its_rotation_group(tmp_path):
    """Asked for 66,000 frames, ezc3d 1.7.2 itself reads 65,535 of the file with the group."""
    n_frames = 66_000
    counts = {}
    for rotations in (True, False):
        made = ezc3d.c3d()
        made["parameters"]["POINT"]["RATE"]["value"] = [100.0]
        made["parameters"]["POINT"]["LABELS"]["value"] = ["A", "B"]
        made["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
        points = np.ones((4, 2, n_frames))
        points[2, 1] = 1500
        made["data"]["points"] = points
        if not rotations:
            del made["data"]["rotations"]
        path = tmp_path / f"rotations_{rotations}.c3d"
        made.write(str(path))
        theirs = ezc3d.c3d(str(path))["data"]["points"].shape[2]
        counts[rotations] = len(read_c3d(path, AXES).markers.time), theirs
    assert counts == {True: (n_frames, 65535), False: (n_frames, n_frames)}


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        ({"rate": 0.0}, r"no frame rate between 0.1 and 100000 Hz is stated \(0 Hz by POINT:RATE"),
        ({"rate": np.nan}, r"is stated \(no number by POINT:RATE, no number by the header\)"),
        ({"POINT": {"SCALE": np.array([0.1])}}, "header scales points by -1, but POINT:SCALE"),
        (
            {"EVENT": {"TIMES": np.ones(3), "LABELS": ["Foot Off", "Foot Off"]}},
            "EVENT:TIMES holds 3 numbers for 2 labels",
        ),
        ({"FORCE_PLATFORM": {"USED": np.array([9999])}}, "USED says 9999 plates: the file is dama"),
    ],
)
def test_parameters_that_cannot_be_true_are_refused(raw_c3d, groups, message):
    groups["POINT"] = {"LABELS": ["A"], **groups.get("POINT", {})}
    with pytest.raises(ValueError, match=message):
        read_c3d(raw_c3d(np.full((4, 1, 4), 500.0), **groups), AXES)


@pytest.fixture
def victim(raw_c3d):
    """Make a small file with everything in it, to be damaged."""
    rng = np.random.default_rng(1)
    path = raw_c3d(
        rng.normal(500, 400, size=(20, 5, 4)) * [1, 1, 1, 0],
        rng.normal(size=(20, 3, 8)),
        POINT={"LABELS": [*"ABCD", "LKneeAngles"], "ANGLES": ["LKneeAngles"]},
        ANALOG={"UNITS": ["N"] * 3 + ["Nmm"] * 3 + ["V"] * 2},
        FORCE_PLATFORM={
            "USED": np.array([1]),
            "TYPE": np.array([4]),
            "ZERO": np.array([1, 0]),
            "CORNERS": rng.normal(size=(3, 4, 1)),
            "ORIGIN": np.array([[0.0], [0], [-40]]),
            "CHANNEL": np.arange(1, 7)[:, None],
            "CAL_MATRIX": rng.normal(size=(6, 6, 1)),
        },
        EVENT={
            "USED": np.array([2]),
            "CONTEXTS": ["Left", "Right"],
            "LABELS": ["Foot Strike", "Foot Off"],
            "TIMES": np.array([[0.0, 0], [0.05, 0.1]]),
        },
        TRIAL={"ACTUAL_START_FIELD": np.array([1, 0]), "ACTUAL_END_FIELD": np.array([20, 0])},
        PROCESSING={"Bodymass": np.array([70.0])},
    )
    assert read_c3d(path, AXES).plates
    return path


damage = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), max_size=8)


@given(cut=st.floats(0, 1), flips=damage)
@settings(
    max_examples=300,
    deadline=timedelta(seconds=5),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_a_damaged_file_gives_a_recording_or_one_line_of_error(victim, cut, flips):
    content = bytearray(victim.read_bytes())
    for place, value in flips:
        content[int(place * len(content))] = value
    if cut < 0.5:
        del content[int(2 * cut * len(content)) :]
    damaged = victim.with_name("damaged.c3d")
    damaged.write_bytes(content)
    assert_read_or_refused(damaged)


def test_dec_numbers_are_ieee_numbers_times_four_with_their_halves_exchanged():
    known = {0x00004080: 1.0, 0x0000C080: -1.0, 0x00004000: 0.125 * 4, 0x0FDB4149: np.pi}
    data = b"".join(struct.pack("<I", word) for word in known)
    np.testing.assert_allclose(floats(data, "dec"), list(known.values()), rtol=1e-6)
