"""What accelerating belts leave in their plates: the pitch moment of motor and rollers."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from compensation.inputs import read_rate, read_signal, refuse_constant, refuse_unequal
from hbm.numbers import read_numbers
from hbm.signals.filtering import LowPassMethod, low_pass
from hbm.spatial import Array, freeze_arrays

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "belts")

SETTLING_SAMPLES: Final = 100
"""At the start of a trial, which depend on the belt's motion before; 1 s at 100 Hz."""
START_GRID: Final = np.linspace(-0.8, 0.8, 5)
"""Reflection coefficients from which the fit starts; the error has several minima."""
State = tuple[float, float]


def belt_acceleration(
    speed: ArrayLike, rate_hz: float, cutoff_hz: float, method: LowPassMethod
) -> Array:
    """Give a belt's acceleration: central differences of its speed, low-passed.

    Parameters
    ----------
    speed
        Belt speed at a constant rate, (N,) [m/s]; resample first where the times jitter.
    rate_hz
        Sampling rate [Hz].
    cutoff_hz, method
        As of `low_pass` [Hz]; filter the pitch moment equally.

    Returns
    -------
    Array
        Acceleration, (N,) [m/s²].

    Raises
    ------
    ValueError
        As `low_pass`; also gaps, and speeds that no belt reaches (mm/s, km/h).

    Examples
    --------
    >>> import numpy as np
    >>> speed = 1.3 + 0.5 * np.arange(0, 2, 0.01)
    >>> belt_acceleration(speed, 100.0, 10.0, "realtime")[-1].round(6)
    np.float64(0.5)
    """
    v = read_signal(speed, "belt speed")
    if len(v) < 2:
        raise ValueError("belt speed has 1 sample; an acceleration needs at least 2")
    if np.max(np.abs(v)) > LIMITS.largest_speed:
        raise ValueError(
            f"belt speed reaches {np.max(np.abs(v)):.3g} m/s, "
            f"expected below {LIMITS.largest_speed:g}; is it in m/s?"
        )
    return low_pass(np.gradient(v, 1 / read_rate(rate_hz)), rate_hz, cutoff_hz, method)


@dataclass(frozen=True, slots=True)
class BeltModel:
    """Second-order discrete model of the pitch moment of an unloaded, accelerating belt.

    ``M[k] = -θ₁ M[k-1] - θ₂ M[k-2] + θ₃ a[k+s] + θ₄ a[k+s-1] + θ₅ a[k+s-2]`` with ``s`` the
    advance. It is valid at the sampling rate of its fit.

    Attributes
    ----------
    theta
        (5,): θ₁, θ₂ [1]; θ₃, θ₄, θ₅ [N·m per m/s²].
    advance
        Samples by which the acceleration is read ahead; in real time the moment is late by them.
    r_squared, rms_measured, rms_compensated
        Of the calibration [1, N·m, N·m].

    Examples
    --------
    >>> model = BeltModel([-1.2, 0.5, 2.0, -1.0, 0.5])
    >>> model.predict([1.0, 0.0, 0.0, 0.0]).round(2)
    array([2.  , 1.4 , 1.18, 0.72])
    """

    theta: Array
    advance: int = 0
    r_squared: float = field(default=float("nan"), kw_only=True)
    rms_measured: float = field(default=float("nan"), kw_only=True)
    rms_compensated: float = field(default=float("nan"), kw_only=True)

    def __post_init__(self) -> None:
        freeze_arrays(self, "belt model", theta=(5,))
        if self.advance < 0:
            raise ValueError(f"belt model: advance must be 0 or more samples, got {self.advance}")
        # poles of the recursion inside the unit circle: the moment fades with the motion
        largest = np.max(np.abs(np.roots(self._recursion)))
        if not largest < 1:
            raise ValueError(f"belt model: unstable, its largest pole has size {largest:.3g}")

    @property
    def at_rest(self) -> State:
        """State of a belt that has run at constant speed, with which `step` begins."""
        return (0.0, 0.0)

    def predict(self, belt_acceleration: ArrayLike) -> Array:
        """Predict the pitch moment of a whole trial that begins at constant speed.

        Parameters
        ----------
        belt_acceleration
            Filtered acceleration, (N,) [m/s²].

        Returns
        -------
        Array
            Pitch moment, (N,) [N·m].

        Raises
        ------
        ValueError
            Wrong shape, no samples or gaps.
        """
        a = read_signal(belt_acceleration, "belt acceleration")
        ahead = _advanced(a, self.advance)
        return np.asarray(scipy.signal.lfilter(self.theta[2:], self._recursion, ahead))

    def step(self, belt_acceleration: float, state: State) -> tuple[float, State]:
        """Predict one sample in real time.

        Parameters
        ----------
        belt_acceleration
            The newest filtered acceleration [m/s²].
        state
            As the last step returned it; `at_rest` at first.

        Returns
        -------
        moment, state
            Pitch moment `advance` samples ago [N·m], and the state of the next step.
        """
        theta_1, theta_2, theta_3, theta_4, theta_5 = self.theta.tolist()
        # transposed direct form II, as scipy.signal.lfilter computes it
        moment = theta_3 * belt_acceleration + state[0]
        following = (
            theta_4 * belt_acceleration - theta_1 * moment + state[1],
            theta_5 * belt_acceleration - theta_2 * moment,
        )
        return moment, following

    @property
    def _recursion(self) -> Array:
        return np.concatenate([[1.0], self.theta[:2]])


