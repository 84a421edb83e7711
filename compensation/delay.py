"""Delays between two devices that recorded the same motion, and of accelerometers on plates."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from compensation.inputs import read_rate, read_table, refuse_constant, refuse_unequal
from hbm.numbers import read_numbers
from hbm.signals.filtering import low_pass
from hbm.spatial import Array

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "delay")

BLOCKS: Final = 40
"""Blocks of a trial whose errors are taken as independent: a second and more in half a minute."""
STEP_TOLERANCE: Final = 1e-9
"""Last step of the delay, in samples: far below any uncertainty."""
SAMPLES_PER_PERIOD: Final = 10
"""Of the fastest motion, so that a cubic spline passes through it."""
MIN_VARIANCE: Final = 1e-12
"""Share of a channel's variance; keeps the weight of a channel without any noise finite."""


@dataclass(frozen=True, slots=True)
class Delay:
    """How much later one device's samples are stamped than another's.

    Attributes
    ----------
    seconds
        Positive where the second device is later [s].
    standard_error
        Of the estimate [s].
    degrees_of_freedom
        Of the standard error; few where it is from the scatter of a few impacts or recordings.

    Examples
    --------
    >>> delay = Delay(0.0072, standard_error=0.0002)
    >>> f"{1000 * delay.seconds:.1f} ± {1000 * delay.uncertainty:.1f} ms"
    '7.2 ± 0.4 ms'
    """

    seconds: float
    standard_error: float
    degrees_of_freedom: float = float("inf")

    @property
    def uncertainty(self) -> float:
        """Half of the 95 % confidence interval, by Student's t [s]."""
        return float(scipy.special.stdtrit(self.degrees_of_freedom, 0.975) * self.standard_error)


def estimate_delay(reference: ArrayLike, late: ArrayLike, rate_hz: float) -> Delay:
    """Estimate by how much one device lags another that recorded the same motion.

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
    combination projected out, give the fraction. Channels of `late` are weighted by the inverse of
    their residual variance. The standard error is the sandwich estimate over 40 blocks, which
    allows for noise that is correlated in time. Both signals are low-passed with zero phase at
    20 Hz before (at a tenth of the sampling rate where that is lower): a spline passes noise
    differently between samples than on them.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> acceleration = low_pass(rng.normal(size=(3000, 3)), 100.0, 5.0, "zero_phase")
    >>> found = estimate_delay(acceleration[2:], 150 * acceleration[:-2], 100.0)
    >>> f"{found.seconds:.3f}"
    '0.020'
    """
    x, y = read_table(reference, "reference"), read_table(late, "late signal")
    given_rate = read_rate(rate_hz)
    refuse_unequal(reference=x, late_signal=y)
    refuse_constant(x, "reference", tuple(f"channel {k + 1}" for k in range(x.shape[1])))
    refuse_constant(y, "late signal", tuple(f"channel {k + 1}" for k in range(y.shape[1])))
    # the spline needs samples beyond both ends of the longest delay
    fewest = int(4 * LIMITS.longest * given_rate) + BLOCKS * SAMPLES_PER_PERIOD
    if len(x) < fewest:
        raise ValueError(
            f"{len(x)} samples are too few to seek delays up to {LIMITS.longest} s "
            f"at {given_rate} Hz; give at least {fewest}"
        )
    x, rate = decimated(x, given_rate)
    y, _ = decimated(y, given_rate)
    reach = int(np.ceil(LIMITS.longest * rate))

    lag, explained = _best_lag(x, y, reach)
    if explained < LIMITS.least_explained:
        raise ValueError(
            f"the late signal follows the reference in {explained:.0%} of its variance only, "
            f"at no delay up to {LIMITS.longest} s; are they of one trial?"
        )
    # a maximum at the end of the range is no maximum
    if abs(lag) == reach:
        raise ValueError(
            f"the best agreement lies beyond {LIMITS.longest} s; are both on one clock?"
        )

    model = _LateChannels([x], y, reach)
    late, covariance = without_step(model.gauss_newton, np.array([-float(lag)]), reach)
    return Delay(-float(late[0] / rate), float(np.sqrt(covariance[0, 0])) / rate)


