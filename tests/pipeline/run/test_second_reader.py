"""``hbm check --second-reader``: every recording of a study read twice."""

import shutil
import sys

import pytest

from hbm.notes import Note
from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.io.c3d.second_reader.agreement import Agreement
from pipeline.io.c3d.second_reader.disagreement import Disagreement
from pipeline.io.c3d.second_reader.process import installed
from pipeline.run import second_reader
from pipeline.run.second_reader import read_twice, study_recordings, summarise

needs_ezc3d = pytest.mark.skipif(not installed("ezc3d"), reason="no ezc3d wheel for this system")


@pytest.fixture
def study(moving_study, tmp_path):
    """A copy of the study with one subject and an excluded trial; tests may change it."""
    folder = shutil.copytree(moving_study, tmp_path / "study")
    for path in folder.glob("sub02*"):
        path.unlink()
    return folder


def checked(folder):
    found = [read_twice(path) for path in study_recordings(read_study(folder))]
    return [*found, summarise(found)]


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
    assert sum(line.endswith("reads the same [second_reader_agrees]") for line in lines) == 4
    assert "- reads the same in 4 of 4 files [second_reader_total]" in lines
    assert not any("not installed" in line for line in lines)
    assert lines[-1].startswith("1 subject, 3 trials, 0 faults")


def test_without_ezc3d_the_check_says_so_in_one_line(study, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    assert main(["check", str(study), "--second-reader"]) == 0
    lines = capsys.readouterr().out.splitlines()
    note = Note.of("second_reader_not_installed", reader="ezc3d", instead="c3d")
    assert [line for line in lines if "ezc3d " in line] == [f"- {note} [{note.code}]"]
    assert "- reads the same in 4 of 4 files [second_reader_total]" in lines


def test_a_disagreement_is_a_fault_with_channel_frame_and_values(study, capsys, monkeypatch):
    found = Disagreement("channel", "Force.Fz1", "1.5", "2.5", frame=120, sample=3, further=1)
    monkeypatch.setattr(
        second_reader, "compare_readers", lambda _: Agreement("ezc3d 1.7.2", (), (found,))
    )
    assert main(["check", str(study), "--second-reader"]) == 2
    out = capsys.readouterr().out
    assert (
        "FAULT sub01_sway.c3d: channel Force.Fz1, frame 120, sample 3: 1.5 here, "
        "2.5 by ezc3d 1.7.2, and 1 further differs\n" in out
    )
    assert "- reads the same in 0 of 4 files [second_reader_total]" in out
    assert "1 subject, 3 trials, 4 faults\n" in out


def test_a_file_that_is_no_c3d_file_is_named_as_not_covered(tmp_path):
    path = tmp_path / "walk.trc"
    path.write_text("PathFileType\t4\t(X/Y/Z)\twalk.trc\n", encoding="utf-8")
    found = read_twice(path)
    assert [str(remark) for remark in found.remarks] == [
        "walk.trc: not a C3D file: there is no second reader for it"
    ]
    assert found.faults == ()


def test_a_file_that_nobody_reads_is_a_fault_and_one_that_is_absent_too(tmp_path, shared_data):
    broken = read_twice(shared_data / "c3d_samples" / "bad_parameter_section.c3d")
    assert str(broken.faults[0]).startswith(
        "bad_parameter_section.c3d: the parameter section is broken"
    )
    assert len(read_twice(tmp_path / "absent.c3d").faults) == 1


@needs_ezc3d
def test_which_reader_checked_and_why_not_the_first_is_noted(shared_data):
    found = read_twice(shared_data / "c3d_samples" / "type1.C3D")
    assert [remark.note.code for remark in found.remarks] == [
        "second_reader_refuses",
        "second_reader_agrees",
    ]
    refuses, agrees = map(str, found.remarks)
    assert refuses.startswith("type1.C3D: ezc3d ")
    assert refuses.endswith(" does not read it: it reads 0 of 6 analog channels")
    assert agrees.startswith("type1.C3D: c3d ")


def test_a_damaged_copy_differs_in_exactly_one_channel_and_frame(study):
    """One bit of one sample: both readers agree on the copy, and the copy is not the original."""
    from pipeline.io.c3d.header import read_header
    from pipeline.io.c3d.second_reader.rewritten import check_rewritten

    original = study / "sub01_sway.c3d"
    header, parameters = read_header(original)
    content = bytearray(original.read_bytes())
    word = 4 * header.n_points + 4 * len(parameters.texts("ANALOG", "LABELS")) + 2
    at = header.data_start + 700 * header.frame.bytes + 4 * word
    content[at + 2] ^= 1
    damaged = study / "damaged.c3d"
    damaged.write_bytes(content)
    assert not read_twice(damaged).faults
    with pytest.raises(ValueError, match=r"channel Force\.Fz1, frame 701, sample 5: ") as caught:
        check_rewritten(original, damaged, changed_channels=())
    assert "more of them" not in str(caught.value)
    assert "further" not in str(caught.value)
