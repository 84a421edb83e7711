"""Means over tenths of a second, and how far markers move in them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.trial.subject import common_tenths, median_extent, tenths


@given(start=st.floats(-5, 5), rate_hz=st.sampled_from([100, 1000]))
def test_means_are_over_the_samples_of_their_tenth(start, rate_hz):
    time = start + np.arange(3 * rate_hz) / rate_hz
    values = np.floor((time - start) * 10 + 1e-6)
    found = tenths(values, time, start + 1.0, 10)
    np.testing.assert_allclose(found, np.arange(10, 20))


def test_missing_samples_do_not_count_and_a_tenth_without_any_is_unknown():
    values = np.arange(30.0)
    values[3:10], values[20:] = np.nan, np.nan
    found = tenths(values, np.arange(30) / 100, 0.0, 3)
    np.testing.assert_array_equal(found, [1.0, 14.5, np.nan])


def test_signals_of_different_rates_and_starts_share_their_tenths():
    markers, plates = np.arange(100) / 100, 0.2 + np.arange(1000) / 1000
    assert common_tenths(markers) == (0.0, 10)
    assert common_tenths(markers, plates) == (0.2, 8)
    assert common_tenths(markers, plates + 5) == (5.2, 0)
    assert common_tenths(markers[:1], plates) == (0.2, 0)


@pytest.mark.parametrize("moving", [0, 2, 3, 5])
def test_the_median_marker_s_path_counts(moving):
    position = np.zeros((10, 5, 3))
    position[:, :moving, 0] = np.linspace(0, 0.3, 10)[:, None]
    position[:, :moving, 2] = np.linspace(0, 0.4, 10)[:, None]
    assert median_extent(position) == pytest.approx(0.5 if moving > 2 else 0.0)
