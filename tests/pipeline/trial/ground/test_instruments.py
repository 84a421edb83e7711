"""Ends of a signal that does not cover the plates are held, and speeds of belts are found."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Treadmill
from pipeline.io.recording import Analog
from pipeline.trial.ground.accelerometers import fastest_belt, hold_ends
from tests.pipeline import lab

TIME = np.arange(2000) / 1000


def signal(first, last):
    values = np.column_stack([TIME, TIME**2])
    values[:first], values[last:] = np.nan, np.nan
    return values


def test_both_ends_keep_their_nearest_known_value():
    held = hold_ends(TIME, signal(20, 1900), "it")
    np.testing.assert_array_equal(held[20:1900], signal(20, 1900)[20:1900])
    np.testing.assert_array_equal(held[:20], np.tile(held[20], (20, 1)))
    np.testing.assert_array_equal(held[1900:], np.tile(held[1899], (100, 1)))


FRAMES = 5
SPEED = np.linspace(0.0, 2.0, FRAMES)


def with_channels(**channels):
    """A recording with these channels: name -> unit and values; a point is written as two _."""
    recording = lab.without_people(1.0)
    names = tuple(name.replace("__", ".") for name in channels)
    units = tuple(unit for unit, _ in channels.values())
    values = np.column_stack([values for _, values in channels.values()])
    analog = Analog(TIME[:FRAMES], names, units, values)
    return replace(recording, analog=analog)


def fastest(**channels):
    found = fastest_belt(with_channels(**channels), Treadmill())
    return None if found is None else found[1]


@pytest.mark.parametrize(("unit", "mps"), [("MM/S", 1e-3), ("km/h", 1 / 3.6)])
def test_the_speed_of_a_belt_is_found_by_name_and_unit(unit, mps):
    np.testing.assert_allclose(fastest(Belt__Left=(unit, -SPEED)), SPEED * mps)


@pytest.mark.parametrize("unit", ["Nm/s", ""])
def test_a_channel_in_another_unit_is_no_speed_of_a_belt(unit):
    assert fastest(Belt=(unit, SPEED)) is None
    np.testing.assert_array_equal(
        fastest(Belt=("m/s", SPEED), Belt__Load=(unit, 100 + SPEED)), SPEED
    )


def test_where_one_belt_is_unknown_the_other_counts():
    left, right = SPEED.copy(), np.full(FRAMES, 0.5)
    left[1], right[3], left[0] = np.nan, np.nan, np.nan
    right[0] = np.nan
    np.testing.assert_array_equal(
        fastest(BeltLeft=("m/s", left), BeltRight=("m/s", right)), [np.nan, 0.5, 1.0, 1.5, 2.0]
    )
