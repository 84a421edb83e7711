"""A treadmill calibrated and its calibration used, by files alone."""

import numpy as np
import pandas as pd
import pytest

from pipeline.cli import main
from tests.pipeline import lab

MARKERS = ", ".join(lab.PLATFORM_MARKERS_M)


@pytest.fixture(scope="module")
def folder(walker, tmp_path_factory):
    """The empty treadmill shaken, and somebody who walks on it while it pitches, as C3D."""
    folder = tmp_path_factory.mktemp("laboratory")
    lab.save(lab.on_platform(lab.without_people(20.0), lab.shaken(20.0)), folder / "empty.c3d")
    lab.save(lab.on_platform(walker, lab.pitching(12.0)), folder / "pitch.c3d")
    return folder


def hbm(capsys, *arguments):
    """Exit code, what was printed, and what was said on stderr."""
    code = main([str(argument) for argument in arguments])
    return code, *capsys.readouterr()


def fit(capsys, recording, out):
    code, printed, _ = hbm(capsys, "calibration", "fit", recording, "-o", out)
    assert code == 0
    return printed


def residuals(capsys, folder, calibration, out):
    options = ["--calibration", calibration, "--platform-markers", MARKERS, "--out", out]
    code, printed, _ = hbm(capsys, "residuals", folder / "pitch.c3d", *options)
    assert code == 0
    table = pd.read_csv(out / "pitch_residuals.csv")
    return printed, table.set_index(["compensated", "axis"])["rms"]


def test_a_calibration_file_takes_the_treadmill_out_of_a_trial(folder, tmp_path, capsys):
    printed = fit(capsys, folder / "empty.c3d", tmp_path / "lab.json")
    assert "plate 2" in printed
    assert "- plate" not in printed  # nothing to warn of
    printed, rms = residuals(capsys, folder, tmp_path / "lab.json", tmp_path / "out")
    assert "warning" not in printed
    assert rms[True, "Fx"] < 0.05 * rms[False, "Fx"]
    assert rms[True, "My"] < 0.05 * rms[False, "My"]


def test_a_calibration_with_somebody_on_the_treadmill_is_told_at_every_use(
    folder, walker, tmp_path, capsys
):
    occupied = lab.save(lab.on_platform(walker, lab.shaken(12.0)), tmp_path / "occupied.c3d")
    assert "someone stood on the treadmill" in fit(capsys, occupied, tmp_path / "lab.json")
    printed, rms = residuals(capsys, folder, tmp_path / "lab.json", tmp_path / "out")
    assert "warning: the calibration of plate 1: the plate carried" in printed
    assert np.isfinite(rms).all()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-o", "lab.json", "--cutoff-hz", "9999"], "--cutoff-hz"),
        (["-o", "lab.json", "--cutoff-hz", "0"], "--cutoff-hz"),
        (["-o", "lab.json", "--cutoff-hz", "nan"], "--cutoff-hz"),
        (["-o", "."], "is a folder"),
        ([], "--out"),
    ],
)
def test_what_cannot_be_is_one_line_before_the_work(
    folder, tmp_path, capsys, monkeypatch, options, said
):
    monkeypatch.chdir(tmp_path)
    code, _, line = hbm(capsys, "calibration", "fit", folder / "empty.c3d", *options)
    assert code == 2
    assert line.startswith("hbm: error: ")
    assert line.count("\n") == 1
    assert said in line
    assert "pydantic" not in line
    assert not list(tmp_path.iterdir())
