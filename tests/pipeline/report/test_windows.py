"""Where one condition counts a part of its gait cycles, every table says so."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.figures.residuals import mean_part
from pipeline.report.figures import gait_cycle_figure, rms_over_cycles
from pipeline.report.write import write_report
from pipeline.run.load import Curves, collect
from pipeline.run.store import write_trial
from pipeline.statistics.design import EXPERIMENT_3
from pipeline.trial.result import CyclePart
from tests.pipeline.fake_results import CYCLE_S, fake_trial, without_figures


def with_part(result):
    """The trial of which 20 to 50 % of every gait cycle count."""
    spans = {
        side: tuple((a + 0.2 * CYCLE_S, a + 0.5 * CYCLE_S) for a in own[:, 0])
        for side, own in result.cycles.items()
    }
    return replace(result, part=CyclePart("motion", spans))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("windows")
    for number in (1, 2):
        for condition in ("baseline", "sway", "pitch"):
            result = fake_trial(number, condition, cycles=2)
            result = with_part(result) if condition == "sway" else result
            path = out / "trials" / f"sub{number:02}_{condition}.parquet"
            write_trial(replace(result, condition=condition, key="key"), path)
    with without_figures():
        write_report(out)
    return out


def test_both_windows_are_in_the_table_and_one_of_each_trial_is_the_headline(folder):
    table = pd.read_csv(folder / "residuals.csv")
    windows = table.groupby("condition")["window"].unique().map(set).to_dict()
    assert windows == {"baseline": {"cycle"}, "pitch": {"cycle"}, "sway": {"motion", "cycle"}}
    keys = ["subject", "condition", "compensated", "axis"]
    headline = table[table["headline"]]
    assert len(headline) == 2 * 3 * 2 * 6
    assert not headline.duplicated(keys).any()
    assert set(headline[headline["condition"] == "sway"]["window"]) == {"motion"}


def test_tests_and_table_3_are_of_the_headline_and_say_of_what(folder):
    table, shown = pd.read_csv(folder / "residuals.csv"), pd.read_csv(folder / "table_3.csv")
    own = table.query("condition == 'sway' and axis == 'Fy' and not compensated")
    (mean,) = shown.query("condition == 'sway' and axis == 'Fy'")["mean_no_ic"]
    assert mean == pytest.approx(own[own["headline"]]["rms"].mean(), rel=1e-4)
    assert mean > 1.2 * own[~own["headline"]]["rms"].mean()
    assert "20 to 50 %" in (folder / "report.html").read_text("utf-8")


def test_the_part_that_counts_is_grey_in_every_panel(folder):
    found = collect(folder)
    curves = rms_over_cycles(Curves(folder / "cycles.parquet"), "cycle")
    grey = mean_part(t for t in found.trials.values() if t.condition == "sway")
    assert grey == pytest.approx((20, 50))
    assert mean_part(t for t in found.trials.values() if t.condition == "pitch") is None
    study = gait_cycle_figure(curves, "sway", EXPERIMENT_3, grey=grey)
    for panel in study.axes:
        (band,) = panel.patches
        box = band.get_extents().transformed(panel.transData.inverted())
        np.testing.assert_allclose([box.x0, box.x1], grey, atol=1e-6)
    assert not gait_cycle_figure(curves, "pitch", EXPERIMENT_3).axes[0].patches
