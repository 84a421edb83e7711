"""Exports of Nexus and MOX are read as their recordings, and what lacks is named."""

import re

import numpy as np
import pytest

from hbm.notes import Note
from pipeline.config.schema import Settings, Subject
from pipeline.io.read import read_recording
from pipeline.trial.process import process_recording
from tests.pipeline.other_formats import excerpt, write_dflow, write_mox, write_nexus


@pytest.fixture(scope="module")
def trial(walker):
    """One second of walking that begins at frame 301."""
    return excerpt(walker, 500, 600, first_frame=301)


def changed(path, *pairs):
    text = path.read_text(encoding="utf-8")
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")
    return path


OUTPUTS = """
Model Outputs
100
,,S01:LHipAngles,,,S01:LKneeAngles,,
Frame,Sub Frame,X,Y,Z,X,Y,Z
,,deg,deg,deg,deg,deg,deg
"""


def test_nexus_states_frames_and_names_the_model_outputs_that_are_not_read(trial, tmp_path):
    path = write_nexus(trial, tmp_path / "t.csv")
    rows = "".join(f"{301 + k},0,{k},1,2,3,4,5\n" for k in range(100))
    path.write_text(path.read_text(encoding="utf-8") + OUTPUTS + rows, encoding="utf-8")
    read = read_recording(path)
    assert read.first_frame == 301
    assert Note.of("parts_left_out", parts=["Model Outputs"]) in read.notes
    assert Note.of("forces_reversed") in read.notes


def test_other_devices_are_analog_channels(trial, tmp_path):
    path = changed(
        write_nexus(trial, tmp_path / "t.csv"),
        ("Imported AMTI #2 - CoP", "EMG - Voltage"),
        ("Imported AMTI #2 - Force", "Left - Volts"),
        ("Imported AMTI #2 - Moment", "Right - Volts"),
    )
    read = read_recording(path)
    assert len(read.plates) == 1
    assert any(name.startswith("EMG") for name in read.analog.names)
    assert read.analog.values.shape == (1000, 9)


@pytest.mark.parametrize(
    ("write", "pairs", "message"),
    [
        (write_nexus, [("S01:", "S02:"), ("\n302,0,", "\n303,0,")], "increase"),
        (write_nexus, [("N.mm", "lbf")], "unit 'lbf'"),
        (write_nexus, [("Devices\n1000", "Devices\n900")], "do not"),
        (write_nexus, [("Trajectories", "Points")], "no Trajectories block"),
        (write_mox, [("</viewer_data>", "")], "broken or truncated"),
        (write_mox, [("frequency>100<", "frequency>50<")], "differ in rate"),
    ],
)
def test_a_broken_file_is_refused_in_one_line(trial, tmp_path, write, pairs, message):
    path = changed(write(trial, tmp_path / "t.x"), *pairs)
    with pytest.raises(ValueError, match=rf"^t\.x: .*{message}"):
        read_recording(path)


@pytest.mark.parametrize(
    ("write", "pair"),
    [
        (write_nexus, ("Imported AMTI #2 - CoP", "Pressure")),
        (write_mox, ("FP2 - Moment Y", "FP2 - Torque Y")),
        (write_dflow, ("FP2.MomY", "FP2.TorqueY")),
    ],
)
def test_a_plate_that_lacks_channels_is_left_out_and_the_other_kept(trial, tmp_path, write, pair):
    whole = read_recording(write(trial, tmp_path / "whole.txt"))
    read = read_recording(changed(write(trial, tmp_path / "less.txt"), pair))
    (plate,) = read.plates
    np.testing.assert_array_equal(plate.wrench, whole.plates[0].wrench)
    (fact,) = read.facts
    assert fact.kind == "left_out"
    assert fact.of.startswith("plate 2")


def test_a_number_of_samples_that_mox_does_not_hold_is_a_doubt(trial, tmp_path):
    pair = ("<nr_of_samples>100", "<nr_of_samples>250")
    (fact,) = read_recording(changed(write_mox(trial, tmp_path / "t.mox"), pair)).facts
    assert fact.kind == "in_doubt"
    assert re.search(r"nr_of_samples 250\b.* 100\b", fact.reason)


def test_a_pose_of_one_frame_is_read_but_is_no_motion(walker, tmp_path):
    path = write_nexus(excerpt(walker, 500, 502), tmp_path / "t.csv")
    lines = path.read_text(encoding="utf-8").split("\n")
    path.write_text("\n".join(line for line in lines if line[:2] != "2,"), encoding="utf-8")
    pose = read_recording(path)
    assert len(pose.markers.time) == 1
    with pytest.raises(ValueError, match=r"^t\.csv: .*one frame"):
        process_recording(pose, Subject(sex="male", mass_kg=80.0), Settings())
