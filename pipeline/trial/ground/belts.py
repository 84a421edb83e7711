"""Belts: their speed in a recording, and the pitch moment that their acceleration adds to plates.

Acceleration and moment go through the same zero-phase low-pass, in the fit and in every trial: the
model is fitted and used without delay, so that its estimate can be subtracted from a plate's own
samples.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import cycle
from pathlib import Path
from typing import Final

import numpy as np

from compensation import BeltModel, belt_acceleration, fit_belt
from hbm.signals.filtering import low_pass
from hbm.signals.resampling import interpolate
from hbm.spatial import Array
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Belt
from pipeline.io.recording import Plate, Recording
from pipeline.io.stated import Stated
from pipeline.io.units import length_in_m
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.empty_plates import FILTER, read_empty

MODEL_RATE_HZ: Final = 100.0
"""The belt model's rate: belts accelerate below 10 Hz."""
FILTER_EDGE_S: Final = 0.5
"""Left out at both ends of the calibration, where the low-pass has no neighbours."""


def belt_speed(recording: Recording, channel: str) -> Array:
    """Give a belt's speed.

    Parameters
    ----------
    recording
        The trial.
    channel
        Name of the analog channel, in a unit of speed such as m/s.

    Returns
    -------
    Array
        (N,) [m/s].

    Raises
    ------
    ValueError
        If there is no such channel, or its unit is none of speed.
    """
    file = recording.source.name
    analog = recording.analog
    if analog is None or channel not in analog.names:
        present = ", ".join(analog.names) if analog is not None else "none"
        raise ValueError(
            f"{file}: no analog channel {channel!r} with belt speed; present: {present}"
        )
    unit = analog.units[analog.names.index(channel)].strip()
    length, per_second, _ = unit.partition("/s")
    if not per_second:
        raise ValueError(f"{file}: {channel} is in {unit!r}, expected a speed such as m/s")
    return analog.channel(channel) * length_in_m(length)


def belt_axes(plate: Plate) -> Array:
    """Give the directions along a belt, to its side, and up; columns in the plate's axes, (3, 3).

    Along is the longer side of the surface, with the sign of the plate's own axis, so that it does
    not depend on the lab's axes. A ValueError where the plate's corners are unknown.
    """
    if not np.isfinite(plate.corners).all():
        raise ValueError(
            f"plate {plate.number}: its corners are unknown, and so is the direction of its belt; "
            "use a C3D file, which holds them"
        )
    corners = (plate.corners - plate.center) @ plate.rotation
    along = max(np.diff(corners[:3], axis=0), key=lambda side: float(np.linalg.norm(side)))
    along = along / np.linalg.norm(along)
    if along[np.argmax(np.abs(along))] < 0:
        along = -along
    up = plate.rotation[2]
    side = np.cross(up, along)
    side /= np.linalg.norm(side)
    return np.column_stack([along, side, np.cross(along, side)])


def fit_belts(recording: Recording, belt: Belt) -> tuple[BeltModel, ...]:
    """Fit what accelerating belts add to their empty plates.

    Parameters
    ----------
    recording
        Belts accelerating at random, nobody on them, the platform at rest.
    belt
        As stated.

    Returns
    -------
    tuple[BeltModel, ...]
        One model per plate, at 100 Hz.

    Raises
    ------
    ValueError
        If a channel is missing or the fit is not possible.
    """
    if not recording.plates:
        raise ValueError(
            f"{recording.source.name}: the belt calibration needs plates: {recording.why_no_plates}"
        )
    models = []
    for plate, (time, acceleration) in _accelerations(recording, belt):
        pitch_moment = plate.wrench_in_plate[:, 3:] @ belt_side(plate)
        filtered = low_pass(pitch_moment, plate.rate_hz, belt.cutoff_hz, FILTER)
        moment = interpolate(plate.time, filtered, time)
        inside = (time > time[0] + FILTER_EDGE_S) & (time < time[-1] - FILTER_EDGE_S)
        inside &= np.isfinite(moment)
        try:
            model = fit_belt(acceleration[inside], moment[inside] - moment[inside].mean())
        except ValueError as error:
            raise ValueError(f"{recording.source.name}: plate {plate.number}: {error}") from error
        models.append(model)
    return tuple(models)


def belt_wrenches(
    recording: Recording, models: Sequence[BeltModel], belt: Belt, times: Sequence[Array]
) -> list[Array]:
    """Give what accelerating belts add to each plate of a trial.

    Parameters
    ----------
    recording
        The trial.
    models
        One per plate.
    belt
        As stated.
    times
        Per plate when, on the plates' clock, (T,) [s].

    Returns
    -------
    list of Array
        Per plate its wrench in the plate's own axes, (T, 6) [N, N·m]; NaN outside the recording.

    Raises
    ------
    ValueError
        If there are other plates than models, or a channel is missing.
    """
    if len(models) != len(recording.plates):
        raise ValueError(
            f"{recording.source.name}: {len(recording.plates)} plates, but the belt calibration "
            f"has {len(models)}"
        )
    wrenches = []
    for model, time, (plate, (model_time, acceleration)) in zip(
        models, times, _accelerations(recording, belt), strict=True
    ):
        moment = interpolate(model_time, model.predict(acceleration), time)
        wrenches.append(np.hstack([np.zeros((len(time), 3)), moment[:, None] * belt_side(plate)]))
    return wrenches


def read_belts(
    path: Path, belt: Belt, stated: Stated, plates: PlateCorrection | None = None
) -> tuple[BeltModel, ...]:
    """Fit the belt models to a recording of the empty treadmill; once in a process.

    Parameters are those of `read_empty`, the belts as stated, and the correction of the plates.

    Raises
    ------
    ValueError, OSError
        If the file cannot be read or used.
    """
    written = path.stat()
    return _fitted(path, (written.st_mtime_ns, written.st_size), belt, stated, plates)


@lru_cache(maxsize=2)
def _fitted(
    path: Path,
    version: tuple[int, int],
    belt: Belt,
    stated: Stated,
    plates: PlateCorrection | None,
) -> tuple[BeltModel, ...]:
    del version  # part of the key: a file written anew is fitted anew
    recording = read_empty(path, stated, any_forward=plates is None)
    return fit_belts(with_corrected_plates(recording, plates), belt)


def belt_side(plate: Plate) -> Array:
    """Give the direction across a belt, about which its moment acts, in the plate's axes, (3,)."""
    return belt_axes(plate)[:, 1]


def _accelerations(recording: Recording, belt: Belt) -> list[tuple[Plate, tuple[Array, Array]]]:
    """Give each plate with the times [s] and accelerations [m/s²] of its belt at 100 Hz."""
    result = []
    for plate, channel in zip(recording.plates, cycle(belt.speed_channels), strict=False):
        speed = belt_speed(recording, channel)
        assert recording.analog is not None
        clock, rate_hz = recording.analog.time, recording.analog.rate_hz
        model_time = np.arange(clock[0], clock[-1], 1 / MODEL_RATE_HZ)
        acceleration = belt_acceleration(speed, rate_hz, belt.cutoff_hz, FILTER)
        result.append((plate, (model_time, interpolate(clock, acceleration, model_time))))
    return result
