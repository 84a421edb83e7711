"""What all instruments have in common: they sample late, hold their values, and add noise."""

from typing import Final

import numpy as np

from hbm.spatial import Array

ANALOG_HZ: Final = 1000.0
FRAME_HZ: Final = 100.0
"""Sampling rate of plates and analog channels, and frame rate of the cameras: the thesis'. Standard
deviations of noise on plates and analog channels are stated for `ANALOG_HZ`."""
SAMPLES_PER_FRAME: Final = round(ANALOG_HZ / FRAME_HZ)


def delayed(values: Array, delay_s: float, time: Array) -> Array:
    """Give what a late instrument reports at the times of the others.

    Parameters
    ----------
    values
        What happens, (N, C).
    delay_s
        How much later the instrument is [s].
    time
        Sample times, (N,) [s].

    Returns
    -------
    Array
        The values ``delay_s`` earlier, interpolated linearly, (N, C); the first value before there
        are any.
    """
    if delay_s == 0:
        return values
    return np.column_stack([np.interp(time - delay_s, time, column) for column in values.T])


def noise_sd_at(sd: float, rate_hz: float) -> float:
    """Give the standard deviation at a sampling rate of white noise stated for `ANALOG_HZ`.

    Its density stays the same.
    """
    return float(sd * np.sqrt(rate_hz / ANALOG_HZ))
