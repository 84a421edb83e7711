"""Signals at other sample times: without aliasing, without delay, never across a gap."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import firwin, kaiserord, oaconvolve

from hbm.signals.convolution import Convolution
from hbm.signals.cubic_spline import MAX_ROUNDING_STEPS, cubic_spline
from hbm.signals.samples import (
    blocks_without_gaps,
    extended,
    mean_rate_hz,
    require_equal_steps,
    require_length,
    sample_times,
    unknown,
)
from hbm.spatial import Array

STOPBAND_DB: Final = 80.0
"""Attenuation of what would otherwise alias: to a ten-thousandth, below the noise of any plate."""

TRANSITION_WIDTH: Final = 0.2
"""Transition band of the anti-aliasing filter, as a share of the new rate: from 0.4 to 0.6 of
it."""

MIN_DECIMATION: Final = 0.99
"""New rate as share of the old one, from which on rates count as equal and nothing can alias."""

MIN_SPLINE_SAMPLES: Final = 4
"""Of a cubic spline."""

ROUNDING_STEPS: Final = 1e-6
"""Time beyond the ends of a block, in samples, that is treated as rounding error."""


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
        Delay of the values' time stamps against the clock of ``new_time`` [s]: the result at ``t``
        is the signal at ``t + delay_s``.

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
    Where ``new_time`` is coarser, a symmetric Kaiser-windowed FIR filter is applied first: flat up
    to 0.4 of the new rate, ``STOPBAND_DB`` down from 0.6 of it, so that nothing aliases to below
    0.4 of the new rate (40 Hz at 100 Hz). It is symmetric about each sample and delays nothing.
    :func:`interpolate` follows.
    """
    values, new_time = np.asarray(values, float), np.asarray(new_time, float)
    time = sample_times(time, values)
    new_rate_hz = mean_rate_hz(sample_times(new_time, new_time))
    wanted = new_time + delay_s
    if new_rate_hz < MIN_DECIMATION * mean_rate_hz(time):
        kept = _samples_wanted(time, wanted)
        time, values = time[kept], _without_aliases(values, time, new_rate_hz, kept)
    return interpolate(time, values, wanted)


def interpolate(time: ArrayLike, values: ArrayLike, at: ArrayLike) -> Array:
    """Evaluate the cubic spline through samples, never across a gap and never beyond the ends.

    Parameters
    ----------
    time
        Sample times, (N,) [s], increasing.
    values
        Samples, (N, ...). Blocks of fewer than 4 samples between gaps (NaN) become gaps.
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
    require_length(time, MIN_SPLINE_SAMPLES)
    wanted, rounding = at.ravel(), ROUNDING_STEPS / mean_rate_hz(time)
    columns = values.reshape(len(time), -1)
    result = unknown((len(wanted), columns.shape[1]))
    for rows, sharing in blocks_without_gaps(columns, MIN_SPLINE_SAMPLES):
        first, last = time[rows][[0, -1]]
        inside = (wanted >= first - rounding) & (wanted <= last + rounding)
        place = inside if isinstance(sharing, slice) else np.ix_(inside, sharing)
        result[place] = cubic_spline(time[rows], columns[rows, sharing], wanted[inside])
    return result.reshape(*at.shape, *values.shape[1:])


def resample_in_real_time(time: Array, values: Array, new_time: Array) -> Array:
    """Bring a signal to other sample times as while it is measured, by `Convolution`.

    Parameters
    ----------
    time
        Sample times, (N,) [s].
    values
        Samples, (N, ...).
    new_time
        Wanted times, (T,) [s].

    Returns
    -------
    Array
        (T, ...); NaN where the samples around it are not all known.
    """
    resampling = Convolution.between(mean_rate_hz(time), mean_rate_hz(new_time))
    found = resampling.evaluate(time, values.reshape(len(time), -1), new_time)
    return found.reshape(len(new_time), *values.shape[1:])


def _samples_wanted(time: Array, wanted: Array) -> slice:
    """Give every which sample is enough: those at wanted times if these are at samples, or all."""
    rate_hz = mean_rate_hz(time)
    nearest = np.rint((wanted - time[0]) * rate_hz).astype(int)
    recorded, every = (nearest >= 0) & (nearest < len(time)), int(nearest[1] - nearest[0])
    apart_s = np.abs(time[nearest[recorded]] - wanted[recorded]).max(initial=0)
    if apart_s * rate_hz > MAX_ROUNDING_STEPS or not np.all(np.diff(nearest) == every):
        return slice(0, None, 1)
    return slice(int(nearest[0]) % every, None, every)


def _without_aliases(signal: Array, time: Array, new_rate_hz: float, kept: slice) -> Array:
    """Low-pass (N, ...) samples to what a lower sampling rate can represent; give the kept ones."""
    require_equal_steps(time)
    rate_hz = mean_rate_hz(time)
    width = TRANSITION_WIDTH * new_rate_hz / (rate_hz / 2)
    length, beta = kaiserord(STOPBAND_DB, width)
    reach = length // 2
    require_length(time, reach + 1)
    taps = firwin(2 * reach + 1, new_rate_hz / 2, window=("kaiser", beta), fs=rate_hz)
    columns = signal.reshape(len(time), -1)
    result = unknown((len(time[kept]), columns.shape[1]))
    for rows, sharing in blocks_without_gaps(columns, reach + 1):
        first = (kept.start - rows.start) % kept.step
        padded = extended(columns[rows, sharing], reach)[first:]
        filtered = _convolved(padded.T, taps, kept.step)
        start = (rows.start + first) // kept.step
        result[start : start + filtered.shape[1], sharing] = filtered.T
    return np.reshape(result, (len(result), *signal.shape[1:]))


def _convolved(channels: Array, taps: Array, every: int) -> Array:
    """Filter (K, N) samples, N ≥ taps; give the first of what N determine, and every so many-th.

    Of one in several, only these are computed: samples and taps are laid out in rows of so many,
    whose products are summed.
    """
    if every == 1:
        return np.asarray(oaconvolve(channels, taps[None], "valid", axes=1))
    count = (channels.shape[1] - len(taps)) // every + 1
    rows = -(-len(taps) // every)
    length = (count + rows - 1) * every
    filters = np.pad(taps[::-1], (0, rows * every - len(taps))).reshape(rows, every)
    result = np.zeros((len(channels), count))
    for channel, filtered in zip(channels, result, strict=True):
        laid_out = np.pad(channel[:length], (0, max(length - len(channel), 0)))
        products = filters @ laid_out.reshape(-1, every).T
        for row, product in enumerate(products):
            filtered += product[row : row + count]
    return result
