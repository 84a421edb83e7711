"""The figure of a trial shows forces on the feet, events and residuals over time."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.figures.residuals import SHOWN_S, SIDE_COLOURS, residual_figure
from pipeline.trial.residuals import reported, worst_cycles
from tests.pipeline.fake_results import fake_trial


@pytest.fixture(scope="module")
def trial():
    return fake_trial(1, "pitch", cycles=4)


def line(panel, label):
    return next(drawn for drawn in panel.get_lines() if drawn.get_label() == label)


def test_the_forces_on_the_feet_are_above_the_residuals_at_the_same_instants(trial):
    forces = {foot: wrench.copy() for foot, wrench in trial.ground["compensated"].items()}
    forces["left_foot"][:, 0] = 7.0
    figure = residual_figure(replace(trial, ground={**trial.ground, "compensated": forces}))
    upward, forward, *panels, behind = figure.axes
    time = trial.motion.time
    for panel, k in ((upward, 2), (forward, 0)):
        drawn = line(panel, "left foot")
        np.testing.assert_array_equal(drawn.get_ydata(), forces["left_foot"][:, k])
        np.testing.assert_array_equal(drawn.get_xdata(), time)
    for name, dynamics in trial.variants.items():
        for k, panel in enumerate(panels):
            values = reported(dynamics.residual)[:, k]
            np.testing.assert_array_equal(line(panel, name).get_ydata(), values)
    assert {panel.get_xlim() for panel in figure.axes} == {(time[0], time[-1])}
    assert behind.get_position().y1 == pytest.approx(upward.get_position().y1)


def test_events_and_what_counts_are_behind_all_panels(trial):
    later = replace(trial, cycles={"right": trial.cycles["right"][1:3], "left": np.empty((0, 2))})
    *_, behind = residual_figure(later).axes
    shaded, *events = behind.collections
    counts = np.concatenate([path.vertices for path in shaded.get_paths()])[:, 0]
    spans = later.cycles["right"]
    assert (counts.min(), counts.max()) == pytest.approx((spans[0, 0], spans[-1, 1]), abs=0.011)
    strikes = {
        tuple(np.round(drawn.get_color()[0][:3], 2)): [s[0, 0] for s in drawn.get_segments()]
        for drawn in events
        if len(drawn.get_segments())
    }
    assert [*strikes.values()] == [[event.time for event in trial.events]]
    assert len(SIDE_COLOURS) == len(events) / 2


def test_of_a_long_trial_the_seconds_around_the_worst_gait_cycle_are_shown():
    trial = fake_trial(1, "baseline", cycles=40)
    residual = trial.compensated.residual.copy()
    jolt = (trial.motion.time > 30.9) & (trial.motion.time < 31.0)
    residual[jolt, 5] += 100.0
    dynamics = replace(trial.compensated, residual=residual)
    trial = replace(trial, variants={**trial.variants, "compensated": dynamics})
    worst = worst_cycles(trial)[0]
    assert worst.axis == "Mz"
    assert worst.start_s < 30.95 < worst.stop_s
    figure = residual_figure(trial)
    first, last = figure.axes[0].get_xlim()
    assert last - first == pytest.approx(SHOWN_S)
    assert (first + last) / 2 == pytest.approx((worst.start_s + worst.stop_s) / 2)
    assert "12 of 44 s" in figure.get_suptitle()
    times = line(figure.axes[2], "compensated").get_xdata()
    assert (times >= first).all()
    assert (times <= last).all()


def test_what_is_drawn_in_one_figure_is_in_no_other_of_the_same_panels(trial):
    """Both are copies of one empty grid."""
    first, second = residual_figure(trial), residual_figure(trial)
    for panel, other in zip(first.axes, second.axes, strict=True):
        assert len(panel.lines) == len(other.lines)
        assert not {*panel.lines} & {*other.lines}


@pytest.mark.parametrize("span", [None, (0.0, 1.0)])
def test_the_uncertainty_of_the_compensation_is_a_band_with_its_name(trial, span):
    """It holds no model error, and says so."""
    frames = len(trial.motion.time)
    spread = np.tile(np.arange(1.0, 7.0), (frames, 1))
    figure = residual_figure(replace(trial, uncertainty=spread, span=span))
    name = "compensation ± 1σ"
    (legend,) = figure.legends
    assert name in [text.get_text() for text in legend.get_texts()]
    for k, panel in enumerate(figure.axes[2:8]):
        (band,) = [drawn for drawn in panel.collections if drawn.get_label() == name]
        height = np.concatenate([path.vertices for path in band.get_paths()])[:, 1]
        curve = line(panel, "compensated").get_ydata()
        assert height.max() == pytest.approx(np.nanmax(curve) + k + 1)
        assert height.min() == pytest.approx(np.nanmin(curve) - k - 1)
