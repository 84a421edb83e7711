"""Shares of the mean square are fair among groups of causes, with how sure they are."""

from itertools import permutations
from math import factorial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.explain.explain import Shares, indistinct, shares_of_groups

GROUPS = [[0, 1], [2], [3, 4], [5]]


def alone(shares):
    return [[k] for k in range(len(shares.share))]


def trial(seed):
    rng = np.random.default_rng(seed)
    effects = rng.normal(size=(6, 40, 6))
    size = rng.normal(size=6)
    residual = np.tensordot(size, effects, 1) + rng.normal(size=(40, 6))
    root = 0.1 * rng.normal(size=(6, 6))
    return residual, effects, size, root @ root.T


@given(seed=st.integers(0, 10_000))
def test_shares_are_shapley_values_over_all_orders(seed):
    residual, effects, size, covariance = trial(seed)
    parts = [np.tensordot(size[own], effects[own], 1) for own in GROUPS]
    expected = np.zeros((len(GROUPS), 6))
    for order in permutations(range(len(GROUPS))):
        left = residual.copy()
        for group in order:
            before = (left**2).sum(axis=0)
            left = left - parts[group]
            expected[group] += before - (left**2).sum(axis=0)
    expected /= factorial(len(GROUPS)) * (residual**2).sum(axis=0)
    found = shares_of_groups(residual, effects, size, covariance, GROUPS)
    np.testing.assert_allclose(found.share, expected, atol=1e-9)
    left = residual - sum(parts)
    unexplained = (left**2).sum(axis=0) / (residual**2).sum(axis=0)
    np.testing.assert_allclose(found.unexplained, unexplained, atol=1e-9)


def test_the_covariance_of_shares_is_that_of_sizes_drawn_again(rng):
    residual, effects, size, covariance = trial(3)
    small = 1e-4 * covariance
    drawn = rng.multivariate_normal(size, small, 4000)
    shares = np.array(
        [shares_of_groups(residual, effects, each, small, GROUPS).share for each in drawn]
    )
    found = shares_of_groups(residual, effects, size, small, GROUPS)
    for axis in range(6):
        expected = np.cov(shares[:, :, axis].T)
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(found.covariance[axis] / scale, expected / scale, atol=0.08)


def test_groups_that_do_the_same_are_named_together(rng):
    """A trial knows the sum of two equal effects, not which of them it is."""
    effects = rng.normal(size=(3, 200, 6))
    effects[2] = effects[0] + 1e-3 * rng.normal(size=(200, 6))
    size = np.array([1.0, 1.0, 1.0])
    covariance = 0.64 * np.array([[1, 0, -0.999], [0, 0.001, 0], [-0.999, 0, 1]])
    residual = np.tensordot(size, effects, 1)
    found = shares_of_groups(residual, effects, size, covariance, [[0], [1], [2]])
    assert indistinct(found, alone(found)) == [[0, 2], [1]]
    together = found.joined(indistinct(found, alone(found)))
    assert together.deviation[0] == pytest.approx(np.zeros(6), abs=0.05)
    np.testing.assert_allclose(together.share.sum(axis=0) + together.unexplained, 1, atol=1e-9)


@pytest.mark.parametrize(
    ("share", "correlation", "together"),
    [
        ((0.3, 0.1), -0.6, [[0, 1]]),
        ((0.3, 0.1), -0.4, [[0], [1]]),
        ((0.7, 0.1), -0.6, [[0], [1]]),
    ],
)
def test_two_groups_are_named_together_if_one_has_what_the_other_lacks_and_neither_is_sure(
    share, correlation, together
):
    """Sure to 30 and 10 %; of the last case, the first group is there whatever the second is."""
    covariance = np.array([[0.09, 0.03 * correlation], [0.03 * correlation, 0.01]])
    both = np.repeat(np.array(share)[:, None], 6, axis=1)
    shares = Shares(both, np.tile(covariance, (6, 1, 1)), np.full(6, 0.2))
    assert indistinct(shares, alone(shares)) == together


def test_groups_that_are_sure_stand_alone_unless_they_are_related():
    residual, effects, size, _ = trial(5)
    found = shares_of_groups(residual, effects, size, 1e-6 * np.eye(6), GROUPS)
    assert indistinct(found, alone(found)) == [[0], [1], [2], [3]]
    assert indistinct(found, [[0, 2], [1], [3]]) == [[0, 2], [1], [3]]
