"""A trial is explained by the faults that it has."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Treadmill
from pipeline.explain.budget import EstimatedCause
from pipeline.explain.explain import explain_trial
from pipeline.explain.linearise import left_by_filter
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording

STILL = Laboratory(Treadmill())


def with_fault(recording, delay_s=0.0, zero=(0, 0, 0, 0, 0, 0)):
    """Give a recording whose plates are late, and the first of which has a zero error."""
    first, *others = (replace(p, time=p.time + delay_s) for p in recording.plates)
    first = replace(first, wrench_in_plate=first.wrench_in_plate + zero)
    return replace(recording, plates=(first, *others))


@pytest.fixture(scope="module")
def faulty(walk):
    """A delay of 12 ms and 4 N to the side."""
    recording = with_fault(walk[0], 0.012, (0, 4, 0, 0, 0, 0))
    result = process_recording(recording, walk[1].subject, walk[1].settings)
    return result, explain_trial(recording, STILL, result)


def test_the_headline_is_the_measured_residual(faulty):
    result, budget = faulty
    side = max(result.cycles, key=lambda each: len(result.cycles[each]))
    start, stop = result.cycles[side][0][0], result.cycles[side][-1][1]
    inside = (result.motion.time >= start) & (result.motion.time < stop)
    expected = np.sqrt(np.mean(result.measured.residual[inside] ** 2, axis=0))
    np.testing.assert_allclose(budget.rms, expected, rtol=0.02)


@pytest.mark.parametrize(
    ("name", "true"), [("plates are late", 0.012), ("plate 1: zero of Fy", 4.0)]
)
def test_a_planted_fault_is_found(faulty, name, true):
    found = next(cause for cause in faulty[1].causes if cause.name == name)
    assert abs(found.size - true) < 1.96 * found.deviation
    assert found.size == pytest.approx(true, rel=0.35)


def test_causes_found_in_one_half_of_the_cycles_take_the_others_residual_away(faulty):
    assert (faulty[1].held_out[:2] > 0.8).all()


@pytest.mark.parametrize(
    ("size", "deviation", "certain"),
    [(3.0, 2.0, False), (-5.0, 2.0, True), (8.0, 3.0, False)],
)
def test_a_cause_is_certain_if_it_cannot_be_zero_and_the_trial_tells_so(size, deviation, certain):
    """Of 3 N usually, a deviation of 3 N after the trial says that it told nothing."""
    cause = EstimatedCause("x", "zero", "N", size, deviation, 3.0, np.ones(6))
    assert cause.is_certain == certain


def test_a_body_that_only_moves_up_and_down_leaves_nothing_to_the_filter(chain):
    """Its equations are linear, and filters of coordinates and forces commute with them."""
    q = np.zeros_like(chain.q)
    q[:, 2] = 1.0 + 0.02 * np.sin(2 * np.pi * 2.0 * chain.time)
    wrenches = [np.zeros_like(each) for each in chain.wrenches]
    moving = chain.changed(q=q, wrenches=wrenches)
    left = left_by_filter(moving)[200:-200]
    # what the filter with the higher cut-off takes of the motion, 1e-4 of it
    assert np.abs(left[:, :3]).max() < 1e-3 * np.abs(moving.residual[200:-200, 2]).max()


def test_a_walking_body_leaves_something_to_the_filter(chain):
    left = left_by_filter(chain)[200:-200]
    assert 0.1 < np.sqrt(np.mean(left[:, 2] ** 2)) < 10
