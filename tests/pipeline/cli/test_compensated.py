"""Compensated C3D files are written, listed, or refused in one line."""

import re

import pytest

from pipeline.cli.app import main
from pipeline.io.c3d.read import read_c3d


@pytest.fixture(scope="module")
def calibration(moving_study, tmp_path_factory):
    path = tmp_path_factory.mktemp("calibration") / "lab.json"
    assert main(["calibration", "fit", str(moving_study / "empty.c3d"), "-o", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def trial(moving_study):
    return moving_study / "sub01_pitch.c3d"


def test_a_trial_is_written_under_its_own_name(trial, calibration, tmp_path, capsys):
    out = tmp_path / "compensated"
    command = [
        "export",
        str(trial),
        "--format",
        "c3d",
        "--out",
        str(out),
        "--calibration",
        str(calibration),
    ]
    assert main(command) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert f"{out / trial.name}: only the plates differ" in printed
    assert f"written: {out / trial.name}" in printed
    done = read_c3d(out / trial.name).compensation
    assert done.calibration == "lab.json"
    again = ["export", str(out / trial.name), "--calibration", str(calibration)]
    assert main([*again, "--format", "c3d", "--out", str(tmp_path / "twice")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.match(r"hbm: error: sub01_pitch\.c3d: .*compensated already", line)
    assert not (tmp_path / "twice").exists()


@pytest.mark.slow
def test_a_study_is_written_to_a_folder_and_can_be_written_again(moving_study, tmp_path, capsys):
    out = tmp_path / "compensated"
    assert (
        main(["export", str(moving_study), "--format", "c3d", "--out", str(out), "--frame", "lab"])
        == 0
    )
    assert "6 recordings with" in capsys.readouterr().out
    assert sorted(path.name for path in out.iterdir()) == sorted(
        path.name for path in moving_study.glob("sub0*.c3d")
    )
    content = (out / "sub01_sway.c3d").read_bytes()
    (out / "sub02_sway.c3d").write_bytes(b"mine")
    (out / "sub02_pitch.c3d").unlink()
    assert (
        main(["export", str(moving_study), "--format", "c3d", "--out", str(out), "--frame", "lab"])
        == 1
    )
    printed = " ".join(capsys.readouterr().out.split())
    assert "FAILED sub02_sway.c3d:" in printed
    assert "another file" in printed
    assert "5 recordings with" in printed
    assert (out / "sub01_sway.c3d").read_bytes() == content
    assert (out / "sub02_sway.c3d").read_bytes() == b"mine"
    assert (out / "sub02_pitch.c3d").is_file()
