"""In studies of many subjects the work for each is that of a study of its own."""

import os
import pickle
from pathlib import Path

import pytest

from pipeline.config.study import read_study
from pipeline.io.qualisys import plate_files
from pipeline.run import check
from pipeline.run.run import plan

SUBJECT = 'id = "{0}"\nsex = "male"\n[trials.level]\nfile = "{0}.c3d"\n'


@pytest.fixture
def study(tmp_path):
    """Give a function that writes a study of some subjects, whose recordings are no C3D files."""

    def of(subjects: int):
        folder = tmp_path / str(subjects)
        folder.mkdir()
        (folder / "study.toml").write_text("[conditions.level]\n", encoding="utf-8")
        for name in (f"s{number:03d}" for number in range(subjects)):
            (folder / f"{name}.toml").write_text(SUBJECT.format(name), encoding="utf-8")
            (folder / f"{name}.c3d").write_text(name, encoding="utf-8")
        return read_study(folder)

    return of


def test_what_a_worker_is_sent_does_not_grow_with_the_study(study):
    few, many = (len(pickle.dumps(plan(study(n), Path("out"))[0])) for n in (2, 30))
    assert many < 1.05 * few


def test_a_folder_is_not_searched_for_forces_of_formats_that_have_none_beside_them(tmp_path):
    for name in ("walk.c3d", "walk_f_1.c3d", "walk.tsv", "walk_f_1.tsv", "walk2_f_1.tsv"):
        (tmp_path / name).touch()
    assert plate_files(tmp_path / "walk.c3d") == []
    assert plate_files(tmp_path / "walk.tsv") == [tmp_path / "walk_f_1.tsv"]


def test_a_folder_of_many_exports_is_searched_once_for_their_forces(study, monkeypatch):
    of_many, searched = study(30), []
    for subject in of_many.subjects:
        (of_many.folder / f"{subject}_f_1.tsv").touch()
    inside = Path.iterdir
    monkeypatch.setattr(Path, "iterdir", lambda path: searched.append(path) or inside(path))
    for subject in of_many.subjects:
        assert plate_files(of_many.folder / f"{subject}.tsv") == [
            of_many.folder / f"{subject}_f_1.tsv"
        ]
    assert searched == [of_many.folder]


def test_a_file_of_forces_that_is_added_is_found(tmp_path):
    (tmp_path / "walk_f_1.tsv").touch()
    before = plate_files(tmp_path / "walk.tsv")
    (tmp_path / "walk_f_2.tsv").touch()
    os.utime(tmp_path, (2e9, 2e9))  # clocks of some file systems are coarse
    assert plate_files(tmp_path / "walk.tsv") == [*before, tmp_path / "walk_f_2.tsv"]


def test_several_processes_find_what_one_finds_in_the_same_order(study):
    of_three = study(3)
    alone, together = (check.check_study(of_three, jobs) for jobs in (1, 2))
    assert len(alone.faults) == 3
    assert (alone.faults, alone.remarks) == (together.faults, together.remarks)
