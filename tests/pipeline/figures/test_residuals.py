"""The figure of one trial's residuals: mean and standard deviation over its gait cycles."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.figures.residuals import residual_figure
from pipeline.trial.residuals import cycle_residuals
from tests.pipeline.fake_results import fake_trial


@pytest.fixture(scope="module")
def trial():
    return fake_trial(1, "pitch", cycles=4)


def line(panel, label):
    return next(drawn for drawn in panel.get_lines() if drawn.get_label() == label)


def test_lines_are_means_over_the_right_foots_cycles(trial):
    figure = residual_figure(trial)
    for variant in ("measured", "compensated"):
        mean = cycle_residuals(trial, variant)["right"].mean(axis=0)
        for k, panel in enumerate(figure.axes):
            drawn = line(panel, variant)
            np.testing.assert_allclose(drawn.get_ydata(), mean[:, k])
            np.testing.assert_allclose(drawn.get_xdata(), np.arange(101))
    assert "4 right gait cycles" in figure.get_suptitle()


def test_what_is_drawn_in_one_figure_is_in_no_other_of_the_same_panels(trial):
    """Both are copies of one empty grid."""
    first, second = residual_figure(trial), residual_figure(replace(trial, span=(0.0, 0.5)))
    third = residual_figure(trial)
    for panel, other, again in zip(first.axes, second.axes, third.axes, strict=True):
        assert len(panel.lines) == len(again.lines)
        assert panel.get_xlim() == again.get_xlim() == (0.0, 100.0)
        assert other.get_xlim() == (trial.motion.time[0], trial.motion.time[-1])


@pytest.mark.parametrize("span", [None, (0.0, 1.0)])
def test_the_uncertainty_of_the_compensation_is_a_band_with_its_name(trial, span):
    """Over gait cycles and over time; it holds no model error, and says so."""
    frames = len(trial.motion.time)
    spread = np.tile(np.arange(1.0, 7.0), (frames, 1))
    figure = residual_figure(replace(trial, uncertainty=spread, span=span))
    name = "compensation ± 1σ"
    (legend,) = figure.legends
    assert name in [text.get_text() for text in legend.get_texts()]
    for k, panel in enumerate(figure.axes):
        (band,) = [drawn for drawn in panel.collections if drawn.get_label() == name]
        height = np.concatenate([path.vertices for path in band.get_paths()])[:, 1]
        curve = line(panel, "compensated").get_ydata()
        assert height.max() == pytest.approx(np.nanmax(curve) + k + 1)
        assert height.min() == pytest.approx(np.nanmin(curve) - k - 1)
