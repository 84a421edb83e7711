"""A calibration against an empty recording of another day."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from compensation import check_trial, from_json, to_json
from compensation.inertia.quality import DayCheck, check_another_day
from hbm.notes import Note
from hbm.signals.resampling import interpolate
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Treadmill
from pipeline.io.input_file import last_written, naming
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.trial.ground.accelerometers import accelerations, at_plate_times, fastest_belt
from pipeline.trial.ground.calibration_recording import read_empty, wrenches_in_time
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory, plate_models

FAULTS: Final = (
    "accelerometer_silent",
    "accelerometer_constant",
    "accelerometer_clipped",
    "accelerometer_inverted",
    "accelerometers_swapped",
)
"""Notes of trials after which nothing else is worth comparing; turned sensors are measured."""


@dataclass(frozen=True, slots=True)
class CalibrationCheck:
    """Whether a calibration is still valid, in words, and the numbers of every plate."""

    valid: bool
    notes: tuple[Note, ...]
    plates: Mapping[str, DayCheck] = field(default_factory=dict)


def check_recording(recording: Recording, laboratory: Laboratory) -> CalibrationCheck:
    """Compare a calibration with an empty recording of another day.

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
    clock, readings = accelerations(recording, treadmill)
    setup = calibration.plates[names[0]].setup
    assert setup is not None  # a calibration's models have one
    seen = readings[np.isfinite(readings).all(axis=1)]
    found = check_trial(calibration.plates[names[0]], seen, treadmill.accelerometer_range_g)
    if faults := tuple(note for note in found if note.code in FAULTS):
        return CalibrationCheck(False, faults)
    filtered, speed = setup.low_pass(readings, clock), fastest_belt(recording, treadmill)
    wrenches = wrenches_in_time(recording, setup, laboratory.plates)
    checked = {}
    for name, plate, wrench in zip(names, recording.plates, wrenches, strict=True):
        felt = at_plate_times(clock, filtered, plate.time, treadmill, calibration.sensors)
        known = np.isfinite(np.hstack([felt, wrench])).all(axis=1)
        belts = None if speed is None else interpolate(*speed, plate.time)[known]
        with naming(recording.source):
            checked[name] = check_another_day(
                calibration.plates[name], felt[known], wrench[known], belts
            )
    faulty = [f"{name}: {', '.join(one.faults)}" for name, one in checked.items() if one.faults]
    if faulty:
        note = Note.of("calibration_outdated", recording=file, faults=faulty)
        return CalibrationCheck(False, (note,), checked)
    left, by_new = (
        [max(np.linalg.norm(part) for part in parts) for parts in zip(*both, strict=True)]
        for both in (
            [np.split(one.left, 2) for one in checked.values()],
            [np.split(one.left_by_new_fit, 2) for one in checked.values()],
        )
    )
    note = Note.of(
        "calibration_still_valid",
        recording=file,
        force_n=left[0],
        moment_nm=left[1],
        new_force_n=by_new[0],
        new_moment_nm=by_new[1],
    )
    return CalibrationCheck(True, (note,), checked)


def read_check(path: Path, laboratory: Laboratory, stated: Stated) -> CalibrationCheck:
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
) -> CalibrationCheck:
    del version  # part of the key: a file written anew is checked anew
    channels = Treadmill.model_validate_json(treadmill)
    laboratory = Laboratory(channels, from_json(calibration), plates=plates)
    return check_recording(read_empty(path, stated, any_forward=plates is None), laboratory)
