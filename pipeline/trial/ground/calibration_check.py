"""A calibration against an empty recording of another day."""

from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from compensation import InertiaModel, Sensor, check_trial, from_json, to_json
from compensation.inertia.another_day import DayCheck, check_another_day
from hbm.notes import Note
from hbm.signals.resampling import interpolate
from hbm.spatial import Array
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Treadmill
from pipeline.io.input_file import last_written
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.trial.ground.accelerometers import accelerations, at_plate_times, fastest_belt
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.empty_plates import read_empty, wrenches_in_time
from pipeline.trial.ground.laboratory import Laboratory, plate_models

FAULTS: Final = (
    "accelerometer_silent",
    "accelerometer_constant",
    "accelerometer_clipped",
    "accelerometer_inverted",
    "accelerometers_swapped",
)
"""Notes of trials after which nothing else is worth comparing; turned sensors are measured."""


def check_recording(recording: Recording, laboratory: Laboratory) -> DayCheck:
    """Compare a calibration with an empty recording of another day.

    Parameters
    ----------
    recording
        The empty treadmill, moving.
    laboratory
        With the calibration, the accelerometers' channels, and the correction of the plates.

    Returns
    -------
    DayCheck
        Whether the calibration is still valid, and what has changed.

    Raises
    ------
    ValueError
        If it was recorded with other plates, sensors or rates than the calibration, or shows
        nothing: a platform at rest, somebody on the boards.
    """
    file = recording.source.name
    if not recording.plates:
        raise ValueError(f"{file}: the check needs plates: {recording.why_no_plates}")
    recording = with_corrected_plates(recording, laboratory.plates)
    plate_models(recording, laboratory)  # refuses other plates, sensors or rates
    treadmill, calibration = laboratory.treadmill, laboratory.calibration
    assert calibration is not None
    names = [f"plate {plate.number}" for plate in recording.plates]
    models = [calibration.plates[name] for name in names]
    clock, readings = accelerations(recording, treadmill)
    if faults := _faults(models[0], readings, treadmill):
        return DayCheck("faulty", faults, (), {})
    first, *others = recording.plates
    if any(not np.array_equal(plate.time, first.time) for plate in others):
        raise ValueError(f"{file}: its plates are sampled at different times")
    setup = models[0].setup
    assert setup is not None  # a calibration's models have one
    felt = at_plate_times(
        clock, setup.low_pass(readings, clock), first.time, treadmill, calibration.sensors
    )
    wrenches = wrenches_in_time(recording, setup, laboratory.plates)
    known = np.isfinite(np.hstack([felt, *wrenches])).all(axis=1)
    speed = fastest_belt(recording, treadmill)
    try:
        return check_another_day(
            dict(zip(names, models, strict=True)),
            felt[known],
            {name: w[known] for name, w in zip(names, wrenches, strict=True)},
            file,
            _without_delay(calibration.sensors, models[0].sensors),
            None if speed is None else interpolate(*speed, first.time)[known],
        )
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


def _faults(model: InertiaModel, readings: Array, treadmill: Treadmill) -> tuple[Note, ...]:
    """Give what checks of trials find of the readings (N, k) that makes any comparison useless."""
    known = readings[np.isfinite(readings).all(axis=1)]
    found = check_trial(model, known, treadmill.accelerometer_range_g)
    return tuple(note for note in found if note.code in FAULTS)


def _without_delay(sensors: tuple[Sensor, ...], names: tuple[str, ...]) -> tuple[str, ...]:
    """Give the sensors of which a calibration states a delay, or none, and did not estimate it."""
    return tuple(s.name for s in sensors if not s.delay_error_s) if sensors else names


def read_check(path: Path, laboratory: Laboratory, stated: Stated) -> DayCheck:
    """Read a recording of another day and compare it with a calibration; once in a process.

    Parameters, result and errors are those of `check_recording` and `read_empty`.
    """
    assert laboratory.calibration is not None
    return _checked(
        path,
        last_written(path),
        to_json(laboratory.calibration),
        laboratory.treadmill.model_dump_json(exclude={"platform"}),
        laboratory.plates,
        stated,
    )


@lru_cache(maxsize=2)
def _checked(
    path: Path,
    version: tuple[int, int],
    calibration: str,
    treadmill: str,
    plates: PlateCorrection | None,
    stated: Stated,
) -> DayCheck:
    del version  # part of the key: a file written anew is checked anew
    channels = Treadmill.model_validate_json(treadmill)
    laboratory = Laboratory(channels, from_json(calibration), plates=plates)
    return check_recording(read_empty(path, stated, any_forward=plates is None), laboratory)
