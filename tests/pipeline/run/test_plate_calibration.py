"""A study's calibration of its plates is checked before, applied, and named in results."""

import json
import re
import shutil

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.config.toml_file import StudyFaults
from pipeline.io.c3d.read import read_c3d
from pipeline.run.check import check_study
from pipeline.run.run import plan
from tests.pipeline import lab
from tests.pipeline.lab import edit
from tests.pipeline.wrong_plates import write_correction, wrongly_measured

AXES = "left,back,up"
"""Of the files of the study; nothing in the empty treadmill's shows them."""
NAMED = '[plates]\ncalibration = "plates.json"\n[treadmill]'


@pytest.fixture
def study(moving_study, tmp_path):
    """A copy with one subject's pitch trial, whose plates a file corrects without changing them."""
    folder = shutil.copytree(moving_study, tmp_path / "study")
    for path in folder.glob("sub02*"):
        path.unlink()
    write_correction(folder / "plates.json", read_c3d(folder / "sub01_pitch.c3d"), change=False)
    edit(folder / "study.toml", "[treadmill]", NAMED)
    edit(folder / "study.toml", "name =", f'axes = "{AXES}"\nname =')
    return folder


def faults_of(folder):
    with pytest.raises(StudyFaults) as caught:
        read_study(folder)
    return caught.value.faults


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: f.unlink(), "no file 'plates.json'"),
        (lambda f: edit(f, "1.0", "NaN"), "damaged: plate 1: matrix "),
    ],
)
def test_a_wrong_file_is_one_line_before_anything_is_read(study, spoil, message):
    spoil(study / "plates.json")
    (fault,) = faults_of(study)
    assert fault.startswith("study.toml: plates.calibration: ")
    assert message in fault
    assert main(["check", str(study)]) == 2


def test_a_stated_delay_that_differs_from_the_calibrations_is_one_line(study):
    recording = read_c3d(study / "sub01_pitch.c3d")
    write_correction(study / "plates.json", recording, delays=(0.004, 0.002))
    edit(study / "study.toml", "[plates]", "[settings]\nplate_delay_s = 0.004\n[plates]")
    (fault,) = faults_of(study)
    assert re.search("4 ms.*plates.json .*2.0 ms .*plate 2", fault)


def test_a_fitted_calibration_of_uncorrected_plates_is_a_fault_that_says_what_to_do(
    study, plain_pages
):
    fitted = ["calibration", "fit", str(study / "empty.c3d"), "-o", str(study / "lab.json")]
    fitted += ["--axes", AXES]
    assert main(fitted) == 0
    edit(study / "study.toml", "empty.c3d", "lab.json")
    for name, found in zip(lab.CHANNELS, ("Acc1", "A2"), strict=True):
        edit(study / "study.toml", f"{name} =", f"{found} =")
    (fault,) = check_study(read_study(study)).faults
    assert re.search("uncorrected plates.*plates.json", str(fault))
    assert main([*fitted, "--plate-calibration", str(study / "plates.json")]) == 0
    assert not check_study(read_study(study)).faults


def test_an_empty_treadmill_whose_forward_is_unknown_is_a_fault(study):
    """Its own calibration needs no axes of the lab, the correction of its plates does."""
    edit(study / "study.toml", f'axes = "{AXES}"', "")
    faults = list(map(str, check_study(read_study(study)).faults))
    assert len(faults) == 1
    assert "give --axes" in faults[0]


def test_another_plate_calibration_outdates_every_result(study, tmp_path):
    before = [job.key for job in plan(read_study(study), tmp_path / "results")]
    document = json.loads((study / "plates.json").read_text(encoding="utf-8"))
    document["provenance"] = {"study": "the same plates on another day"}
    (study / "plates.json").write_text(json.dumps(document), encoding="utf-8")
    after = [job.key for job in plan(read_study(study), tmp_path / "results")]
    assert all(old != new for old, new in zip(before, after, strict=True))


def residuals(trial, out, *options):
    command = ["residuals", str(trial), "--mass-kg", "75", "--out", str(out)]
    code = main([*command, *map(str, options)])
    return code, out / f"{trial.stem}_residuals.csv"


def test_one_trial_of_wrong_plates_is_corrected_on_the_command_line(
    study, tmp_path, plain_pages, capsys
):
    """Platform and all; the calibration of the treadmill is fitted to plates corrected alike."""
    right = study / "sub01_pitch.c3d"
    recording, empty = read_c3d(right), read_c3d(study / "empty.c3d", AXES)
    plates = write_correction(tmp_path / "plates.json", recording)
    wrong = lab.save(wrongly_measured(recording), tmp_path / "sub01_pitch.c3d")
    wrong_empty = lab.save(wrongly_measured(empty), tmp_path / "empty.c3d")
    axes = ("--axes", AXES)
    tables = []
    for trial, of_empty, options in (
        (right, study / "empty.c3d", ()),
        (wrong, wrong_empty, ("--plate-calibration", str(plates))),
    ):
        out = tmp_path / f"out{len(options)}"
        fitted = ["calibration", "fit", str(of_empty), "-o", str(out / "lab.json"), *options]
        assert main([*fitted, *axes]) == 0
        markers = ("--platform-markers", ",".join(lab.PLATFORM_MARKERS_M))
        code, table = residuals(trial, out, "--calibration", out / "lab.json", *markers, *options)
        assert code == 0
        tables.append(pd.read_csv(table)["rms"])
    np.testing.assert_allclose(tables[1], tables[0], rtol=1e-3)
    assert re.search(r"plates\s+1,\s+2\s+.*plates\.json", capsys.readouterr().out, re.DOTALL)