def fit_belt(belt_acceleration: ArrayLike, pitch_moment: ArrayLike, advance: int = 0) -> BeltModel:
    """Fit the pitch moment of an unloaded belt to its acceleration.

    Parameters
    ----------
    belt_acceleration
        Filtered acceleration of a random belt trial, (N,) [m/s²], at a constant rate.
    pitch_moment
        Pitch moment of the empty plate at the same instants, through the same filter, (N,) [N·m].
    advance
        Samples to read the acceleration ahead, where the speed arrives later than the moment;
        0 is the published model.

    Returns
    -------
    BeltModel
        Stable, and best in the sense of least squares over its free-running output.

    Raises
    ------
    ValueError
        Wrong shapes, no or too few samples, gaps, different numbers of samples, constant channels,
        or implausible units.

    Notes
    -----
    The simulated output is fitted, not the one-step-ahead prediction, by Gauss–Newton steps with
    analytic sensitivities: each derivative is the model's own denominator applied to the past
    output or input. The recursion is written in reflection coefficients ``κ``,
    ``θ₁ = κ₁ (1 + κ₂), θ₂ = κ₂``, which are stable for ``|κ| < 1``; they are bounded to 0.9. The
    error has several minima: the best of several starts is taken. The first 100 samples, which
    depend on the belt's motion before, do not count.

    Source: Hnat and van den Bogert (2014).

    Deviations from the original: bounded to stable models; best of several starts; optional
    advance.

    Examples
    --------
    >>> import numpy as np
    >>> acceleration = np.random.default_rng(0).normal(size=1500)
    >>> moment = BeltModel([-1.2, 0.5, 2.0, -1.0, 0.5]).predict(acceleration)
    >>> fit_belt(acceleration, moment).theta.round(3)
    array([-1.2,  0.5,  2. , -1. ,  0.5])
    """
    a = read_signal(belt_acceleration, "belt acceleration")
    moment = read_signal(pitch_moment, "pitch moment")
    refuse_unequal(belt_acceleration=a, pitch_moment=moment)
    if len(a) < LIMITS.least_samples:
        raise ValueError(
            f"{len(a)} samples are too few to fit a belt model, give {LIMITS.least_samples}"
        )
    refuse_constant(a[:, None], "belt acceleration", ("its only channel",))
    refuse_constant(moment[:, None], "pitch moment", ("its only channel",))
    ratio = float(np.std(moment) / np.std(a))
    if not LIMITS.least_moment < ratio < LIMITS.largest_moment:
        raise ValueError(
            f"pitch moment by belt acceleration is {ratio:.3g} N·m per m/s², expected "
            f"{LIMITS.least_moment:g} to {LIMITS.largest_moment:g}; the moment must "
            "be in N·m, the acceleration in m/s²"
        )
    if advance < 0:
        raise ValueError(f"advance must be 0 or more samples, got {advance}")
    # a moment that precedes its cause: the channels have different delays
    ahead, moment = a[advance:], moment[: len(moment) - advance]
    # the output error has several minima: a grid of poles, with the best numerator for each
    starts = [_best_numerator(k1, k2, ahead, moment) for k1 in START_GRID for k2 in START_GRID]
    starts.sort(key=lambda start: start[0])
    # more than three starts find the same minimum
    fits = [_refine(start, ahead, moment) for _, start in starts[:3]]
    best = min(fits, key=lambda fit: float(fit.cost))
    theta = _theta(best.x)
    # quality of the free-running model, as `predict` will be used
    measured = moment[SETTLING_SAMPLES:]
    error = measured - _sensitivities(theta, ahead)[0][SETTLING_SAMPLES:]
    return BeltModel(
        theta,
        advance,
        r_squared=float(1 - np.sum(error**2) / np.sum((measured - measured.mean()) ** 2)),
        rms_measured=float(np.sqrt(np.mean(measured**2))),
        rms_compensated=float(np.sqrt(np.mean(error**2))),
    )


