"""The scripts in `subjects`, one per level, give the study's results."""

import io

import pandas as pd
import pytest

from pipeline.run.store import read_trial
from pipeline.trial.residuals import residual_table
from tests.subjects.conftest import results

pytestmark = pytest.mark.slow


def printed(shell, command):
    running = shell(command)
    text, _ = running.communicate()
    assert running.returncode == 0, text
    return text


def table_in(text):
    """The residual table that a script has printed."""
    lines = text[text.index("subject condition") :]
    table = pd.read_csv(io.StringIO(lines), sep=r"\s+")
    return table.set_index(["compensated", "axis"])["rms"]


def rms_of(trial):
    result = read_trial(trial)
    table = residual_table(result, "any").query("headline")
    return table.set_index(["compensated", "axis"])["rms"].round(1)


def test_one_trial_by_hand_has_the_residuals_of_the_study(shell, clone, expected):
    found = table_in(printed(shell, "python subjects/one_trial.py"))
    trial = clone / "sub01_pitch.parquet"
    trial.write_bytes(expected[trial.name])
    pd.testing.assert_series_equal(found, rms_of(trial))


def test_one_subject_in_one_condition_is_one_result_of_the_study(shell, clone, expected):
    text = printed(shell, "python subjects/one_condition.py sub02 sway")
    assert text.startswith("done sub02 sway\n")
    assert results(clone / "results") == {"sub02_sway.parquet": expected["sub02_sway.parquet"]}
    trial = clone / "results" / "trials" / "sub02_sway.parquet"
    pd.testing.assert_series_equal(table_in(text), rms_of(trial))
    again = printed(shell, "python subjects/one_condition.py sub02 sway subjects")
    assert again.startswith("kept sub02 sway\n")


def test_a_trial_that_fails_ends_its_script_with_the_reason(shell, clone):
    (clone / "subjects" / "sub01_sway.c3d").write_bytes(b"no trial")
    running = shell("python subjects/one_condition.py")
    text, _ = running.communicate()
    assert running.returncode == 1
    assert text.startswith("FAILED sub01 sway: sub01_sway.c3d: ")
    assert text.count("\n") == 1


def test_the_whole_study_ends_with_its_report(shell, clone, expected):
    text = printed(shell, "python subjects/whole_study.py")
    assert text.count("done ") == 6
    assert "| Fy (N) | baseline | 2 |" in text
    assert text.endswith("report: results/report.html\n")
    assert results(clone / "results") == expected
    assert (clone / "results" / "report.html").stat().st_size > 0
