"""Errors of measurement that trials share do not average out of means and differences."""

import numpy as np
import pandas as pd
import pytest

from pipeline.statistics.measurement import CELL, deviation, half_interval, mean_covariance
from tests.pipeline.statistics.shared_errors import covariances

SUBJECTS, CHANGE = 4, 3.0
PEOPLE = [f"s{k}" for k in range(SUBJECTS)]


def sd(level, *wanted, change=CHANGE):
    """The standard deviation of a mean over subjects, or of one minus another."""
    cells = pd.MultiIndex.from_product([PEOPLE, ("baseline", "sway"), (False, True)], names=CELL)
    table = cells.to_frame(index=False).assign(axis="Fx")
    known = covariances(table, level, change)["Fx"]
    return deviation(mean_covariance(known, PEOPLE, wanted), (1, -1)[: len(wanted)])


@pytest.mark.parametrize(
    ("level", "mean", "between_conditions", "between_variants"),
    [
        ("laboratory", 1.0, 0.0, 0.0),
        ("subject", SUBJECTS**-0.5, 0.0, 0.0),
        ("trial", SUBJECTS**-0.5, (2 / SUBJECTS) ** 0.5, 0.0),
        ("sample", SUBJECTS**-0.5, (2 / SUBJECTS) ** 0.5, (2 / SUBJECTS) ** 0.5),
    ],
)
def test_equal_changes_shrink_in_means_and_cancel_in_differences_by_what_shares_them(
    level, mean, between_conditions, between_variants
):
    assert sd(level, ("sway", True)) == pytest.approx(CHANGE * mean)
    conditions = sd(level, ("sway", False), ("baseline", False))
    assert conditions == pytest.approx(CHANGE * between_conditions)
    variants = sd(level, ("sway", True), ("sway", False))
    assert variants == pytest.approx(CHANGE * between_variants)


def test_changes_of_opposite_sign_add_up_in_the_difference_and_cancel_in_the_mean():
    of_condition = np.tile([-CHANGE, -CHANGE, CHANGE, CHANGE], SUBJECTS)
    both = ("sway", False), ("baseline", False)
    assert sd("laboratory", *both, change=of_condition) == pytest.approx(2 * CHANGE)
    of_subject = np.repeat([CHANGE, -CHANGE, CHANGE, -CHANGE], 4)
    assert sd("laboratory", ("sway", False), change=of_subject) == pytest.approx(0.0)


def test_the_interval_holds_95_percent_of_a_normal_distribution():
    drawn = np.random.default_rng(0).normal(0, 2.5, 40_000)
    assert np.mean(np.abs(drawn) < half_interval(2.5)) == pytest.approx(0.95, abs=0.005)
