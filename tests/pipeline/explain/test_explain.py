"""A trial is explained by the faults that it has."""

import numpy as np
import pytest

from pipeline.explain.budget import EstimatedCause
from pipeline.explain.cause import Cause, Prior
from pipeline.explain.linearise import ExplainedPart, left_by_filter, linearised, rms
from pipeline.explain.series import cycle_series


@pytest.mark.parametrize(
    ("size", "deviation", "certain"),
    [(3.0, 2.0, False), (-5.0, 2.0, True), (8.0, 3.0, False)],
)
def test_a_cause_is_certain_if_it_cannot_be_zero_and_the_trial_tells_so(size, deviation, certain):
    """Of 3 N usually, a deviation of 3 N after the trial says that it told nothing."""
    cause = EstimatedCause("x", "zero", "N", size, deviation, 3.0, 1.0, np.ones(6))
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


def test_a_fault_is_weighed_again_without_what_was_found_of_it_but_skin_as_measured(chain):
    """Plates that read twice the load: half of it is found at first, exp(-1/2) of it left."""

    def louder(of, size):
        return of.changed(wrenches=tuple(np.exp(size) * each for each in of.wrenches))

    def pushed_forward(of, size):
        return of.changed(wrenches=tuple(each * [1 + size, *[1] * 5] for each in of.wrenches))

    causes = (
        Cause("twice", "gain", Prior(0.3, "1", ""), louder),
        Cause("skin of a thigh", "skin", Prior(0.01, "1", ""), pushed_forward),
    )
    spans = chain.time[0] + np.array([[2, 3], [3, 4], [4, 5], [5, 6]])
    twice = louder(chain, np.log(2))
    part = ExplainedPart(twice, causes, cycle_series(chain.time, spans, 6.6), 4)
    as_measured, model, posterior = linearised(part, np.zeros_like(chain.residual))
    first, again = (rms(effects[0][part.counts])[2] for effects in (as_measured, model.effects))
    assert again / first == pytest.approx(np.exp(-1 / 2), rel=0.05)
    assert posterior.size[0] == pytest.approx(np.log(2), abs=0.05)
    np.testing.assert_array_equal(model.effects[1], as_measured[1])
