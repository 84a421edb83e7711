"""Splines through samples are those that SciPy computes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

from hbm.signals.samples import cubic_spline


@given(
    st.lists(st.tuples(st.floats(0.5, 2), st.floats(-9, 9)), min_size=4, max_size=30),
    st.lists(st.floats(-0.1, 1.1), min_size=1, max_size=30),
)
def test_a_cubic_spline_is_that_of_scipy_also_beyond_its_ends(samples, shares):
    step, value = np.array(samples).T
    time, values = np.cumsum(step), np.column_stack([value, np.cos(value)])
    at = time[0] + np.array(shares) * (time[-1] - time[0])
    expected = make_interp_spline(time, values)(at)
    largest = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(cubic_spline(time, values)(at), expected, atol=1e-11 * largest)
