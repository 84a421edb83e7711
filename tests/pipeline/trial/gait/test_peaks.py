"""Peaks of the feet's distance are those that SciPy finds."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from pipeline.trial.gait.events import find_peaks

HEIGHTS = st.integers(-6, 6) | st.floats(-6, 6, allow_nan=False)


@given(st.lists(HEIGHTS, max_size=40), st.integers(1, 9), st.floats(0, 4))
def test_peaks_are_those_of_scipy(values, apart, prominence):
    """Also flat ones, at the ends, and equally high ones."""
    values = np.repeat(np.array(values, float), 1 + np.arange(len(values)) % 3)  # some are flat
    expected, _ = signal.find_peaks(values, distance=apart, prominence=prominence)
    assert find_peaks(values, apart, prominence).tolist() == expected.tolist()
