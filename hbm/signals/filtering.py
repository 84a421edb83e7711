"""The one low-pass of the project: a second-order Butterworth filter, and its derivatives.

A gap (NaN) that is longer than `longest_gap_s` splits a signal: each block is filtered on its own
and the gap stays a gap. A shorter one, such as a lost frame, is bridged. Coordinates and forces
need the same filter, or their phases disagree.
"""

from functools import lru_cache
from typing import Final, Literal, NamedTuple, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hbm.signals.samples import (
    blocks_without_gaps,
    bridged,
    extended,
    mean_rate_hz,
    require_equal_steps,
    require_length,
    sample_times,
    unknown,
)
from hbm.spatial import Array, Mask, frozen

Method = Literal["realtime", "zero_phase"]
"""How coordinates and forces are filtered; `low_pass` says what each method does."""

LowPassMethod = Literal["realtime", "zero_phase", "double_pass"]
"""The same, and the uncorrected double pass, to repeat published work."""

DOUBLE_PASS_MINUS_3_DB: Final = float((np.sqrt(2) - 1) ** 0.25)
"""Frequency of −3 dB of two passes, per cut-off of each: 0.802 for second order (Winter 2009)."""


EQUAL_STEPS_TOLERANCE: Final = 1e-9
"""Relative difference of time steps, or rates, up to which it is a rounding error."""


def longest_gap_s(cutoff_hz: float) -> float:
    """Give the longest step from one known sample to the next over which a filter goes on [s].

    Examples
    --------
    >>> f"{longest_gap_s(6.0):.4f} s"
    '0.0417 s'
    """
    # over a quarter of a period and more it would follow nothing of what happened between; within,
    # a walk that loses every tenth frame has residuals that err by 2 N in real time, 1 N otherwise
    return 0.25 / cutoff_hz * (1 + 1e-6)


def over_short_gaps(columns: Array, time: Array, cutoff_hz: float, method: str) -> Array:
    """Fill unknown samples, (T, K), over which the filter goes on."""
    degree = 1 if method == "realtime" else 3  # lines know nothing of what follows
    return bridged(columns, time, longest_gap_s(cutoff_hz), degree)


class Filtered(NamedTuple):
    """A low-passed signal and its first two time derivatives.

    Attributes
    ----------
    value, velocity, acceleration
        All of the signal's shape, (T, ...), in its unit, unit/s and unit/s². A gap
        that is not bridged is NaN.
    """

    value: Array
    velocity: Array
    acceleration: Array


def butterworth(signal: ArrayLike, time: ArrayLike, cutoff_hz: float, method: Method) -> Filtered:
    """Low-pass a signal with the Human Body Model's second-order Butterworth filter.

    Parameters
    ----------
    signal, time, cutoff_hz
        As in :func:`low_pass`; for gait the cut-off is usually 6 Hz.
    method
        ``"realtime"`` or ``"zero_phase"``, as in :func:`low_pass`.

    Returns
    -------
    Filtered
        Filtered signal and derivatives, each (T, ...).

    Raises
    ------
    ValueError
        As :func:`low_pass`.

    Notes
    -----
    Real time: ÿ + bẏ + ay = ax with a = ω², b = √2 ω, ω = 2π cutoff, stepped with the implicit
    mid-point rule (van den Bogert et al. 2013, Med Biol Eng Comput 51:1069). With
    x̄ = (x₋ + x)/2 and D = 4 + 2hb + h²a::

        y = [(4 + 2hb − h²a) y₋ + 4h ẏ₋ + 2h²a x̄] / D
        ẏ = [−4ha y₋ + (4 − 2hb − h²a) ẏ₋ + 4ha x̄] / D
        ÿ = (ẏ − ẏ₋) / h

    from y = x, ẏ = ÿ = 0 at the first sample. This is Tustin's rule without pre-warping, so −3 dB
    lies slightly low (5.93 Hz at 100 Hz), and ÿ is the mean over the step, half a step late.

    Zero phase: the same section forward and backward, pre-warped, and its cut-off divided by
    ``DOUBLE_PASS_MINUS_3_DB`` so that −3 dB *after both passes* is at the requested frequency
    (Winter 2009, Biomechanics and Motor Control of Human Movement). Ends are extended by
    reflection through the last sample, which keeps value and slope. Derivatives are those of the
    quintic spline through the filtered samples, laid through the extension too so that its end
    conditions play no part: they are derivatives of the returned values, and on a sine at 100 Hz
    the velocity errs by 1e-9 (2 Hz) to 6e-7 (6 Hz) and the acceleration by 4e-7 to 3e-5 of its
    amplitude. The section's own ẏ and ÿ would err as tan(ωh/2)/(ωh/2) does: 1.2 % and 2.4 % at
    6 Hz. The samples beyond the ends are unknown: trust the acceleration from one period of the
    cut-off inwards.

    Deviations from the original
    ----------------------------
    - The original restarts where time runs backwards; here that is an error.
    - The original's off-line variant runs backward first and is not pre-warped; here forward
      first, and pre-warped, which makes the −3 dB frequency exact.
    - Both restart after a gap. Gaps of at most a quarter of the cut-off's period (42 ms at 6 Hz)
      are bridged: in real time by straight lines, else by cubic splines.
    """
    return Filtered(*map(frozen, _filtered(signal, time, cutoff_hz, method, outputs=3)))


