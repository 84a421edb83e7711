"""Events by the speed of the feet are the same above any ground that moves."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.trial.gait.detection import foot_motion_events

TIME = np.arange(1200) / 100
STRIDE_S, STANCE, SPEED_MPS = 1.1, 0.62, 1.3
FIRST_S = {"left": 0.4, "right": 0.4 + STRIDE_S / 2}


def place(first_s):
    """Forward place of a foot on the ground: at rest in stance, a stride farther in each swing."""
    phase = (TIME - first_s) / STRIDE_S
    swing = np.clip((phase % 1 - STANCE) / (1 - STANCE), 0, 1)
    smooth = swing**3 * (10 - 15 * swing + 6 * swing**2)
    return SPEED_MPS * STRIDE_S * (np.floor(phase) + smooth)


def walk(belt_mps=0.0, sides=("left", "right")):
    """Walking over ground, or on a belt that carries the feet backwards."""
    feet = np.column_stack([place(FIRST_S[side]) for side in sides])
    moved = -belt_mps * TIME
    pelvis = SPEED_MPS * TIME + 0.02 * np.sin(4 * np.pi * TIME / STRIDE_S)
    forward = feet + moved[:, None]
    return np.column_stack([pelvis + moved, forward, forward + 0.15])


def times(events, label, side="left"):
    return np.array([e.time for e in events if (e.label, e.side) == (label, side)])


def test_a_foot_strikes_when_it_comes_to_rest_and_leaves_when_it_begins_to_move():
    events = foot_motion_events(TIME, walk())
    for side, first_s in FIRST_S.items():
        for label, at in (("foot_strike", first_s), ("foot_off", first_s + STANCE * STRIDE_S)):
            true = at + STRIDE_S * np.arange(-2, 20)
            own = times(events, label, side)
            nearest = true[np.abs(own[:, None] - true).argmin(axis=1)]
            assert len(own) >= 9
            np.testing.assert_allclose(np.diff(nearest), STRIDE_S)
            assert np.abs(own - nearest).max() < 0.08
            assert np.std(own - nearest) < 0.005


@settings(max_examples=20)
@given(st.floats(-2, 3))
def test_on_a_belt_of_any_speed_events_are_those_over_ground(belt_mps):
    over_ground, on_belt = (foot_motion_events(TIME, each) for each in (walk(), walk(belt_mps)))
    assert [(e.label, e.side) for e in on_belt] == [(e.label, e.side) for e in over_ground]
    np.testing.assert_allclose([e.time for e in on_belt], [e.time for e in over_ground], atol=1e-6)


def test_exchanged_feet_exchange_the_sides_of_their_events():
    mirrored = foot_motion_events(TIME, walk(sides=("right", "left")))
    other = {"left": "right", "right": "left"}
    assert [(e.time, e.label, other[e.side]) for e in mirrored] == [
        (e.time, e.label, e.side) for e in foot_motion_events(TIME, walk())
    ]


def test_who_stands_and_sways_has_no_events():
    sway = 0.03 * np.sin(2 * np.pi * 0.4 * TIME)
    still = np.zeros((len(TIME), 2))
    assert foot_motion_events(TIME, np.column_stack([sway, still, still + 0.15])) == ()


def test_a_belt_that_starts_and_stops_under_a_walker_invents_no_event():
    """The walker stands, and is carried with the belt, before the first and after the last step."""
    motion, walking = walk(), (TIME > 4) & (TIME < 9)
    first, last = np.flatnonzero(walking)[[0, -1]]
    frame = np.clip(np.arange(len(TIME)), first, last)
    belt = np.cumsum(SPEED_MPS * walking) / 100
    events = foot_motion_events(TIME, motion[frame] - belt[:, None])
    regular = foot_motion_events(TIME, motion)
    assert len(events) >= 12
    for event in events:
        same = [e.time for e in regular if (e.label, e.side) == (event.label, event.side)]
        assert np.abs(np.array(same) - event.time).min() < 0.03


def test_in_a_gap_of_the_ankles_there_are_no_strikes():
    motion, gap = walk(SPEED_MPS), (TIME > 5) & (TIME < 7)
    motion[gap, 1:3] = np.nan
    events = foot_motion_events(TIME, motion)
    strikes = np.concatenate([times(events, "foot_strike", side) for side in FIRST_S])
    assert not ((strikes > 5) & (strikes < 7)).any()
    assert len(strikes) > 10
