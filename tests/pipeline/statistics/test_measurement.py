"""Errors of measurement in means and differences: what trials share does not average out."""

import itertools

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.statistics.measurement import (
    LEVELS,
    deviation,
    half_interval,
    mean_covariance,
    measurement_covariances,
)

COLUMNS = ("subject", "condition", "compensated", "axis", "error", "level", "change")
CONDITIONS = ("baseline", "sway")
CHANGE = 3.0


def cells(subjects):
    names = [f"s{k}" for k in range(subjects)]
    return list(itertools.product(names, CONDITIONS, (False, True)))


def errors(*rows):
    """Lay out (cell, error, level, change) as a table."""
    return pd.DataFrame([(*cell, "Fx", *rest) for cell, *rest in rows], columns=COLUMNS)


def equal(level, subjects=4, change=CHANGE):
    """An error that changes every value alike, shared within a level."""
    return errors(*((cell, "error", level, change) for cell in cells(subjects)))


def sd(table, subjects, *wanted):
    """The standard deviation of a mean over subjects, or of one minus another."""
    names = [f"s{k}" for k in range(subjects)]
    found = mean_covariance(measurement_covariances(table)["Fx"], names, wanted)
    return deviation(found, (1, -1)[: len(wanted)])


@given(
    level=st.sampled_from(LEVELS),
    subjects=st.integers(1, 12),
)
@settings(deadline=None, max_examples=30)
def test_only_what_the_laboratory_shares_does_not_shrink_in_the_mean_over_subjects(level, subjects):
    found = sd(equal(level, subjects), subjects, ("sway", True))
    shrinks = 1.0 if level == "laboratory" else subjects**-0.5
    assert found == pytest.approx(CHANGE * shrinks)


@pytest.mark.parametrize(
    ("level", "between_conditions", "between_variants"),
    [
        ("laboratory", 0.0, 0.0),
        ("subject", 0.0, 0.0),
        ("trial", 2**0.5, 0.0),
        ("sample", 2**0.5, 2**0.5),
    ],
)
def test_equal_changes_cancel_in_the_difference_of_values_that_share_them(
    level, between_conditions, between_variants
):
    subjects = 4
    each = CHANGE * subjects**-0.5
    conditions = sd(equal(level, subjects), subjects, ("sway", False), ("baseline", False))
    variants = sd(equal(level, subjects), subjects, ("sway", True), ("sway", False))
    assert conditions == pytest.approx(each * between_conditions)
    assert variants == pytest.approx(each * between_variants)


def test_changes_of_opposite_sign_add_up_in_the_difference_and_cancel_in_the_mean():
    changes = {"baseline": -CHANGE, "sway": CHANGE}
    table = errors(*((c, "late", "laboratory", changes[c[1]]) for c in cells(3)))
    assert sd(table, 3, ("sway", False), ("baseline", False)) == pytest.approx(6.0)
    subjects = errors(
        *((c, "late", "laboratory", CHANGE if c[0] == "s0" else -CHANGE) for c in cells(2))
    )
    assert sd(subjects, 2, ("sway", False)) == pytest.approx(0.0)


def test_different_errors_are_independent():
    table = pd.concat([equal("laboratory"), equal("laboratory").assign(error="other")])
    assert sd(table, 4, ("sway", False)) == pytest.approx(2**0.5 * CHANGE)


def test_an_error_that_a_trial_does_not_have_changes_nothing_there():
    sway = [c for c in cells(2) if c[1] == "sway"]
    table = pd.concat([equal("sample", 2, 0.0), errors(*((c, "own", "trial", 1.0) for c in sway))])
    assert sd(table, 2, ("baseline", False)) == 0
    assert sd(table, 2, ("sway", False)) == pytest.approx(2**-0.5)


def test_an_axis_has_its_own_errors():
    table = pd.concat([equal("trial"), equal("trial", change=7.0).assign(axis="Mz")])
    found = measurement_covariances(table)
    assert list(found) == ["Fx", "Mz"]
    assert np.allclose(np.sqrt(np.diag(found["Mz"])), 7.0)


@given(seed=st.integers(0, 10_000))
@settings(deadline=None, max_examples=10)
def test_any_linear_combination_varies_as_drawn_values_do(seed):
    rng = np.random.default_rng(seed)
    table = errors(
        *(
            (cell, f"{level} {k}", level, rng.normal())
            for cell in cells(3)
            for level in LEVELS
            for k in range(2)
        )
    )
    covariance = measurement_covariances(table)["Fx"]
    weights = rng.normal(size=len(covariance))
    known = np.sqrt(weights @ covariance.to_numpy() @ weights)
    drawn = weights @ draw(table, list(covariance.index), rng)
    assert drawn.std() == pytest.approx(known, rel=0.05)


def draw(table, order, rng):
    """Draw each error once for all values that share it, and add what it changes them by."""
    drawn: dict[object, np.ndarray] = {}
    values = {cell: np.zeros(10_000) for cell in order}
    for row in table.itertuples():
        own = {
            "laboratory": (),
            "subject": (row.subject,),
            "trial": (row.subject, row.condition),
            "sample": (row.subject, row.condition, row.compensated),
        }[row.level]
        size = drawn.setdefault((row.error, own), rng.normal(size=10_000))
        values[row.subject, row.condition, row.compensated] += size * row.change
    return np.array(list(values.values()))


def test_the_interval_holds_95_percent_of_a_normal_distribution():
    drawn = np.random.default_rng(0).normal(0, 2.5, 40_000)
    assert np.mean(np.abs(drawn) < half_interval(2.5)) == pytest.approx(0.95, abs=0.005)
