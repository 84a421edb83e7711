"""Cut-off frequency of a noisy signal from the smoothing spline that fits it best."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dct
from scipy.optimize import minimize_scalar

from compensation.inputs import read_rate, read_signal, refuse_constant
from hbm.spatial import Array

MIN_SAMPLES: Final = 10
"""Fewer hold no frequencies to tell signal from noise by."""
GRID: Final = np.linspace(-8, 12, 201)
"""Powers of ten of the smoothing about that which passes half of the spectrum; steps of 0.1."""


def cutoff_of_spline(smoothing: float, interval_s: float, order: int = 4) -> float:
    """Give the frequency at which a smoothing spline halves an amplitude.

    Parameters
    ----------
    smoothing
        Weight ``p`` of the squared derivative, in ``Σ (f - x)² + p ∫ f⁽ᴹ⁾²`` [s^(2M - 1)].
    interval_s
        Sampling interval ``T`` [s].
    order
        Order ``2M`` of the spline: 4 for a cubic one.

    Returns
    -------
    float
        Cut-off frequency [Hz].

    Raises
    ------
    ValueError
        Smoothing or interval that is not positive, or an odd order.

    Notes
    -----
    ``ω₀ = (p T)^(-0.5/M)`` (Woltring 1986; van de Loosdrecht 2018, eq. D.8). A spline passes
    ``1 / (1 + (ω/ω₀)^(2M))`` without delay: half the amplitude at ``ω₀``, where a Butterworth
    filter of one pass leaves 0.71.

    Examples
    --------
    >>> f"{cutoff_of_spline(6.4e-6, 0.01):.1f} Hz"
    '10.0 Hz'
    """
    if not (smoothing > 0 and interval_s > 0 and order > 0 and order % 2 == 0):
        raise ValueError(
            f"smoothing and interval must be positive and the order even, got {smoothing}, "
            f"{interval_s} s and {order}"
        )
    return float((smoothing * interval_s) ** (-1 / order) / (2 * np.pi))


def spline_smoothing(signal: ArrayLike, rate_hz: float) -> float:
    """Find the smoothing parameter of a cubic spline by generalised cross-validation.

    Parameters
    ----------
    signal
        Samples at a constant rate, (N,), with white noise.
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    float
        Weight ``p`` of the squared second derivative [s³]; `cutoff_of_spline` gives its frequency.

    Raises
    ------
    ValueError
        Wrong shape, fewer than 10 samples, gaps, or a constant signal.

    Notes
    -----
    On even samples a cubic smoothing spline is a filter that leaves ``1 / (1 + p q(θ))`` of
    every cosine, with ``q = (2 - 2 cos θ)² / ((2 + cos θ) / 3) / T³``, so that the score (Craven
    and Wahba 1979) costs one cosine transform. The ends are mirrored about the straight line
    through the signal, where a spline is free: without consequence for signals much longer than
    the spline's impulse response.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(0, 20, 0.01)
    >>> noise = 0.01 * np.random.default_rng(0).normal(size=len(time))
    >>> p = spline_smoothing(np.sin(2 * np.pi * time) + noise, 100.0)
    >>> f"{cutoff_of_spline(p, 0.01):.0f} Hz"
    '8 Hz'
    """
    x, rate = read_signal(signal, "signal"), read_rate(rate_hz)
    if len(x) < MIN_SAMPLES:
        raise ValueError(
            f"{len(x)} samples are too few to find a smoothing, give at least {MIN_SAMPLES}"
        )
    refuse_constant(x[:, None], "signal", ("its only channel",))
    line = np.polynomial.Polynomial.fit(np.arange(len(x)), x, 1)
    amplitude: Array = dct(x - line(np.arange(len(x))), norm="ortho")
    theta = np.pi * np.arange(len(x)) / len(x)
    penalty = (2 - 2 * np.cos(theta)) ** 2 / ((2 + np.cos(theta)) / 3) * rate**3

    def score(log_p: float) -> float:
        removed = 1 - 1 / (1 + 10**log_p * penalty)
        return float(np.log(np.sum((removed * amplitude) ** 2)) - 2 * np.log(removed.mean()))

    middle = -3 * np.log10(rate)  # where half of the spectrum is smoothed, whatever the rate
    grid = middle + GRID
    nearest = grid[int(np.argmin([score(log_p) for log_p in grid]))]
    best = minimize_scalar(score, bounds=(nearest - 0.1, nearest + 0.1), method="bounded")
    return float(10**best.x)
