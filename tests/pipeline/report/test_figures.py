"""Figures of a study: the lines show the data, and every axis is labelled."""

import numpy as np
import pytest
from scipy import stats

from pipeline.report.figures import (
    gait_cycle_figure,
    marginal_means_figure,
    raw_figure,
)
from pipeline.run.load import collect
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3
from pipeline.trial.residuals import AXES
from tests.pipeline.fake_results import SWAY, write_fake_results


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return collect(write_fake_results(tmp_path_factory.mktemp("three"), subjects=3, cycles=4))


@pytest.fixture(scope="module")
def tests(results):
    return statistics(results.residuals, results.subjects)


def line(panel, label):
    return next(drawn for drawn in panel.get_lines() if drawn.get_label() == label)


def test_a_gait_cycle_is_the_mean_over_subjects_of_their_mean_cycles(results):
    figure = gait_cycle_figure(results.cycles, "pitch", EXPERIMENT_3)
    cells = results.cycles.query("condition == 'pitch' and compensated and axis == 'My'")
    by_subject = [
        own["value"].to_numpy().reshape(-1, 101).mean(0) for _, own in cells.groupby("subject")
    ]
    panel = figure.axes[AXES.index("My")]
    np.testing.assert_allclose(line(panel, "pitch, IC").get_ydata(), np.mean(by_subject, axis=0))
    band = panel.collections[-1].get_paths()[0].vertices
    spread = np.mean(by_subject, axis=0) + np.std(by_subject, axis=0, ddof=1)
    assert band[:, 1].max() == pytest.approx(spread.max())


def test_residuals_of_left_and_right_cycles_do_not_cancel(results):
    assert {"left", "right"} <= set(results.cycles.query("condition == 'sway'")["side"])
    panel = gait_cycle_figure(results.cycles, "sway", EXPERIMENT_3).axes[AXES.index("Fy")]
    assert line(panel, "sway, no IC").get_ydata().max() == pytest.approx(SWAY[1], rel=0.15)


def test_the_band_of_a_single_subject_is_over_its_cycles(results):
    own = results.cycles[results.cycles["subject"] == "sub01"]
    figure = gait_cycle_figure(own, "pitch", EXPERIMENT_3)
    assert "gait cycles of one subject" in figure.get_suptitle()
    values = own.query("condition == 'pitch' and compensated and axis == 'Fx'")["value"]
    curves = values.to_numpy().reshape(-1, 101)
    top = (curves.mean(0) + curves.std(0, ddof=1)).max()
    assert figure.axes[0].collections[-1].get_paths()[0].vertices[:, 1].max() == pytest.approx(top)


def test_marginal_means_have_confidence_intervals(results, tests):
    panel = marginal_means_figure(results.residuals, tests, EXPERIMENT_3).axes[AXES.index("Mz")]
    rms = results.residuals.query("axis == 'Mz' and compensated and condition == 'sway'")["rms"]
    points, _, (bars,) = panel.containers[1]
    assert points.get_ydata()[1] == pytest.approx(rms.mean())
    low, high = np.array(bars.get_segments())[1, :, 1]
    expected = stats.t.interval(0.95, len(rms) - 1, rms.mean(), stats.sem(rms))
    assert (low, high) == pytest.approx(expected)
    assert "interaction p" in panel.get_title(loc="right")


def test_marginal_means_are_over_the_same_subjects_in_all_cells(results, tests):
    incomplete = results.residuals.query("not (subject == 'sub03' and condition == 'sway')")
    figure = marginal_means_figure(incomplete, tests, EXPERIMENT_3)
    assert "2 subjects" in figure.get_suptitle()
    whole = incomplete.query("subject != 'sub03'")
    mean = whole.query("axis == 'Fx' and condition == 'baseline' and compensated")["rms"].mean()
    assert figure.axes[0].containers[1][0].get_ydata()[0] == pytest.approx(mean)


def test_single_cycles_follow_one_another_in_time(results):
    own = results.cycles[results.cycles["subject"] == "sub02"]
    spans = {n[1:]: trial.cycles for n, trial in results.trials.items() if n.subject == "sub02"}
    panel = raw_figure(own, spans, "Fy", EXPERIMENT_3).axes[1]
    assert panel.get_title(loc="left") == "sway"
    peaks = line(panel, "no IC").get_ydata().reshape(-1, 101)
    signs = np.sign(peaks[np.arange(4), np.abs(peaks).argmax(axis=1)])
    assert signs.tolist() == [1, -1, 1, -1]  # right, left, right, left: nothing mirrored
