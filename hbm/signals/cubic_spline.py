"""The cubic spline through samples, fast where their steps are equal."""

from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import correlate1d, spline_filter1d

from hbm.spatial import Array, Indices

POLE: Final = float(np.sqrt(3) - 2)
"""Of the recursive filter that turns samples into coefficients: its response falls to 0.27 of
itself from sample to sample, with alternating sign."""
REACH: Final = 32
"""Samples over which that response falls below the rounding error: 0.27³² is 5e-19."""
FOURTH_DIFFERENCE: Final = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
"""Of coefficients: by how much the third derivative jumps at the sample in their middle."""
MAX_ROUNDING_STEPS: Final = 1e-9
"""Of a sample's time from equal steps, in steps: the rounding error of times in seconds."""


def cubic_spline(time: Array, samples: Array, at: Array) -> Array:
    """Evaluate the cubic spline with not-a-knot ends through samples.

    Parameters
    ----------
    time
        Sample times, (N,), N ≥ 4, increasing [s].
    samples
        Without gaps, (N, K).
    at
        Wanted times, (S,) [s], of the recorded ones.

    Returns
    -------
    Array
        Values there, (S, K).

    Notes
    -----
    With equal steps the coefficients c of the cubic B-splines solve
    ``(c[k−1] + 4 c[k] + c[k+1]) / 6 = y[k]``, by a recursive filter forward and backward
    (Unser, Aldroubi and Eden 1993, IEEE Trans Signal Process 41:821). Solutions differ by multiples
    of the filter's response from either end; these are set so that the third derivative is
    continuous at the second sample and the last but one. It is the spline that SciPy's general
    solver gives, but for rounding, in a third of the time; at the samples it is the samples.

    Examples
    --------
    >>> time = np.arange(100) / 100
    >>> cubic_spline(time, time[:, None] ** 3, np.array([0.005, 0.5])).ravel().round(12).tolist()
    [1.25e-07, 0.125]
    """
    step = (time[-1] - time[0]) / (len(time) - 1)
    from_equal_steps = time - (time[0] + step * np.arange(len(time)))
    if len(time) < 2 * REACH or np.abs(from_equal_steps).max() > MAX_ROUNDING_STEPS * step:
        spline: Array = make_interp_spline(time, samples)(at)
        return spline
    place = (at - time[0]) / step
    nearest = np.rint(place)
    if np.abs(place - nearest).max(initial=0) <= MAX_ROUNDING_STEPS:
        of_sample: Array = samples.take(nearest.astype(int), axis=0)
        return of_sample
    before = np.clip(np.floor(place).astype(int), 0, len(time) - 2)
    coefficients, share = _coefficients(samples), place - before
    if every := _common_step(before, share):
        first, last = before[[0, -1]].tolist()
        near, of_all = coefficients[first : last + 4].T, np.concatenate(_weights(share[:1]))
        # origin: the first weight is of the coefficient at the same place
        summed = correlate1d(near, of_all, mode="constant", origin=-2)
        return np.asarray(summed[:, : last - first + 1 : every].T)
    weights = _weights(share[:, None])
    value: Array = weights[0] * coefficients.take(before, axis=0)
    for k in (1, 2, 3):
        value += weights[k] * coefficients.take(before + k, axis=0)
    return value


def _common_step(before: Indices, share: Array) -> int:
    """Give the samples from each place to the next; 0 where these differ, or the shares do."""
    steps = np.diff(before)
    alike = len(steps) > 0 and steps[0] > 0 and bool((steps == steps[0]).all())
    return int(steps[0]) if alike and np.ptp(share) <= MAX_ROUNDING_STEPS else 0


def _weights(share: Array) -> tuple[Array, Array, Array, Array]:
    """Give the four B-splines that count at a share of the way from one sample to the next."""
    rest = 1 - share
    of_share, of_rest = share * share, rest * rest
    return (
        of_rest * rest / 6,
        2 / 3 - of_share * (2 - share) / 2,
        2 / 3 - of_rest * (2 - rest) / 2,
        of_share * share / 6,
    )


def _coefficients(samples: Array) -> Array:
    """Give the coefficients of the spline through (N, K) samples, (N + 2, K)."""
    channels = np.empty((samples.shape[1], len(samples) + 2))
    spline_filter1d(samples.T, 3, output=channels[:, 1:-1], mode="mirror")
    coefficients = channels.T
    coefficients[0], coefficients[-1] = coefficients[2], coefficients[-3]
    for from_end in (coefficients, coefficients[::-1]):
        jump = FOURTH_DIFFERENCE @ from_end[: len(FOURTH_DIFFERENCE)]
        from_end[:REACH] -= POLE ** np.arange(REACH)[:, None] * jump / (1 - POLE) ** 4
    return coefficients
