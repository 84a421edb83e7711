"""``hbm FILE`` says what a file or folder is, and what can be done with it."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from pipeline.cli.app import main
from pipeline.cli.recognise import recognise
from pipeline.io.read import read_with_any_axes
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.pipeline.cli.test_app import plate
from tests.synthetic import synthetic_t_pose


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A person who stands, the same without plates, and plates with hardly a marker."""
    folder = tmp_path_factory.mktemp("files")
    person, half = synthetic_t_pose(), np.full(1000, 74.6 * 9.81 / 2)
    write_c3d(folder / "standing.c3d", person, [plate(1, half), plate(2, half)])
    write_c3d(folder / "no_plates.c3d", person)
    return folder


def test_a_folder_of_recordings_is_no_study_and_begins_with_one(folder):
    found = recognise(folder)
    assert "2 recordings" in found.what
    assert found.commands[0] == f"hbm init {folder}"


def test_what_a_killed_process_left_is_no_recording(folder, tmp_path, capsys):
    """Neither for a look at the folder, nor for a new study, nor where it is named."""
    shutil.copy(folder / "standing.c3d", tmp_path / "walk.c3d")
    part = tmp_path / ".walk.c3d.deadbeef.part"
    shutil.copy(folder / "standing.c3d", part)
    assert re.search(r"\b1 recording\b", recognise(tmp_path).what)
    assert main(["residuals", str(part)]) == 2
    assert "writing was stopped" in capsys.readouterr().err
    assert main(["init", str(tmp_path)]) == 0
    assert "deadbeef" not in capsys.readouterr().out
    assert "deadbeef" not in (tmp_path / "sub01.toml").read_text(encoding="utf-8")


def test_a_study_its_calibration_and_its_settings_are_recognised(moving_study):
    found = recognise(moving_study)
    assert "2 subject files" in found.what
    assert found.commands[0] == f"hbm check {moving_study}"
    assert recognise(moving_study / "study.toml").what == found.what
    assert "subject file" in recognise(moving_study / "sub01.toml").what


def test_a_study_without_subjects_or_not_in_toml_is_checked_and_nothing_else(
    moving_study, tmp_path
):
    live = f"hbm live --study {moving_study} --subject sub01"
    assert recognise(moving_study).commands[-1] == live
    (tmp_path / "study.toml").write_text("[conditions.walk]\n")
    assert recognise(tmp_path).commands == (f"hbm check {tmp_path}",)
    (tmp_path / "sub01.toml").write_text('id = "sub01"\nheight_m = 1,64\n[trials]\n')
    assert recognise(tmp_path).commands == (f"hbm check {tmp_path}",)


@pytest.mark.parametrize(("share", "load_n"), [(0.001, 0.0), (1.0, 700.0)])
def test_a_recording_of_a_person_beside_an_empty_plate_is_fitted_with_that_of_the_empty_one(
    moving_study, tmp_path, share, load_n
):
    """Hardly a motion of the platform, or somebody on a plate."""
    empty = read_with_any_axes(moving_study / "empty.c3d")
    values, mean = empty.analog.values, empty.analog.values.mean(axis=0)
    shaken = replace(empty.analog, values=mean + share * (values - mean))
    first, *others = empty.plates
    loaded = replace(first, wrench_in_plate=first.wrench_in_plate + np.eye(6)[2] * load_n)
    path = tmp_path / "beside.c3d"
    write_c3d(path, empty.markers, [loaded, *others], analog=shaken)
    (command,) = recognise(path).commands
    assert command.startswith("hbm calibration fit ")
    assert f"--beside {path}" in command


def test_a_recording_without_plates_is_a_static_or_needs_forces(folder, capsys):
    path = folder / "no_plates.c3d"
    assert main([str(path)]) == 0
    out = capsys.readouterr().out
    assert "no plates" in out
    assert f"--static {path}" in out


def test_a_trial_with_plates_is_processed_and_has_a_page(folder, tmp_path, capsys):
    path, out = folder / "standing.c3d", tmp_path / "out"
    assert main([str(path), "--mass-kg", "74.6", "--out", str(out)]) == 0
    assert "a C3D recording" in capsys.readouterr().out
    assert {file.name for file in out.glob("standing.*")} == {"standing.html", "standing.parquet"}
    found = recognise(out / "standing.parquet")
    assert found.commands[0].startswith("hbm view")


def test_for_scripts_what_a_file_is_is_one_object(folder, capsys):
    assert main([str(folder / "no_plates.c3d"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert "no plates" in found["what"]
    assert found["commands"]


def test_what_is_no_recording_is_named_by_residuals_with_what_to_do(folder, moving_study, capsys):
    shutil.copy(moving_study / "study.toml", folder / "other.toml")
    assert main(["residuals", str(moving_study)]) == 2
    line = capsys.readouterr().err
    assert "no recording" in line
    assert f"hbm check {moving_study}" in line


def test_what_is_neither_a_command_nor_a_file_gets_the_nearest_one(folder, capsys):
    assert main(["residual"]) == 2
    assert "residuals" in capsys.readouterr().err
    assert main(["walk.c3d"]) == 2
    assert "walk.c3d: no such" in capsys.readouterr().err
    assert main([str(folder / "standig.c3d")]) == 2
    assert re.search(r"standig\.c3d: .*'standing\.c3d'", capsys.readouterr().err)


def test_a_calibration_is_recognised(tmp_path, moving_study, capsys):
    out = tmp_path / "lab.json"
    recording = moving_study / "empty.c3d"
    assert main(["calibration", "fit", str(recording), "-o", str(out), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    found = recognise(out)
    assert re.search("calibration .*treadmill, plate 1, plate 2", found.what)
    assert found.commands[1].startswith("hbm calibration check")
    assert recognise(recording).commands[0].startswith("hbm calibration fit")
