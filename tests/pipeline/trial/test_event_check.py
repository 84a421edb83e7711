"""Gait events of the wrong side, early or late are named, and events that agree are not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pipeline.io.recording import Event
from pipeline.trial.gait.events import Swings, check_events, choose_method

OTHER = {"left": "right", "right": "left"}


def walking(strides=10, stride_s=1.1, noise_s=0.01, seed=0):
    """Events of a walk: feet strike half a stride apart and leave after 0.62 of a stride."""
    rng = np.random.default_rng(seed)
    starts = stride_s * np.arange(strides) + 0.2
    events = [
        Event(float(start + later * stride_s + rng.normal(scale=noise_s)), label, side)
        for start in starts
        for later, label, side in (
            (0.0, "foot_strike", "left"),
            (0.12, "foot_off", "right"),
            (0.5, "foot_strike", "right"),
            (0.62, "foot_off", "left"),
        )
    ]
    return tuple(sorted(events, key=lambda event: event.time))


def shifted(events, seconds, labels=("foot_strike", "foot_off")):
    return tuple(replace(e, time=e.time + seconds * (e.label in labels)) for e in events)


def other_side(events):
    return tuple(replace(e, side=OTHER[e.side]) for e in events)


TRUE = walking()
PLATES = {"the plates": walking(seed=1)}


def test_events_that_agree_raise_no_warning():
    assert check_events(TRUE, PLATES) == ()


@given(seconds=st.floats(-0.3, 0.3), stride_s=st.floats(0.9, 1.6))
def test_events_are_early_or_late_from_150_ms_on_and_never_below(seconds, stride_s):
    assume(abs(abs(seconds) - 0.15) > 0.02)
    events = shifted(walking(stride_s=stride_s), seconds)
    notes = check_events(events, {"the plates": walking(stride_s=stride_s, seed=1)})
    assert bool(notes) == (abs(seconds) > 0.15)
    for note in notes:
        assert note.code == "events_offset"
        assert len(note.values["offset_ms"]) == 4
        for offset_ms in note.values["offset_ms"].values():
            assert offset_ms == pytest.approx(1000 * seconds, abs=20)


def test_where_the_plates_show_too_little_the_markers_decide():
    few = {"the plates": PLATES["the plates"][:4], "the feet": walking(seed=2)}
    (note,) = check_events(shifted(TRUE, 0.25), few)
    assert note.values["source"] == "the feet"
    assert check_events(TRUE, few) == ()


@given(seed=st.integers(0, 50))
def test_events_that_have_nothing_in_common_are_not_compared(seed):
    rng = np.random.default_rng(seed)
    scattered = tuple(replace(e, time=float(rng.uniform(0, 11))) for e in TRUE)
    assert check_events(TRUE, {"the plates": scattered}) == ()


def test_a_walk_over_one_plate_is_compared_where_it_can_be():
    one_foot = {"the plates": [e for e in PLATES["the plates"] if e.side == "left"]}
    assert check_events(TRUE, one_foot) == ()
    assert check_events(other_side(TRUE), one_foot)[0].code == "events_of_other_side"


@pytest.mark.parametrize(("carried", "source"), [(0.5, "the feet"), (1.0, "the plates")])
def test_plates_that_often_carry_nobody_are_no_reference_for_events(carried, source):
    """A dead plate shows none of its foot."""
    swings = Swings(np.arange(1300) / 100, np.zeros((1300, 2, 3)), TRUE, np.array([[0.0, 12.99]]))
    late, by_plates = shifted(TRUE, 0.25), PLATES["the plates"]
    _, (_, note) = choose_method(late, swings, None, by_plates, carried)
    assert (note.code, note.values["source"]) == ("events_offset", source)