def low_pass(signal: ArrayLike, time: ArrayLike, cutoff_hz: float, method: LowPassMethod) -> Array:
    """Low-pass a signal with a second-order Butterworth filter.

    Parameters
    ----------
    signal
        Samples, (T, ...); NaN where unknown. Known samples that are at most a quarter of the
        cut-off's period apart are one block: what lacks between them is interpolated. Each block
        is filtered on its own; those shorter than the filter needs become gaps.
    time
        Sample times, (T,) [s], increasing; or one number, the sampling rate [Hz].
    cutoff_hz
        The filter's cut-off [Hz]; what it leaves there depends on the method.
    method
        ``"zero_phase"``: forward and backward, without delay; −3 dB (0.707 of the amplitude) at
        the cut-off after both passes. Time steps must be equal.
        ``"realtime"``: causal, as the Human Body Model computes it live; late by √2/(2π cutoff)
        (37.5 ms at 6 Hz), transient in the first second; time steps may vary. It is not
        pre-warped, so −3 dB lies below the cut-off: at 5.93 Hz for 6 Hz sampled at 100 Hz, at
        9.997 Hz for 10 Hz sampled at 1000 Hz. That is stated here, not corrected.
        ``"double_pass"``: forward and backward, each pass with the cut-off as stated, as MATLAB's
        ``filtfilt`` of ``butter(2, …)``; half the amplitude (−6 dB) at the cut-off, −3 dB at 0.802
        of it. Only for repeating an experiment whose signals were filtered that way.

    Returns
    -------
    Array
        Filtered signal, (T, ...), at the same times.

    Raises
    ------
    ValueError
        If the whole signal is shorter than the filter needs (real time: 2 samples; the others: one
        period of the cut-off), if times do not increase or do not fit the signal, if the time steps
        for one of the others are unequal, or if the cut-off is not between 0 and half the sampling
        rate.

    See Also
    --------
    butterworth : the same filter with derivatives, its equations and their sources.

    Examples
    --------
    The amplitude left of a sine at the cut-off:

    >>> import numpy as np
    >>> time = np.arange(0, 10, 0.001)
    >>> sine = np.sin(2 * np.pi * 6 * time)
    >>> for method in ("zero_phase", "double_pass"):
    ...     left = low_pass(sine, time, cutoff_hz=6.0, method=method)
    ...     print(method, left[2000:8000].max().round(3))
    zero_phase 0.707
    double_pass 0.5
    """
    return _filtered(signal, time, cutoff_hz, method, outputs=1)[0]


