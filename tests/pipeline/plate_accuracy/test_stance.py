"""The loads under which a plate is judged are those of people who walk on a treadmill."""

import numpy as np
import pytest

from hbm.numbers import read_numbers
from pipeline.io.read import read_recording

STANCE = read_numbers("pipeline.plate_accuracy", "thresholds.toml", "stance")


@pytest.fixture(scope="module")
def loads(shared_data):
    """Forces in body weights, and centres of pressure from the middle of the plate [m]."""
    plates = read_recording(shared_data / "treadmill_hbm2" / "treadmill_events.c3d").plates
    weight_n = np.median(sum(plate.wrench[:, 2] for plate in plates))
    forces, places = [], []
    for plate in plates:
        wrench = plate.wrench[plate.wrench[:, 2] > 0.2 * weight_n]
        pressure = np.column_stack([-wrench[:, 4], wrench[:, 3]]) / wrench[:, 2:3]
        forces.append(wrench[:, :3] / weight_n)
        places.append(pressure - plate.center[:2])
    return np.vstack(forces), np.vstack(places)


def test_lateral_forces_of_a_real_walk_are_those_that_are_judged(loads):
    low, high = np.percentile(loads[0][:, 1], [1, 99])
    assert low == pytest.approx(STANCE.lateral[0], abs=0.015)
    assert high == pytest.approx(STANCE.lateral[1], abs=0.015)


def test_feet_of_a_real_walk_are_within_the_places_that_are_judged_along_the_belt(loads):
    low, high = np.percentile(loads[1][:, 0], [1, 99])
    assert STANCE.along[0] < low < -0.1
    assert 0.3 < high < STANCE.along[-1]


def test_feet_of_a_real_walk_are_to_either_side_of_what_is_judged_across_the_belt(loads):
    low, high = np.percentile(np.abs(loads[1][:, 1]), [1, 99])
    assert STANCE.across[-1] < low < 0.16
    assert 0.2 < high < 0.25
