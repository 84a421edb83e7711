"""Signals at other sample times: without aliasing, without delay, never across a gap."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hbm.signals.samples import (
    MIN_SPLINE_SAMPLES,
    blocks_without_gaps,
    cubic_spline,
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


Signal = Callable[[Array], Array]
"""Values at any times."""


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
    # what the new rate cannot represent would appear as lower frequencies
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
    return interpolant(time, values)(np.asarray(at, float))


def interpolant(time: ArrayLike, values: ArrayLike) -> Signal:
    """Give `interpolate` of the wanted times alone, for samples that are evaluated many times."""
    values = np.asarray(values, float)
    time = sample_times(time, values)
    require_length(time, MIN_SPLINE_SAMPLES)
    # times beyond the ends by a millionth of a sample are rounding errors
    columns, rounding = values.reshape(len(time), -1), 1e-6 / mean_rate_hz(time)
    splines = [
        (time[rows][[0, -1]], sharing, _spline(time[rows], columns[rows, sharing]))
        for rows, sharing in blocks_without_gaps(columns, MIN_SPLINE_SAMPLES)
    ]

    def evaluate(at: Array) -> Array:
        times = at.ravel()
        result = unknown((len(times), columns.shape[1]))
        for (first, last), sharing, spline in splines:
            inside = (times >= first - rounding) & (times <= last + rounding)
            place = inside if isinstance(sharing, slice) else np.ix_(inside, sharing)
            result[place] = spline(times[inside])
        return result.reshape(*at.shape, *values.shape[1:])

    return evaluate


def delayed(time: Array, values: Array, delay_s: float) -> Array:
    """Give a signal that comes later.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    values
        (T, ...); gaps are NaN.
    delay_s
        By how much [s]; negative for earlier.

    Returns
    -------
    Array
        (T, ...). Before the first and after the last known value these are held; gaps stay where
        they are.

    Examples
    --------
    >>> time = np.arange(6.0)
    >>> delayed(time, time**2, 0.5).round(2).tolist()
    [0.0, 0.25, 2.25, 6.25, 12.25, 20.25]
    """
    at = np.clip(time - delay_s, time[0], time[-1])
    later = interpolate(time, values, at)
    return np.asarray(np.where(np.isnan(later), values, later))


def _spline(time: Array, samples: Array) -> Signal:
    """Give the spline through (N, K) samples; at their times it is the samples themselves."""
    step = (time[-1] - time[0]) / (len(time) - 1)
    through_samples = cache(lambda: cubic_spline(time, samples))

    def evaluate(at: Array) -> Array:
        # times that are samples' own need no spline: values stay as they are
        nearest = np.rint((at - time[0]) / step).astype(int).clip(0, len(time) - 1)
        if np.abs(time[nearest] - at).max(initial=0) <= 1e-9 * step:
            return np.asarray(samples.take(nearest, axis=0))
        return np.asarray(through_samples()(at))

    return evaluate


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
    resampled = resampling.evaluate(time, values.reshape(len(time), -1), new_time)
    return resampled.reshape(len(new_time), *values.shape[1:])


def _without_aliases(signal: Array, time: Array, new_rate_hz: float) -> Array:
    """Low-pass (N, ...) samples to what a lower sampling rate can represent."""
    require_equal_steps(time)
    rate_hz = mean_rate_hz(time)
    # by half of the old rate
    # transition band from 0.4 to 0.6 of the new rate
    width = 0.2 * new_rate_hz / (rate_hz / 2)
    # Kaiser's formulas (1974) for how far the window reaches, and for its shape
    reach = int(np.ceil((STOPBAND_DB - 7.95) / (2.285 * np.pi * width) + 1)) // 2
    require_length(time, reach + 1)
    window = np.kaiser(2 * reach + 1, 0.1102 * (STOPBAND_DB - 8.7))
    # ideal low-pass at half of the new rate, windowed; gain 1 at rest
    taps = np.sinc(new_rate_hz / rate_hz * np.arange(-reach, reach + 1)) * window
    taps /= taps.sum()
    columns = signal.reshape(len(time), -1)
    result = unknown(columns.shape)
    for rows, sharing in blocks_without_gaps(columns, reach + 1):
        padded = extended(columns[rows, sharing], reach)
        # as a product of spectra; what wraps around is in the samples that are not kept
        size = scipy.fft.next_fast_len(len(padded), real=True)
        spectrum = scipy.fft.rfft(padded.T, size) * scipy.fft.rfft(taps, size)
        result[rows, sharing] = scipy.fft.irfft(spectrum, size).T[2 * reach : len(padded)]
    return result.reshape(signal.shape)


REACH_STEPS: Final = 2
"""To either side, in steps of the slower one of the two clocks."""


@dataclass(frozen=True, slots=True)
class Convolution:
    """How samples at one rate are brought to instants at another.

    Attributes
    ----------
    step_s
        Of the samples [s].
    scale_s
        Step of the slower one of the two clocks [s].

    Notes
    -----
    The value at t is the mean of the samples with the weights ``h((t_k − t) / scale)``, h the cubic
    convolution kernel (Keys 1981, IEEE Trans Acoust Speech Signal Process 29:1153), plus what makes
    it reproduce straight lines whatever the steps. At equal rates it interpolates, and quadratic
    functions are reproduced; from a faster clock it passes 6 Hz to 0.03 % and 10 Hz to 0.2 % at
    100 Hz, and what would alias to below 6 Hz is 65 dB down. It delays nothing, and needs the
    samples of two steps (20 ms at 100 Hz) to either side.

    Examples
    --------
    >>> resampling = Convolution.between(1000.0, 100.0)
    >>> resampling.reach_s
    0.02
    >>> time = np.arange(0, 1, 0.001)
    >>> at = np.array([0.5, 0.51])
    >>> resampling.evaluate(time, np.sin(2 * np.pi * time)[:, None], at).round(4).ravel()
    array([ 0.    , -0.0628])
    """

    step_s: float
    scale_s: float

    @classmethod
    def between(cls, rate_hz: float, new_rate_hz: float) -> "Convolution":
        """Give what brings samples at one rate to another.

        Rates [Hz] are rounded to whole ones, so that the weights do not depend on how long a
        recording was when its rate was measured, nor on the drift of a clock.
        """
        # the slower clock sets the width: it interpolates when faster, and averages when slower
        step_s, new_step_s = (1 / max(round(rate), 1) for rate in (rate_hz, new_rate_hz))
        return cls(step_s, max(step_s, new_step_s))

    @property
    def reach_s(self) -> float:
        """How far samples count to either side [s]."""
        return REACH_STEPS * self.scale_s

    @property
    def longest_s(self) -> float:
        """Longest step between samples that is no gap [s]."""
        # over more than 1.5 steps of the slower clock the weights nearly cancel
        return min(2.5 * self.step_s, 1.5 * self.scale_s)

    def evaluate(self, time: Array, values: Array, at: Array) -> Array:
        """Give a signal at some instants.

        Parameters
        ----------
        time
            Sample times, (N,) [s], increasing.
        values
            Samples, (N, K); NaN where missing.
        at
            Wanted instants, (T,) [s].

        Returns
        -------
        Array
            (T, K); NaN where a sample within reach is NaN, where the samples leave a gap, and where
            they end before the reach does.
        """
        rows = [self.at_one(time, values, instant) for instant in at.tolist()]
        return np.array(rows).reshape(len(at), values.shape[1])

    def at_one(self, time: Array, values: Array, at: float) -> Array:
        """Do the same for one instant, (K,)."""
        reach_s = self.reach_s
        start = int(time.searchsorted(at - reach_s, side="right"))
        stop = int(time.searchsorted(at + reach_s, side="left"))
        weights = _weights(self, (time[start:stop] - at).tobytes())
        if weights is None:
            return np.full(values.shape[1], np.nan)
        return np.asarray(weights @ values[start:stop])

    def is_known(self, later: Array) -> bool:
        """Whether samples so much later than an instant, (n,) [s], leave no gap within reach."""
        if not len(later):
            return False
        reach_s, longest_s = self.reach_s, self.longest_s
        # no sample near one end of the reach, or a step inside it that is too long
        if later[0] + reach_s > longest_s or reach_s - later[-1] > longest_s:
            return False
        return len(later) == 1 or bool((later[1:] - later[:-1]).max() <= longest_s)


@lru_cache(maxsize=4)
def _weights(how: Convolution, later_s: bytes) -> Array | None:
    """Give those of samples so much later than an instant; None where they leave a gap.

    Streams of one clock share them: in a live frame this takes longer than all else of resampling.
    """
    later = np.frombuffer(later_s)
    if not how.is_known(later):
        return None
    u = np.abs(later) / how.scale_s
    weights = _cubic(u)
    weights /= weights.sum()
    # a correction that makes straight lines exact where samples are not evenly spread
    near = (1 - u * u / REACH_STEPS**2) ** 2
    tilt = near * (later - near.dot(later) / near.sum())
    arm = float(tilt.dot(later))
    # no second sample beside one instant shows a slope
    if arm > 1e-9 * how.scale_s**2:
        weights -= tilt * (weights.dot(later) / arm)
    return weights


def _cubic(u: Array) -> Array:
    """Give the cubic convolution kernel at distances up to 2 steps."""
    # Keys' kernel (a = −½): 1 at 0, 0 at 1 and 2, exact for parabolas
    from_one = 1 - u
    inner = np.maximum(from_one, 0)
    return np.asarray(0.5 * from_one * (2 - u) ** 2 + inner * inner * (2 * u - 1))