def _filtered(
    signal: ArrayLike, time: ArrayLike, cutoff_hz: float, method: str, outputs: int
) -> list[Array]:
    """Filter every block without gaps: the value, or with its derivatives, (T, ...) each."""
    methods = get_args(LowPassMethod if outputs == 1 else Method)
    if method not in methods:
        choices = " or ".join(f'"{name}"' for name in methods)
        raise ValueError(f"filter method must be {choices}, got {method!r}")
    signal = np.asarray(signal, float)
    time = sample_times(time, signal)
    rate_hz = mean_rate_hz(time)
    if not 0 < cutoff_hz < rate_hz / 2 * (1 - EQUAL_STEPS_TOLERANCE):
        raise ValueError(
            f"cut-off must lie between 0 and half the sampling rate ({rate_hz / 2:g} Hz), "
            f"got {cutoff_hz:g} Hz"
        )
    # both ways, a block shorter than a period of the cut-off has no end to settle at
    needed, shortest = 2, 1
    if method != "realtime":
        needed = shortest = int(np.ceil(rate_hz / cutoff_hz))
        require_equal_steps(time)
    require_length(time, needed)

    columns = over_short_gaps(signal.reshape(len(time), -1), time, cutoff_hz, method)
    results: tuple[Array, ...] = ()
    for rows, sharing in blocks_without_gaps(columns, shortest):
        block = columns[rows, sharing], time[rows], cutoff_hz
        if method == "realtime":
            parts = _realtime(*block)
        else:
            parts = _both_ways(*block, method == "double_pass", derivatives=outputs > 1)
        if parts[0].shape == columns.shape:  # without gaps it is copied nowhere
            results = parts
            break
        results = results or tuple(unknown(columns.shape) for _ in range(outputs))
        for result, part in zip(results, parts, strict=False):
            result[rows, sharing] = part
    results = results or (unknown(columns.shape),) * outputs
    return [result.reshape(signal.shape) for result in results[:outputs]]


def _realtime(signal: Array, time: Array, cutoff_hz: float) -> tuple[Array, ...]:
    """Filter (T, K) samples causally; the signal's first value is the state of rest."""
    step = np.diff(time)
    # steps that differ are taken one by one, as while they are measured
    equal = np.ptp(step) <= EQUAL_STEPS_TOLERANCE * np.mean(step) if len(step) else False
    if not equal or step[0] > longest_gap_s(cutoff_hz):
        usual_s = float(np.median(step)) if len(step) else 1.0
        running, states = RealtimeFilter(cutoff_hz, signal.shape[1], usual_s), []
        for t, x in zip(time, signal - signal[0], strict=True):
            running.step(t, x)
            states.append((running.value, running.velocity, running.acceleration))
        value, velocity, acceleration = np.swapaxes(states, 0, 1)
        return value + signal[0], velocity, acceleration
    # at rest at its first value: no transient from zero
    relative = (signal - signal[0]).T
    to_value, to_velocity, feedback = _section(2 * np.pi * cutoff_hz, float(np.mean(step)))
    value = _recursion(to_value, feedback, relative).T + signal[0]
    velocity = _recursion(to_velocity, feedback, relative).T
    acceleration = np.zeros_like(velocity)
    # mean over the step: ÿ of the mid-point rule
    acceleration[1:] = np.diff(velocity, axis=0) / step[:, None]
    return value, velocity, acceleration


