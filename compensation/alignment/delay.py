"""Delays between devices, from motion or from hammer hits, and how to undo them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, correlate, sosfiltfilt

from compensation.inputs import (
    read_rate,
    read_signal,
    read_table,
    refuse_constant,
    refuse_unequal,
)
from hbm.spatial import Array

_BLOCKS = 40
_STEPS = 20
_LEAST_EXPLAINED = 0.1
_MOTION_HZ = 20.0  # neither platforms nor people move faster
_OVERSAMPLED = 10  # samples per period of the fastest motion kept


@dataclass(frozen=True, slots=True)
class Delay:
    """How much later one device's samples are stamped than another's.

    Attributes
    ----------
    seconds
        Positive where the second device is later [s].
    standard_error
        Of the estimate [s]; a 95 % interval is ± 1.96 of it, with few hits Student's t.
    explained
        Share of the late signal's variance that follows the reference [1]; NaN for hits.
    differences
        Delays of the single hits, in their order [s]; empty for motion.
    """

    seconds: float
    standard_error: float
    explained: float = float("nan")
    differences: tuple[float, ...] = ()


def estimate_delay(
    reference: ArrayLike, late: ArrayLike, rate_hz: float, longest_s: float = 0.2
) -> Delay:
    """Estimate by how much one device lags another that saw the same motion.

    Parameters
    ----------
    reference
        Channels of the first device, (N, K), in any unit.
    late
        Channels of the second device at the same nominal instants, (N, C), in any unit; each is,
        apart from the delay and noise, a linear combination of the first device's channels and a
        constant. A wrench of an empty plate is that of accelerometers; a measured pose is that
        of the commanded one.
    rate_hz
        Common sampling rate [Hz].
    longest_s
        Delays are sought up to this, either way [s].

    Returns
    -------
    Delay
        With `late` at ``t`` agreeing best with `reference` at ``t - seconds``.

    Raises
    ------
    ValueError
        Wrong shapes, no samples, gaps, different numbers of samples, constant channels, a trial
        shorter than the delays sought, signals that do not follow each other, or a best agreement
        at the end of the range.

    Notes
    -----
    The combination and the delay are fitted together. Correlation over whole samples comes first;
    then Gauss–Newton steps over a cubic spline through the reference, with the linear
    combination projected out, give the fraction. Channels of `late` count by the inverse of
    their residual variance. The standard error is the sandwich estimate over 40 blocks, which
    allows for noise that is correlated in time. Low-pass both signals alike where noise reaches
    up to half the sampling rate: a spline passes it differently between samples than on them.
    """
    x, y = read_table(reference, "reference"), read_table(late, "late signal")
    given_rate = read_rate(rate_hz)
    refuse_unequal(reference=x, late_signal=y)
    refuse_constant(x, "reference", tuple(f"channel {k + 1}" for k in range(x.shape[1])))
    refuse_constant(y, "late signal", tuple(f"channel {k + 1}" for k in range(y.shape[1])))
    fewest = int(4 * longest_s * given_rate) + _BLOCKS * _OVERSAMPLED
    if len(x) < fewest:
        raise ValueError(
            f"{len(x)} samples are too few to seek delays up to {longest_s} s at {given_rate} Hz; "
            f"give at least {fewest}"
        )
    x, rate = _slowed(x, given_rate)
    y, _ = _slowed(y, given_rate)
    reach = int(np.ceil(longest_s * rate))

    lag, explained = _best_lag(x, y, reach)
    if explained < _LEAST_EXPLAINED:
        raise ValueError(
            f"the late signal follows the reference in {explained:.0%} of its variance only, "
            f"at no delay up to {longest_s} s; are they of one trial?"
        )
    if abs(lag) == reach:
        raise ValueError(f"the best agreement lies beyond {longest_s} s; seek longer delays")

    spline, inside = CubicSpline(np.arange(len(x)), x), np.arange(reach + 1, len(x) - reach - 1)
    shift = float(lag)
    for _ in range(_STEPS):
        step, error, explained = _gauss_newton(spline, y, inside, shift)
        shift = float(np.clip(shift + step, lag - 1, lag + 1))
        if abs(step) < 1e-9:
            break
    return Delay(shift / rate, error / rate, explained)


def undo_delay(signal: ArrayLike, delay_s: float, rate_hz: float) -> Array:
    """Bring a late signal to the reference's clock, ``x(t + delay)``.

    Parameters
    ----------
    signal
        Channels of the late device, (N, C).
    delay_s
        Its delay, positive where it is late [s].
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    Array
        The same channels at the reference's instants by cubic interpolation, (N, C); NaN at the
        end (or the beginning, for a negative delay) that the recording does not reach.

    Raises
    ------
    ValueError
        Wrong shape, fewer than 2 samples, gaps, or no rate.
    """
    x, rate = read_table(signal, "signal"), read_rate(rate_hz)
    if len(x) < 2:
        raise ValueError("signal has 1 sample; interpolation needs at least 2")
    at = np.arange(len(x)) + delay_s * rate
    shifted: Array = CubicSpline(np.arange(len(x)), x)(at)
    shifted[(at < 0) | (at > len(x) - 1)] = np.nan
    return shifted


def hammer_delay(
    marker_time: ArrayLike,
    marker_height: ArrayLike,
    force_time: ArrayLike,
    force: ArrayLike,
    window_s: float = 0.1,
) -> Delay:
    """Estimate by how much a plate lags the cameras from hits with a hammer that has a marker.

    Parameters
    ----------
    marker_time
        Instants of the marker's samples, (N,) [s].
    marker_height
        Height of the marker on the hammer, (N,) [m].
    force_time
        Instants of the plate's samples, (P,) [s], on the same nominal clock.
    force
        Vertical force of the plate, unfiltered, (P,) [N].
    window_s
        The marker's turn is sought this long before and after the force begins [s].

    Returns
    -------
    Delay
        Mean over hits, positive where the plate is later; its standard error from their scatter.

    Raises
    ------
    ValueError
        Wrong shapes, no samples, gaps, times that do not increase, fewer than 3 hits.

    Notes
    -----
    The force begins where it first leaves the baseline by five standard deviations (van de
    Loosdrecht 2018, II.A.3): halfway between the last sample within and the first beyond, for a
    blow rises within less than a sample. Baseline and deviation are the median and 1.4826 times
    the median absolute deviation, which hits do not move. The marker's turn is
    where the lines through three samples on its way down and three on its way up meet.

    Deviations from the original: both instants to a fraction of a sample; the original takes the
    lowest and the first sample.
    """
    t_m, height = _read_timed(marker_time, marker_height, "marker")
    t_f, load = _read_timed(force_time, force, "force")
    found = [
        onset - turn
        for onset in _onsets(t_f, load, 2 * window_s)
        if (turn := _turn(t_m, height, onset, window_s)) is not None
    ]
    if len(found) < 3:
        raise ValueError(
            f"{len(found)} hits found in both marker and force, expected at least 3; "
            "is the force unfiltered and are both on one clock?"
        )
    error = float(np.std(found, ddof=1) / np.sqrt(len(found)))
    return Delay(float(np.mean(found)), error, differences=tuple(found))


def _slowed(signal: Array, rate: float) -> tuple[Array, float]:
    """Low-pass without delay, thin out, and scale; give the new rate too."""
    cutoff = min(_MOTION_HZ, rate / _OVERSAMPLED)
    thin = int(rate / (_OVERSAMPLED * cutoff))
    slow = sosfiltfilt(butter(4, cutoff, fs=rate, output="sos"), signal, axis=0)[::thin]
    return (slow - slow.mean(axis=0)) / slow.std(axis=0), rate / thin


def _best_lag(x: Array, y: Array, reach: int) -> tuple[int, float]:
    """Whole samples that `y` lags by and the share of its variance explained there."""
    u, s, _ = np.linalg.svd(x, full_matrices=False)
    lags = np.arange(-reach, reach + 1)
    middle = len(x) - 1
    power = np.zeros(len(lags))
    for column in u[:, s > 1e-6 * s[0]].T:
        for channel in y.T:
            power += correlate(channel, column, method="fft")[middle + lags] ** 2
    best = int(np.argmax(power))
    return int(lags[best]), float(power[best] / np.sum(y**2))


def _gauss_newton(
    spline: CubicSpline, y: Array, inside: NDArray[np.int64], shift: float
) -> tuple[float, float, float]:
    """Step of the delay, its standard error [samples], share of variance explained."""
    at = inside - shift
    x = np.column_stack([spline(at), np.ones(len(at))])
    target = y[inside]
    gain = np.linalg.lstsq(x, target)[0]
    residual = target - x @ gain
    slope = -spline(at, 1) @ gain[:-1]
    slope -= x @ np.linalg.lstsq(x, slope)[0]
    variance = np.maximum(np.mean(residual**2, axis=0), 1e-12)
    scores = np.sum(slope * residual / variance, axis=1)
    information = float(np.sum(slope**2 / variance))
    blocks = np.array([block.sum() for block in np.array_split(scores, _BLOCKS)])
    error = float(np.sqrt(np.sum(blocks**2) * _BLOCKS / (_BLOCKS - 1))) / information
    explained = 1 - float(np.sum(residual**2) / np.sum((target - target.mean(axis=0)) ** 2))
    return float(scores.sum()) / information, error, explained


def _read_timed(time: ArrayLike, values: ArrayLike, name: str) -> tuple[Array, Array]:
    t, x = read_signal(time, f"{name} times"), read_signal(values, name)
    refuse_unequal(**{f"{name}_times": t, name: x})
    if not np.all(np.diff(t) > 0):
        raise ValueError(f"{name} times must increase")
    refuse_constant(x[:, None], name, ("its only channel",))
    return t, x


def _onsets(time: Array, force: Array, quiet_s: float) -> list[float]:
    """Instants at which the force leaves its baseline after it was quiet for a while."""
    baseline = float(np.median(force))
    spread = 1.4826 * float(np.median(np.abs(force - baseline)))
    beyond = np.abs(force - baseline) - 5 * spread
    out = np.flatnonzero(beyond > 0)
    first = out[np.diff(time[out], prepend=-np.inf) > quiet_s]
    return [float(time[k - 1] + time[k]) / 2 for k in first if k > 0]


def _turn(time: Array, height: Array, around: float, window_s: float) -> float | None:
    """Instant at which the marker turns from falling to rising, None where it does not."""
    near = np.flatnonzero(np.abs(time - around) <= window_s)
    if len(near) == 0:
        return None
    lowest = int(near[np.argmin(height[near])])
    if lowest < 4 or lowest > len(time) - 5:
        return None
    # the lowest sample may lie on either side of the turn: it belongs to neither line
    down, up = slice(lowest - 3, lowest), slice(lowest + 1, lowest + 4)
    fall, rise = (
        np.polynomial.Polynomial.fit(time[part] - around, height[part], 1).convert().coef
        for part in (down, up)
    )
    if not fall[1] < 0 <= rise[1]:
        return None
    return around + float((fall[0] - rise[0]) / (rise[1] - fall[1]))
