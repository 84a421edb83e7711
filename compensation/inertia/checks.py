"""Checks of a calibration, and of a trial's accelerometers against it."""

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.model import InertiaModel
from compensation.inputs import read_table
from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, Array

_NEAR_LIMIT = 0.98  # share of the sensor's range that counts as clipped
_MARGIN = 0.05  # share of the calibration's range that a trial may exceed it by
_TURNED_DEG = 45.0
_PERSON_N = 150.0  # mean force above which a zeroed plate is not empty
_EMPTY_N = 30.0  # standard deviation of force that a fit on an empty plate stays below
_QUIET = 0.05  # m/s²: combinations of channels quieter than this in the calibration are constraints
_DRIFT = 0.03  # m/s²: what constraints may change by between calibration and trial
_BROKEN = 9.0  # mean square of the constraints, in those units, that needs an explanation


def check_trial(
    model: InertiaModel, accelerations: ArrayLike, range_g: float = 2.0
) -> tuple[Note, ...]:
    """Find what in a trial's accelerations makes its compensation doubtful.

    Parameters
    ----------
    model
        The fitted calibration.
    accelerations
        The trial's, in the calibration's order and unit, (N, k) [m/s²]. Clipping shows best before
        any filter.
    range_g
        Range of the accelerometers [g].

    Returns
    -------
    tuple of Note
        Warnings, empty where there is nothing to warn of: a channel that is dead or clipped, a
        sensor that is turned or upside down, two that are swapped, motion beyond that of the
        calibration.

    Raises
    ------
    ValueError
        Wrong shape, no samples or gaps.

    Notes
    -----
    Swapped sensors show in the combinations of channels that hardly changed in the calibration,
    such as the difference of two sensors along the sway: they stay as they were unless a sensor
    was moved. Two sensors whose offsets and axes agree to within 0.03 m/s² cannot be told apart.
    """
    a = read_table(accelerations, "accelerations", len(model.acceleration_mean))
    dead = _dead(model, a)
    if dead:
        return dead
    return (
        *_clipped(model, a, range_g * GRAVITY_MPS2),
        *(_turned(model, a) or _swapped(model, a)),
        *_beyond(model, a),
    )


def check_calibration(model: InertiaModel, plate: str) -> tuple[Note, ...]:
    """Find what in a calibration is not of an empty plate.

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
        ``calibration_unexplained`` where accelerations leave more force than an empty plate's.
    """
    mean = np.append(model.acceleration_mean, 1.0) @ model.gain[:, :3]
    notes = []
    if (force := float(np.linalg.norm(mean))) > _PERSON_N:
        notes.append(Note.of("calibration_loaded", plate=plate, force_n=force))
    if (left := float(np.linalg.norm(model.sigma[:3]))) > _EMPTY_N:
        notes.append(Note.of("calibration_unexplained", plate=plate, force_n=left))
    return tuple(notes)


def _channels(model: InertiaModel) -> list[str]:
    return [f"{sensor} {axis}" for sensor in model.sensors for axis in "xyz"]


def _by_sensor(values: Array) -> Array:
    return values.reshape(*values.shape[:-1], -1, 3)


def _dead(model: InertiaModel, a: Array) -> tuple[Note, ...]:
    size = np.median(np.linalg.norm(_by_sensor(a), axis=2), axis=0)
    still = np.ptp(a, axis=0) == 0
    silent = [
        Note.of("accelerometer_silent", sensor=sensor, median_mps2=size, gravity_mps2=GRAVITY_MPS2)
        for sensor, size in zip(model.sensors, size, strict=True)
        if not GRAVITY_MPS2 / 2 < size < 2 * GRAVITY_MPS2
    ]
    stuck = [
        Note.of("accelerometer_constant", channel=channel, value_mps2=value)
        for channel, value, dead in zip(_channels(model), a[0], still, strict=True)
        if dead and not still.all()
    ]
    return (*silent, *stuck)


def _clipped(model: InertiaModel, a: Array, limit: float) -> tuple[Note, ...]:
    share = np.mean(np.abs(a) >= _NEAR_LIMIT * limit, axis=0)
    return tuple(
        Note.of("accelerometer_clipped", channel=channel, limit_mps2=limit, share=share)
        for channel, share in zip(_channels(model), share, strict=True)
        if share > 0
    )


def _turned(model: InertiaModel, a: Array) -> tuple[Note, ...]:
    now, then = _by_sensor(a.mean(axis=0)), _by_sensor(model.acceleration_mean)
    cosine = np.sum(now * then, axis=1) / np.linalg.norm(now, axis=1) / np.linalg.norm(then, axis=1)
    angles = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return tuple(
        Note.of(
            "accelerometer_inverted" if angle > 180 - _TURNED_DEG else "accelerometer_turned",
            sensor=sensor,
            angle_deg=angle,
        )
        for sensor, angle in zip(model.sensors, angles, strict=True)
        if angle > _TURNED_DEG
    )


def _swapped(model: InertiaModel, a: Array) -> tuple[Note, ...]:
    variance, directions = np.linalg.eigh(model.acceleration_covariance)
    quiet = variance < _QUIET**2
    if not quiet.any():
        return ()
    weights = directions[:, quiet] / np.sqrt(np.maximum(variance[quiet], 0) + _DRIFT**2)

    def violation(order: list[int]) -> float:
        reordered = _by_sensor(a)[:, order].reshape(a.shape)
        return float(np.mean(((reordered - model.acceleration_mean) @ weights) ** 2))

    order = list(range(len(model.sensors)))
    as_is = violation(order)
    if as_is < _BROKEN:
        return ()
    exchanged = {}
    for i, j in combinations(order, 2):
        other = order.copy()
        other[i], other[j] = j, i
        exchanged[i, j] = violation(other)
    best = min(exchanged, key=lambda pair: exchanged[pair], default=None)
    if best is None or exchanged[best] > as_is / 4:
        return ()
    i, j = best
    return (Note.of("accelerometers_swapped", first=model.sensors[i], second=model.sensors[j]),)


def _beyond(model: InertiaModel, a: Array) -> tuple[Note, ...]:
    low, high = model.acceleration_low, model.acceleration_high
    margin = _MARGIN * (high - low)
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
