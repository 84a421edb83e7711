"""The study in `subjects` is the virtual laboratory's, and nothing but its text is kept."""

import shutil
import subprocess

import pytest

from pipeline.virtual_lab.protocol.walking_protocol import Setting
from pipeline.virtual_lab.protocol.walking_study import folder_setting, study_files, study_texts
from tests.subjects.conftest import ROOT, SUBJECTS

TEXTS = study_texts(Setting())


@pytest.mark.parametrize("name", TEXTS)
def test_the_text_is_what_the_simulation_of_experiment_3_writes(name):
    """After a change of the protocol: delete the file and run `hbm simulate subjects`."""
    assert (SUBJECTS / name).read_text(encoding="utf-8") == TEXTS[name]


def test_nine_subjects_in_three_conditions_are_simulated_into_it():
    setting = folder_setting(SUBJECTS)
    assert setting == Setting()
    recordings = [name for name in study_files(setting) if name.endswith(".c3d")]
    assert len(recordings) == 1 + 5 + 9 * 3


def test_recordings_and_results_stay_out_of_git():
    if not shutil.which("git") or not (ROOT / ".git").exists():
        pytest.skip("not a git repository")
    made = [name for name in study_files(Setting()) if name not in TEXTS]
    made += ["results/report.html", ".sub01_sway.c3d.deadbeef.part"]
    asked = subprocess.run(
        ["git", "check-ignore", "--no-index", *(f"subjects/{name}" for name in made)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert len(asked.stdout.splitlines()) == len(made)
    kept = [f"subjects/{name}" for name in TEXTS]
    asked = subprocess.run(["git", "check-ignore", "--no-index", *kept], cwd=ROOT, check=False)
    assert asked.returncode == 1
