"""Cut-off frequency of a noisy signal from the smoothing spline that fits it best."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dct
from scipy.optimize import minimize_scalar

from compensation.inputs import read_rate, read_signal, refuse_constant
from hbm.spatial import Array


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
        Smoothing or interval not positive, or an odd order.

    Notes
    -----
    ``ω₀ = (p T)^(-0.5/M)`` (Woltring 1986; van de Loosdrecht 2018, eq. D.8). A spline passes
    ``1 / (1 + (ω/ω₀)^(2M))`` without delay: half the amplitude at ``ω₀``, where a Butterworth
    filter of one pass leaves 0.71.
    """
    if not (smoothing > 0 and interval_s > 0 and order > 0 and order % 2 == 0):
        raise ValueError(
            f"smoothing and interval must be positive and the order even, got {smoothing}, "
            f"{interval_s} s and {order}"
        )
    return float((smoothing * interval_s) ** (-1 / order) / (2 * np.pi))


def spline_smoothing(signal: ArrayLike, rate_hz: float) -> float:
    """Find the smoothing of a cubic spline by generalised cross-validation.

    Parameters
    ----------
    signal
        Samples at a constant rate, (N,), with white noise.
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    float
        Weight ``p`` of the squared second derivative [s³]; `cutoff_of_spline` makes it a frequency.

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
    the spline's reach.
    """
    x, rate = read_signal(signal, "signal"), read_rate(rate_hz)
    if len(x) < 10:
        raise ValueError(f"{len(x)} samples are too few to find a smoothing, give at least 10")
    refuse_constant(x[:, None], "signal", ("its only channel",))
    line = np.polynomial.Polynomial.fit(np.arange(len(x)), x, 1)
    amplitude: Array = dct(x - line(np.arange(len(x))), norm="ortho")
    theta = np.pi * np.arange(len(x)) / len(x)
    penalty = (2 - 2 * np.cos(theta)) ** 2 / ((2 + np.cos(theta)) / 3) * rate**3

    def score(log_p: float) -> float:
        removed = 1 - 1 / (1 + 10**log_p * penalty)
        return float(np.log(np.sum((removed * amplitude) ** 2)) - 2 * np.log(removed.mean()))

    middle = -3 * np.log10(rate)  # where half of the spectrum is smoothed, whatever the rate
    grid = middle + np.linspace(-8, 12, 201)
    nearest = grid[int(np.argmin([score(log_p) for log_p in grid]))]
    best = minimize_scalar(score, bounds=(nearest - 0.1, nearest + 0.1), method="bounded")
    return float(10**best.x)
