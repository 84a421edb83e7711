"""How sure the RMS of residuals is agrees with known answers and with drawing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config.schema import Treadmill
from pipeline.explain.cause import Cause, priors
from pipeline.explain.linearise import explained_part
from pipeline.explain.uncertainty import (
    drawn_rms,
    measured_uncertainty,
    noise_of_samples,
    shared_sizes,
)
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline.explain.monte_carlo import draw_residuals
from tests.pipeline.explain.monte_carlo import drawn_rms as rms_of_draws

NO_NOISE = np.zeros(6)
TIME = np.linspace(0, 1, 200)


def waves(*sizes):
    """Effects that are sines of different frequencies in all axes."""
    return np.array(
        [
            size * np.repeat(np.sin(2 * np.pi * (k + 1) * TIME)[:, None], 6, 1)
            for k, size in enumerate(sizes)
        ]
    )


def propagated(residual, usual, noise=NO_NOISE, samples=1.0):
    """Mean and deviation of the RMS: over so many draws, sure to 1 %."""
    sizes = np.random.default_rng(7).standard_normal((20_000, len(usual) + 1))
    drawn = drawn_rms(residual, usual, noise, samples, sizes)
    return drawn.mean(axis=0), drawn.std(axis=0)


def test_a_small_error_of_the_residuals_own_shape_changes_the_rms_by_its_own():
    _, deviation = propagated(waves(10.0)[0], waves(0.01))
    np.testing.assert_allclose(deviation, 0.01 / np.sqrt(2), rtol=0.02)


def test_errors_of_another_shape_add_by_their_squares_alone():
    residual = waves(10.0)[0]
    mean, deviation = propagated(residual, waves(0.0, 3.0)[1:])
    # s² of one error, of mean 1 and deviation √2, adds to the mean square
    square = (residual**2).mean(axis=0)
    added = (waves(0.0, 3.0)[1] ** 2).mean(axis=0)
    np.testing.assert_allclose(mean**2 + deviation**2, square + added, rtol=0.01)
    assert (mean > np.sqrt(square)).all()
    np.testing.assert_allclose(deviation, added / np.sqrt(2 * square), rtol=0.15)


def test_the_rms_of_a_longer_time_is_surer_of_noise_and_no_surer_of_a_cause():
    residual, usual, noise = waves(10.0)[0], waves(0.5), np.ones(6)
    tiled, usual_tiled = np.tile(residual, (4, 1)), np.tile(usual, (1, 4, 1))
    np.testing.assert_allclose(
        propagated(tiled, usual_tiled)[1], propagated(residual, usual)[1], rtol=0.02
    )
    short = propagated(residual, 0 * usual, noise, 0.1)[1]
    long = propagated(tiled, 0 * usual_tiled, noise, 0.1)[1]
    np.testing.assert_allclose(long, short / 2, rtol=0.02)


@settings(max_examples=8)
@given(
    st.lists(st.floats(0.1, 5.0), min_size=1, max_size=5),
    st.floats(0.0, 10.0),
    st.integers(0, 2**32 - 1),
)
def test_mean_and_deviation_are_those_of_drawn_sums(sizes, own, seed):
    """Gaussian sizes, drawn and squared without the formulas of the delta method."""
    rng = np.random.default_rng(seed)
    mixed = np.einsum("kl,ltx->ktx", rng.uniform(-1, 1, (len(sizes),) * 2), waves(*sizes))
    residual = own * mixed[0] + 1.0
    drawn = residual + np.tensordot(rng.standard_normal((4000, len(sizes))), mixed, 1)
    rms = np.sqrt((drawn**2).mean(axis=1))[:, 0]
    mean, deviation = propagated(residual, mixed)
    assert mean[0] == pytest.approx(rms.mean(), rel=0.05)
    assert deviation[0] == pytest.approx(rms.std(), rel=0.15)


def of_some_cycles(result, count):
    """Draws solve the inverse kinematics again, so that every frame costs."""
    side, cycles = max(result.cycles.items(), key=lambda own: len(own[1]))
    return replace(result, cycles={side: cycles[:count]})


@pytest.fixture(scope="module")
def result(walk):
    return of_some_cycles(walk[1], 1)


@pytest.fixture(scope="module")
def part(walk, result):
    found = explained_part(walk[0], Laboratory(Treadmill()), result)
    assert np.isfinite(found.chain.residual).all()  # first: effects keep its steps
    return found


@pytest.fixture(scope="module")
def effects(part):
    return np.nan_to_num([cause.effect(part.chain) for cause in part.causes])


def test_noise_of_samples_passes_the_filter_of_the_trial(part):
    sharp = part.chain.changed(settings=part.chain.settings.model_copy(update={"cutoff_hz": 3.0}))
    assert (noise_of_samples(sharp) < noise_of_samples(part.chain)).all()


def test_a_draw_without_causes_is_the_residual_and_noise(part):
    (drawn,) = draw_residuals(part.chain, [], 1)
    difference = np.sqrt(((drawn - part.chain.residual) ** 2).mean(axis=0))
    np.testing.assert_allclose(difference, noise_of_samples(part.chain, seed=3), rtol=0.3)


@pytest.mark.parametrize("kind", ["markers' place", "knee: axis", "zero of Fz"])
def test_one_drawn_cause_does_what_its_effect_says(part, kind):
    """Through the inverse kinematics, which effects have linearised."""
    own = next(cause for cause in part.causes if kind in cause.name)
    (with_it,) = draw_residuals(part.chain, [own], 1, seed=1)
    (noise,) = draw_residuals(part.chain, [_nothing(own)], 1, seed=1)
    size = np.random.default_rng(1).standard_normal() * own.prior.size
    expected = size * own.effect(part.chain)
    missed = with_it - noise - expected
    assert np.linalg.norm(missed) < 0.1 * np.linalg.norm(expected)


def _nothing(cause):
    """A cause that takes a draw and does nothing."""
    return Cause("nothing", "zero", cause.prior, lambda chain, size: chain)


def cause(group, name="error", along=None):
    return Cause(name, group, priors()["delay"], lambda chain, size: chain, along=along)


@pytest.mark.parametrize(
    ("group", "alike"),
    [
        ("delay", {"another trial", "another subject"}),
        ("inertia", {"another trial"}),
        ("zero", set()),
    ],
)
def test_a_size_is_drawn_alike_in_all_that_shares_the_cause(group, alike):
    own = shared_sizes([cause(group)], "sub01", "walk.c3d", 50)
    others = {
        "another trial": shared_sizes([cause(group)], "sub01", "sway.c3d", 50),
        "another subject": shared_sizes([cause(group)], "sub02", "walk.c3d", 50),
    }
    assert {name for name, other in others.items() if (other == own)[:, 0].all()} == alike


def test_directions_of_two_trials_covary_as_far_as_they_point_the_same_way():
    """Combinations of the same errors of a calibration."""
    first, second = np.array([1.0, 0.0, 0.0]), np.array([0.6, 0.8, 0.0])
    sizes = [
        shared_sizes([cause("compensation", name, along)], "s", name, 20_000)[:, 0]
        for name, along in (("walk", first), ("sway", second))
    ]
    np.testing.assert_allclose(np.cov(sizes), [[1.0, 0.6], [0.6, 1.0]], atol=0.03)


def test_bands_hold_two_thirds_of_the_draws(part, effects, result):
    *_, bands = measured_uncertainty(part, effects, noise_of_samples(part.chain), result)
    drawn = np.array(
        [residual[part.counts] for residual in draw_residuals(part.chain, part.causes, 30)]
    )
    spread = (drawn - part.chain.residual[part.counts]).std(axis=0)
    ratio = np.sqrt((spread**2).mean(axis=0) / (bands.deviation**2).mean(axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.3)


@pytest.mark.campaign
@pytest.mark.parametrize("trial", ["walk", "moving"])
def test_delta_method_and_monte_carlo_agree_within_a_tenth(trial, request):
    """Three standard errors of the draws' own deviation are allowed besides."""
    recording, *laboratory, result = request.getfixturevalue(trial)
    result = of_some_cycles(result, 2)
    (laboratory,) = laboratory or [Laboratory(Treadmill())]
    draws, found = 200, explained_part(recording, laboratory, result)
    assert np.isfinite(found.chain.residual[found.counts]).all()
    effects = np.nan_to_num([cause.effect(found.chain) for cause in found.causes])
    drawn = rms_of_draws(found, draws)
    delta = measured_uncertainty(found, effects, noise_of_samples(found.chain), result)[0][-1]
    error = 1 / np.sqrt(2 * draws)
    np.testing.assert_allclose(delta.deviation, drawn.std(axis=0, ddof=1), rtol=0.1 + 3 * error)
    np.testing.assert_allclose(delta.draws.mean(axis=0), drawn.mean(axis=0), rtol=0.1)


def test_what_is_hidden_in_a_residual_is_taken_away_in_squares():
    """A residual of two waves, of which more markers would show one alone."""
    shown, hidden = waves(3.0, 4.0)
    square = np.tile((hidden**2).mean(axis=0), (10, 1))
    nothing = waves(0.0), NO_NOISE, 1.0, np.zeros((10, 2))
    drawn = drawn_rms(shown + hidden, *nothing, square)
    np.testing.assert_allclose(drawn, np.full((10, 6), 3.0 / np.sqrt(2)), rtol=0.01)
    assert not drawn_rms(hidden, *nothing, 2 * square).any(), "no mean square is below zero"
