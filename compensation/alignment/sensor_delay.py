"""How much later each accelerometer of a platform is than its plates."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from compensation.alignment.delay import (
    BLOCKS,
    MIN_VARIANCE,
    Delay,
    decimated,
    estimate_delay,
    linear_fit,
    without_step,
)
from compensation.inputs import read_rate, read_table
from hbm.spatial import Array

SOUGHT_S: Final = np.arange(-0.03, 0.0301, 0.003)
"""About the common delay, in which the delay of each sensor is sought: the steps are a fraction of
the fastest motion's period, so that one of them leads to the best."""
SEARCHES: Final = 2
"""Rounds over all sensors; the delay of one changes what fits best of another."""
SEARCHED: Final = 4
"""Of the samples every which one is searched: their covariance needs no more."""
MODEL_ERROR_S: Final = 0.00005
"""Standard error besides the noise's: a platform that vibrates on an elastic base, which no rigid
motion explains, moves the estimate by up to this (virtual laboratory, 7 to 30 Hz)."""
MAX_SEPARATE_ERROR_S: Final = 0.002
"""Standard error above which the sensors cannot be told apart and share the common delay."""


def sensor_delays(
    accelerations: ArrayLike, wrench: ArrayLike, rate_hz: float, longest_s: float = 0.2
) -> tuple[Delay, ...]:
    """Estimate how much later each accelerometer is than the empty plates that move with it.

    Parameters
    ----------
    accelerations
        Readings at the plates' nominal instants, three columns per sensor, (N, 3 S), in any unit.
    wrench
        Wrenches of one or more empty plates side by side, (N, 6 P), in any unit.
    rate_hz
        Common sampling rate [Hz].
    longest_s
        Delays are sought up to this, either way [s].

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
    >>> from compensation import low_pass, undo_delay
    >>> rng = np.random.default_rng(0)
    >>> felt = low_pass(rng.normal(size=(6000, 6)), 200.0, 5.0, "zero_phase")
    >>> plate = felt @ rng.normal(size=(6, 6)) + 0.001 * rng.normal(size=(6000, 6))
    >>> felt[:, 3:] = np.nan_to_num(undo_delay(felt[:, 3:], -0.005, 200.0))
    >>> [round(1000 * late.seconds, 1) + 0.0 for late in sensor_delays(felt, plate, 200.0)]
    [0.0, 5.0]
    """
    a, w = read_table(accelerations, "accelerations"), read_table(wrench, "wrench")
    common = estimate_delay(a, w, rate_hz, longest_s)
    all_alike = Delay(
        -common.seconds, float(np.hypot(common.standard_error, MODEL_ERROR_S)), common.explained
    )
    count = a.shape[1] // 3
    if count == 1:
        return (all_alike,)
    x, rate = decimated(a, read_rate(rate_hz))
    y, _ = decimated(w, rate_hz)
    model = _LateSensors(x, y, round(longest_s * rate))
    delays = _search(model, np.full(count, all_alike.seconds * rate), SOUGHT_S * rate)
    delays, covariance = without_step(model.gauss_newton, delays)
    errors = np.hypot(np.sqrt(np.diag(covariance)) / rate, MODEL_ERROR_S)
    if not np.all(errors < MAX_SEPARATE_ERROR_S):
        return tuple(all_alike for _ in range(count))
    explained = model.explained(delays)
    return tuple(
        Delay(float(late / rate), float(error), explained)
        for late, error in zip(delays, errors, strict=True)
    )


class _LateSensors:
    """The linear model of wrenches (N, C) by sensors (N, 3 S), each read ahead by its delay."""

    def __init__(self, readings: Array, wrench: Array, reach: int) -> None:
        self.sensors = [slice(3 * k, 3 * k + 3) for k in range(readings.shape[1] // 3)]
        self.splines = [CubicSpline(np.arange(len(readings)), readings[:, s]) for s in self.sensors]
        self.inside = np.arange(reach + 1, len(readings) - reach - 1)
        self.wrench = wrench[self.inside]

    def _ahead(self, delays: Array, derivative: int, every: int = 1) -> Array:
        at = self.inside[::every]
        parts = [
            spline(at + late, derivative) for late, spline in zip(delays, self.splines, strict=True)
        ]
        return np.hstack(parts)

    def _fit(self, delays: Array) -> tuple[Array, Array, Array]:
        x = np.column_stack([self._ahead(delays, 0), np.ones(len(self.inside))])
        return linear_fit(x, self.wrench)

    def misfit(self, delays: Array) -> float:
        """Give how little all channels have in common: the logarithm of their covariance's volume.

        Sensors on one rigid body agree in what sway does to them, and together they predict the
        plates; a wrong delay spoils either.
        """
        together = np.hstack([self._ahead(delays, 0, SEARCHED), self.wrench[::SEARCHED]])
        variances = np.linalg.eigvalsh(np.cov(together, rowvar=False))
        return float(np.sum(np.log(np.maximum(variances, MIN_VARIANCE))))

    def explained(self, delays: Array) -> float:
        left = np.sum(self._fit(delays)[2] ** 2)
        return 1 - float(left / np.sum((self.wrench - self.wrench.mean(axis=0)) ** 2))

    def gauss_newton(self, delays: Array) -> tuple[Array, Array]:
        """Give the step of the delays and their covariance, in samples."""
        basis, gain, left = self._fit(delays)
        weight = 1 / np.maximum(np.mean(left**2, axis=0), MIN_VARIANCE)
        rates = self._ahead(delays, 1)
        slopes = [rates[:, s] @ gain[s] for s in self.sensors]
        slopes = [(slope - basis @ (basis.T @ slope)) * np.sqrt(weight) for slope in slopes]
        weighted = left * np.sqrt(weight)
        scores = np.column_stack([np.vecdot(slope, weighted) for slope in slopes])
        inverse = np.linalg.pinv([[np.vdot(one, other) for other in slopes] for one in slopes])
        blocks = np.stack([block.sum(axis=0) for block in np.array_split(scores, BLOCKS)])
        covariance = inverse @ (blocks.T @ blocks) @ inverse * BLOCKS / (BLOCKS - 1)
        return inverse @ scores.sum(axis=0), covariance


def _search(model: _LateSensors, delays: Array, steps: Array) -> Array:
    """Vary the delay of one sensor after the other by some steps, and keep the best."""
    for _ in range(SEARCHES):
        for k in range(len(delays)):
            tried = [delays + step * (np.arange(len(delays)) == k) for step in steps]
            delays = min(tried, key=model.misfit)
    return delays