def _both_ways(
    signal: Array, time: Array, cutoff_hz: float, uncorrected: bool, *, derivatives: bool
) -> tuple[Array, ...]:
    """Filter (T, K) samples forward and backward; differentiate the spline through the result."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    # pre-warped: Tustin's rule maps this frequency to the cut-off
    omega = 2 / step * float(np.tan(np.pi * cutoff_hz * step))
    # two passes together attenuate by 3 dB at the cut-off that is asked for
    omega /= 1.0 if uncorrected else DOUBLE_PASS_MINUS_3_DB
    to_value, _, feedback = _section(omega, step)

    def reversed_pass(channels: Array) -> Array:
        rest = channels[:, :1]
        return np.flip(_recursion(to_value, feedback, channels - rest) + rest, axis=1)

    # reflected ends keep value and slope, so that transients are beyond them
    # four periods of the cut-off: a transient decays to 2e-10 over them
    padding = int(np.ceil(4 / (cutoff_hz * step)))
    kept = slice(padding, padding + len(time))
    filtered = np.ascontiguousarray(reversed_pass(reversed_pass(extended(signal, padding).T))).T
    more = spline_derivatives(filtered, step) if derivatives else ()
    return filtered[kept], *(derivative[kept] for derivative in more)


def _recursion(numerator: Array, feedback: Array, channels: Array) -> Array:
    """Run the difference equation of second order over (K, T) samples, from rest at zero.

    As `scipy.signal.lfilter`, which takes half a second to load.
    """
    # n₀ x + n₁ x₋₁ + n₂ x₋₂
    driven = numerator[0] * channels
    for delay in (1, 2):
        driven[:, delay:] += numerator[delay] * channels[:, :-delay]
    # y + f₁ y₋₁ + f₂ y₋₂ is the driven side: of all samples a triangular matrix of three diagonals
    diagonals = np.repeat(feedback[:, None], channels.shape[1], axis=1)
    solved, _ = scipy.linalg.lapack.dtbtrs(
        diagonals, driven.T, uplo="L", diag="U", overwrite_b=True
    )
    return np.asarray(solved.T)


def _section(omega: float, step: float) -> tuple[Array, Array, Array]:
    """Give the difference equation of the filter: numerators of y and ẏ, denominator of both."""
    # ÿ + b ẏ + a y = a x with Butterworth's damping, by the mid-point rule (see `butterworth`)
    a, b = omega**2, np.sqrt(2) * omega
    divisor = 4 + 2 * step * b + step**2 * a
    to_value = step**2 * a * np.array([1.0, 2.0, 1.0]) / divisor
    to_velocity = 2 * step * a * np.array([1.0, 0.0, -1.0]) / divisor
    feedback = np.array([divisor, 2 * step**2 * a - 8, 4 - 2 * step * b + step**2 * a]) / divisor
    return to_value, to_velocity, feedback


class RealtimeFilter:
    """The filter of `butterworth` with ``method="realtime"``, as it runs.

    Parameters
    ----------
    cutoff_hz
        Cut-off [Hz].
    columns
        Number of signals K.
    step_s
        Usual time from one sample to the next [s]. A longer one is divided into such steps along a
        straight line, so that derivatives are of the same time whether samples were lost or not.

    Attributes
    ----------
    value, velocity, acceleration
        Of the last step, (K,): filtered signal and derivatives, NaN where the sample was unknown;
        the next step makes new arrays.

    Examples
    --------
    >>> smooth = RealtimeFilter(6.0, 1, 0.01)
    >>> for k in range(200):
    ...     smooth.step(k / 100, np.array([2 * k / 100]))
    >>> f"{smooth.value[0]:.3f} {smooth.velocity[0]:.3f}"  # of a ramp, 37.5 ms late
    '3.905 2.000'
    """

    def __init__(self, cutoff_hz: float, columns: int, step_s: float) -> None:
        omega = 2 * np.pi * cutoff_hz
        self.a, self.b = omega**2, 2**0.5 * omega
        self.longest_s, self.step_s = longest_gap_s(cutoff_hz), step_s
        self.value, self.velocity, self.acceleration = np.full((3, columns), np.nan)
        self._known_s = np.full(columns, -np.inf)
        self._before = np.zeros(columns)
        self._state = np.zeros((3, columns))

    def step(self, time: float, signal: Array) -> None:
        """Take the next sample, (K,), at its time [s].

        Parameters
        ----------
        time
            After that of the last step [s].
        signal
            (K,); NaN where unknown. A signal that is known again goes on, or after longer than
            `longest_gap_s` begins anew.
        """
        finite = np.isfinite(signal)
        sampled = slice(None) if finite.all() else finite
        # channels with the same last sample go on together
        last_s = set(self._known_s[sampled].tolist())
        state = np.full((3, len(signal)), np.nan)
        for known_s in last_s:
            these = sampled if len(last_s) == 1 else finite & (self._known_s == known_s)
            state[:, these] = self._goes_on(time - known_s, these, signal[these])
        self._state[:, sampled], self._before[sampled] = state[:, sampled], signal[sampled]
        self._known_s[sampled] = time
        self.value, self.velocity, self.acceleration = state

    def _goes_on(self, since_s: float, these: Mask | slice, signal: Array) -> Array:
        """Give the state of some signals that were known so long ago, (3, n)."""
        # after a gap it begins anew, at rest at the first value
        if since_s > self.longest_s:
            return np.array([signal, 0 * signal, 0 * signal])
        (y, v, acceleration), before = self._state[:, these], self._before[these]
        # lost frames are stepped over at the usual step, along the line to this sample
        steps = max(round(since_s / self.step_s), 1)
        change, h = (signal - before) / steps, since_s / steps
        # ÿ = a (x - y) - b ẏ by the trapezoidal rule, x the mean of the signal over the step
        divisor = 4 + 2 * h * self.b + h * h * self.a
        stiffness, damping = 4 * self.a / divisor, (4 * self.b + 2 * h * self.a) / divisor
        for k in range(steps):
            acceleration = stiffness * (before + (k + 0.5) * change - y) - damping * v
            y, v = y + h * v + h * h / 2 * acceleration, v + h * acceleration
        return np.array([y, v, acceleration])


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


def spline_derivatives(samples: Array, step: float) -> tuple[Array, Array]:
    """Give the first two derivatives of a quintic spline, at its samples.

    Parameters
    ----------
    samples
        Without gaps, (N, K), N ≥ 3.
    step
        Time from each to the next [s].

    Returns
    -------
    first, second
        (N, K), per s and per s².

    Notes
    -----
    Coefficients c of the quintic B-splines by a recursive filter forward and backward (Unser,
    Aldroubi and Eden 1993, IEEE Trans Signal Process 41:821), samples mirrored at the ends: what
    that does to the derivatives falls to 0.43 of itself from sample to sample. At sample k they are
    ``(c[k+2] − c[k−2] + 10 (c[k+1] − c[k−1])) / 24 h`` and
    ``(c[k+2] + c[k−2] + 2 (c[k+1] + c[k−1]) − 6 c[k]) / 6 h²``.

    Examples
    --------
    >>> time = np.arange(200) / 100
    >>> first, second = spline_derivatives(time[:, None] ** 3, 0.01)
    >>> first[100].round(9).item(), second[100].round(6).item()
    (3.0, 6.0)
    """
    # coefficients of the quintic B-spline; its derivatives at samples are sums of five of them
    inner = scipy.ndimage.spline_filter1d(samples.T, 5, mode="mirror")

    def summed(*weights: float) -> Array:
        return np.asarray(scipy.ndimage.correlate1d(inner, weights, mode="mirror").T)

    return summed(-1, -10, 0, 10, 1) / (24 * step), summed(1, 2, -6, 2, 1) / (6 * step**2)


def oscillation(
    drive: Array, time: Array, frequency_hz: float, damping: float
) -> tuple[Array, Array]:
    """Give how a mass moves relative to its accelerated support.

    Parameters
    ----------
    drive
        Acceleration of the support times -1, (T, K) [m/s²]; the same in other units gives the same
        in others.
    time
        In equal steps, (T,) [s].
    frequency_hz, damping
        Natural frequency and damping ratio.

    Returns
    -------
    displacement, acceleration
        ``d`` and ``d̈`` of ``d̈ + 2 ζ ω ḋ + ω² d = drive``, from rest, (T, K) [m, m/s²]; solved
        exactly for a drive that is linear between samples.

    Examples
    --------
    >>> displacement, acceleration = oscillation(np.ones((500, 1)), np.arange(500) / 100, 2.0, 0.5)
    >>> f"{displacement[-1, 0] * (2 * np.pi * 2.0) ** 2:.3f} {acceleration[-1, 0]:.3f}"
    '1.000 -0.000'
    """
    omega = 2 * np.pi * frequency_hz
    loss = 2 * damping * omega
    filters = _oscillator(omega, loss, 1 / mean_rate_hz(time))
    # relative to the support: ẍ = drive − 2 ζ ω ẋ − ω² x
    shift, speed = (_recursion(up, down, drive.T).T for up, down in filters)
    return shift, drive - loss * speed - omega**2 * shift


@lru_cache(maxsize=64)
def _oscillator(omega: float, loss: float, step: float) -> list[tuple[Array, Array]]:
    """Give what makes displacement and speed of a drive: numerators and denominators."""
    # displacement, speed, drive and its change over a step h: x₊ = P x + b u + a u₊
    system = np.zeros((4, 4))
    system[:2, :3] = np.array([[0, 1, 0], [-(omega**2), -loss, 1]]) * step
    system[2, 3] = 1
    exact = scipy.linalg.expm(system)
    before, after = exact[:2, 2] - exact[:2, 3], exact[:2, 3]
    # (z − P)⁻¹ is (z + P − tr P) over z² − z tr P + det P, for both states
    trace = np.trace(exact[:2, :2])
    rest = exact[:2, :2] - trace * np.eye(2)
    numerators = np.column_stack([after, before + rest @ after, rest @ before])
    feedback = np.array([1.0, -trace, np.linalg.det(exact[:2, :2])])
    return [(numerator, feedback) for numerator in numerators]
