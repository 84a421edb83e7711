"""Gait cycles and running root mean squares are those of the trial, known as soon as they end."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Settings, Subject
from pipeline.live.cycles import ConditionSoFar, GaitTracker
from pipeline.trial.gait.contact import LIMITS
from pipeline.trial.gait.events import SIDES, event_times
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import reported
from tests.pipeline.live.playing import frames_of

FRAME_S = 0.01


@pytest.fixture(scope="module")
def result(walker):
    return process_recording(walker, Subject(sex="female"), Settings())


@pytest.fixture(scope="module")
def frames(result):
    return list(frames_of(result))


@pytest.fixture(scope="module")
def followed(frames):
    """The gait cycles that become known, and when."""
    tracker = GaitTracker(0.042)
    return [(frame.time, cycles_of(tracker, frame)) for frame in frames]


def cycles_of(tracker, frame):
    return [each for each in tracker.add(frame) if each.whole and each.unit == "cycle"]


def so_far_of(result):
    return ConditionSoFar(result.settings.min_valid_share)


def test_cycles_begin_at_strikes_of_the_trial_and_are_known_a_tenth_of_a_second_later(
    result, followed
):
    for side in ("left", "right"):
        true = event_times(result.events, "foot_strike", side)
        ours = [c.start_s for _, cycles in followed for c in cycles if c.side == side]
        nearest = [np.abs(ours - each).min() for each in true[1:-2]]
        assert max(nearest) < 0.04
    delays = [now - cycle.stop_s for now, cycles in followed for cycle in cycles]
    np.testing.assert_allclose(delays, LIMITS.shortest_stance, atol=FRAME_S + 1e-9)


def test_the_running_root_mean_square_is_over_every_frame_of_the_cycles_once(
    result, frames, followed
):
    """Cycles of both sides overlap; all cycles of the trial but the first ones are there."""
    so_far, inside = so_far_of(result), np.zeros(len(frames), bool)
    for _, cycles in followed:
        for cycle in cycles:
            so_far.add(cycle)
            inside |= (result.motion.time >= cycle.start_s) & (result.motion.time < cycle.stop_s)
    inside &= result.counts
    expected = np.sqrt(np.mean(reported(result.measured.residual[inside]) ** 2, axis=0))
    np.testing.assert_allclose(so_far.rms["measured"], expected, rtol=1e-9)
    assert so_far.cycles >= sum(map(len, result.cycles.values())) - 2


def test_a_cycle_has_its_curve_and_the_residuals_of_its_frames(frames, followed):
    cycle = next(cycle for _, cycles in followed[600:] for cycle in cycles)
    inside = [f for f in frames if cycle.start_s <= f.time < cycle.stop_s]
    every = np.array([f.residual["measured"] for f in inside])
    np.testing.assert_allclose(cycle.residual["measured"], every, rtol=1e-9)
    np.testing.assert_allclose(cycle.curve["measured"][0], every[0], rtol=1e-9)
    assert cycle.curve["measured"].shape == (101, 6)


@pytest.mark.parametrize(
    ("flag", "every", "reason"),
    [
        (Quality.NOT_CARRIED, 10, None),
        (Quality.NOT_CARRIED, 1, "plates that do not carry the subject"),
        (Quality.SETTLING, 1, "an end or a gap too near for the filters to settle"),
        (Quality.POSE_UNKNOWN, 10, "frames without a solution or without forces"),
        ("lost", 10, None),
        ("lost for 50 ms", 1, "frames without a solution or without forces"),
    ],
)
def test_gait_cycles_are_left_out_and_counted_as_in_trials(result, frames, flag, every, reason):
    tracker, so_far = GaitTracker(0.042), so_far_of(result)
    for k, frame in enumerate(frames):
        doubtful = frame.time > 8 and k % every == 0
        if doubtful and (flag == "lost" or (flag == "lost for 50 ms" and k % 50 < 4)):
            continue
        more = flag if doubtful and isinstance(flag, Quality) else Quality(0)
        for cycle in cycles_of(tracker, replace(frame, quality=frame.quality | more)):
            so_far.add(cycle)
    counted = so_far.left_out
    assert all("to settle" in other for other in set(counted) - {reason})
    assert (counted[reason] > 2) == (reason is not None)
    assert so_far.cycles > 2


def test_steps_follow_one_another_and_are_those_of_the_trial(result, frames):
    tracker = GaitTracker(0.042)
    steps = [e for frame in frames for e in tracker.add(frame) if e.unit == "step"]
    np.testing.assert_array_equal([a.stop_s for a in steps[:-1]], [b.start_s for b in steps[1:]])
    assert [a.side for a in steps[:-1]] != [b.side for b in steps[1:]]
    of_trial = np.sort(
        np.concatenate([event_times(result.events, "foot_strike", side) for side in SIDES])
    )
    within = [step for step in steps if of_trial[0] - 0.1 < step.start_s < of_trial[-1] + 0.1]
    assert len(within) > 8
    assert max(np.abs(of_trial - step.start_s).min() for step in within) < 0.04


def test_where_the_plates_carry_a_step_alone_the_summary_is_of_that_step(result, frames):
    """Feet are on the plates from one strike to the next but 0.1 s; strides are carried by less
    than half."""
    tracker, so_far = GaitTracker(0.042), {u: ConditionSoFar(0.6, u) for u in ("cycle", "step")}
    strikes = [e.time for e in result.events if e.label == "foot_strike" and e.time > 8]
    start, stop = sorted(strikes)[:2]
    for frame in frames:
        on = start - 0.03 <= frame.time < stop
        quality = frame.quality | (Quality(0) if on else Quality.NOT_CARRIED)
        for each in tracker.add(replace(frame, quality=quality)):
            if each.whole:
                so_far[each.unit].add(each)
    assert so_far["cycle"].cycles == 0
    assert so_far["step"].cycles == 1


def test_a_subject_who_stands_makes_no_cycle(frames):
    tracker = GaitTracker(0.042)
    for k in range(1000):
        standing = replace(frames[0], time=k * FRAME_S, contact=np.ones(2, bool))
        assert tracker.add(standing) == []


def test_a_pause_is_no_gait_cycle(frames):
    """Walking, 5 s of standing, walking: no cycle spans the pause."""
    tracker, cycles = GaitTracker(0.042), []
    middle = len(frames) // 2
    for k, frame in enumerate([*frames[:middle], *[frames[middle]] * 500, *frames[middle:]]):
        cycles += cycles_of(tracker, replace(frame, time=k * FRAME_S))
    assert len(cycles) > 8
    assert max(cycle.stop_s - cycle.start_s for cycle in cycles) < 1.6


def test_a_cycle_whose_frames_are_gone_after_a_gap_is_none(frames):
    """The foot lands, the stream goes away for 2.4 s, and the foot is still on the ground."""
    tracker, cycles = GaitTracker(0.042), []
    for time, loaded in ((0.0, 0), (0.2, 1), (0.35, 1), (0.8, 0), (1.0, 0), (1.3, 1), (3.7, 1)):
        contact = np.array([bool(loaded), False])
        cycles += cycles_of(tracker, replace(frames[0], time=time, contact=contact))
    assert cycles == []
