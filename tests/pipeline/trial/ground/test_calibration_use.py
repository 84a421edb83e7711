"""A calibration made on the command line: what is refused before the fit, and noted in trials."""

from dataclasses import replace

import numpy as np

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
