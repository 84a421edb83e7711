"""Whether the plates carry the subject: of loads whose missing parts are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.io.recording import Event
from pipeline.trial.gait.carried import carried_frames, stances

WEIGHT_N = 700.0
STRIDE_S, STANCE_S, STRIDES = 1.1, 0.66, 10
TIME = np.arange(round(100 * STRIDES * STRIDE_S)) / 100
BEGIN = {"left": 0.1, "right": 0.1 + STRIDE_S / 2}


def load_of(side):
    """A foot's share of the load, which it takes and leaves within a double support."""
    double_s = STANCE_S - STRIDE_S / 2
    since = np.mod(TIME - BEGIN[side], STRIDE_S)
    return np.clip(np.minimum(since, STANCE_S - since) / double_s, 0, 1)


NEED = WEIGHT_N * (1 + 0.25 * np.cos(4 * np.pi * (TIME - 0.155) / STRIDE_S))
PLATES = np.stack([NEED * load_of("left"), NEED * load_of("right")])
EVENTS = tuple(
    Event(begin + STRIDE_S * k + later, label, side)
    for side, begin in BEGIN.items()
    for k in range(STRIDES)
    for later, label in ((0.0, "foot_strike"), (STANCE_S, "foot_off"))
)


def carried(plates, need=NEED, *, events=EVENTS, method="zero_phase"):
    feet = {
        f"{side}_foot": np.outer(plates[k], [0, 0, 1, 0, 0, 0])
        for k, side in enumerate(("left", "right"))
    }
    return carried_frames(
        TIME,
        need,
        plates,
        weight_n=WEIGHT_N,
        events=events,
        feet=feet,
        threshold_n=30.0,
        cutoff_hz=6.0,
        method=method,
    )


def scaled(side, step, share):
    """The plates with another share of one step's load."""
    start, stop = stances(EVENTS, side)[step]
    plates = PLATES.copy()
    inside = (start <= TIME) & (stop > TIME)
    plates[("left", "right").index(side), inside] *= share
    return plates, start, stop


def test_walking_on_plates_is_carried_throughout():
    assert carried(PLATES).all()


@given(
    gains=st.tuples(st.floats(0.7, 1.3), st.floats(0.7, 1.3)),
    mass=st.floats(0.9, 1.1),
    noise=st.floats(0, 20),
)
def test_a_wrong_gain_or_mass_is_no_foot_beside_the_plates(gains, mass, noise):
    """Their residual is real, and has to be shown."""
    plates = PLATES * np.reshape(gains, (2, 1))
    plates = plates + np.random.default_rng(0).normal(0, noise, plates.shape)
    assert carried(plates, NEED * mass).all()


@given(side=st.sampled_from(["left", "right"]), step=st.integers(1, 8), share=st.floats(0.0, 0.5))
def test_a_step_beside_the_plates_or_half_on_them_does_not_count(side, step, share):
    plates, start, stop = scaled(side, step, share)
    valid = carried(plates)
    missing = NEED - plates.sum(axis=0) > 0.5 * NEED
    assert not valid[missing].any()
    assert not valid[(start + 0.15 < TIME) & (stop - 0.15 > TIME)].any()
    assert valid[(start - 0.5 > TIME) | (stop + 0.5 < TIME)].all()


def test_all_of_a_stance_goes_with_the_foot_that_no_plate_sees():
    """Also its light ends, from strike to foot off, and as far as the low-pass reaches."""
    plates, start, stop = scaled("right", 4, 0.0)
    first, last = TIME[~carried(plates)][[0, -1]]
    assert first == pytest.approx(start - 0.1, abs=0.02)
    assert last == pytest.approx(stop + 0.1, abs=0.02)


def test_the_causal_filter_spreads_what_is_missing_into_later_frames_only():
    plates, start, stop = scaled("right", 4, 0.0)
    first, last = TIME[~carried(plates, method="realtime")][[0, -1]]
    assert first == pytest.approx(start, abs=0.02)
    assert last == pytest.approx(stop + 1 / 6, abs=0.02)


def test_a_plate_that_begins_late_carries_nobody_before():
    late = PLATES.copy()
    late[:, TIME < 5.0] = 0.0
    valid = carried(late)
    assert not valid[TIME < 5.0].any()
    assert valid[TIME > 5.7].all()


@pytest.mark.parametrize("events", [EVENTS, ()])
def test_without_one_of_two_plates_no_whole_stride_counts(events):
    valid = carried(PLATES * [[1], [0]], events=events)
    for start in np.arange(0.1, 9.0, STRIDE_S):
        assert np.mean(valid[(start <= TIME) & (start + STRIDE_S > TIME)]) < 0.5


def test_on_empty_plates_nobody_is_carried():
    assert not carried(0 * PLATES, events=()).any()


def test_in_flight_there_is_nothing_to_carry():
    """Running: each foot loads its plate for less than half of a stride."""
    since = np.stack([np.mod(TIME - begin, STRIDE_S) for begin in BEGIN.values()])
    plates = 2.5 * WEIGHT_N * np.clip(np.sin(np.pi * since / 0.4), 0, None) * (since < 0.4)
    assert (plates.sum(axis=0) == 0).mean() > 0.2
    assert carried(plates, plates.sum(axis=0), events=()).all()


def test_frames_whose_need_is_unknown_are_not_judged():
    need = np.where((TIME > 4) & (TIME < 5), np.nan, NEED)
    assert carried(PLATES, need).all()
