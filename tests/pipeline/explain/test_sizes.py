"""Sizes of causes are found from Fourier coefficients of gait cycles, with how sure they are."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.explain.linearise import MIN_VARIANCE
from pipeline.explain.series import cycle_series
from tests.pipeline.explain.coefficients import estimate_sizes

TIME = np.arange(600) / 100
SPANS = [(0.5, 1.62), (1.62, 2.70), (2.70, 3.85), (3.85, 4.93)]


def waves(seed, harmonics=6):
    """A signal whose Fourier coefficients are those of each cycle, and they."""
    rng = np.random.default_rng(seed)
    signal, coefficients = np.zeros((len(TIME), 6)), rng.normal(size=(4, 2 * harmonics + 1, 6))
    for (start, stop), own in zip(SPANS, coefficients, strict=True):
        inside = (start <= TIME) & (stop > TIME)
        phase = 2 * np.pi * (TIME[inside] - start) / (stop - start)
        signal[inside] = own[0]
        for h in range(1, harmonics + 1):
            pair = own[2 * h - 1 : 2 * h + 1]
            sine, cosine = np.sin(h * phase), np.cos(h * phase)
            signal[inside] += np.sqrt(2) * (np.outer(sine, pair[0]) + np.outer(cosine, pair[1]))
    return signal, coefficients


@given(seed=st.integers(0, 10_000))
def test_the_coefficients_of_sums_of_waves_are_their_own(seed):
    signal, expected = waves(seed)
    found = cycle_series(TIME, SPANS, 6.0).coefficients(signal)
    np.testing.assert_allclose(found[:, : expected.shape[1]], expected, atol=1e-9)


def test_the_sum_of_squares_is_the_mean_square_of_each_cycle():
    signal, _ = waves(1)
    series = cycle_series(TIME, SPANS, 6.0)
    squares = (series.coefficients(signal) ** 2).sum(axis=1)
    means = np.array([np.mean(signal[cycle] ** 2, axis=0) for cycle in series.frames])
    np.testing.assert_allclose(squares, means, rtol=0.05)  # frames do not sample a cycle evenly


def test_several_signals_at_once_and_some_cycles_give_the_same():
    signal, _ = waves(2)
    series = cycle_series(TIME, SPANS, 6.0)
    both = series.coefficients(np.stack([signal, 2 * signal]))
    np.testing.assert_allclose(both[1], 2 * series.coefficients(signal), atol=1e-12)
    np.testing.assert_allclose(series.some(slice(2)).coefficients(signal), both[0, :2], atol=1e-12)


@pytest.mark.parametrize(("to_hz", "harmonics"), [(3.0, 4), (40.0, 18)])
def test_harmonics_reach_what_is_wanted_unless_a_cycle_has_too_few_frames(to_hz, harmonics):
    """Cycles have a median of 1.1 s, and the shortest 108 frames: six for each harmonic."""
    assert len(cycle_series(TIME, SPANS, to_hz).inverse[0]) == 1 + 2 * harmonics


B = 17
"""Of the mean and eight harmonics."""
NEITHER = np.zeros((2, 12), bool)
USUAL = np.zeros(2, bool)
"""No cause that follows the platform, and no rare one."""


def effects_of(rng, causes, cycles):
    """Effects that repeat but for a tenth."""
    mean = rng.normal(size=(causes, 1, B, 6))
    return mean * (1 + 0.1 * rng.normal(size=(causes, cycles, 1, 1)))


def test_the_sizes_are_those_of_least_squares_with_the_priors_as_observations(rng):
    """One cycle: the variance is that of what no cause describes alone."""
    effects, prior = effects_of(rng, 12, 1), np.linspace(0.5, 2, 12)
    residual = rng.normal(size=(1, B, 6))
    found = estimate_sizes(residual, effects, prior, *NEITHER[:, :12])
    again = estimate_sizes(residual, effects, prior, *NEITHER[:, :12])
    deviation = np.tile(np.sqrt(found.undescribed[0] + MIN_VARIANCE), B)
    rows = np.vstack([(effects[:, 0].reshape(12, -1) / deviation).T, np.diag(1 / prior)])
    wanted = np.concatenate([residual.ravel() / deviation, np.zeros(12)])
    expected, *_ = np.linalg.lstsq(rows, wanted)
    np.testing.assert_allclose(found.size, expected, rtol=0.02, atol=1e-3)
    np.testing.assert_array_equal(found.size, again.size)


def test_what_the_residual_does_not_tell_keeps_its_prior(rng):
    effects = effects_of(rng, 3, 6)
    effects[2] = 0
    residual = rng.normal(size=(6, B, 6))
    found = estimate_sizes(residual, effects, np.array([1.0, 1.0, 0.7]), *NEITHER[:, :3])
    assert found.size[2] == pytest.approx(0, abs=1e-12)
    assert found.if_there[1, 2] == pytest.approx(0.7)


@pytest.mark.parametrize("draws", [25, pytest.param(150, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("undescribed", [0.0, 1.0])
def test_intervals_contain_the_sizes_as_often_as_they_say(rng, undescribed, draws):
    """Whether causes describe the residual or something besides them does."""
    prior, inside = np.array([1.0, 0.5, 2.0, 1.0]), []
    for _ in range(draws):
        effects, true = effects_of(rng, 4, 8), prior * rng.normal(size=4)
        other = undescribed * rng.normal(size=(B, 6))
        noise = 0.5 * rng.normal(size=(8, B, 6))
        residual = np.tensordot(true, effects, 1) + other + noise
        found = estimate_sizes(residual, effects, prior, *NEITHER[:, :4])
        inside.append(np.abs(found.size - true) < 1.96 * found.if_there[1])
    # four standard errors of these intervals. Something is always taken to be undescribed.
    allowed = 4 * np.sqrt(0.95 * 0.05 / (4 * draws))
    assert np.mean(inside) > 0.95 - allowed
    if undescribed:
        assert np.mean(inside) < 0.95 + allowed


def test_more_cycles_do_not_make_sure_what_a_wrong_model_leaves_open(rng):
    """What no cause describes repeats with the cycle: a hundred cycles tell no more of it."""
    deviations = []
    for cycles in (10, 1000):
        effects = np.repeat(effects_of(rng, 4, 1), cycles, axis=1)
        other = rng.normal(size=(B, 6))
        residual = other + 0.3 * rng.normal(size=(cycles, B, 6))
        found = estimate_sizes(residual, effects, np.ones(4), *NEITHER[:, :4])
        deviations.append(found.if_there[1])
    assert np.median(deviations[1] / deviations[0]) > 0.7


def test_a_cause_that_follows_the_platform_is_found_in_what_differs_between_cycles(rng):
    """Its effect has no mean: only the differences between cycles tell of it."""
    effects = effects_of(rng, 2, 20)
    effects[1] = rng.normal(size=(20, B, 6))
    effects[1] -= effects[1].mean(axis=0)
    residual = 0.8 * effects[1] + 0.1 * rng.normal(size=(20, B, 6))
    prior = np.ones(2)
    without = estimate_sizes(residual, effects, prior, np.array([False, False]), USUAL)
    found = estimate_sizes(residual, effects, prior, np.array([False, True]), USUAL)
    assert without.if_there[1, 1] == pytest.approx(1.0)
    assert found.size[1] == pytest.approx(0.8, abs=0.02)


CYCLES, TILTED = 30, 11
TILT = np.sin(2 * np.pi * np.arange(CYCLES) / CYCLES)[:, None, None]


def tilted_trial(rng, size, response):
    """Residual and effects: one cause of the plates, one that follows a slow tilt, and a person."""
    cycle, tilted = rng.normal(0, 1, (2, TILTED, 6))
    effects = np.stack([np.tile(cycle, (CYCLES, 1, 1)), TILT * tilted])
    missed, changed = rng.normal(0, 1, (2, TILTED, 6))
    noise = rng.normal(0, 0.3, (CYCLES, TILTED, 6))
    residual = np.tensordot(size, effects, 1) + missed + response * TILT * changed + noise
    return residual, effects


@pytest.mark.parametrize("draws", [20, pytest.param(60, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("response", [0.0, 2.0])
def test_intervals_hold_however_much_a_person_changes_with_the_platform(response, draws):
    rng = np.random.default_rng(4)
    prior, held = np.array([1.0, 1.0]), []
    for _ in range(draws):
        size = rng.normal(0, prior)
        residual, effects = tilted_trial(rng, size, response)
        found = estimate_sizes(residual, effects, prior, np.array([False, True]), USUAL)
        held.append(np.abs(found.size - size) < 1.96 * found.if_there[1])
    assert np.all(np.mean(held, axis=0) > 0.85)


def test_one_cycle_alone_tells_of_its_mean():
    residual, effects = tilted_trial(np.random.default_rng(6), np.array([0.5, 0.5]), 0.0)
    follow = np.array([False, True])
    found = estimate_sizes(residual[:1], effects[:, :1], np.ones(2), follow, USUAL)
    assert np.isfinite(found.size).all()
    assert found.if_there[1, 1] == pytest.approx(1.0)


SIZES = {"0-1": (0.0, 1.0), "1-3": (1.0, 3.0), "3-6": (3.0, 6.0), "6-10": (6.0, 10.0)}
"""Classes of sizes of faults, in usual sizes."""


def faulty_trial(rng, size, told):
    """Eight faults, of which the trial tells by so many standard deviations per usual size, and
    twenty other causes of usual size."""
    every = np.concatenate([size, rng.normal(size=20)])
    effects = rng.normal(size=(28, 1, B, 6))
    effects[:8] *= told / 8
    residual = np.tensordot(every, effects, 1) + rng.normal(size=(1, B, 6))
    return residual, effects, np.ones(28), np.zeros(28, bool), np.arange(28) < 8


LONG = [pytest.param(*case, 60, marks=pytest.mark.campaign) for case in product(SIZES, (0.3, 3.0))]


@pytest.mark.parametrize(("name", "told", "draws"), [("0-1", 0.3, 8), ("6-10", 3.0, 8), *LONG])
def test_faults_of_any_size_are_found_as_large_as_they_are(name, told, draws):
    """Whether the trial tells of them or not, their intervals hold; where it does, they are found
    as large as they are: no prior draws them to zero."""
    rng, held, ratio = np.random.default_rng(3), [], []
    for _ in range(draws):
        size = np.zeros(8)
        size[:2] = rng.uniform(*SIZES[name], 2) * rng.choice([-1, 1], 2)
        found = estimate_sizes(*faulty_trial(rng, size, told))
        held.append(np.abs(found.if_there[0, :8] - size)[:2] < 1.96 * found.if_there[1, :2])
        ratio.append((found.if_there[0, :2] @ size[:2], size @ size))
    # 92 % or more, less two standard errors of these intervals
    assert np.mean(held) > 0.92 - 2 * np.sqrt(0.92 * 0.08 / (2 * draws))
    if told > 1 and name != "0-1":
        projected, square = np.sum(ratio, axis=0)
        assert projected / square == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("draws", [10, pytest.param(40, marks=pytest.mark.campaign)])
def test_absent_faults_are_not_claimed_and_large_ones_are(draws):
    rng, claimed = np.random.default_rng(4), []
    for _ in range(draws):
        size = np.append(rng.uniform(4, 10, 2), np.zeros(6))
        claimed.append(estimate_sizes(*faulty_trial(rng, size, 3.0)).chance[:8] > 0.95)
    assert np.mean(claimed, axis=0)[:2].min() > 0.9
    assert np.mean(claimed, axis=0)[2:].max() < 0.05


def test_a_fault_that_the_trial_does_not_tell_may_be_as_large_as_faults_are():
    rng = np.random.default_rng(5)
    found = estimate_sizes(*faulty_trial(rng, np.zeros(8), 0.0))
    np.testing.assert_allclose(found.if_there[1, :8], 6.0, rtol=0.01)
    np.testing.assert_allclose(found.chance[:8], 0.5, atol=0.06)


def test_of_two_faults_that_do_the_same_either_may_be_there():
    rng = np.random.default_rng(6)
    size = np.append(8.0, np.zeros(7))
    residual, effects, *rest = faulty_trial(rng, size, 3.0)
    effects[1] = effects[0]
    found = estimate_sizes(residual, effects, *rest)
    assert (found.chance[:2] < 0.95).all()
    assert found.size[:2].sum() == pytest.approx(8.0, abs=1.0)
