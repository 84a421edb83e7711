"""The real-time Butterworth filter of the Human Body Model, sample by sample."""

from typing import Final

import numpy as np

from hbm.spatial import Array

MAX_STEP_PERIODS: Final = 0.25
"""Of the cut-off: over a longer step from one sample to the next the filter would follow nothing of
what happened between, so that it begins anew as after a gap."""


class RealtimeFilter:
    """The filter of `hbm.signals.filtering.butterworth` with ``method="realtime"``, as it runs.

    Parameters
    ----------
    cutoff_hz
        Cut-off [Hz].
    columns
        Number of signals K.

    Attributes
    ----------
    value, velocity, acceleration
        Of the last step, (K,): filtered signal and derivatives; the next step makes new arrays.

    Examples
    --------
    >>> smooth = RealtimeFilter(6.0, 1)
    >>> for k in range(200):
    ...     smooth.step(k / 100, np.array([2 * k / 100]))
    >>> f"{smooth.value[0]:.3f} {smooth.velocity[0]:.3f}"  # of a ramp, 37.5 ms late
    '3.905 2.000'
    """

    def __init__(self, cutoff_hz: float, columns: int) -> None:
        omega = 2 * np.pi * cutoff_hz
        self.a, self.b = omega**2, np.sqrt(2) * omega
        self.longest_s = longest_step_s(cutoff_hz)
        self.time = -np.inf
        self.value, self.velocity, self.acceleration, self.before = np.full((4, columns), np.nan)

    def step(self, time: float, signal: Array) -> None:
        """Take the next sample, (K,), at its time [s]; a NaN is a gap, after which it starts anew.

        Parameters
        ----------
        time
            After that of the last step [s].
        signal
            (K,).
        """
        h, self.time = time - self.time, time
        if h > self.longest_s:
            self.before[:] = np.nan
            h = self.longest_s
        y, v, x = self.value, self.velocity, (self.before + signal) / 2
        a, b = self.a, self.b
        divisor = 4 + 2 * h * b + h * h * a
        value = ((4 + 2 * h * b - h * h * a) * y + 4 * h * v + 2 * h * h * a * x) / divisor
        velocity = (-4 * h * a * y + (4 - 2 * h * b - h * h * a) * v + 4 * h * a * x) / divisor
        self.acceleration = (velocity - v) / h
        self.value, self.velocity, self.before = value, velocity, signal.copy()
        begins = np.isnan(value)
        if begins.any():
            self.value[begins] = signal[begins]
            still = np.where(np.isnan(signal[begins]), np.nan, 0.0)
            self.velocity[begins] = self.acceleration[begins] = still


def longest_step_s(cutoff_hz: float) -> float:
    """Give the longest step between samples that is no gap for the filter [s]."""
    return MAX_STEP_PERIODS / cutoff_hz


def acceleration_lag_s(time: Array) -> float:
    """Give by how much accelerations of the filter are older than its values: half a step [s].

    Parameters
    ----------
    time
        Of its steps, (T,) [s].

    Examples
    --------
    >>> acceleration_lag_s(np.arange(5) / 100)
    0.005
    """
    return float(np.median(np.diff(time))) / 2