def decimated(signal: Array, rate: float) -> tuple[Array, float]:
    """Low-pass, decimate and standardise (N, C) samples; give the new rate [Hz] too."""
    cutoff_hz = min(LIMITS.fastest_motion, rate / SAMPLES_PER_PERIOD)
    every = int(rate / (SAMPLES_PER_PERIOD * cutoff_hz))
    slow = low_pass(signal, rate, cutoff_hz, "zero_phase")[::every]
    # standardised, so that channels of different units weigh alike
    return (slow - slow.mean(axis=0)) / slow.std(axis=0), rate / every


def _best_lag(x: Array, y: Array, reach: int) -> tuple[int, float]:
    """Whole samples that `y` lags by and the share of its variance explained there."""
    # orthonormal channels: their correlations with the late signal add up to explained variance
    u, s, _ = np.linalg.svd(x, full_matrices=False)
    lags = np.arange(-reach, reach + 1)
    length = scipy.fft.next_fast_len(len(x) + reach, real=True)
    late = scipy.fft.rfft(y.T, length)
    power = np.zeros(len(lags))
    # correlations at all lags at once, by products of spectra
    for column in u[:, s > 1e-6 * s[0]].T:
        correlation = scipy.fft.irfft(late * scipy.fft.rfft(column, length).conj(), length)
        power += np.sum(correlation[:, lags] ** 2, axis=0)
    best = int(np.argmax(power))
    return int(lags[best]), float(power[best] / np.sum(y**2))


def without_step(
    step_of: Callable[[Array], tuple[Array, Array]], start: Array, limit: float = np.inf
) -> tuple[Array, Array]:
    """Give the delays (S,) from which a Gauss–Newton step leads no farther, and their covariance.

    `step_of` gives step and covariance at some delays. Where noise is in both signals, the steps
    are too short or too long by a constant factor, which Broyden's method learns from each step and
    the next (Broyden 1965, Math Comput 19:577).
    """
    delays, inverse = start, np.eye(len(start))
    step, covariance = step_of(start)
    # four to eight steps are enough where there is one best delay
    for _ in range(20):
        # a step at a time, no longer than a sample
        before, delays = delays, np.clip(delays + np.clip(inverse @ step, -1, 1), -limit, limit)
        change, last = delays - before, step
        step, covariance = step_of(delays)
        shorter = inverse @ (last - step)
        size = change @ shorter
        if np.max(np.abs(step)) < STEP_TOLERANCE or not size:
            break
        # Broyden's update: how the step changes with the delays, from what the last one did
        inverse += np.outer(change - shorter, change @ inverse) / size
    return delays, covariance


class _LateChannels:
    """Linear model of a signal (N, C) by groups of channels, (N, K) each, read ahead by delays."""

    def __init__(self, groups: Sequence[Array], signal: Array, reach: int) -> None:
        samples, spline = len(signal), scipy.interpolate.CubicSpline
        self.splines = [spline(np.arange(samples), group) for group in groups]
        self.inside = np.arange(reach + 1, samples - reach - 1)
        self.signal = signal[self.inside]

    def _ahead(self, delays: Array, derivative: int, every: int = 1) -> list[Array]:
        at = self.inside[::every]
        return [s(at + late, derivative) for late, s in zip(delays, self.splines, strict=True)]

    def misfit(self, delays: Array) -> float:
        """Give how little all channels have in common: the logarithm of their covariance's volume.

        Sensors on one rigid body agree in what sway does to them, and together they predict the
        plates; a wrong delay spoils either.
        """
        # channels that have much in common span little volume
        together = np.hstack([*self._ahead(delays, 0, SEARCHED), self.signal[::SEARCHED]])
        variances = np.linalg.eigvalsh(np.cov(together, rowvar=False))
        return float(np.sum(np.log(np.maximum(variances, MIN_VARIANCE))))

    def gauss_newton(self, delays: Array) -> tuple[Array, Array]:
        """Give the step of the delays and their covariance, in samples; gains are projected out."""
        channels = np.column_stack([*self._ahead(delays, 0), np.ones(len(self.inside))])
        # gains are projected out: for any delays the best ones are a linear fit
        u, s, vt = np.linalg.svd(channels, full_matrices=False)
        kept = s > s[0] * len(channels) * np.finfo(float).eps
        basis, along = u[:, kept], u[:, kept].T @ self.signal
        gain, remainder = vt[kept].T @ (along / s[kept, None]), self.signal - basis @ along
        # weight of each channel by what it leaves
        root = 1 / np.sqrt(np.maximum(np.mean(remainder**2, axis=0), MIN_VARIANCE))
        rates = self._ahead(delays, 1)
        ends = np.cumsum([rate.shape[1] for rate in rates])
        parts = np.split(gain, ends)[:-1]
        slopes = [rate @ part for rate, part in zip(rates, parts, strict=True)]
        # of the part of the slope that other gains cannot make up for
        slopes = [(slope - basis @ (basis.T @ slope)) * root for slope in slopes]
        scores = np.column_stack([np.vecdot(slope, remainder * root) for slope in slopes])
        inverse = np.linalg.pinv([[np.vdot(one, other) for other in slopes] for one in slopes])
        # errors are correlated in time: independent from block to block alone (sandwich)
        blocks = np.stack([block.sum(axis=0) for block in np.array_split(scores, BLOCKS)])
        covariance = inverse @ (blocks.T @ blocks) @ inverse * BLOCKS / (BLOCKS - 1)
        return inverse @ scores.sum(axis=0), covariance


