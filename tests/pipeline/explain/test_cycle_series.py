"""Fourier coefficients of gait cycles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.explain.sizes import cycle_series

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


@pytest.mark.parametrize(("to_hz", "harmonics"), [(3.0, 4), (9.0, 10), (40.0, 18)])
def test_harmonics_reach_what_is_wanted_unless_a_cycle_has_too_few_frames(to_hz, harmonics):
    """Cycles have a median of 1.1 s, and the shortest 108 frames: six for each harmonic."""
    series = cycle_series(TIME, SPANS, to_hz)
    assert series.frequency[0] == 0
    assert series.frequency[-1] == pytest.approx(harmonics / 1.1)