def _advanced(signal: Array, samples: int) -> Array:
    return np.concatenate([signal[samples:], np.repeat(signal[-1:], samples)])


def _delayed(signal: Array, samples: int) -> Array:
    return np.concatenate([np.zeros(samples), signal[: len(signal) - samples]])


def _theta(kappa_and_numerator: Array) -> Array:
    kappa_1, kappa_2, *numerator = kappa_and_numerator
    # reflection coefficients between −1 and 1 are stable poles, whatever their combination
    return np.array([kappa_1 * (1 + kappa_2), kappa_2, *numerator])


def _sensitivities(theta: Array, a: Array) -> tuple[Array, Array]:
    """Give the free-running output, (N,), and its derivatives by theta, (N, 5)."""
    # derivatives of a recursion run through the same recursion
    recursion = [1, *theta[:2]]
    moment = scipy.signal.lfilter(theta[2:], recursion, a)
    by_past, by_input = (scipy.signal.lfilter([1], recursion, x) for x in (-moment, a))
    columns = [(by_past, 1), (by_past, 2), (by_input, 0), (by_input, 1), (by_input, 2)]
    return moment, np.column_stack([_delayed(signal, n) for signal, n in columns])


def _best_numerator(kappa_1: float, kappa_2: float, a: Array, moment: Array) -> tuple[float, Array]:
    theta = _theta(np.array([kappa_1, kappa_2, 0.0, 0.0, 0.0]))
    basis = _sensitivities(theta, a)[1][SETTLING_SAMPLES:, 2:]
    # with fixed poles the output is linear in the numerator
    numerator = np.linalg.lstsq(basis, moment[SETTLING_SAMPLES:])[0]
    error = moment[SETTLING_SAMPLES:] - basis @ numerator
    return float(error @ error), np.array([kappa_1, kappa_2, *numerator])


def _refine(start: Array, a: Array, moment: Array) -> "scipy.optimize.OptimizeResult":
    def error(x: Array) -> Array:
        return (_sensitivities(_theta(x), a)[0] - moment)[SETTLING_SAMPLES:]

    def jacobian(x: Array) -> Array:
        by_theta = _sensitivities(_theta(x), a)[1][SETTLING_SAMPLES:]
        # chain rule: θ₁ = κ₁ (1 + κ₂), θ₂ = κ₂
        by_kappa_1 = by_theta[:, 0] * (1 + x[1])
        by_kappa_2 = by_theta[:, 0] * x[0] + by_theta[:, 1]
        return np.column_stack([by_kappa_1, by_kappa_2, by_theta[:, 2:]])

    # poles well inside the unit circle
    bound = np.array([0.9] * 2 + [np.inf] * 3)
    return scipy.optimize.least_squares(
        error, start, jac=jacobian, bounds=(-bound, bound), x_scale="jac"
    )


