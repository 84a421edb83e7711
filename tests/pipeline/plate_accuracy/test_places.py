"""Where a weight stood still on a plate: what is a place, and what is taken for the empty plate."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.io.recording import Plate
from pipeline.plate_accuracy import trials

RATE_HZ, WEIGHT_N = 100.0, 200.0
SPOTS = np.array([[-0.3, -0.1], [0.3, -0.1], [0.3, 0.1], [-0.3, 0.1]])
STUDY = SimpleNamespace(
    file=SimpleNamespace(static=[SimpleNamespace(file="static.c3d", belt="left")], marker="WEIGHT")
)


@pytest.fixture
def places(monkeypatch):
    """Find places from steps: duration [s], load as a fraction of the weight, from and to [m]."""

    def find(steps, *, marker_noise_m=0.0, noise=0.0, zero=0.0):
        rng, load, spot = np.random.default_rng(1), [], []
        for duration_s, fraction, start, stop in steps:
            part = np.linspace(0, 1, round(duration_s * RATE_HZ))[:, None]
            load.append(np.full(len(part), fraction * WEIGHT_N))
            spot.append((1 - part) * start + part * np.asarray(stop))
        load, spot = np.concatenate(load), np.concatenate(spot)
        time = np.arange(len(load)) / RATE_HZ
        wrench = np.zeros((len(load), 6))
        wrench[:, 2], wrench[:, 3], wrench[:, 4] = load, load * spot[:, 1], -load * spot[:, 0]
        wrench += rng.normal(size=wrench.shape) * noise
        wrench[:, 2:5] += zero * WEIGHT_N * np.array([1.0, 0.1, 0.1])
        marker = np.column_stack([spot, np.full(len(spot), 0.3)])
        marker += rng.normal(size=marker.shape) * marker_noise_m
        plate = Plate.at_origin(1, time, wrench)
        monkeypatch.setattr(trials, "read_with_marker", lambda *_: (plate, time, marker))
        return trials.static_places(STUDY, "left")

    return find


def carried(rest_s=1.5, moved_s=1.0, spots=SPOTS):
    """A weight that is put down on each spot, and carried to the next one."""
    for here, there in zip(spots, [*spots[1:], spots[-1] + 0.4], strict=True):
        yield rest_s, 1.0, here, here
        yield moved_s, 0.0, here, there


def test_places_are_found_beside_noise_of_a_fifth_of_a_millimetre(places):
    _, camera = places(carried(), marker_noise_m=2e-4)
    np.testing.assert_allclose(camera, SPOTS, atol=1e-3)


def test_a_weight_that_is_dragged_slowly_rests_nowhere(places):
    end = SPOTS[-1]
    dragged = [(4.0, 1.0, end, end + np.array([0.06, 0.0])), (1.0, 0.0, end, SPOTS[0])]
    _, camera = places([*carried(), *dragged])
    np.testing.assert_allclose(camera, SPOTS, atol=5e-3)


def test_less_than_half_a_second_is_enough_for_a_place_and_a_fifth_is_not(places):
    touch = [(1.0, 0.0, SPOTS[-1], SPOTS[0] / 2), (0.24, 1.0, SPOTS[0] / 2, SPOTS[0] / 2)]
    _, camera = places([*carried(rest_s=0.5), *touch, (1.0, 0.0, SPOTS[0] / 2, SPOTS[0])])
    np.testing.assert_allclose(camera, SPOTS, atol=0.01)


def test_a_weight_that_a_hand_holds_for_the_most_part_stands_nowhere(places):
    held = SPOTS[0] / 2
    steps = [*carried(), (1.5, 0.4, held, held), (1.0, 0.0, held, SPOTS[0])]
    _, camera = places(steps, noise=1.0)
    np.testing.assert_allclose(camera, SPOTS, atol=0.01)


def test_a_zero_of_a_tenth_of_the_weight_moves_no_place(places):
    plate, camera = places(carried(), zero=0.08)
    np.testing.assert_allclose(plate, camera, atol=2e-3)


def test_a_hand_that_rests_on_the_plate_is_not_the_empty_plate(places):
    hand = np.array([0.5, 0.3])
    steps = [*carried(), (3.0, 0.15, hand, hand), (1.0, 0.0, hand, SPOTS[0])]
    plate, camera = places(steps)
    np.testing.assert_allclose(plate[: len(SPOTS)], camera[: len(SPOTS)], atol=2e-3)


def test_a_zero_is_taken_away_where_the_plate_is_empty_for_a_seventh_of_the_time(places):
    plate, camera = places(carried(rest_s=2.0, moved_s=0.36), zero=0.05)
    np.testing.assert_allclose(plate, camera, atol=5e-3)


def test_half_a_second_of_an_empty_plate_shows_no_drift(places):
    slid = [(3.0, 1.0, spot, spot) for spot in SPOTS]
    plate, camera = places([(0.9, 0.0, SPOTS[0], SPOTS[0]), *slid], noise=2.0)
    np.testing.assert_allclose(plate, camera, atol=0.02)
