"""A folder of recordings becomes a study that needs no editing to run."""

import shutil

import numpy as np
import pytest

from pipeline.cli.app import main
from pipeline.config.found_recordings import found_subjects
from pipeline.config.study import read_study
from pipeline.io.c3d.write import write_c3d
from pipeline.trial.study_files import read_study_file
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.pipeline.cli.test_app import plate
from tests.synthetic import synthetic_t_pose


@pytest.fixture
def folder(tmp_path):
    """Two subjects; one has a pose, the other two walks alone; and files that are none."""
    half = np.full(1000, 74.6 * 9.81 / 2)
    write_c3d(tmp_path / "S01_standing.c3d", synthetic_t_pose(), [plate(1, half), plate(2, half)])
    simulate_trial(tmp_path / "S01_4.c3d", duration_s=8.0)
    for name in ("S02_5.c3d", "S02_6.c3d"):
        shutil.copy(tmp_path / "S01_4.c3d", tmp_path / name)
    (tmp_path / "notes.txt").write_text("measured on Monday")
    (tmp_path / "broken.c3d").write_bytes(b"no recording")
    return tmp_path


def test_recordings_are_grouped_by_subject_and_the_stillest_is_the_pose(folder):
    (first, second), unused = found_subjects(folder)
    assert first == ("S01", "S01_standing.c3d", {"walking": ["S01_4.c3d"]})
    assert second == ("S02", "", {"walking": ["S02_5.c3d", "S02_6.c3d"]})
    assert list(unused) == ["broken.c3d"]


def test_words_in_names_are_conditions_and_a_pose_is_named_so(folder):
    for name, better in (
        ("S01_4", "S01_shoes_1"),
        ("S02_5", "S02_barefoot_1"),
        ("S02_6", "S02_shoes_1"),
        ("S01_standing", "S01_static"),
    ):
        (folder / f"{name}.c3d").rename(folder / f"{better}.c3d")
    (first, second), _ = found_subjects(folder)
    assert first == ("S01", "S01_static.c3d", {"shoes": ["S01_shoes_1.c3d"]})
    assert second.trials == {"barefoot": ["S02_barefoot_1.c3d"], "shoes": ["S02_shoes_1.c3d"]}


def test_a_pose_without_a_trial_is_not_skipped_silently(folder):
    (folder / "S01_4.c3d").unlink()
    (folder / "S01_standing.c3d").rename(folder / "S01_static.c3d")
    (second,), unused = found_subjects(folder)
    assert second.name == "S02"
    assert unused["S01_static.c3d"] == "there is no trial of S01 on plates"


def test_a_study_of_the_recordings_in_a_folder_runs_as_it_is_written(folder, tmp_path, capsys):
    assert main(["init", str(folder)]) == 0
    assert "S01: pose S01_standing.c3d; walking: S01_4.c3d" in capsys.readouterr().out
    study = read_study(folder)
    assert [str(name) for name in study.trials] == [
        "S01 walking",
        "S02 walking 01",
        "S02 walking 02",
    ]
    results = tmp_path / "results"
    assert main(["run", str(folder), "--subject", "S01", "--out", str(results)]) == 0
    assert (results / "trials" / "S01_walking.parquet").is_file()


def test_options_of_a_trial_are_refused_for_a_folder(folder, capsys):
    assert main([str(folder), "--mass-kg", "74.6"]) == 2
    assert f"--mass-kg has no effect on it; next: hbm init {folder}" in capsys.readouterr().err


def test_an_empty_folder_gets_an_example(tmp_path, capsys):
    assert main(["init", str(tmp_path / "new")]) == 0
    assert "study.toml, sub01.toml" in capsys.readouterr().out


def test_real_children_have_their_pose_found(shared_data):
    found, _ = found_subjects(shared_data / "overground_walks")
    assert [(one.name, one.static) for one in found] == [
        ("HC030", "HC030A01.c3d"),
        ("HC031", "HC031A01.c3d"),
    ]


def test_labels_of_one_recording_are_corrected_in_its_trial(tmp_path):
    """Of exchanged knees the recording, and not the pose, has both directions of the pair."""
    half = np.full(1000, 74.6 * 9.81 / 2)
    write_c3d(tmp_path / "S01_static.c3d", synthetic_t_pose(), [plate(1, half), plate(2, half)])
    simulate_trial(tmp_path / "S01_1.c3d", duration_s=8.0)
    assert main(["init", str(tmp_path)]) == 0
    file = tmp_path / "S01.toml"
    rename = '[trials.walking.rename]\nLLEK = "RLEK"\nRLEK = "LLEK"\n'
    file.write_text(f"{file.read_text(encoding='utf-8')}\n{rename}", encoding="utf-8")
    study = read_study(tmp_path)
    (trial,) = study.trials.values()
    walk, static = (
        read_study_file(study, "S01_1.c3d", trial),
        read_study_file(study, "S01_static.c3d"),
    )
    plain = read_study_file(study, "S01_1.c3d")
    left, right = (plain.markers.names.index(name) for name in ("LLEK", "RLEK"))
    assert walk.markers.names.index("LLEK") == right
    assert walk.markers.names.index("RLEK") == left
    assert not static.stated.rename