SEARCHED: Final = 4
"""Of the samples every which one is searched: their covariance needs no more."""
MODEL_ERROR_S: Final = 0.00005
"""Standard error besides the noise's: a platform that vibrates on an elastic base, which no rigid
motion explains, moves the estimate by up to this (virtual laboratory, 7 to 30 Hz)."""


def sensor_delays(accelerations: ArrayLike, wrench: ArrayLike, rate_hz: float) -> tuple[Delay, ...]:
    """Estimate how much later each accelerometer is than the empty plates that move with it.

    Parameters
    ----------
    accelerations
        Readings at the plates' nominal instants, three columns per sensor, (N, 3 S), in any unit.
    wrench
        Wrenches of one or more empty plates side by side, (N, 6 P), in any unit.
    rate_hz
        Common sampling rate [Hz].

    Returns
    -------
    tuple of Delay
        One per sensor; positive where it is later than the plates.

    Raises
    ------
    ValueError
        As `estimate_delay`.

    Notes
    -----
    `estimate_delay` gives the delay of all sensors together. From there on the delay of each is a
    parameter of its own of the linear model that compensates the plates (`fit_inertia`): sought
    in steps of 3 ms, then by Gauss–Newton with the gains projected out. The standard errors are
    those of the sandwich over 40 blocks, and 0.05 ms for vibration that the model lacks. The
    search minimises the determinant of the covariance of all channels, to which the sensors'
    agreement with each other contributes.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> accelerations = low_pass(rng.normal(size=(6000, 6)), 200.0, 5.0, "zero_phase")
    >>> plate = accelerations @ rng.normal(size=(6, 6)) + 0.001 * rng.normal(size=(6000, 6))
    >>> accelerations[1:, 3:] = accelerations[:-1, 3:].copy()
    >>> [round(1000 * late.seconds, 1) + 0.0 for late in sensor_delays(accelerations, plate, 200.0)]
    [0.0, 5.0]
    """
    a, w = read_table(accelerations, "accelerations"), read_table(wrench, "wrench")
    common, count = estimate_delay(a, w, rate_hz), a.shape[1] // 3
    alike = Delay(-common.seconds, float(np.hypot(common.standard_error, MODEL_ERROR_S)))
    if count == 1:
        return (alike,)
    x, rate = decimated(a, read_rate(rate_hz))
    model = _LateChannels(
        np.split(x, count, axis=1), decimated(w, rate_hz)[0], round(LIMITS.longest * rate)
    )
    delays: Array = np.full(count, alike.seconds * rate)
    # a second round, since the delay of one sensor changes what fits best of another
    for _ in range(2):
        # one sensor at a time on a grid: Gauss–Newton alone might lead to another minimum
        for direction in np.eye(count):
            # within 30 ms, in steps that are a fraction of the fastest motion's period
            tried: list[Array] = [
                delays + step * direction for step in np.arange(-0.03, 0.0301, 0.003) * rate
            ]
            delays = min(tried, key=model.misfit)
    delays, covariance = without_step(model.gauss_newton, delays)
    errors = np.hypot(np.sqrt(np.diag(covariance)) / rate, MODEL_ERROR_S)
    if not np.all(errors < LIMITS.largest_separate_error):
        return tuple(alike for _ in range(count))
    return tuple(
        Delay(float(late / rate), float(error)) for late, error in zip(delays, errors, strict=True)
    )
