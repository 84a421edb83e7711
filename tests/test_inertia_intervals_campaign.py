"""A short campaign of intervals, a longer one, and that the long one can fail."""

import numpy as np
import pytest

from pipeline.virtual_lab.protocol.calibration_trial import BYSTANDERS
from tests.campaign.inertia_intervals import (
    CALIBRATIONS,
    CUTOFFS_HZ,
    chosen,
    covered,
    laboratory,
)

WITH_PEOPLE = CALIBRATIONS[1]


@pytest.fixture(scope="module")
def one_laboratory():
    """On a soft machine, which people shake."""
    return list(laboratory(1, 200.0, flexibility=4.0))


def left(cells):
    return np.sqrt(np.mean([cell.left for cell in cells], axis=0))


def stated(cells):
    return np.sqrt(np.mean([cell.stated for cell in cells], axis=0))


@pytest.mark.slow
def test_intervals_of_one_laboratory_hold_as_often_as_chance_allows(one_laboratory):
    """A zero is drawn once in a trial: of one laboratory 95 % of all is not far from 95 %."""
    own = chosen(one_laboratory, calibration=WITH_PEOPLE)
    assert 0.90 < covered(own).mean() < 0.99
    ratio = stated(own) / left(own)
    assert ratio.min() > 0.7
    assert ratio.max() < 1.6


@pytest.mark.slow
def test_intervals_are_tighter_where_people_shake_the_platform_less(one_laboratory):
    own = chosen(one_laboratory, sensors=2, calibration=WITH_PEOPLE, cutoff_hz=20.0)
    running, pitch = (stated(chosen(own, trial=trial)) for trial in ("running", "pitch"))
    assert (running > 1.5 * pitch)[:3].all()


@pytest.mark.slow
def test_intervals_of_several_laboratories_hold():
    """Single components may leave 90 to 99 % by chance: 12 zeros scatter one by about 5 %."""
    seeds = range(1, 13)
    own = [cell for seed in seeds for cell in laboratory(seed, 200.0, calibrations=[WITH_PEOPLE])]
    assert 0.93 < covered(own).mean() < 0.97
    for trial in BYSTANDERS:
        for cutoff_hz in CUTOFFS_HZ:
            assert 0.90 < covered(chosen(own, trial=trial, cutoff_hz=cutoff_hz)).mean() < 0.99
