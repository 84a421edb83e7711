"""Causes in words."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.budgets.words import (
    MASS,
    group_name,
    how_to_tell_apart,
    most_worth_mending,
    size_in_words,
)
from pipeline.explain.budget import Budget, EstimatedCause
from pipeline.explain.cause import OF_PERSON

CAUSE = EstimatedCause("x", "gain", "1", 0.012, 0.001, 0.01, np.ones(6))


def test_groups_are_named_by_their_owner_once_and_the_persons_as_one():
    assert group_name(["zero", "place"]) == "plates' zero, or their place and direction"
    assert group_name(["gain", "inertia"]) == "plates' gain and cross-talk, or body's masses"
    assert group_name(["zero", *OF_PERSON]) == "plates' zero, or body and markers"


def test_all_but_one_of_the_groups_have_to_be_known_to_tell_them_apart():
    assert len(how_to_tell_apart(["zero", "gain", "inertia"])) == 2
    assert len(how_to_tell_apart(["zero", *OF_PERSON])) == 1
    assert how_to_tell_apart(OF_PERSON) == ()


@pytest.mark.parametrize(
    ("unit", "size", "deviation", "words"),
    [
        ("s", 0.0091, 0.0029, "9.1 ± 5.7 ms"),
        ("m", -0.0025, 0.0002, "-2.50 ± 0.39 mm"),
        ("rad", 0.0174533, 0.0174533, "1.0 ± 2.0 °"),
        ("1", 0.5, 0.1, "50 ± 20 %"),
        ("N", -2.3, 1.27, "-2.3 ± 2.5 N"),
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
