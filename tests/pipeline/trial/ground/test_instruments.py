"""Ends of a signal that does not cover the plates are held; gaps are refused."""

import numpy as np
import pytest

from pipeline.trial.ground.instruments import hold_ends

TIME = np.arange(2000) / 1000


def signal(first, last):
    values = np.column_stack([TIME, TIME**2])
    values[:first], values[last:] = np.nan, np.nan
    return values


def test_both_ends_keep_their_nearest_known_value():
    held, held_s = hold_ends(TIME, signal(20, 1900), "it")
    np.testing.assert_array_equal(held[20:1900], signal(20, 1900)[20:1900])
    np.testing.assert_array_equal(held[:20], np.tile(held[20], (20, 1)))
    np.testing.assert_array_equal(held[1900:], np.tile(held[1899], (100, 1)))
    assert held_s == pytest.approx(0.1)


def test_a_signal_without_gaps_stays_as_it_is():
    held, held_s = hold_ends(TIME, signal(0, 2000), "it")
    np.testing.assert_array_equal(held, signal(0, 2000))
    assert held_s == 0


def test_a_gap_is_refused_with_its_time():
    values = signal(10, 1990)
    values[700:720, 1] = np.nan
    with pytest.raises(ValueError, match=r"^the pose has a gap at 0\.700 s"):
        hold_ends(TIME, values, "the pose")


def test_a_long_end_is_refused():
    with pytest.raises(ValueError, match=r"the pose is unknown for 0\.60 s at one end"):
        hold_ends(TIME, signal(600, 2000), "the pose")
    with pytest.raises(ValueError, match="the pose is nowhere known"):
        hold_ends(TIME, signal(2000, 2000), "the pose")
