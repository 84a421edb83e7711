"""A file's events that the swings of the feet contradict are named, and who does not swing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hbm.markers import Markers, marker_sets
from pipeline.io.recording import Event
from pipeline.trial.gait.cycles import NO_SWING, cut_cycles, is_standing
from pipeline.trial.gait.events import (
    SIDES,
    Swings,
    choose_method,
    counterparts,
    event_times,
    foot_swings,
)
from tests.pipeline.trial.test_event_check import other_side, shifted, walking

TIME = np.arange(1300) / 100
STRIDE_S = 1.1
TRUE = tuple(event for event in walking(noise_s=0.0) if event.time < TIME[-1])
FEET = np.zeros((len(TIME), 2, 3))
SWINGS = Swings(TIME, FEET, TRUE, np.array([[TIME[0], TIME[-1]]]))


def chosen(events, wanted=None, swings=SWINGS):
    method, notes = choose_method(tuple(events), swings, wanted)
    return method, [note.code for note in notes]


SOUND = "file", ["events_compared"]
CONTRADICTED = "auto", ["events_contradicted"]


@given(
    st.floats(-0.1, 0.1),
    st.integers(0, 20),
    st.integers(8, 40),
    st.sampled_from([SIDES, SIDES[:1], SIDES[1:]]),
    st.sampled_from([("foot_strike",), ("foot_strike", "foot_off")]),
)
def test_a_file_that_marks_a_part_of_what_the_feet_do_is_used(late_s, first, count, sides, labels):
    part = shifted(TRUE[first : first + count], late_s)
    events = [e for e in part if e.side in sides and e.label in labels]
    assume(any(event_times(events, "foot_strike", side).size > 1 for side in SIDES))
    assert chosen(events) == SOUND


def test_strides_over_plates_that_are_far_apart_are_used():
    assert chosen([*TRUE[:9], *TRUE[20:29]]) == SOUND


def test_a_crop_that_keeps_the_events_of_the_whole_walk_is_used():
    crop = [event for event in TRUE if event.time < 4.5]
    swings = SWINGS._replace(time=TIME[:450], events=tuple(crop), seen=np.array([[0.0, 4.49]]))
    assert chosen(TRUE, swings=swings) == SOUND
    assert counterparts(TRUE, swings)["outside"] == len(TRUE) - len(crop)


@pytest.mark.parametrize(
    ("events", "code"),
    [
        (other_side(TRUE), "events_of_other_side"),
        (shifted(TRUE, 0.25), "events_offset"),
        (shifted(TRUE, -0.3), "events_offset"),
    ],
)
def test_sides_or_times_that_are_all_wrong_alike_have_a_warning_of_their_own(events, code):
    assert chosen(events) == ("file", ["events_compared", code])


@settings(max_examples=60)
@given(st.floats(6.0, 500.0), st.sampled_from([-1, 1]))
def test_events_that_begin_elsewhere_are_not_used_however_far(shift_s, sign):
    assert chosen(shifted(TRUE, sign * shift_s)) == CONTRADICTED
    method, codes = chosen(shifted(TRUE, sign * shift_s), "file")
    assert (method, codes) == ("file", ["events_contradicted"])


@given(st.integers(0, 1000), st.sampled_from(["times", "sides"]))
def test_events_at_random_times_or_of_random_sides_are_not_used(seed, kind):
    rng = np.random.default_rng(seed)
    if kind == "times":
        events = [replace(e, time=float(rng.uniform(0, TIME[-1]))) for e in TRUE]
    else:
        events = [replace(e, side=str(rng.choice(SIDES))) for e in TRUE]
        assume(0.35 < np.mean([a.side == b.side for a, b in zip(events, TRUE, strict=True)]) < 0.65)
    assert chosen(events) == CONTRADICTED


@given(st.floats(0.8, 0.93) | st.floats(1.1, 1.4), st.floats(-0.5, 0.5))
def test_events_of_a_walk_at_another_cadence_are_not_used(factor, late_s):
    assert chosen([replace(e, time=factor * e.time + late_s) for e in TRUE]) == CONTRADICTED


@pytest.mark.parametrize("sides", [SIDES, SIDES[:1]])
def test_events_without_every_other_strike_are_not_used(sides):
    strikes = [e for side in sides for e in TRUE if (e.label, e.side) == ("foot_strike", side)]
    lacking = [strike for k, strike in enumerate(strikes) if k % 2]
    assert chosen([event for event in TRUE if event not in lacking]) == CONTRADICTED


@given(st.data())
def test_events_that_are_missing_or_alone_are_counted(data):
    inner = range(4, len(TRUE) - 4)
    gone = data.draw(st.sets(st.sampled_from(inner), max_size=6))
    assume(not any({k, k + 1, k + 2} <= gone for k in inner))
    kept = [event for k, event in enumerate(TRUE) if k not in gone]
    swings = SWINGS._replace(events=tuple(kept))
    of_file, of_feet = counterparts(kept, SWINGS), counterparts(TRUE, swings)
    assert (of_file["missing"], of_file["alone"]) == (len(gone), 0)
    assert (of_feet["missing"], of_feet["alone"]) == (0, len(gone))
    assert of_feet["outside"] == of_file["outside"] == 0


def test_events_while_nobody_swings_are_not_used():
    swings = SWINGS._replace(events=())
    assert chosen(TRUE, swings=swings) == CONTRADICTED


def test_feet_that_are_not_seen_contradict_nothing():
    swings = SWINGS._replace(events=(), seen=np.empty((0, 2)))
    assert chosen(shifted(TRUE, 60.0), swings=swings) == ("file", [])


# How feet swing

LABELS = "LASIS", "RASIS", "LPSIS", "RPSIS", "LHEE", "LMT2", "RHEE", "RMT2"


def walker_that_turns(heading, backwards, stride_s):
    """Markers of a treadmill walker who faces ``heading``, (T,) [rad]; strikes at k strides."""
    places = []
    for side, first_s in ((1, 0.0), (-1, 0.5 * stride_s)):
        phase = 2 * np.pi * (TIME - first_s) / stride_s
        ahead = 0.3 * np.cos(phase) * (-1 if backwards else 1)
        up = -0.8 + 0.05 * np.clip(-np.sin(phase), 0, None)
        places += [(ahead + toe, np.full(len(TIME), 0.1 * side), up) for toe in (-0.1, 0.1)]
    still = np.ones(len(TIME))
    pelvis = [(x * still, y * still, 0 * still) for x in (0.1, -0.1) for y in (0.12, -0.12)]
    x, y, z = np.moveaxis(np.array([*pelvis, *places]), 1, 0)
    turned = x * np.cos(heading) - y * np.sin(heading), x * np.sin(heading) + y * np.cos(heading)
    return Markers(TIME, LABELS, np.stack([*turned, z]).transpose(2, 1, 0))


@settings(max_examples=25)
@given(st.floats(-3, 3), st.floats(-0.5, 0.5), st.booleans(), st.floats(0.7, 2.2))
def test_strikes_are_found_whichever_way_one_faces_turns_or_walks(start, turn, backwards, stride_s):
    markers = walker_that_turns(start + turn * TIME, backwards, stride_s)
    swings = foot_swings(markers, marker_sets()["hbm2"])
    for side, first_s in zip(SIDES, (0.0, 0.5 * stride_s), strict=True):
        strikes = event_times(swings.events, "foot_strike", side)
        assert len(strikes) >= (TIME[-1] - first_s) // stride_s - 1
        np.testing.assert_allclose(np.diff(strikes), stride_s, atol=0.03)
        late = (strikes - first_s + stride_s / 2) % stride_s - stride_s / 2
        assert np.abs(late).max() < 0.05


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("away_m", [-0.2, 0.2])
def test_two_strides_in_which_the_pelvis_moves_too_are_seen_the_right_way_round(backwards, away_m):
    markers = walker_that_turns(0 * TIME, backwards, STRIDE_S)
    position = markers.position[:275].copy()
    position[:, :4, 0] += np.linspace(0, away_m, 275)[:, None]
    part = Markers(TIME[:275], LABELS, position)
    strikes = event_times(foot_swings(part, marker_sets()["hbm2"]).events, "foot_strike", "left")
    assert len(strikes) > 0
    assert np.abs((strikes + STRIDE_S / 2) % STRIDE_S - STRIDE_S / 2).max() < 0.05


def test_unmarked_feet_and_a_short_recording_show_no_swing():
    markers = walker_that_turns(0 * TIME, False, STRIDE_S)
    legs = Markers(TIME, LABELS[:4], markers.position[:, :4])
    short = Markers(TIME[:5], LABELS, markers.position[:5])
    for few in (legs, short):
        swings = foot_swings(few, marker_sets()["hbm2"])
        assert (swings.events, len(swings.seen)) == ((), 0)


# Who stands


@given(st.floats(0, 0.4), st.integers(0, 1), st.integers(0, 2))
def test_a_foot_that_travels_a_step_against_the_pelvis_swings(travel_m, foot, way):
    assume(abs(travel_m - 0.05) > 1e-6)
    feet = np.zeros((100, 2, 3))
    feet[:, foot, way] = travel_m / 2 * np.cos(np.linspace(0, 2 * np.pi, 101)[:100])
    assert is_standing(feet) == (travel_m < 0.05)
    feet[50:60, foot] = np.nan
    assert not is_standing(feet)


def test_cycles_in_which_no_foot_swings_are_left_out():
    feet = FEET.copy()
    feet[500:, :, 0] = 0.3 * np.cos(2 * np.pi * TIME[500:, None] / STRIDE_S)
    events = [Event(t, "foot_strike", "left") for t in np.arange(0.3, 12, STRIDE_S)]
    flags = np.zeros(len(TIME), int)
    cycles, left_out = cut_cycles(events, TIME, flags, 0.5, feet=feet)
    assert left_out["left"] == (NO_SWING,) * 4
    assert cycles["left"][:, 0].min() > 5.0 - STRIDE_S
