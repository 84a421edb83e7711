"""Figures of a study: the lines show the data, and every axis is labelled."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text
from scipy import stats

from pipeline.figures.style import COLOURS, condition_style
from pipeline.report.figures import (
    gait_cycle_figure,
    marginal_means_figure,
    rms_over_cycles,
    study_figures,
)
from pipeline.run.load import Curves, collect
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3, unstated_design
from pipeline.trial.residuals import AXES
from tests.pipeline.fake_results import write_fake_results


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = write_fake_results(tmp_path_factory.mktemp("three"), subjects=3, cycles=4)
    return collect(folder, in_curves=lambda trial: True)


@pytest.fixture(scope="module")
def curves(results):
    return rms_over_cycles(Curves(results.folder / "cycles.parquet"), "cycle")


@pytest.fixture(scope="module")
def tests(results):
    return statistics(results.residuals, results.subjects)


def line(panel, label):
    return next(drawn for drawn in panel.get_lines() if drawn.get_label() == label)


@pytest.mark.parametrize("condition", ["sway", "pitch"])
@pytest.mark.parametrize("axis", AXES)
def test_the_quadratic_mean_of_a_subjects_curve_is_its_value_in_the_table(
    results, curves, condition, axis
):
    """Of pitch too, whose artefact changes sign from cycle to cycle and cancels in a mean."""
    cell = f"subject == 'sub01' and condition == '{condition}' and axis == '{axis}'"
    curve = curves.query(cell)
    for compensated, own in curve.groupby("compensated"):
        rms = results.residuals.query(cell).set_index("compensated")["rms"][compensated]
        assert np.sqrt(np.mean(own["value"] ** 2)) == pytest.approx(rms, rel=0.02)


def test_recordings_of_unlike_length_are_equal_where_the_study_says_so(results, tmp_path):
    """A recording of residual 1 with three cycles, and one of residual 7 with one."""
    every = Curves(results.folder / "cycles.parquet").read()
    one = every.query("subject == 'sub01' and condition == 'sway' and percent == 0")
    first = one.assign(recording="01", value=1.0).query("cycle == 1 and side == 'right'")
    cycles = pd.concat([*[first] * 3, first.assign(recording="02", value=7.0)])
    cycles.to_parquet(tmp_path / "cycles.parquet")
    for weigh, mean_square in (("cycle", 13.0), ("recording", 25.0)):
        over_cycles = rms_over_cycles(Curves(tmp_path / "cycles.parquet"), weigh)
        np.testing.assert_allclose(over_cycles["value"] ** 2, mean_square)


def test_a_gait_cycle_is_the_mean_and_sd_over_subjects(curves):
    cells = curves.query("condition == 'pitch' and compensated and axis == 'My'")
    by_subject = cells.pivot(index="subject", columns="percent", values="value").to_numpy()
    panel = gait_cycle_figure(curves, "pitch", EXPERIMENT_3).axes[AXES.index("My")]
    np.testing.assert_allclose(line(panel, "pitch IC").get_ydata(), by_subject.mean(axis=0))
    band = panel.collections[-1].get_paths()[0].vertices
    spread = by_subject.mean(axis=0) + by_subject.std(axis=0, ddof=1)
    assert band[:, 1].max() == pytest.approx(spread.max())


def test_colours_mean_compensation_and_line_styles_conditions(curves):
    """In every figure, so that no two conditions differ by colour alone."""
    panels = [gait_cycle_figure(curves, c, EXPERIMENT_3).axes[0] for c in ("sway", "pitch")]
    styles = {}
    for panel, condition in zip(panels, ("sway", "pitch"), strict=True):
        for name in ("baseline", condition):
            for label, variant in (("no IC", "measured"), ("IC", "compensated")):
                drawn = line(panel, f"{name} {label}")
                assert drawn.get_color() == COLOURS[variant]
                styles.setdefault(name, set()).add(drawn.get_linestyle())
    assert all(len(of_condition) == 1 for of_condition in styles.values())
    assert len(set.union(*styles.values())) == 3
    looks = [condition_style(k) for k in range(25)]
    assert len(set(looks)) == 25
    assert not {colour for colour, _ in looks} & {*COLOURS.values()}


def test_a_study_without_compensation_does_not_speak_of_it(tmp_path):
    conditions = ("barefoot", "boots")
    folder = write_fake_results(
        tmp_path, subjects=2, conditions=conditions, cycles=3, compensated=False
    )
    own = collect(folder, in_curves=lambda trial: True)
    over_cycles = rms_over_cycles(Curves(folder / "cycles.parquet"), "cycle")
    design = unstated_design(conditions, compensated=False)
    tests = statistics(own.residuals, own.subjects, design)
    curves = pd.DataFrame(columns=["curve", "compared", "start_percent", "stop_percent", "p"])
    drawn = study_figures(own, over_cycles, tests, design, curves)
    figures = {name: draw() for name, draw in drawn}
    shown = [text for figure in figures.values() for text in figure.findobj(Text)]
    assert not [text.get_text() for text in shown if "IC" in text.get_text()]
    lines = figures["gait_cycle_boots"].axes[0].get_lines()[:2]
    assert {drawn.get_label() for drawn in lines} == {*conditions}
    assert len({drawn.get_color() for drawn in lines}) == 2


def test_every_interval_ends_on_the_axis_or_at_its_lower_edge(results, tests):
    """Two subjects: intervals go far below zero, and no axis may cut off their upper ends."""
    two = results.residuals.query("subject != 'sub03'")
    for panel in marginal_means_figure(two, tests, EXPERIMENT_3).axes:
        low, high = panel.get_ylim()
        assert high >= low * 9.999  # what hardly differs looks so
        for _, _, (bars,) in panel.containers:
            ends = np.array(bars.get_segments())[:, :, 1]
            assert ends.max() <= high
            assert panel.get_yscale() == "log"


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
