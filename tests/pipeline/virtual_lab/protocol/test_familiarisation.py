"""Familiarisation, an optional condition of the walking study: processed, reported, not tested."""

import re

import pandas as pd
import pytest

from pipeline.config.study import read_study
from pipeline.report.write import write_report
from pipeline.run.load import collect
from pipeline.run.run import run_study
from pipeline.statistics.comparison import statistics
from pipeline.statistics.table_3 import table_3
from pipeline.virtual_lab.protocol.walking_protocol import ANALYSED_CONDITIONS, Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study
from tests.pipeline.fake_results import write_fake_results

EXTRA = "familiarisation"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """One subject who gets used to the treadmill and then walks the baseline, and the results."""
    protocol = Protocol(
        conditions=(EXTRA, "baseline"),
        subjects=1,
        familiarisation_s=7.0,
        baseline_s=5.0,
        calibration="square_sway_60s_3mps",
        beside_s=0.0,
    )
    folder = tmp_path_factory.mktemp("familiarisation")
    simulate_study(folder / "study", Setting(protocol=protocol), jobs=1)
    outcomes = list(run_study(read_study(folder / "study"), folder / "results"))
    assert [outcome.state for outcome in outcomes] == ["done", "done"]
    return folder


def test_familiarisation_is_simulated_and_processed_like_any_other_condition(study):
    condition = read_study(study / "study").file.conditions[EXTRA]
    assert (condition.cycles, condition.skip_s, condition.perturbed) == (50, 10.0, False)
    results = collect(study / "results")
    assert sorted(results.trials) == [("sub01", "baseline"), ("sub01", EXTRA)]
    rows = results.residuals[results.residuals["condition"] == EXTRA]
    assert rows["window"].unique().tolist() == ["cycle"]
    assert set(rows["compensated"]) == {True, False}
    assert 0 < rows["rms"].min() < rows["rms"].max() < 50  # nothing sways but what people shake


def test_the_report_shows_familiarisation_beside_the_baseline(study):
    page = write_report(study / "results", study / "study", lambda _: None).read_text("utf-8")
    assert re.search(rf"<td[^>]*>{EXTRA}</td>", page)
    assert (study / "results" / "figures" / f"gait_cycle_{EXTRA}.svg").is_file()


def test_familiarisation_changes_no_test_and_no_cell_of_table_3(tmp_path):
    """It is outside the 2 x 3 design, and the table of statistics says so."""
    conditions = (EXTRA, *ANALYSED_CONDITIONS)
    folder = write_fake_results(tmp_path, subjects=3, cycles=2, conditions=conditions)
    with_it = collect(folder).residuals
    without = with_it[with_it["condition"] != EXTRA].reset_index(drop=True)
    found, expected = statistics(with_it), statistics(without)
    about = found["note"].str.contains(EXTRA)
    assert about.sum() == 1
    pd.testing.assert_frame_equal(found[~about].reset_index(drop=True), expected)
    pd.testing.assert_frame_equal(table_3(with_it, found), table_3(without, expected))
