"""Walks that turn have the axes of the laboratory's static recording."""

import pytest

from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.io.read import read_recording
from pipeline.io.read_options import ReadOptions
from pipeline.trial.process import process_trial


@pytest.fixture
def folder(shared_data):
    return shared_data / "overground_walks"


def test_a_turn_takes_the_axes_of_its_static_recording(folder):
    path, pose = folder / "HC030A22.c3d", folder / "HC030A01.c3d"
    with pytest.raises(ValueError, match="axes cannot be inferred"):
        read_recording(path, ReadOptions())
    recording = read_recording(path, ReadOptions(), static=pose)
    (note,) = [note for note in recording.notes if note.code == "axes"]
    assert note.values["axes"] == ("left", "back", "up")
    assert pose.name in note.values["evidence"]


def test_a_walk_that_shows_its_axes_does_not_take_those_of_the_static_recording(folder):
    walk = read_recording(folder / "HC030A05.c3d", ReadOptions(), static=folder / "HC030A01.c3d")
    (note,) = [note for note in walk.notes if note.code == "axes"]
    assert "static" not in note.values["evidence"]


def test_a_study_of_turns_is_checked_and_processed(folder, tmp_path):
    (tmp_path / "study.toml").write_text("[conditions.turn]\n", encoding="utf-8")
    (tmp_path / "child.toml").write_text(
        f'id = "child"\nstatic = "{(folder / "HC031A01.c3d").as_posix()}"\n'
        f'[trials.turn]\nfile = "{(folder / "HC031A23.c3d").as_posix()}"\n',
        encoding="utf-8",
    )
    assert main(["check", str(tmp_path)]) == 0
    result = process_trial(read_study(tmp_path), "child", "turn")
    assert result.counts.sum() > 50
