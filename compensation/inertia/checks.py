"""Checks of a calibration, and of a trial's accelerometers against it."""

from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.model import InertiaModel
from compensation.inputs import read_table
from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, Array

CLIPPED_SHARE: Final = 0.98
"""Of a sensor's range, from which on a sample counts as clipped; room for an error of the gain."""
MAX_EXCESS_SHARE: Final = 0.05
"""Of the calibration's range, by which a trial may exceed it; a linear model extrapolates."""
MIN_ROTATION_DEG: Final = 45.0
"""Between calibration and trial; the platform itself tilts by 10° at most."""
GRAVITY_FACTOR: Final = 2.0
"""Either way from gravity; a sensor whose median is outside is dead or in another unit."""
MIN_LOAD_N: Final = 150.0
"""Mean force above which a zeroed plate is not empty: a fifth of a body weight."""
MAX_UNEXPLAINED_N: Final = 30.0
"""Standard deviation of the force that a fit on an empty plate leaves; usual are a few newtons."""
CONSTRAINT_MPS2: Final = 0.05
"""Standard deviation below which a combination of channels was constant in the calibration."""
DRIFT_MPS2: Final = 0.03
"""By which the offsets of sensors are assumed to change between calibration and trial."""
MAX_VIOLATION: Final = 9.0
"""Mean square of the constraints, in units of that drift squared: three times the drift."""
MIN_IMPROVEMENT: Final = 4.0
"""Factor by which exchanging two sensors must reduce that mean square; 2 in root mean square."""


def check_trial(
    model: InertiaModel, accelerations: ArrayLike, range_g: float = 2.0
) -> tuple[Note, ...]:
    """Find what in a trial's accelerations makes its compensation doubtful.

    Parameters
    ----------
    model
        The fitted calibration.
    accelerations
        Of the trial, in the calibration's order and unit, (N, k) [m/s²]. Clipping is seen best
        before any filter.
    range_g
        Range of the accelerometers [g].

    Returns
    -------
    tuple of Note
        Warnings, empty where nothing is doubtful: a channel that is dead or clipped, a sensor
        that was rotated or is upside down, two that are swapped, motion beyond that of the
        calibration.

    Raises
    ------
    ValueError
        Wrong shape, no samples or gaps.

    Notes
    -----
    Swapped sensors show in the combinations of channels that hardly changed in the calibration,
    such as the difference of two sensors along the sway: they stay as they were unless a sensor
    was moved. Two sensors whose offsets and axes agree to within 0.03 m/s² cannot be
    distinguished.

    Examples
    --------
    >>> import compensation, numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> model = compensation.fit_inertia(accelerations, wrench)
    >>> [note.code for note in check_trial(model, -accelerations)]
    ['accelerometer_inverted', 'calibration_range_exceeded']
    """
    a = read_table(accelerations, "accelerations", len(model.acceleration_mean))
    dead = _dead(model, a)
    if dead:
        return dead
    return (
        *_clipped(model, a, range_g * GRAVITY_MPS2),
        *(_rotated(model, a) or _swapped(model, a)),
        *_beyond(model, a),
    )


def check_calibration(model: InertiaModel, plate: str) -> tuple[Note, ...]:
    """Find signs that the plate was not empty in a calibration.

    Parameters
    ----------
    model
        The fitted calibration of one plate.
    plate
        The plate's name.

    Returns
    -------
    tuple of Note
        Warnings: ``calibration_loaded`` where the mean force is that of a person,
        ``calibration_unexplained`` where the fit leaves more force than that of an empty plate.

    Examples
    --------
    >>> import compensation, numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> model = compensation.fit_inertia(accelerations, wrench)  # a plate that was not zeroed
    >>> [note.code for note in check_calibration(model, "plate 1")]
    ['calibration_loaded']
    """
    mean = model.acceleration_mean @ model.gain[: len(model.acceleration_mean), :3]
    mean = mean + model.gain[-1, :3]  # differences have no mean
    notes = []
    if (force := float(np.linalg.norm(mean))) > MIN_LOAD_N:
        notes.append(Note.of("calibration_loaded", plate=plate, force_n=force))
    if (left := float(np.linalg.norm(model.sigma[:3]))) > MAX_UNEXPLAINED_N:
        notes.append(Note.of("calibration_unexplained", plate=plate, force_n=left))
    return tuple(notes)


