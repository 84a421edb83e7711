"""The figure of one trial's residuals: mean and standard deviation over its gait cycles."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.figures.residuals import axis_label, residual_figure
from pipeline.trial.residuals import AXES, cycle_residuals
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


def test_cycles_of_the_left_foot_are_drawn_where_there_are_none_of_the_right(trial):
    left = replace(trial, cycles={"left": trial.cycles["right"], "right": np.zeros((0, 2))})
    assert "4 left gait cycles" in residual_figure(left).get_suptitle()


def test_a_trial_without_compensation_has_one_line_and_no_legend(trial):
    ground = {"measured": trial.ground["measured"]}
    figure = residual_figure(replace(trial, compensated=None, ground=ground))
    assert figure.axes[0].get_legend() is None
    assert len(figure.axes[0].collections) == 1


def test_every_panel_names_axis_direction_and_unit(trial):
    panels = residual_figure(trial).axes
    labels = [panel.get_title(loc="left") for panel in panels]
    assert labels == [axis_label(k) for k in range(6)]
    assert labels[AXES.index("My")] == "My (about right)"
    assert [panel.get_ylabel() for panel in panels] == ["N"] * 3 + ["N·m"] * 3
