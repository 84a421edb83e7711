"""Long, broken and unusual C3D files give a Recording or one line of error."""

import struct
from itertools import chain

import numpy as np
import pytest

from hbm.markers import Markers
from pipeline.export.tables import write_trc
from pipeline.io.c3d.read import read_c3d
from pipeline.io.c3d.second_reader import compare_readers
from pipeline.io.read import read_recording
from pipeline.io.recording import Analog
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.synthetic import synthetic_t_pose

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


@pytest.mark.parametrize("suffix", [".c3d", ".trc"])
def test_positions_and_samples_that_no_laboratory_has_are_gaps_with_a_note(tmp_path, suffix):
    person, path = synthetic_t_pose(), tmp_path / f"still{suffix}"
    position = person.position.copy()
    position[20:25, 3, 0] = 60.0
    markers = Markers(person.time, person.names, position)
    samples = np.zeros((1000, 2))
    samples[:7] = 1e38, -np.inf
    analog = Analog(np.arange(1000) / 1000, ("A", "B"), ("V", "V"), samples)
    counts = {person.names[3]: 5}
    if suffix == ".c3d":
        write_c3d(path, markers, analog=analog)
        counts |= {"A": 7, "B": 7}
    else:
        write_trc(markers, path)
    read = read_recording(path, "left,back,up" if suffix == ".c3d" else AXES)
    assert not np.isfinite(read.markers.position[20:25, 3]).any()
    assert np.isfinite(np.delete(read.markers.position, 3, axis=1)).all()
    noted = [fact.of.split(", ") for fact in read.facts if fact.kind == "impossible_samples"]
    assert {*chain(*noted)} == {f"{name} {count}" for name, count in counts.items()}
    if suffix == ".c3d":
        assert np.isnan(read.analog.values[:7]).all()
        assert compare_readers(path).disagreements == ()


@pytest.mark.parametrize("n_frames", [65535, 70000])
@pytest.mark.parametrize("counted_by", ["started_over", "saturated", "trial", "long_frames"])
def test_no_frame_is_lost_where_16_bits_cannot_count_them(raw_c3d, n_frames, counted_by):
    points = np.zeros((n_frames, 2, 4))
    points[..., 0] = np.arange(n_frames)[:, None] / 2
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
    assert position[-1, 0, 0] == pytest.approx((n_frames - 1) / 2000)


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        ({"rate": 0.0}, " 0 Hz by POINT:RATE, .* 100000 Hz"),
        ({"POINT": {"SCALE": np.array([0.1])}}, " by -1, .*POINT:SCALE"),
        ({"FORCE_PLATFORM": {"USED": np.array([9999])}}, "USED says 9999 "),
    ],
)
def test_parameters_that_cannot_be_true_are_refused(raw_c3d, groups, message):
    groups["POINT"] = {"LABELS": ["A"], **groups.get("POINT", {})}
    with pytest.raises(ValueError, match=message):
        read_c3d(raw_c3d(np.full((4, 1, 4), 500.0), **groups), AXES)
