"""A trial is explained by the faults that it has."""

import numpy as np
import pytest

from pipeline.explain.budget import EstimatedCause
from pipeline.explain.linearise import left_by_filter


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
