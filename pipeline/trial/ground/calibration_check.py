"""A calibration against an empty recording of another day."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from compensation import check_trial, to_json
from compensation.inertia.quality import DayCheck, check_another_day
from compensation.inertia.sensors import FAULTS
from hbm.notes import Note
from pipeline.io.input_file import naming
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.trial.ground.accelerometers import accelerations, fastest_belt, mean_belt_speed
from pipeline.trial.ground.calibration_recording import plate_samples, read_empty
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory, once_in_a_process, plate_models


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
    models = plate_models(recording, laboratory)  # refuses other plates, sensors or rates
    treadmill, calibration = laboratory.treadmill, laboratory.calibration
    assert calibration is not None
    _, readings = accelerations(recording, treadmill)
    seen = readings[np.isfinite(readings).all(axis=1)]
    found = check_trial(models[0], seen, treadmill.accelerometer_range_g)
    if faults := tuple(note for note in found if note.code in FAULTS):
        return CalibrationCheck(False, faults)
    belts_mps, checked = mean_belt_speed(fastest_belt(recording, treadmill)), {}
    samples = plate_samples(recording, treadmill, calibration.sensors, laboratory.plates)
    for plate in recording.plates:
        name = f"plate {plate.number}"
        model, (felt, wrench) = calibration.plates[name], samples[name]
        with naming(recording.source):
            checked[name] = check_another_day(model, felt, wrench, belts_mps)
    faulty = [f"{name}: {', '.join(one.faults)}" for name, one in checked.items() if one.faults]
    if faulty:
        note = Note.of("calibration_outdated", recording=file, faults=faulty)
        return CalibrationCheck(False, (note,), checked)
    left, by_new = (
        np.max([np.linalg.norm(np.split(each, 2), axis=1) for each in of_plates], axis=0)
        for of_plates in (
            [one.left for one in checked.values()],
            [one.left_by_new_fit for one in checked.values()],
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
    """Read a recording of another day and compare it with a calibration; once in a process."""
    calibration, plates, treadmill = (
        laboratory.calibration,
        laboratory.plates,
        laboratory.treadmill,
    )
    assert calibration is not None
    return once_in_a_process(
        lambda: check_recording(read_empty(path, stated, any_forward=plates is None), laboratory),
        "check",
        (path,),
        treadmill,
        to_json(calibration),
        plates,
        stated,
    )
