"""How many subjects a comparison needs: by simulation, and where no number is enough."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.statistics.sample_size import noninferiority_power, subjects_needed

ALPHA = 0.05 / 5 / 2
"""One side of a simultaneous interval over five pairs."""


def simulated_power(n, sd, mean, margin, alpha, studies=20_000):
    """Share of simulated studies whose upper confidence bound is at most the margin."""
    differences = np.random.default_rng(n).normal(mean, sd, (studies, n))
    half = stats.t.ppf(1 - alpha, n - 1) * stats.sem(differences, axis=1)
    return float(np.mean(differences.mean(axis=1) + half <= margin))


@pytest.mark.parametrize(("sd", "mean"), [(3.0, 0.0), (6.0, 0.0), (6.0, 3.0), (12.0, -2.0)])
def test_the_number_has_80_percent_power_in_simulated_studies_and_one_less_has_not(sd, mean):
    margin = 8.0
    n = subjects_needed(sd, margin - mean, ALPHA)
    error = 3 * np.sqrt(0.8 * 0.2 / 20_000)
    assert simulated_power(n, sd, mean, margin, ALPHA) >= 0.8 - error
    assert simulated_power(n - 1, sd, mean, margin, ALPHA) < 0.8 + error
    assert noninferiority_power(n - 1, sd, margin - mean, ALPHA) < 0.8


@given(
    st.integers(2, 60),
    st.floats(0.5, 20),
    st.floats(0.5, 20),
)
@settings(deadline=None, max_examples=50)
def test_power_grows_with_subjects_and_room_and_falls_with_variance(n, sd, room):
    power = noninferiority_power(n, sd, room, ALPHA)
    assert 0 <= power <= 1
    rounding = 1e-9
    assert noninferiority_power(n + 1, sd, room, ALPHA) >= power - rounding
    assert noninferiority_power(n, sd, 1.1 * room, ALPHA) >= power - rounding
    assert noninferiority_power(n, 1.1 * sd, room, ALPHA) <= power + rounding


@given(st.floats(0.05, 20), st.floats(0.05, 20), st.floats(1, 1000))
@settings(deadline=None, max_examples=50)
def test_the_unit_is_irrelevant(sd, room, unit):
    assert subjects_needed(sd, room, ALPHA) == subjects_needed(unit * sd, unit * room, ALPHA)


def test_no_number_shows_a_difference_that_exceeds_the_margin():
    assert subjects_needed(1.0, 0.0, ALPHA) is None
    assert subjects_needed(1.0, -1.0, ALPHA) is None


def test_a_number_beyond_a_thousand_is_none():
    assert subjects_needed(100.0, 1.0, ALPHA) is None


@pytest.mark.parametrize("sd", [0.0, 1e-300, 1e-12, 1e-4])
def test_subjects_who_all_agree_need_two(sd):
    assert subjects_needed(sd, 1.0, ALPHA) == 2
