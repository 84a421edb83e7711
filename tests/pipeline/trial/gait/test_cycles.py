"""Gait cycles follow the events of sines, of plates and of a real trial that are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.markers import Markers, marker_sets
from hbm.signals.samples import stretches
from pipeline.io.c3d.read import read_c3d
from pipeline.io.recording import Event
from pipeline.trial.gait.contact import Contact
from pipeline.trial.gait.cycles import gait_cycles, normalise, steps
from pipeline.trial.gait.detection import plate_events
from pipeline.trial.gait.events import SIDES, compare_events, zeni_events
from pipeline.trial.ground.wrenches import PlateLoad
from tests.hbm.motions import without

HBM2 = {"sacrum": ("LPSIS", "RPSIS"), "heel": "{}HEE", "toe": "{}MT2"}
OPENSIM = {"sacrum": ("V.Sacral",), "heel": "{}.Heel", "toe": "{}.Toe.Tip"}
SETS = marker_sets()

STRIDE_S = 1.13
STRIKE = {"left": 0.203, "right": 0.203 + STRIDE_S / 2}
OFF = {side: STRIKE[side] + 0.62 * STRIDE_S for side in SIDES}
time = np.arange(1200) / 100


def walker(names=HBM2, drift=0.0, sway=0.0, standing_s=0.0, noise=0.0):
    """Feet that swing as sines about the sacrum, so that events are at the extremes."""

    def swing(first_turn):
        phase = 2 * np.pi * np.maximum(time - standing_s - first_turn, -first_turn) / STRIDE_S
        return 0.3 * np.cos(phase)

    tracks = {name: np.array([0.0, side, 1.0]) for side, name in enumerate(names["sacrum"])}
    for side, letter in zip(SIDES, "LR", strict=True):
        for part, extreme, sign in (("heel", STRIKE, 1), ("toe", OFF, -1)):
            track = np.zeros((len(time), 3))
            track[:, 0] = sign * swing(extreme[side])
            tracks[names[part].format(letter)] = track
    position = np.stack([np.broadcast_to(track, (len(time), 3)) for track in tracks.values()], 1)
    position = position + np.stack([drift * time, sway * np.sin(time), 0 * time], -1)[:, None]
    position = position + np.random.default_rng(0).normal(0, noise, position.shape)
    return Markers(time, tuple(tracks), position)


def zeni(markers):
    """Gait events by the markers of the set HBM2."""
    return zeni_events(markers, SETS["hbm2"])


def times_of(events, label, side):
    return np.array([e.time for e in events if (e.label, e.side) == (label, side)])


def assert_known_events(events, atol, start=0.0):
    for label, first in (("foot_strike", STRIKE), ("foot_off", OFF)):
        for side in SIDES:
            found = times_of(events, label, side)
            strides = (found - first[side] - start) / STRIDE_S
            assert len(found) >= 9
            np.testing.assert_allclose(np.diff(np.round(strides)), 1)
            np.testing.assert_allclose(strides, np.round(strides), atol=atol / STRIDE_S)


@pytest.mark.parametrize(
    ("names", "marker_set"),
    [
        (HBM2, SETS["hbm2"]),
        (OPENSIM, SETS["gait2354"]),
    ],
)
def test_feet_strike_and_leave_where_they_change_direction_against_the_sacrum(names, marker_set):
    assert_known_events(zeni_events(walker(names), marker_set), atol=5e-4)  # 1/20 of a frame


@settings(max_examples=8)
@given(drift=st.floats(-0.3, 0.3), sway=st.floats(-0.1, 0.1))
def test_events_do_not_depend_on_where_on_the_belt_the_subject_walks(drift, sway):
    here, there = zeni(walker()), zeni(walker(drift=drift, sway=sway))
    np.testing.assert_allclose([e.time for e in there], [e.time for e in here], atol=1e-6)


def test_marker_noise_moves_events_by_a_few_milliseconds_only():
    assert_known_events(zeni(walker(noise=0.001)), atol=6e-3)


def test_no_events_are_found_in_a_gap_and_all_others_are():
    markers = walker()
    whole, holed = zeni(markers), zeni(without(markers, ["LHEE"], slice(400, 500)))
    hidden = [e for e in whole if (e.label, e.side) == ("foot_strike", "left") and 4 <= e.time < 5]
    assert len(hidden) == 1
    assert len(holed) == len(whole) - 1
    assert all(a.only_in_first == 0 and a.sd_ms < 3 for a in compare_events(holed, whole))


def on_plates(vertical, time):
    """Events of plates that carry one foot each, from their vertical forces, side -> (N,) [N]."""
    contacts, loads = [], []
    for number, (side, force) in enumerate(vertical.items(), start=1):
        loads.append(PlateLoad(number, time, force))
        for start, stop in stretches(force > 20):
            if time[stop - 1] - time[start] > 0.1:
                contacts.append(Contact(number, start, stop, (f"{side}_foot",), False, 0.05))
    weight_n = 0.8 * np.median([force.max() for force in vertical.values()])
    return plate_events(contacts, loads, time, weight_n)


def test_agreement_of_shifted_events_is_their_shift():
    events = zeni(walker())
    jitter = np.random.default_rng(1).normal(0, 0.004, len(events))
    moved = [
        Event(e.time + 0.025 + d, e.label, e.side) for e, d in zip(events, jitter, strict=True)
    ]
    moved.append(Event(30.0, "foot_off", "right"))
    for agreement in compare_events(moved, events):
        mine = [(e.label, e.side) == (agreement.label, agreement.side) for e in events]
        assert agreement.mean_ms == pytest.approx(25 + 1000 * jitter[mine].mean(), abs=1e-6)
        assert agreement.sd_ms == pytest.approx(1000 * jitter[mine].std(ddof=1), abs=1e-6)
        assert agreement.matched == sum(mine)
        alone = (agreement.label, agreement.side) == ("foot_off", "right")
        assert (agreement.only_in_first, agreement.only_in_second) == (alone, 0)


def regular_events(strikes=10):
    return [
        Event(1.0 * k + shift, label, side)
        for k in range(strikes)
        for shift, label, side in (
            (0.0, "foot_strike", "left"),
            (0.1, "foot_off", "right"),
            (0.5, "foot_strike", "right"),
            (0.6, "foot_off", "left"),
        )
    ]


@pytest.mark.parametrize(("side", "first"), [("left", 0.0), ("right", 0.5)])
def test_cycles_run_from_strike_to_strike(side, first):
    spans, rejected = gait_cycles(regular_events(), side)
    expected = first + np.arange(9)[:, None] + [0, 1]
    np.testing.assert_allclose(spans, expected)
    assert rejected == ()


def test_a_cycle_with_a_missed_strike_is_left_out_with_a_note():
    events = [e for e in regular_events() if (e.time, e.label) != (4.0, "foot_strike")]
    spans, rejected = gait_cycles(events, "left")
    assert len(spans) == 7
    assert [reason.split()[1] for reason in rejected] == ["duration"]


def test_a_cycle_in_which_feet_do_not_alternate_is_left_out_with_a_note():
    events = [*regular_events(), Event(3.3, "foot_strike", "right")]
    events = [e for e in events if (e.time, e.label) != (6.6, "foot_off")]
    spans, rejected = gait_cycles(events, "left")
    assert len(spans) == 7
    assert ["alternate" in reason for reason in rejected] == [True, True]


def test_normalising_resolves_a_signal_between_its_samples():
    wave = np.sin(2 * np.pi * 2 * time)
    at = np.linspace(3.004, 4.137, 51)
    normalised = normalise(time, wave, [[3.004, 4.137]], samples=51)[0]
    np.testing.assert_allclose(normalised, np.sin(2 * np.pi * 2 * at), atol=3e-6)


def test_gaps_and_the_end_of_the_recording_stay_not_a_number():
    wave = np.sin(time)
    wave[300:310] = np.nan
    normalised = normalise(time, wave, [[2.5, 3.5], [11.5, 12.5]])
    assert np.isnan(normalised[0, 50:59]).all()
    assert np.isfinite(normalised[0, :49]).all()
    assert np.isnan(normalised[1, 51:]).all()
    assert normalise(time, wave, np.zeros((0, 2))).shape == (0, 101)


@pytest.fixture(scope="module")
def treadmill(shared_data):
    return read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")


def test_file_zeni_and_force_agree_on_a_real_treadmill(treadmill):
    by_markers = zeni(treadmill.markers)
    sides = ("left" if plate.center[1] > 0 else "right" for plate in treadmill.plates)
    vertical = {s: plate.wrench[:, 2] for s, plate in zip(sides, treadmill.plates, strict=True)}
    force = on_plates(vertical, treadmill.plates[0].time)
    by_file = compare_events(by_markers, treadmill.events)
    assert all(a.only_in_first == 0 and a.only_in_second <= 1 for a in by_file)
    assert all(abs(a.mean_ms) < 35 and a.sd_ms < 6 for a in by_file)
    for agreement, measured in zip(
        compare_events(by_markers, force), (-24, -30, -14, -22), strict=True
    ):
        assert agreement.mean_ms == pytest.approx(measured, abs=5)  # measured independently before


def test_contacts_of_a_real_treadmill_are_those_its_authors_published(shared_data):
    folder = shared_data / "treadmill_forces"
    read = lambda name: np.genfromtxt(folder / name, delimiter=",", names=True)  # noqa: E731
    record, published = read("UnpertPre_data.csv"), read("UnpertPre__event.csv")
    vertical = {side: record[f"{side.capitalize()}GRF_y"] for side in SIDES}
    expected = [
        Event(instant, label, side)
        for label, suffix in (("foot_strike", "hs"), ("foot_off", "to"))
        for side in SIDES
        for instant in published[side[0] + suffix]
        if np.isfinite(instant)
    ]
    found = on_plates(vertical, record["time"])
    for agreement in compare_events(found, expected):
        assert agreement.matched >= 43
        assert (agreement.only_in_first, agreement.only_in_second) == (0, 0)
        assert abs(agreement.mean_ms) < 6  # half a sample; ours count from the level at rest
        assert agreement.sd_ms < 10
    assert [len(gait_cycles(found, side)[0]) for side in SIDES] == [43, 42]


def alternating(first_s, step_s, stance_s, count):
    """Events of steps that last equally long, the left foot first."""
    strikes = [(first_s + step_s * k, SIDES[k % 2]) for k in range(count)]
    offs = [Event(at + stance_s, "foot_off", side) for at, side in strikes]
    return [*(Event(at, "foot_strike", side) for at, side in strikes), *offs]


@given(step_s=st.floats(0.3, 1.0), double=st.floats(0.02, 0.2), count=st.integers(2, 9))
def test_steps_follow_one_another_without_overlap_and_stances_overlap_in_double_support(
    step_s, double, count
):
    events = alternating(0.5, step_s, step_s + double, count)
    of_steps = np.concatenate([steps(events, side, "step")[0] for side in SIDES])
    of_steps = of_steps[np.argsort(of_steps[:, 0])]
    assert len(of_steps) == count - 1
    np.testing.assert_allclose(np.diff(of_steps), step_s)
    np.testing.assert_array_equal(of_steps[1:, 0], of_steps[:-1, 1])
    for side, own in zip(SIDES, (-(-count // 2), count // 2), strict=True):
        stances, left_out = steps(events, side, "stance")
        assert (len(stances), left_out) == (own, ())
        np.testing.assert_allclose(np.diff(stances), step_s + double)


def test_a_step_without_the_other_foot_s_strike_is_none():
    strikes = [Event(at, "foot_strike", "left") for at in (0.5, 1.6, 2.7)]
    assert not len(steps(strikes, "left", "step")[0])
    late = [*strikes, Event(2.2, "foot_strike", "right")]
    spans, left_out = steps(late, "left", "step")
    assert spans.tolist() == [[1.6, 2.2]]
    assert len(left_out) == 1
