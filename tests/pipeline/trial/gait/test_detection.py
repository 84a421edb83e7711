"""A trial has one set of gait events, by the method that is wanted, and a note names it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config.schema import Subject, Treadmill
from pipeline.io.recording import Event
from pipeline.trial.gait.detection import combined_events, detect_events
from pipeline.trial.ground.laboratory import Laboratory
from tests.benchmarks.events import event_sources

KINDS = [(label, side) for label in ("foot_strike", "foot_off") for side in ("left", "right")]
TRUE = [
    Event(1.1 * stride + 0.25 * k, label, side)
    for stride in range(1, 11)
    for k, (label, side) in enumerate(KINDS)
]
OFFSET_S = {kind: 0.03 - 0.02 * k for k, kind in enumerate(KINDS)}


def by_motion(events=TRUE, offset_s=OFFSET_S):
    """Events that are early or late by a time of their kind and foot."""
    return [replace(e, time=e.time + offset_s[e.label, e.side]) for e in events]


def assert_same(events, true, atol=1e-9):
    kinds = [(e.label, e.side) for e in sorted(true, key=lambda e: e.time)]
    assert [(e.label, e.side) for e in events] == kinds
    np.testing.assert_allclose([e.time for e in events], sorted(e.time for e in true), atol=atol)


@pytest.mark.parametrize("every", [1, 3])
def test_contacts_that_plates_see_clean_correct_all_others(every):
    strides = TRUE[: 4 * 9]
    clean = [e for k, e in enumerate(strides) if (k // 4) % every == 0]
    events, corrections = combined_events(by_motion(strides), clean)
    assert_same(events, strides)
    assert corrections["left foot strikes"] == pytest.approx(-0.03)
    assert corrections["right foot offs"] == pytest.approx(0.03)


def test_one_wrong_plate_event_moves_no_other_event_and_is_not_used():
    """A foot beside the plate loads it late."""
    late = [replace(e, time=e.time + 0.09) if e is TRUE[20] else e for e in TRUE]
    events, _ = combined_events(by_motion(), late)
    assert_same(events, TRUE)


def test_a_foot_that_no_plate_carries_alone_is_corrected_by_the_other_one():
    symmetric = {kind: 0.04 for kind in KINDS}
    left = [e for e in TRUE if e.side == "left"]
    events, corrections = combined_events(by_motion(offset_s=symmetric), left)
    assert_same(events, TRUE)
    assert corrections["right foot offs"] == pytest.approx(corrections["left foot offs"])


def test_without_clean_contacts_events_stay_where_the_motion_shows_them():
    events, corrections = combined_events(by_motion(), TRUE[:2])
    assert corrections == {}
    assert_same(events, by_motion())


def test_the_correction_follows_gait_that_changes():
    """The foot comes ever earlier than its load, by 55 ms in the end: as on a rising treadmill."""
    drift = [replace(e, time=0.995 * e.time) for e in TRUE]
    clean = [e for k, e in enumerate(TRUE) if (k // 4) % 3 != 1]
    events, _ = combined_events(drift, clean)
    error_s = np.array([e.time for e in events]) - np.sort([e.time for e in TRUE])
    assert np.sqrt(np.mean(error_s**2)) < 0.01


@settings(max_examples=25)
@given(later=st.floats(-20, 20), keep=st.lists(st.booleans(), min_size=40, max_size=40))
def test_events_move_with_the_clock_and_change_sides_with_the_feet(later, keep):
    other = {"left": "right", "right": "left"}

    def moved(events):
        return [replace(e, time=e.time + later, side=other[e.side]) for e in events]

    clean = [e for e, kept in zip(TRUE, keep, strict=True) if kept]
    events, _ = combined_events(by_motion(), clean)
    again, _ = combined_events(moved(by_motion()), moved(clean))
    assert_same(again, moved(events), atol=1e-6)


@pytest.fixture(scope="module")
def sources(walker):
    """What the events of a walk can be found from."""
    return event_sources(walker, Laboratory(Treadmill()), Subject(sex="male"))


def test_who_stands_has_no_events_and_the_note_says_why(sources):
    still = 0 * sources["motion"] + [0, 0, 0, 0.15, 0.15]
    events, note, _ = detect_events(**sources | {"motion": still}, method="auto")
    assert events == ()
    assert "no foot swings" in note.text


def test_plates_that_carry_nobody_alone_leave_the_motion_and_the_note_says_so(sources):
    events, note, _ = detect_events(**sources | {"of_plates": ()}, method="auto")
    assert len(events) > 15
    assert note.code == "events_uncalibrated"


def test_automatic_events_of_a_walk_are_those_of_the_force_under_its_feet(sources, walker):
    """Its plates are not late; each carries one foot."""
    events, *_ = detect_events(**sources, method="auto")
    for plate, side in zip(walker.plates, ("left", "right"), strict=True):
        above = plate.wrench[:, 2] > 20
        strikes = plate.time[1:][~above[:-1] & above[1:]]
        own = [e.time for e in events if (e.label, e.side) == ("foot_strike", side)]
        assert np.abs(np.array(own)[:, None] - strikes).min(axis=1).max() < 0.005