MIN_SPLINE_SAMPLES: Final = 10
"""Fewer hold no frequencies to tell signal from noise by."""


def spline_cutoff(signal: ArrayLike, rate_hz: float) -> float:
    """Give the cut-off frequency of the cubic smoothing spline that fits a signal best.

    Parameters
    ----------
    signal
        Samples at a constant rate, (N,), with white noise.
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    float
        Where the spline halves an amplitude [Hz].

    Raises
    ------
    ValueError
        Wrong shape, fewer than 10 samples, gaps, or a constant signal.

    Notes
    -----
    The spline ``f`` minimises ``Σ (f - x)² + p ∫ f''²``; ``p`` is found by generalised
    cross-validation (Craven and Wahba 1979). On even samples the spline is a filter that leaves
    ``1 / (1 + p q(θ))`` of every cosine, with ``q = (2 - 2 cos θ)² / ((2 + cos θ) / 3) / T³``, so
    that the score costs one cosine transform. The ends are mirrored about the straight line through
    the signal, where a spline is free: without consequence for signals much longer than the
    spline's impulse response.

    It passes ``1 / (1 + (ω/ω₀)⁴)`` without delay, with ``ω₀ = (p T)^(-1/4)`` (Woltring 1986; van
    de Loosdrecht 2018, eq. D.8): half the amplitude at ``ω₀``, where a Butterworth filter of one
    pass leaves 0.71.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(0, 20, 0.01)
    >>> noise = 0.01 * np.random.default_rng(0).normal(size=len(time))
    >>> f"{spline_cutoff(np.sin(2 * np.pi * time) + noise, 100.0):.0f} Hz"
    '8 Hz'
    """
    x, rate = read_signal(signal, "signal"), read_rate(rate_hz)
    if len(x) < MIN_SPLINE_SAMPLES:
        raise ValueError(
            f"{len(x)} samples are too few to find a smoothing, give at least {MIN_SPLINE_SAMPLES}"
        )
    refuse_constant(x[:, None], "signal", ("its only channel",))
    # without its line the signal's periodic extension has no jump
    line = np.polynomial.Polynomial.fit(np.arange(len(x)), x, 1)
    amplitude: Array = scipy.fft.dct(x - line(np.arange(len(x))), norm="ortho")
    theta = np.pi * np.arange(len(x)) / len(x)
    # eigenvalues of the cubic smoothing spline's penalty for equal steps, in the cosine basis
    penalty = (2 - 2 * np.cos(theta)) ** 2 / ((2 + np.cos(theta)) / 3) * rate**3

    def score(log_p: float) -> float:
        removed = 1 - 1 / (1 + 10**log_p * penalty)
        # generalised cross-validation: error by the square of the degrees of freedom left
        return float(np.log(np.sum((removed * amplitude) ** 2)) - 2 * np.log(removed.mean()))

    middle = -3 * np.log10(rate)  # where half of the spectrum is smoothed, whatever the rate
    # powers of ten of the smoothing, in steps of 0.1
    grid = middle + np.linspace(-8, 12, 201)
    nearest = grid[int(np.argmin([score(log_p) for log_p in grid]))]
    bounds = nearest - 0.1, nearest + 0.1
    best = scipy.optimize.minimize_scalar(score, bounds=bounds, method="bounded")
    # frequency that the spline halves, from its smoothing
    return float((10**best.x * (1 / rate)) ** (-1 / 4) / (2 * np.pi))