def _channels(model: InertiaModel) -> list[str]:
    return [f"{sensor} {axis}" for sensor in model.sensors for axis in "xyz"]


def _by_sensor(values: Array) -> Array:
    return values.reshape(*values.shape[:-1], -1, 3)


def _dead(model: InertiaModel, a: Array) -> tuple[Note, ...]:
    readings = _by_sensor(a)
    size = np.median(np.sqrt(np.vecdot(readings, readings)), axis=0)
    still = (a == a[0]).all(axis=0)
    without_gravity = [
        Note.of("accelerometer_silent", sensor=sensor, median_mps2=size, gravity_mps2=GRAVITY_MPS2)
        for sensor, size in zip(model.sensors, size, strict=True)
        if not GRAVITY_MPS2 / GRAVITY_FACTOR < size < GRAVITY_FACTOR * GRAVITY_MPS2
    ]
    stuck = [
        Note.of("accelerometer_constant", channel=channel, value_mps2=value)
        for channel, value, dead in zip(_channels(model), a[0], still, strict=True)
        if dead and not still.all()
    ]
    return (*without_gravity, *stuck)


def _clipped(model: InertiaModel, a: Array, limit: float) -> tuple[Note, ...]:
    share = np.mean(np.abs(a) >= CLIPPED_SHARE * limit, axis=0)
    return tuple(
        Note.of("accelerometer_clipped", channel=channel, limit_mps2=limit, share=share)
        for channel, share in zip(_channels(model), share, strict=True)
        if share > 0
    )


def _rotated(model: InertiaModel, a: Array) -> tuple[Note, ...]:
    now, then = _by_sensor(a.mean(axis=0)), _by_sensor(model.acceleration_mean)
    cosine = np.sum(now * then, axis=1) / np.linalg.norm(now, axis=1) / np.linalg.norm(then, axis=1)
    angles = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return tuple(
        Note.of(
            "accelerometer_inverted" if angle > 180 - MIN_ROTATION_DEG else "accelerometer_turned",
            sensor=sensor,
            angle_deg=angle,
        )
        for sensor, angle in zip(model.sensors, angles, strict=True)
        if angle > MIN_ROTATION_DEG
    )


def _swapped(model: InertiaModel, a: Array) -> tuple[Note, ...]:
    variance, directions = np.linalg.eigh(model.acceleration_covariance)
    constant = variance < CONSTRAINT_MPS2**2
    if not constant.any():
        return ()
    weights = directions[:, constant] / np.sqrt(np.maximum(variance[constant], 0) + DRIFT_MPS2**2)

    def violation(order: list[int]) -> float:
        reordered = _by_sensor(a)[:, order].reshape(a.shape)
        return float(np.mean(((reordered - model.acceleration_mean) @ weights) ** 2))

    order = list(range(len(model.sensors)))
    as_is = violation(order)
    if as_is < MAX_VIOLATION:
        return ()
    exchanged = {}
    for i, j in combinations(order, 2):
        other = order.copy()
        other[i], other[j] = j, i
        exchanged[i, j] = violation(other)
    best = min(exchanged, key=lambda pair: exchanged[pair], default=None)
    if best is None or exchanged[best] > as_is / MIN_IMPROVEMENT:
        return ()
    i, j = best
    return (Note.of("accelerometers_swapped", first=model.sensors[i], second=model.sensors[j]),)


def _beyond(model: InertiaModel, a: Array) -> tuple[Note, ...]:
    low, high = model.acceleration_low, model.acceleration_high
    margin = MAX_EXCESS_SHARE * (high - low)
    outside = (a < low - margin) | (a > high + margin)
    share = float(np.mean(outside.any(axis=1)))
    if share == 0:
        return ()
    worst = int(np.argmax(outside.mean(axis=0)))
    return (
        Note.of(
            "calibration_range_exceeded",
            share=share,
            channel=_channels(model)[worst],
            low_mps2=a[:, worst].min(),
            high_mps2=a[:, worst].max(),
            calibrated_low_mps2=low[worst],
            calibrated_high_mps2=high[worst],
        ),
    )
