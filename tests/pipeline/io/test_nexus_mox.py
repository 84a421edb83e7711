import numpy as np
import pytest

from hbm.notes import Note
from pipeline.io.read import read_recording
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


def test_nexus_states_subject_and_frames_and_keeps_its_model_outputs(trial, tmp_path):
    path = write_nexus(trial, tmp_path / "t.csv")
    rows = "".join(f"{301 + k},0,{k},1,2,3,4,5\n" for k in range(100))
    path.write_text(path.read_text(encoding="utf-8") + OUTPUTS + rows, encoding="utf-8")
    read = read_recording(path)
    assert read.first_frame == 301
    assert read.metadata.subject == "S01"
    np.testing.assert_array_equal(read.model_outputs["LHipAngles"][:, 0], np.arange(100))
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
    assert "EMG - Voltage Cx" in read.analog.names
    assert read.analog.values.shape == (1000, 9)


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([("S01:", "S02:"), ("\n302,0,", "\n303,0,")], "upward"),
        ([("N.mm", "lbf")], "unknown moment unit 'lbf'"),
        ([("Trajectories\n100", "Trajectories\nfast")], "no number"),
        ([("Devices\n1000", "Devices\n900")], "do not"),
        ([("Trajectories", "Points")], "no Trajectories block"),
        ([("Frame,Sub Frame,X,Y,Z", "Frame,Sub Frame,X,Y,Q,X")], "columns"),
    ],
)
def test_a_broken_nexus_export_is_refused_in_one_line(trial, tmp_path, pairs, message):
    path = changed(write_nexus(trial, tmp_path / "t.csv"), *pairs)
    with pytest.raises(ValueError, match=rf"^t\.csv: .*{message}"):
        read_recording(path)


@pytest.mark.parametrize(
    ("write", "name", "pair", "reason"),
    [
        (
            write_nexus,
            "t.csv",
            ("Imported AMTI #2 - CoP", "Pressure"),
            "it has forces but no CoP; export Force, Moment and CoP: only together they give the "
            "wrench in the lab",
        ),
        (
            write_mox,
            "t.mox",
            ("FP2 - Moment Y", "FP2 - Torque Y"),
            "mom Y is absent, but others that belong to it are there",
        ),
        (
            write_dflow,
            "t.txt",
            ("FP2.MomY", "FP2.TorqueY"),
            "FP2.MomY is absent, but others that belong to it are there",
        ),
    ],
)
def test_a_plate_that_lacks_channels_is_left_out_and_the_other_kept(
    trial, tmp_path, write, name, pair, reason
):
    whole = read_recording(write(trial, tmp_path / "whole.txt"))
    read = read_recording(changed(write(trial, tmp_path / name), pair))
    (plate,) = read.plates
    np.testing.assert_array_equal(plate.wrench, whole.plates[0].wrench)
    (note,) = [note for note in read.notes if note.code == "plate_left_out"]
    assert note.values["plate"].startswith("plate 2")
    assert note.values["reason"] == reason


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([("</viewer_data>", "")], "broken or truncated"),
        ([("<nr_of_samples>100", "<nr_of_samples>250")], "nr_of_samples 250"),
        ([("<sampling_frequency>100<", "<sampling_frequency>50<")], "differ in rate"),
        ([("<channel_data>", "<channel_data>x ")], "no number"),
        ([(".PosX", ".PosQ")], "is absent, but"),
    ],
)
def test_a_broken_mox_file_is_refused_in_one_line(trial, tmp_path, pairs, message):
    path = changed(write_mox(trial, tmp_path / "t.mox"), *pairs)
    with pytest.raises(ValueError, match=rf"^t\.mox: .*{message}"):
        read_recording(path)
