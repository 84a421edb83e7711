"""The command line alone leads from the empty treadmill to compensated residuals."""

from dataclasses import replace

import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.io.c3d.read import read_c3d
from tests.pipeline import lab


@pytest.fixture(scope="module")
def fitted(moving_study, tmp_path_factory):
    """Calibration fitted to a file of another name than the study's."""
    out = tmp_path_factory.mktemp("fitted") / "lab.json"
    assert main(["calibration", "fit", str(moving_study / "empty.c3d"), "-o", str(out)]) == 0
    return out


def residuals(moving_study, out, *options):
    trial = str(moving_study / "sub01_pitch.c3d")
    code = main(["residuals", trial, "--mass-kg", "75", *map(str, options), "--out", str(out)])
    if code:
        return None
    table = pd.read_csv(out / "sub01_pitch_residuals.csv")
    return table.pivot_table("rms", index="axis", columns="compensated")


def test_a_calibration_fitted_to_a_recording_compensates_its_trials(
    moving_study, fitted, tmp_path, capsys
):
    platform = read_study(moving_study).file.treadmill.platform
    markers = ",".join(platform.markers)
    rms = residuals(moving_study, tmp_path, "--calibration", fitted, "--platform-markers", markers)
    assert rms.loc["Fx", True] < 0.2 * rms.loc["Fx", False]
    assert rms.loc["My", True] < 0.2 * rms.loc["My", False]
    assert "taken as level" not in capsys.readouterr().out


def test_a_platform_without_a_stated_pose_is_taken_as_level(moving_study, fitted, tmp_path, capsys):
    assert residuals(moving_study, tmp_path, "--calibration", fitted) is not None
    assert "taken as level" in " ".join(capsys.readouterr().out.split())


def test_a_recording_given_as_a_calibration_is_refused_with_how_to_fit_one(
    moving_study, tmp_path, capsys
):
    assert residuals(moving_study, tmp_path, "--calibration", moving_study / "empty.c3d") is None
    assert "calibration fit empty.c3d" in capsys.readouterr().err


def test_a_unit_that_the_file_states_wrongly_can_be_stated(moving_study, fitted, tmp_path, capsys):
    empty = read_c3d(moving_study / "empty.c3d", "left,back,up")
    units = tuple("V" if unit == "g" else unit for unit in empty.analog.units)
    in_volts = replace(empty, analog=replace(empty.analog, units=units))
    path, out = lab.save(in_volts, tmp_path / "volts.c3d"), tmp_path / "lab.json"
    command = ["calibration", "fit", str(path), "-o", str(out)]
    assert main(command) == 2
    assert "m/s² (--accelerometer-unit)" in capsys.readouterr().err
    assert main([*command, "--accelerometer-unit", "g"]) == 0
    assert '"accelerometer_unit": "g"' in out.read_text(encoding="utf-8")
