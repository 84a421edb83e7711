"""The scripts in `subjects` and the commands of docs/cluster.md give the study's results.

The commands run as printed, on a stand-in for SLURM with two nodes.
"""

import io
import os
import re
import signal

import pandas as pd
import pytest

from pipeline.run.store import read_trial
from pipeline.trial.residuals import residual_table
from tests.subjects.conftest import ROOT, results

pytestmark = pytest.mark.slow
PAGE = (ROOT / "docs" / "cluster.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```sh\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
(CLUSTER,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


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


@pytest.mark.parametrize("command", BLOCKS, ids=["jobs", "loop", "array"])
def test_every_way_to_run_the_study_leaves_the_same_results(shell, clone, expected, command):
    text = printed(shell, command)
    assert results(clone / "results") == expected, text


def test_dask_workers_from_the_queue_leave_the_same_results(shell, clone, expected):
    pytest.importorskip("dask_jobqueue", reason="the extra 'cluster' is not here")
    (clone / "cluster.py").write_text(CLUSTER, encoding="utf-8")
    cluster = shell("exec python cluster.py")
    try:
        lines = iter(cluster.stdout.readline, "")
        command = next((line for line in lines if line.startswith("hbm run ")), None)
        assert command is not None
        text = printed(shell, command.partition("   (Enter")[0])
        assert re.search("6 trials processed, 0 .*, 0 failed", text)
        cluster.communicate("\n", timeout=60)
        assert cluster.returncode == 0
    finally:
        if cluster.poll() is None:
            os.killpg(cluster.pid, signal.SIGKILL)
    assert results(clone / "results") == expected
