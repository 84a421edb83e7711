"""The zero-phase low-pass that experiments 1 and 2 put on all signals that they compare."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from hbm.spatial import Array


def smooth(signal: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """Low-pass evenly sampled signals without delay.

    Parameters
    ----------
    signal
        Samples without gaps, (N, ...).
    rate_hz
        Sampling rate [Hz].
    cutoff_hz
        Cut-off of each pass [Hz]; two passes halve the amplitude there.

    Returns
    -------
    Array
        Second-order Butterworth, forward and backward, (N, ...), as MATLAB's filtfilt
        (van de Loosdrecht 2018, D.2).
    """
    sections = butter(2, cutoff_hz, fs=rate_hz, output="sos")
    return np.asarray(sosfiltfilt(sections, signal, axis=0))
