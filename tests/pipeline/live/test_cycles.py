"""Gait cycles that are found live are those of the recording, and so are their residuals."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.live.cycles import KEPT, LiveCycles
from pipeline.live.frame import Quality
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import threshold_rows
from tests.pipeline.live.playing import arrivals, chain_of, play

PERSON = Subject(sex="male", mass_kg=74.6)
REALTIME = Settings(filter="realtime", events="plates")


@pytest.fixture(scope="module")
def whole(walker):
    return process_recording(walker, PERSON, REALTIME)


@pytest.fixture(scope="module")
def frames(walker, whole):
    chain = chain_of(whole.body, Laboratory(Treadmill()), REALTIME, walker)
    return play(chain, arrivals(walker))


@pytest.fixture(scope="module")
def cycles(whole, frames):
    found = LiveCycles(whole.body, 0.5)
    return found, [cycle for frame in frames for cycle in found.step(frame)]


def test_they_begin_and_end_where_the_plates_show_it(whole, cycles):
    for side in ("left", "right"):
        expected = whole.cycles[side]
        found = np.array([(c.start_s, c.stop_s) for c in cycles[1] if c.side == side])
        for span in expected:
            assert np.abs(found - span).max(axis=1).min() < 0.03
    assert len(cycles[1]) <= whole.found_cycles + 4


def test_their_residuals_are_those_of_their_frames(frames, cycles):
    for cycle in cycles[1]:
        inside = [
            f.residual["measured"]
            for f in frames
            if cycle.start_s <= f.time < cycle.stop_s and f.quality.counts
        ]
        rms = np.sqrt(np.mean(np.square(inside), axis=0))
        np.testing.assert_allclose(cycle.rms["measured"], rms, rtol=1e-12)
        largest = np.linalg.norm(np.array(inside)[:, :3], axis=1).max()
        assert cycle.peak_force_n["measured"] == pytest.approx(largest)
    expected = np.sqrt(np.mean([c.rms["measured"] ** 2 for c in cycles[1][-KEPT:]], axis=0))
    np.testing.assert_allclose(cycles[0].running_rms["measured"], expected)


def test_their_limits_are_those_of_the_trial(whole, cycles):
    force, moment = (row.limit for row in threshold_rows(whole) if not row.compensated)
    found = [(c.limit_force_n, c.limit_moment_nm) for c in cycles[1]]
    np.testing.assert_allclose(np.max(found, axis=0), [force, moment], rtol=0.02)


def test_a_gap_of_the_plates_costs_the_cycles_that_it_lies_in(whole, frames, cycles):
    middle = float(np.mean([cycles[1][2].start_s, cycles[1][2].stop_s]))
    gone = [
        replace(f, quality=f.quality | Quality.FORCES_UNKNOWN) if abs(f.time - middle) < 0.02 else f
        for f in frames
    ]
    found = LiveCycles(whole.body, 0.5)
    left = [(c.side, c.start_s) for f in gone for c in found.step(f)]
    lost = [c for c in cycles[1] if (c.side, c.start_s) not in left]
    spans = [(c.side, round(c.start_s - middle, 2), round(c.stop_s - middle, 2)) for c in lost]
    assert 1 <= len(lost) <= 4, spans
    assert all(stop > -0.03 and start < 1.0 for _, start, stop in spans), spans


def test_a_cycle_of_which_too_little_counts_is_left_out(whole, frames):
    doubtful = [replace(f, quality=f.quality | Quality.SETTLING) for f in frames]
    found = LiveCycles(whole.body, 0.5)
    assert not [cycle for frame in doubtful for cycle in found.step(frame)]
    assert found.running_rms == {}
