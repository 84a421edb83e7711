"""Causes in words."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.budgets.words import (
    MASS,
    most_worth_mending,
    size_in_words,
)
from pipeline.explain.budget import Budget, EstimatedCause

CAUSE = EstimatedCause("x", "gain", "1", 0.012, 0.001, 0.01, 1.0, np.ones(6))


@pytest.mark.parametrize(
    ("unit", "size", "deviation", "words"),
    [
        ("m", -0.0025, 0.0002, "-2.50 ± 0.39 mm"),
        ("rad", 0.0174533, 0.0174533, "1.0 ± 2.0 °"),
        ("1", 0.5, 0.1, "50 ± 20 %"),
    ],
)
def test_sizes_are_in_units_that_people_read(unit, size, deviation, words):
    assert size_in_words(replace(CAUSE, unit=unit, size=size, deviation=deviation)) == words


def budget(*causes):
    axes = np.ones(6)
    return Budget("walk.c3d", False, 2 * axes, axes, 3 * axes, 9, 9, (), axes, causes, axes, ())


class Processed:
    """What advice takes of a trial."""

    class settings:
        plate_delay_s = None

    class body:
        mass = 70.7


class Uncalibrated:
    """A laboratory that says nothing of its plates."""

    plates = None


class Calibrated:
    """A laboratory whose plates are calibrated, their delay among the rest."""

    plates = "plates.json"


def test_a_mass_is_advised_as_the_scales_would_show_it():
    (found,) = most_worth_mending(
        budget(replace(CAUSE, name=MASS, size=0.01)), Processed, Uncalibrated
    )
    assert found.action == "state mass_kg = 70.0 of the subject, once scales confirm it"


def test_a_delay_that_a_calibration_gives_is_not_stated_a_second_time():
    late = replace(CAUSE, name="plates are late", group="delay", unit="s")
    (found,) = most_worth_mending(budget(late), Processed, Calibrated)
    assert found.action == "measure the plates' delay (plates are late 12.0 ± 2.0 ms)"


@pytest.mark.parametrize(
    "changed",
    [{"deviation": 0.01}, {"left": 2 * np.ones(6)}, {"group": "soft_tissue"}],
    ids=["may be zero", "changes no residual", "nothing to do"],
)
def test_what_is_not_sure_or_changes_nothing_is_not_worth_mending(changed):
    own = budget(replace(CAUSE, **changed))
    assert most_worth_mending(own, Processed, Uncalibrated) == ()
