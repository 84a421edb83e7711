"""Sizes of causes from residuals of gait cycles."""

import numpy as np
import pytest

from pipeline.explain.sizes import MIN_VARIANCE, estimate_sizes

FREQUENCY = np.repeat(np.arange(9), 2)[1:] / 1.1
B = len(FREQUENCY)


def effects_of(rng, causes, cycles):
    """Effects that repeat but for a tenth."""
    mean = rng.normal(size=(causes, 1, B, 6))
    return mean * (1 + 0.1 * rng.normal(size=(causes, cycles, 1, 1)))


def test_without_noise_and_with_few_causes_the_sizes_are_found(rng):
    effects = effects_of(rng, 5, 8)
    true = np.array([1.0, -0.5, 2.0, 0.0, 0.3])
    residual = np.tensordot(true, effects, 1)
    found = estimate_sizes(residual, effects, np.full(5, 2.0), FREQUENCY, np.zeros(5, bool))
    np.testing.assert_allclose(found.size, true, atol=1e-3)


def test_the_sizes_are_those_of_least_squares_with_the_priors_as_observations(rng):
    """One cycle: the variance is that of what no cause describes alone."""
    effects, prior = effects_of(rng, 12, 1), np.linspace(0.5, 2, 12)
    residual = rng.normal(size=(1, B, 6))
    found = estimate_sizes(residual, effects, prior, FREQUENCY, np.zeros(12, bool))
    again = estimate_sizes(residual, effects, prior, FREQUENCY, np.zeros(12, bool))
    deviation = np.tile(np.sqrt(found.unexplained**2 + MIN_VARIANCE), B)
    rows = np.vstack([(effects[:, 0].reshape(12, -1) / deviation).T, np.diag(1 / prior)])
    wanted = np.concatenate([residual.ravel() / deviation, np.zeros(12)])
    expected, *_ = np.linalg.lstsq(rows, wanted)
    np.testing.assert_allclose(found.size, expected, rtol=0.02, atol=1e-3)
    np.testing.assert_array_equal(found.size, again.size)


def test_what_the_residual_does_not_tell_keeps_its_prior(rng):
    effects = effects_of(rng, 3, 6)
    effects[2] = 0
    residual = rng.normal(size=(6, B, 6))
    found = estimate_sizes(
        residual, effects, np.array([1.0, 1.0, 0.7]), FREQUENCY, np.zeros(3, bool)
    )
    assert found.size[2] == pytest.approx(0, abs=1e-12)
    assert found.deviation[2] == pytest.approx(0.7)


@pytest.mark.parametrize("undescribed", [0.0, 1.0])
def test_intervals_contain_the_sizes_as_often_as_they_say(rng, undescribed):
    """Whether causes describe the residual or something besides them does."""
    prior, inside = np.array([1.0, 0.5, 2.0, 1.0]), []
    for _ in range(150):
        effects, true = effects_of(rng, 4, 8), prior * rng.normal(size=4)
        other = undescribed * rng.normal(size=(B, 6))
        noise = 0.5 * rng.normal(size=(8, B, 6))
        residual = np.tensordot(true, effects, 1) + other + noise
        found = estimate_sizes(residual, effects, prior, FREQUENCY, np.zeros(4, bool))
        inside.append(np.abs(found.size - true) < 1.96 * found.deviation)
    # 600 intervals; four standard errors
    assert np.mean(inside) == pytest.approx(0.95, abs=0.036)


def test_more_cycles_do_not_make_sure_what_a_wrong_model_leaves_open(rng):
    """What no cause describes repeats with the cycle: a hundred cycles tell no more of it."""
    deviations = []
    for cycles in (10, 1000):
        effects = np.repeat(effects_of(rng, 4, 1), cycles, axis=1)
        other = rng.normal(size=(B, 6))
        residual = other + 0.3 * rng.normal(size=(cycles, B, 6))
        found = estimate_sizes(residual, effects, np.ones(4), FREQUENCY, np.zeros(4, bool))
        deviations.append(found.deviation)
    assert np.median(deviations[1] / deviations[0]) > 0.7


def test_a_cause_that_follows_the_platform_is_found_in_what_differs_between_cycles(rng):
    """Its effect has no mean: only the differences between cycles tell of it."""
    effects = effects_of(rng, 2, 20)
    effects[1] = rng.normal(size=(20, B, 6))
    effects[1] -= effects[1].mean(axis=0)
    residual = 0.8 * effects[1] + 0.1 * rng.normal(size=(20, B, 6))
    prior = np.ones(2)
    without = estimate_sizes(residual, effects, prior, FREQUENCY, np.array([False, False]))
    found = estimate_sizes(residual, effects, prior, FREQUENCY, np.array([False, True]))
    assert without.deviation[1] == pytest.approx(1.0)
    assert found.size[1] == pytest.approx(0.8, abs=0.02)
