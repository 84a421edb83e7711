"""A calibration made on the command line: what is refused before the fit, and noted in trials."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cli.app import main
from tests.pipeline import lab


def test_a_calibration_that_is_loaded_is_noted_at_every_use(moving_study, tmp_path, capsys):
    empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0))
    sack = np.array([0, 0, 300.0, 0, 0, 0])
    loaded = [replace(p, wrench_in_plate=p.wrench_in_plate + sack) for p in empty.plates]
    occupied = lab.save(replace(empty, plates=tuple(loaded)), tmp_path / "loaded.c3d")
    fitted = tmp_path / "lab.json"
    assert main(["calibration", "fit", str(occupied), "-o", str(fitted)]) == 0
    capsys.readouterr()
    trial = str(moving_study / "sub01_pitch.c3d")
    markers = ", ".join(lab.PLATFORM_MARKERS_M)
    options = ["--calibration", str(fitted), "--platform-markers", markers]
    assert main(["residuals", trial, *options, "--out", str(tmp_path / "out")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "warning: in the calibration plates carried on average plate 1" in printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "lab.json", "--cutoff-hz", "9999"], "--cutoff-hz"),
        (["-o", "lab.json", "--cutoff-hz", "0"], "--cutoff-hz"),
        (["-o", "lab.json", "--cutoff-hz", "nan"], "--cutoff-hz"),
        (["-o", "."], "is a folder"),
        ([], "--out"),
    ],
)
def test_impossible_options_give_one_line_and_write_nothing(
    moving_study, tmp_path, capsys, monkeypatch, options, message
):
    monkeypatch.chdir(tmp_path)
    assert main(["calibration", "fit", str(moving_study / "empty.c3d"), *options]) == 2
    line = capsys.readouterr().err
    assert line.startswith("hbm: error: ")
    assert line.count("\n") == 1
    assert message in line
    assert "pydantic" not in line
    assert not list(tmp_path.iterdir())
