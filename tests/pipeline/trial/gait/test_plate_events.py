"""Events of plates that carry one foot are exact where they can be, and none where they cannot."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.trial.gait.contact import Contact
from pipeline.trial.gait.detection import plate_events
from pipeline.trial.ground.wrenches import PlateLoad

TIME = np.arange(600) / 100
CLOCK = np.arange(6000) / 1000
WEIGHT_N = 700.0
RISE_S = 0.1
STEPS_S = ((1.0, 1.7), (2.2, 2.9), (3.4, 4.1))
AFTER_S = RISE_S * 20 / WEIGHT_N
"""After a step begins its load, which rises evenly to body weight, passes 20 N."""


def steps(spans=STEPS_S, weight_n=WEIGHT_N):
    """The load of steps that begin and end at these times, (N,) [N]."""
    up = sum(
        np.clip((CLOCK - a) / RISE_S, 0, 1) * np.clip((b - CLOCK) / RISE_S, 0, 1) for a, b in spans
    )
    return weight_n * up


def contact(span, foot="left_foot", plate=1, **changed):
    start, stop = np.searchsorted(TIME, span)
    values = {"feet": (foot,), "ambiguous": False, "distance_m": 0.05} | changed
    return Contact(plate, int(start), int(stop), **values)


def found(contacts, *loads):
    plates = [PlateLoad(number, CLOCK, load) for number, load in enumerate(loads, start=1)]
    return plate_events(contacts, plates, TIME, WEIGHT_N)


def times(events, label="foot_strike", side="left"):
    return np.array([e.time for e in events if (e.label, e.side) == (label, side)])


CONTACTS = [contact(span) for span in STEPS_S]


def test_a_foot_strikes_and_leaves_where_its_load_passes_20_n():
    events = found(CONTACTS, steps())
    np.testing.assert_allclose(times(events), [a + AFTER_S for a, _ in STEPS_S], atol=1e-6)
    offs = times(events, "foot_off")
    np.testing.assert_allclose(offs, [b - AFTER_S for _, b in STEPS_S], atol=1e-6)
    assert len(events) == 6


@settings(max_examples=30)
@given(later=st.floats(-50, 50), right=st.booleans())
def test_events_move_with_the_clock_and_change_side_with_the_foot(later, right):
    foot, side = ("right_foot", "right") if right else ("left_foot", "left")
    plate = PlateLoad(1, CLOCK + later, steps())
    contacts = [contact(span, foot) for span in STEPS_S]
    events = plate_events(contacts, [plate], TIME + later, WEIGHT_N)
    assert {event.side for event in events} == {side}
    np.testing.assert_allclose(
        [event.time for event in events],
        [event.time + later for event in found(CONTACTS, steps())],
        atol=1e-6,
    )


@given(st.floats(-60, 60))
@settings(max_examples=30)
def test_what_an_unloaded_plate_reads_does_not_move_events(level_n):
    """An unweighted platform that tilts adds tens of newtons, slowly."""
    slow = level_n * np.sin(2 * np.pi * CLOCK / 30)
    events = found(CONTACTS, steps() + slow)
    np.testing.assert_allclose(times(events), [a + AFTER_S for a, _ in STEPS_S], atol=1e-3)


def test_noise_of_a_plate_neither_adds_nor_drops_events():
    noise = np.random.default_rng(0).normal(scale=6.0, size=len(CLOCK))
    events = found(CONTACTS, steps() + noise)
    assert len(events) == 6
    np.testing.assert_allclose(times(events), [a + AFTER_S for a, _ in STEPS_S], atol=0.004)


def test_a_platform_that_presses_on_its_plate_for_as_long_as_a_step_makes_no_step():
    assert found(CONTACTS, steps(weight_n=0.2 * WEIGHT_N)) == ()


def test_of_a_plate_that_both_feet_share_only_its_first_strike_and_last_off_are_known():
    shared = contact((1.0, 2.9), feet=("left_foot", "right_foot"), changes=(200,))
    load = np.maximum(steps(((1.0, 2.1),)), steps(((1.9, 2.9),)))
    events = found([shared], load)
    assert [(e.label, e.side) for e in events] == [("foot_strike", "left"), ("foot_off", "right")]
    np.testing.assert_allclose([e.time for e in events], [1 + AFTER_S, 2.9 - AFTER_S], atol=1e-6)


def test_a_foot_that_lands_on_two_plates_strikes_where_their_sum_passes_20_n():
    both = [contact((1.0, 1.7), plate=1), contact((1.01, 1.7), plate=2)]
    events = found(both, 0.6 * steps(STEPS_S[:1]), 0.4 * steps(STEPS_S[:1]))
    np.testing.assert_allclose([e.time for e in events], [1 + AFTER_S, 1.7 - AFTER_S], atol=1e-6)


def test_a_foot_that_lands_beside_the_other_one_on_one_of_two_plates_has_no_strike():
    other = contact((0.5, 1.7), plate=2, feet=("right_foot", "left_foot"), changes=(103,))
    events = found([contact((1.0, 1.7)), other], steps(STEPS_S[:1]), steps(((0.5, 1.7),)))
    assert not len(times(events))


def test_a_recording_that_begins_or_ends_in_a_step_shows_only_the_other_end():
    first, last = (-1.0, 1.0), (5.0, 8.0)
    contacts = [contact((0.0, 1.0)), Contact(1, 500, 600, ("left_foot",), False, 0.05)]
    events = found(contacts, steps((first, last)))
    assert [e.label for e in events] == ["foot_off", "foot_strike"]


def test_a_strike_right_after_another_load_has_no_known_level_and_no_event():
    contacts = [contact((1.0, 1.7)), contact((1.75, 2.4))]
    events = found(contacts, steps(((1.0, 1.7), (1.75, 2.4))))
    assert len(times(events)) == 1


def test_where_the_load_is_unknown_there_is_no_event():
    load = steps()
    load[(CLOCK > 0.9) & (CLOCK < 1.3)] = np.nan
    assert len(times(found(CONTACTS, load))) == 2
