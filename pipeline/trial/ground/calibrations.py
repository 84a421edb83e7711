"""Calibrations of a laboratory: read from a file, or made of recordings of its empty treadmill.

That of the moving platform, that of accelerating belts, and the check of the first on another day.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, TypeVar, cast

import numpy as np

from compensation import (
    BeltModel,
    Calibration,
    fit_belt,
    from_json,
    to_json,
)
from compensation.inertia.quality import DayCheck, check_another_day
from compensation.inertia.sensors import faulty_sensors
from hbm.notes import Note
from hbm.signals.filtering import low_pass
from hbm.signals.resampling import interpolate
from pipeline.config.plate_correction import SAME_DELAY_S, PlateCorrection
from pipeline.config.schema import Belt, Platform, Treadmill
from pipeline.io.input_file import last_written, naming, read_text
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated, as_stated
from pipeline.trial.ground.accelerometers import accelerations, fastest_belt, mean_belt_speed
from pipeline.trial.ground.belts import belt_accelerations, belt_side
from pipeline.trial.ground.calibration_recording import (
    FILTER,
    fit_calibration,
    plate_samples,
    read_empty,
)
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import (
    Laboratory,
    bind,
    channels_of,
    plate_models,
    require_same_plates,
)
from pipeline.trial.ground.wrenches import plate_artefacts, sensor_notes

FILTER_EDGE_S: Final = 0.5
"""Left out at both ends of the calibration, where the low-pass has no neighbours."""


Made = TypeVar("Made")
_made: dict[Hashable, object] = {}


def once_in_a_process(
    make: Callable[[], Made], what: str, files: Sequence[Path], laboratory: Laboratory, of: Stated
) -> Made:
    """Give what is made of files for a laboratory, made anew only where one of all that changes."""
    treadmill = laboratory.treadmill.model_dump_json(exclude={"platform"})
    known = None if laboratory.calibration is None else to_json(laboratory.calibration)
    versions = tuple(map(last_written, files))
    key = what, tuple(files), versions, treadmill, known, laboratory.plates, of
    if key not in _made:
        _made[key] = make()
    return cast(Made, _made[key])


def read_calibration(
    path: str | Path,
    treadmill: Treadmill,
    stated: Stated | str | None = None,
    plates: PlateCorrection | None = None,
    beside: Sequence[str | Path] = (),
) -> Calibration:
    """Read a fitted calibration (JSON), or fit one to a recording of the empty treadmill (C3D).

    Parameters
    ----------
    path
        ``.json`` or ``.c3d``.
    treadmill
        Names of the accelerometers' channels.
    stated
        How a recording is to be read, as for `read_empty`; a text states its axes alone.
    plates
        The correction of the plates of trials: those of a recording are corrected alike.
    beside
        Recordings of people beside an empty plate, fitted together with a recording.

    Returns
    -------
    Calibration
        One model per plate. A recording is fitted once in a process, however often it is asked for.

    Raises
    ------
    ValueError, OSError
        If the file cannot be read or used, or is a calibration of otherwise corrected plates.

    Examples
    --------
    >>> import compensation, pipeline
    >>> import numpy as np
    >>> felt = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = felt @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> setup = compensation.Setup(("rear",), rate_hz=1000.0, cutoff_hz=20.0)
    >>> fitted = Calibration({"plate 1": compensation.fit_inertia(felt, wrench, setup)})
    >>> _ = Path("lab.json").write_text(compensation.to_json(fitted))
    >>> rear = pipeline.Treadmill(accelerometers={"rear": ("Acc1.X", "Acc1.Y", "Acc1.Z")})
    >>> list(pipeline.read_calibration("lab.json", rear).plates)
    ['plate 1']
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        with naming(path):
            calibration = from_json(read_text(path))
            channels_of(calibration)  # refuses damaged ones
            _require_as_stated(calibration, treadmill)
            require_same_plates(calibration, plates)
        return calibration
    files = path, *map(Path, beside)

    def fitted() -> Calibration:
        forward = plates is None
        recording, *others = (
            read_empty(file, as_stated(stated), any_forward=forward) for file in files
        )
        try:
            return fit_calibration(recording, treadmill, plates, others)
        except ValueError as error:
            text = str(error)
            known = any(file.name in text for file in files)
            raise ValueError(text if known else f"{path.name}: {text}") from error

    laboratory = Laboratory(treadmill, plates=plates)
    return once_in_a_process(fitted, "fit", files, laboratory, as_stated(stated))


def _require_as_stated(calibration: Calibration, treadmill: Treadmill) -> None:
    """Refuse a stated delay or model that is not the one with which the calibration was fitted."""
    stated_s = treadmill.accelerometer_delay_s
    for sensor in calibration.sensors:
        if stated_s is not None and abs(sensor.correction_s - stated_s) > SAME_DELAY_S:
            raise ValueError(
                f"the calibration was fitted with a delay of {1000 * sensor.correction_s:.2f} ms "
                f"of accelerometer {sensor.name}, but treadmill.accelerometer_delay_s is "
                f"{1000 * stated_s:.2f} ms; leave it out, or fit again"
            )
    fitted, stated = "dynamic" if calibration.dynamic else "static", treadmill.inertia_model
    if stated not in ("auto", fitted):
        raise ValueError(
            f"the calibration is of a {fitted} model, but treadmill.inertia_model is {stated!r}; "
            f"leave it out, or fit it again with --model {stated}"
        )


