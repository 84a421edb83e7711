"""Observed power and the interval of partial eta squared: published values and invariances."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.statistics.f_test import observed_power, partial_eta_squared_interval
from pipeline.statistics.rm_glm import repeated_measures_glm


@pytest.mark.parametrize(("p", "printed"), [(0.259, 0.184), (0.467, 0.101)])
def test_observed_power_gives_what_the_thesis_printed_for_sex_and_length(p, printed):
    power = observed_power(stats.f.isf(p, 1, 6), 1, 6)
    assert round(power, 3) == printed
    assert round(observed_power(stats.f.isf(p, 1, 7), 1, 7), 3) != printed


@pytest.mark.parametrize("alpha", [0.05, 0.01])
def test_observed_power_of_no_effect_is_the_level_of_significance(alpha):
    assert observed_power(0.0, 2, 16, alpha) == pytest.approx(alpha)
    assert observed_power(1e5, 2, 16, alpha) == pytest.approx(1)


@pytest.mark.parametrize(
    ("f", "df", "low", "high"),
    [(40.72, (2, 18), 0.66, 0.89), (33.77, (1, 9), 0.49, 0.89)],
)
def test_the_interval_of_partial_eta_squared_is_that_of_rs_effectsize(f, df, low, high):
    found = partial_eta_squared_interval(f, *df, confidence=0.9)
    assert tuple(round(bound, 2) for bound in found) == (low, high)


@given(
    st.floats(0, 20) | st.floats(0, 1e30, allow_subnormal=False),
    st.integers(1, 8),
    st.integers(1, 100),
)
@example(7.000641807206912e16, 8, 65)  # both bounds are 1 but for rounding
@settings(deadline=None, max_examples=60)
def test_the_interval_of_partial_eta_squared_excludes_zero_where_f_is_significant(f, df1, df2):
    low, high = partial_eta_squared_interval(f, df1, df2)
    assert 0 <= low <= high <= 1
    assert (low > 0) == (stats.f.sf(f, df1, df2) < 0.025)


@pytest.mark.parametrize("df", [(1, 8), (2, 16), (0.5, 3.2)])
def test_the_interval_of_a_very_large_effect_continues_that_of_a_large_one(df):
    below, above = (partial_eta_squared_interval(f / df[0], *df) for f in (0.999e6, 1.001e6))
    np.testing.assert_allclose(1 - np.array(below), 1 - np.array(above), rtol=0.01)


def test_the_effect_size_is_inside_its_interval():
    values = np.random.default_rng(3).lognormal(3, 0.5, (9, 2, 3))
    for term in repeated_measures_glm(values, "ab"):
        low, high = partial_eta_squared_interval(term.f, term.df1, term.df2)
        assert low <= term.partial_eta_squared <= high


def test_a_very_large_f_has_a_power_of_one():
    for f in np.geomspace(200, 1e5, 300):
        assert observed_power(f, 1, 8) > 1 - 1e-9
