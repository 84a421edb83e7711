"""Long, broken and unusual C3D files give a Recording or one line of error."""

import struct

import numpy as np
import pytest

from pipeline.io.c3d.read import read_c3d

ezc3d = pytest.importorskip("ezc3d", reason="ezc3d has no wheel for this system")

AXES = "forward,left,up"
SAMPLES = {
    "Empty.c3d": "the file is empty",
    "LICENSE": "not a C3D file",
    "MACsample.c3d": r"header scales points by 0.0551.*POINT:SCALE says 0.0215",
    "bad_parameter_section.c3d": "the parameter section is broken",
    "parameterOverflow.c3d": "no marker is ever visible: export the file again",
    "phasespace_sample.c3d": "no length unit is given",
    "type1.C3D": "force plate 1: channel Px1: unknown length unit 'N'",
}


@pytest.mark.parametrize(("name", "refusal"), SAMPLES.items())
def test_broken_sample_files_are_refused_in_one_line(shared_data, name, refusal):
    with pytest.raises(ValueError, match=refusal):
        read_c3d(shared_data / "c3d_samples" / name)


@pytest.mark.parametrize("n_frames", [65535, 70000])
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


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        ({"rate": 0.0}, r"no frame rate between 0.1 and 100000 Hz is given \(0 Hz by POINT:RATE"),
        ({"POINT": {"SCALE": np.array([0.1])}}, "header scales points by -1, but POINT:SCALE"),
        ({"FORCE_PLATFORM": {"USED": np.array([9999])}}, "USED says 9999 plates: the file is dama"),
    ],
)
def test_parameters_that_cannot_be_true_are_refused(raw_c3d, groups, message):
    groups["POINT"] = {"LABELS": ["A"], **groups.get("POINT", {})}
    with pytest.raises(ValueError, match=message):
        read_c3d(raw_c3d(np.full((4, 1, 4), 500.0), **groups), AXES)
