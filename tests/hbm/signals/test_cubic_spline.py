"""The cubic spline: exact for cubics, through every sample, and that of the general solver."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

from hbm.signals.cubic_spline import REACH, cubic_spline

SAMPLES = st.integers(4, 400)
SEEDS = st.integers(0, 2**32 - 1)


def scattered(samples, seed, columns=3):
    return np.random.default_rng(seed).normal(size=(samples, columns))


@given(samples=SAMPLES, seed=SEEDS, start_s=st.floats(-1000, 1000))
def test_equal_steps_give_the_spline_of_the_general_solver(samples, seed, start_s):
    values, time = scattered(samples, seed), start_s + np.arange(samples) / 1000
    at = np.random.default_rng(seed).uniform(time[0], time[-1], 50)
    np.testing.assert_allclose(
        cubic_spline(time, values, at), make_interp_spline(time, values)(at), atol=1e-9
    )


@given(
    samples=st.integers(2 * REACH, 400),
    seed=SEEDS,
    every=st.integers(1, 12),
    share=st.floats(0.001, 0.999),
)
def test_times_with_equal_steps_give_what_the_same_times_give_in_any_order(
    samples, seed, every, share
):
    values, time = scattered(samples, seed), np.arange(samples) / 1000
    at = (np.arange(3, samples - 1, every) + share) / 1000
    order = np.random.default_rng(seed).permutation(len(at))
    found = cubic_spline(time, values, at)
    np.testing.assert_allclose(found[order], cubic_spline(time, values, at[order]), atol=1e-9)


@given(samples=SAMPLES, seed=SEEDS)
def test_a_cubic_is_met_exactly_up_to_both_ends(samples, seed):
    time = np.arange(samples) / 100
    at = np.linspace(time[0], time[-1], 77)
    powers = np.arange(4)
    factors = scattered(4, seed)
    wanted = (at[:, None] / time[-1]) ** powers @ factors
    found = cubic_spline(time, (time[:, None] / time[-1]) ** powers @ factors, at)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_unequal_steps_have_their_own_spline():
    time = np.cumsum(np.random.default_rng(2).uniform(0.5, 1.5, 200)) / 100
    at = np.linspace(time[0], time[-1], 300)
    found = cubic_spline(time, np.sin(5 * time)[:, None], at)
    np.testing.assert_allclose(found[:, 0], np.sin(5 * at), atol=2e-5)
