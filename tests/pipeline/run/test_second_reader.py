"""``hbm check --second-reader``: every recording of a study read twice."""

import shutil
import sys

import pytest

from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.io.c3d.second_reader import SecondReading, installed
from pipeline.run import second_reader
from pipeline.run.second_reader import read_twice, study_recordings

needs_ezc3d = pytest.mark.skipif(not installed(), reason="no ezc3d wheel for this system")


@pytest.fixture
def study(moving_study, tmp_path):
    """A copy of the study with one subject and an excluded trial; tests may change it."""
    folder = shutil.copytree(moving_study, tmp_path / "study")
    for path in folder.glob("sub02*"):
        path.unlink()
    return folder


def test_every_recording_is_read_once_more_and_none_that_is_excluded(study):
    text = (study / "sub01.toml").read_text(encoding="utf-8")
    before, sway, after = text.partition("sub01_sway.c3d")
    assert sway
    (study / "sub01.toml").write_text(
        f'static = "sub01_pitch.c3d"\n{before}sub01_sway.c3d"\nexclude = "fell{after}',
        encoding="utf-8",
    )
    names = [path.name for path in study_recordings(read_study(study))]
    assert sorted(names) == ["empty.c3d", "sub01_baseline.c3d", "sub01_pitch.c3d"]


@needs_ezc3d
def test_a_study_in_which_everything_agrees_says_so(study, capsys):
    assert main(["check", str(study), "--second-reader"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum("ezc3d" in line and "reads the same" in line for line in lines) == 4
    assert "- Second reader: reads the same in 4 of 4 files" in lines
    assert not any("not installed" in line for line in lines)
    assert lines[-1].startswith("1 subject, 3 trials, 0 faults")


def test_without_ezc3d_the_check_says_so(study, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    assert main(["check", str(study), "--second-reader"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum("ezc3d does not read it: it is not installed" in line for line in lines) == 4
    assert "- Second reader: reads the same in 0 of 4 files" in lines


def test_a_disagreement_is_a_fault_with_channel_frame_and_values(study, capsys, monkeypatch):
    line = "channel Force.Fz1, frame 120: 1.5 here, 2.5 by ezc3d 1.7.2, and 1 further"
    monkeypatch.setattr(
        second_reader, "compare_readers", lambda _: SecondReading("ezc3d 1.7.2", "", (line,))
    )
    assert main(["check", str(study), "--second-reader"]) == 2
    out = capsys.readouterr().out
    assert f"FAULT sub01_sway.c3d: {line}\n" in out
    assert "- Second reader: reads the same in 0 of 4 files" in out
    assert "1 subject, 3 trials, 4 faults\n" in out


def test_a_file_that_is_no_c3d_file_is_named_as_not_covered(tmp_path):
    path = tmp_path / "walk.trc"
    path.write_text("PathFileType\t4\t(X/Y/Z)\twalk.trc\n", encoding="utf-8")
    found = read_twice(path)
    assert [str(remark) for remark in found.remarks] == [
        "walk.trc: not a C3D file: there is no second reader for it"
    ]
    assert not found.faults


def test_a_file_that_nobody_reads_is_a_fault_and_one_that_is_absent_too(tmp_path, shared_data):
    broken = read_twice(shared_data / "c3d_samples" / "bad_parameter_section.c3d")
    assert str(broken.faults[0]).startswith(
        "bad_parameter_section.c3d: the parameter section is broken"
    )
    assert len(read_twice(tmp_path / "absent.c3d").faults) == 1


@needs_ezc3d
def test_why_a_file_is_read_once_only_is_a_warning(shared_data):
    (remark,) = read_twice(shared_data / "c3d_samples" / "type1.C3D").remarks
    assert remark.note.level == "warning"
    assert str(remark).endswith(" does not read it: it reads 0 of 6 analog channels")
