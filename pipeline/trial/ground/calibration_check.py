"""A calibration against an empty recording of another day."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from compensation import Calibration, from_json, to_json
from compensation.inertia.another_day import DayCheck, check_another_day
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.trial.ground.accelerometers import accelerations, at_plate_times
from pipeline.trial.ground.calibration_recording import read_empty
from pipeline.trial.ground.laboratory import Laboratory, plate_models


def check_recording(
    recording: Recording, calibration: Calibration, treadmill: Treadmill
) -> DayCheck:
    """Compare a calibration with an empty recording of another day.

    Parameters
    ----------
    recording
        The empty treadmill, moving.
    calibration
        As fitted.
    treadmill
        Names of the accelerometers' channels.

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
    models = plate_models(recording, Laboratory(treadmill, calibration))
    clock, readings = accelerations(recording, treadmill)
    first, *others = recording.plates
    if any(not np.array_equal(plate.time, first.time) for plate in others):
        raise ValueError(f"{file}: its plates are sampled at different times")
    setup = models[0].setup
    assert setup is not None  # a calibration's models have one
    felt = at_plate_times(
        clock, setup.low_pass(readings, clock), first.time, treadmill, calibration.sensors
    )
    wrenches = [setup.low_pass(plate.wrench_in_plate, plate.time) for plate in recording.plates]
    known = np.isfinite(np.hstack([felt, *wrenches])).all(axis=1)
    names = [f"plate {plate.number}" for plate in recording.plates]
    try:
        return check_another_day(
            dict(zip(names, models, strict=True)),
            felt[known],
            {name: w[known] for name, w in zip(names, wrenches, strict=True)},
            file,
        )
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


def read_check(
    path: Path, calibration: Calibration, treadmill: Treadmill, stated: Stated
) -> DayCheck:
    """Read a recording of another day and compare it with a calibration; once in a process.

    Parameters, result and errors are those of `check_recording` and `read_empty`.
    """
    written = path.stat()
    return _checked(
        path,
        (written.st_mtime_ns, written.st_size),
        to_json(calibration),
        treadmill.model_dump_json(exclude={"platform"}),
        stated,
    )


@lru_cache(maxsize=2)
def _checked(
    path: Path, version: tuple[int, int], calibration: str, treadmill: str, stated: Stated
) -> DayCheck:
    del version  # part of the key: a file written anew is checked anew
    treadmill_ = Treadmill.model_validate_json(treadmill)
    return check_recording(read_empty(path, stated), from_json(calibration), treadmill_)