def read_laboratory(
    file: Path,
    platform_markers: tuple[str, ...],
    accelerometers: Mapping[str, tuple[str, str, str]] | None = None,
    plates: PlateCorrection | None = None,
) -> Laboratory:
    """Give the laboratory that a calibration file (JSON, as `hbm calibration fit` wrote) describes.

    Accelerometers are sensor -> its channels in the trials, where these are called otherwise than
    in the calibration. Without platform markers the treadmill stands still. A ValueError where the
    file is no such calibration, or one of otherwise corrected plates.
    """
    if file.suffix.lower() != ".json":
        raise ValueError(
            f"{file.name}: --calibration takes a fitted calibration; make one with "
            f"'hbm calibration fit {file.name} -o lab.json'"
        )
    calibration = read_calibration(file, Treadmill(), plates=plates)
    with naming(file):
        channels = channels_of(calibration)
    if not channels:
        raise ValueError(
            f"{file.name}: the calibration does not name its channels; fit it again with "
            "'hbm calibration fit'"
        )
    if accelerometers and set(accelerometers) != set(channels):
        raise ValueError(
            f"{file.name}: the calibration has the accelerometers {', '.join(channels)}, "
            f"--accelerometer names {', '.join(accelerometers)}; name all of them and no others"
        )
    setup = next(iter(calibration.plates.values())).setup
    treadmill = Treadmill(
        accelerometers={s: (accelerometers or channels)[s] for s in channels},
        accelerometer_unit=calibration.provenance.get("accelerometer_unit") or None,
        cutoff_hz=(setup and setup.cutoff_hz) or 20.0,
        platform=Platform(markers=platform_markers) if platform_markers else None,
    )
    return Laboratory(treadmill, calibration, plates=plates)


def belts_alone(recording: Recording, laboratory: Laboratory) -> tuple[Recording, tuple[Note, ...]]:
    """Correct the plates of a belt calibration as those of trials are, but for the belts.

    Belts accelerate at random, nobody is on them, and the platform is at rest. What the
    accelerometers explain is subtracted: accelerating belts shake the platform too, and of a trial
    that is subtracted before the belts' part is. A note says where the recording lacks their
    channels, so that what the belts shake is still in its plates, or where its accelerations are
    doubtful. A ValueError where an accelerometer is faulty, and as of `plate_artefacts`.
    """
    recording = with_corrected_plates(recording, laboratory.plates)
    if laboratory.calibration is None:
        return recording, ()
    channels = {name for names in laboratory.treadmill.accelerometers.values() for name in names}
    present = set() if recording.analog is None else set(recording.analog.names)
    if not channels <= present:
        missing = Note.of("belts_without_accelerometers", recording=recording.source.name)
        return recording, (missing,)
    file = recording.source.name
    with naming(recording.source):
        platform = bind(recording, replace(laboratory, belts=()))
        if faults := sensor_notes(platform, faulty_sensors):
            raise ValueError(f"the belts' calibration needs its accelerometers: {faults[0]}")
        artefacts, _ = plate_artefacts(recording, platform.laboratory)
    doubts = tuple(map(str, sensor_notes(platform)))
    plates = tuple(
        replace(plate, wrench_in_plate=plate.wrench_in_plate - artefact)
        for plate, artefact in zip(recording.plates, artefacts, strict=True)
    )
    notes = (Note.of("belts_recording_doubtful", recording=file, doubts=doubts),) if doubts else ()
    return replace(recording, plates=plates), notes


def fit_belts(recording: Recording, belt: Belt) -> tuple[BeltModel, ...]:
    """Fit what accelerating belts add to their empty plates: one model per plate, at 100 Hz.

    Belts accelerate at random, nobody is on them, and the platform is at rest. A ValueError where a
    channel is missing or the fit is not possible.
    """
    if not recording.plates:
        raise ValueError(
            f"{recording.source.name}: the belt calibration needs plates: {recording.why_no_plates}"
        )
    models = []
    for plate, (time, acceleration) in belt_accelerations(recording, belt):
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


def read_belts(
    path: Path, laboratory: Laboratory, stated: Stated
) -> tuple[tuple[BeltModel, ...], tuple[Note, ...]]:
    """Fit the belt models to a recording of the empty treadmill; once in a process.

    The laboratory has the belts as stated, the correction of the plates, and the calibration of the
    platform by which trials are compensated. No models where no belts are stated; notes are those
    of `belts_alone`.
    """
    belt = laboratory.treadmill.belt
    if belt is None:
        return (), ()

    def fitted() -> tuple[tuple[BeltModel, ...], tuple[Note, ...]]:
        recording = read_empty(path, stated, any_forward=laboratory.plates is None)
        alone, notes = belts_alone(recording, laboratory)
        return fit_belts(alone, belt), notes

    return once_in_a_process(fitted, "belts", (path,), laboratory, stated)


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
    if faults := faulty_sensors(models[0], seen, treadmill.accelerometer_range_g):
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

    def checked() -> CalibrationCheck:
        recording = read_empty(path, stated, any_forward=laboratory.plates is None)
        return check_recording(recording, laboratory)

    return once_in_a_process(checked, "check", (path,), laboratory, stated)
