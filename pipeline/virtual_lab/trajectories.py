"""Smooth functions of time: quintic splines with exact derivatives, and a smooth step."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import BSpline, PPoly, make_interp_spline

from hbm.spatial import Array

DEGREE: Final = 5
"""Of the splines: accelerations are still twice continuously differentiable."""
PADDING: Final = 3 * DEGREE
"""Samples by which a series is continued at both ends, so that the spline inside does not depend
on how it ends."""
_PIECES: Final = PPoly.from_spline(BSpline.basis_element(np.arange(DEGREE + 2.0)).tck)


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A smooth function of time, given by a uniform quintic spline.

    Attributes
    ----------
    start
        Time of the first knot [s].
    rate_hz
        Knots per second.
    coefficients
        One row per knot and some beyond both ends, (K + 4, C).
    """

    start: float
    rate_hz: float
    coefficients: Array

    @property
    def duration(self) -> float:
        """Time from the first knot to the last [s]."""
        return (len(self.coefficients) - DEGREE) / self.rate_hz

    def at(self, time: Array, derivative: int = 0) -> Array:
        """Evaluate a derivative at any times between the knots, (T, C) [unit/s^derivative]."""
        position = (np.asarray(time, float) - self.start) * self.rate_hz
        knot = np.clip(np.floor(position).astype(int), 0, len(self.coefficients) - DEGREE - 1)
        weights = _weights(position - knot, derivative) * self.rate_hz**derivative
        value = np.zeros((len(position), self.coefficients.shape[1]))
        for k in range(DEGREE + 1):
            value += weights[:, k, None] * self.coefficients[knot + k]
        return value

    def between_knots(self, parts: int, first: int, last: int, derivative: int = 0) -> Array:
        """Evaluate a derivative at equal intervals between knots, time last.

        Parameters
        ----------
        parts
            Samples per knot.
        first, last
            Knots from which, and before which, samples begin; none is beyond the last knot.
        derivative
            Which.

        Returns
        -------
        Array
            (C, N) [unit/s^derivative].
        """
        knots = len(self.coefficients) - DEGREE + 1
        own = np.ascontiguousarray(self.coefficients[first : last + DEGREE].T)
        weights = _weights(np.arange(parts) / parts, derivative) * self.rate_hz**derivative
        count = last - first
        values = np.zeros((len(own), count, parts))
        for part in range(parts):
            end = count if part == 0 or last < knots else count - 1
            for k in np.flatnonzero(weights[part]):
                values[:, :end, part] += weights[part, k] * own[:, k : k + end]
        flat = values.reshape(len(own), -1)
        return flat if last < knots else flat[:, : flat.shape[1] - parts + 1]


def fit_trajectory(values: Array, rate_hz: float, start: float = 0.0) -> Trajectory:
    """Interpolate samples by a quintic spline.

    Parameters
    ----------
    values
        Samples at equal intervals, (K, C); more of them than `PADDING`.
    rate_hz
        Sampling rate [Hz].
    start
        Time of the first sample [s].

    Returns
    -------
    Trajectory
        Passes through the samples; four times continuously differentiable.
    """
    extended = np.pad(values, ((PADDING, PADDING), (0, 0)), mode="reflect", reflect_type="odd")
    spline = make_interp_spline(np.arange(len(extended)), extended, k=DEGREE)
    first = PADDING - DEGREE // 2
    return Trajectory(start, rate_hz, spline.c[first : first + len(values) + DEGREE - 1])


def smooth_step(x: Array) -> Array:
    """Rise from 0 (at x = 0 and below) to 1 (at x = 1 and above), without units.

    Notes
    -----
    The minimum-jerk polynomial ``10 x³ - 15 x⁴ + 6 x⁵`` (Flash and Hogan 1985, J Neurosci 5:1688):
    velocity and acceleration are zero at both ends.
    """
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


def _weights(fraction: Array, derivative: int) -> Array:
    """Give the weights of the six coefficients around places between two knots, (T, 6)."""
    places = np.arange(DEGREE, -1, -1) + fraction[:, None]
    return np.asarray(_PIECES(places, nu=derivative))
