"""Signals at other times than they were sampled at: without aliases, never across a gap."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline
from scipy.signal import firwin, kaiserord, oaconvolve

from hbm.signals.samples import (
    extended,
    mean_rate_hz,
    require_equal_steps,
    require_length,
    sample_times,
    stretches,
)
from hbm.spatial import Array

STOPBAND_DB = 80.0
"""How far :func:`resample` suppresses what would otherwise fold back below the new Nyquist."""


def resample(
    time: ArrayLike, values: ArrayLike, new_time: ArrayLike, *, delay_s: float = 0.0
) -> Array:
    """Bring a signal to other sample times without shifting it and without aliasing.

    Parameters
    ----------
    time
        Sample times, (N,) [s], increasing; equal steps where ``new_time`` is coarser.
    values
        Samples, (N, ...). Gaps (NaN) stay gaps.
    new_time
        Wanted times, (T,) [s], increasing.
    delay_s
        How much later than the clock of ``new_time`` the values were stamped [s]: the result at
        ``t`` is the signal at ``t + delay_s``.

    Returns
    -------
    Array
        Values at ``new_time``, (T, ...); NaN outside the recorded time and inside gaps.

    Raises
    ------
    ValueError
        If times do not increase or do not fit the values, or if there are too few samples.

    Notes
    -----
    Where ``new_time`` is coarser, a symmetric Kaiser-windowed FIR filter runs first: flat up to 0.4
    of the new rate, ``STOPBAND_DB`` down from 0.6 of it, so that nothing folds back below 0.4 of
    the new rate (40 Hz at 100 Hz). Being symmetric it delays nothing once its centre is taken as
    its time. :func:`interpolate` follows.
    """
    values, new_time = np.asarray(values, float), np.asarray(new_time, float)
    time = sample_times(time, values)
    new_rate_hz = mean_rate_hz(sample_times(new_time, new_time))
    if new_rate_hz < 0.99 * mean_rate_hz(time):
        values = _without_aliases(values, time, new_rate_hz)
    return interpolate(time, values, new_time + delay_s)


def interpolate(time: ArrayLike, values: ArrayLike, at: ArrayLike) -> Array:
    """Evaluate the cubic spline through samples, never across a gap and never beyond the ends.

    Parameters
    ----------
    time
        Sample times, (N,) [s], increasing.
    values
        Samples, (N, ...). Stretches of fewer than 4 samples between gaps (NaN) become gaps.
    at
        Wanted times in any order, any shape (S) [s].

    Returns
    -------
    Array
        Values there, (S, ...); NaN outside the recorded time and inside gaps.

    Raises
    ------
    ValueError
        If times do not increase or do not fit the values, or if there are fewer than 4 samples.
    """
    values, at = np.asarray(values, float), np.asarray(at, float)
    time = sample_times(time, values)
    require_length(time, 4)
    wanted, rounding = at.ravel(), 1e-6 / mean_rate_hz(time)
    columns = values.reshape(len(time), -1)
    result = np.full((len(wanted), columns.shape[1]), np.nan)
    for rows, alike in stretches(columns, 4):
        first, last = time[rows][[0, -1]]
        inside = (wanted >= first - rounding) & (wanted <= last + rounding)
        spline = make_interp_spline(time[rows], columns[rows, alike])
        result[np.ix_(inside, alike)] = spline(wanted[inside])
    return result.reshape(*at.shape, *values.shape[1:])


def _without_aliases(signal: Array, time: Array, new_rate_hz: float) -> Array:
    """Take from (N, ...) samples what a lower sampling rate cannot show."""
    require_equal_steps(time)
    rate_hz = mean_rate_hz(time)
    length, beta = kaiserord(STOPBAND_DB, 0.2 * new_rate_hz / (rate_hz / 2))
    reach = length // 2
    require_length(time, reach + 1)
    taps = firwin(2 * reach + 1, new_rate_hz / 2, window=("kaiser", beta), fs=rate_hz)[:, None]
    columns = signal.reshape(len(time), -1)
    result = np.full(columns.shape, np.nan)
    for rows, alike in stretches(columns, reach + 1):
        longer = extended(columns[rows, alike], reach)
        result[rows, alike] = oaconvolve(longer, taps, "valid", axes=0)
    return np.reshape(result, signal.shape)
