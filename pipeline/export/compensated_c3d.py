"""The original C3D files of a trial or study with compensated force plates, for other programs."""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path, PurePath
from typing import Final, Literal

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from pipeline.config.schema import Trial
from pipeline.config.study import Study
from pipeline.export.rewritten_c3d import rewrite_plates
from pipeline.io.c3d.second_reader import SecondReading
from pipeline.io.input_file import describe_error
from pipeline.io.read import file_format
from pipeline.io.recording import Compensation, Recording
from pipeline.run.job import file_digest
from pipeline.trial.ground.laboratory import (
    Laboratory,
    bind,
    plate_delays_s,
    with_corrected_plates,
)
from pipeline.trial.ground.platform import moved_corners, platform_pose, pose_at, turned_to_lab
from pipeline.trial.ground.wrenches import plate_artefacts
from pipeline.trial.study_files import read_study_file, read_study_laboratory

PROGRAM: Final = "hbm-residuals"
Frame = Literal["plate", "lab"]


@dataclass(frozen=True, slots=True)
class Calibrations:
    """A laboratory and the files of its calibrations, which compensated files name.

    Attributes
    ----------
    laboratory
        The treadmill, with the calibration of its platform, its belts or its plates.
    platform, belts
        The files of the first two.
    """

    laboratory: Laboratory
    platform: Path | None = None
    belts: Path | None = None


@dataclass(frozen=True, slots=True)
class Written:
    """A compensated file.

    Attributes
    ----------
    path
        The file.
    verification
        Which second reader read it and its original and found only the plates changed.
    notes
        What is doubtful about the compensation.
    """

    path: Path
    verification: SecondReading
    notes: tuple[Note, ...]


def write_compensated(
    recording: Recording,
    calibrations: Calibrations,
    target: Path,
    *,
    frame: Frame | None = None,
    plate_delay_s: float | None = None,
) -> Written:
    """Write a trial's C3D file again with compensated plates.

    Parameters
    ----------
    recording
        The trial, read from a C3D file.
    calibrations
        The treadmill with a calibration, and the calibration's file.
    target
        Where to write. A file with other content there is not overwritten.
    frame
        None changes nothing but the plates' samples: wrenches stay in the plates' own moving
        frame, corners where the file has them. "plate" also moves the corners to the platform's
        mean pose. "lab" expresses every wrench in the lab frame, sample by sample, about the centre
        of the plate's surface in neutral position; the corners stay.
    plate_delay_s
        How much later the plates are than the markers, which show the platform's pose [s]; None
        as their calibration states it.

    Returns
    -------
    Written
        The file, and what is doubtful about it.

    Raises
    ------
    ValueError
        The recording is no C3D file or has no plates, ``target`` is the recording, the calibration
        does not fit it, the pose is needed and unknown, or `rewrite_plates` refuses.
    OSError
        A file cannot be read or written.

    Notes
    -----
    Measured signals stay as they are, without any low-pass, and the prediction is subtracted
    unfiltered too. After the low-pass of the calibration, or a lower one, the plates are those that
    `hbm residuals --calibration` computes.
    """
    laboratory = calibrations.laboratory
    if (kind := file_format(recording.source)) != "C3D":
        raise ValueError(
            f"{recording.source.name}: is a {kind} file; c3d copies a C3D file and changes its "
            "plates, so give the trial's C3D file"
        )
    if not recording.plates:
        raise ValueError(f"{recording.source.name}: {recording.why_no_plates}")
    if target.exists() and target.samefile(recording.source):
        raise ValueError(
            f"{recording.source.name}: would be written over the original; name another folder"
        )
    corrected = with_corrected_plates(recording, laboratory.plates)
    artefacts, doubts = plate_artefacts(bind(corrected, laboratory))
    notes = (*corrected.notes[len(recording.notes) :], *doubts)
    corners: list[Array] = []
    changes = [
        after.wrench_in_plate - plate.wrench_in_plate - artefact
        for plate, after, artefact in zip(
            recording.plates, corrected.plates, artefacts, strict=True
        )
    ]
    if frame is not None:
        pose, pose_notes = platform_pose(
            recording, laboratory.treadmill.platform, recording.markers.time
        )
        notes += pose_notes
        if pose is None:
            raise ValueError(
                f"{recording.source.name}: --frame {frame} needs the pose of the platform: name "
                "its markers or channels"
            )
        if frame == "plate":
            corners = [moved_corners(plate, pose) for plate in recording.plates]
        else:
            delays = plate_delays_s(recording.plates, laboratory.plates, plate_delay_s)
            changes = [
                turned_to_lab(
                    plate,
                    plate.wrench_in_plate + change,
                    pose_at(recording, pose, plate.time - delay),
                )
                - plate.wrench_in_plate
                for plate, change, delay in zip(recording.plates, changes, delays, strict=True)
            ]
    for plate, change in zip(recording.plates, changes, strict=True):
        change[~np.isfinite(plate.wrench_in_plate).all(axis=1)] = 0  # what is unknown stays so
    calibration, belts = (_named(path) for path in (calibrations.platform, calibrations.belts))
    of_plates = laboratory.plates
    done = Compensation(
        software=f"{PROGRAM} {version(PROGRAM)}",
        plates=tuple(plate.number for plate in recording.plates),
        calibration=calibration[0],
        calibration_sha256=calibration[1],
        belts=belts[0],
        belts_sha256=belts[1],
        plate_calibration=of_plates.name if of_plates else "",
        plate_calibration_sha256=of_plates.sha256 if of_plates else "",
        cutoff_hz=laboratory.treadmill.cutoff_hz if laboratory.calibration else None,
        frame=frame or "recorded",
    )
    verification = rewrite_plates(
        recording.source, target, changes, done, corners, stated=recording.stated
    )
    return Written(target, verification, notes)


def _named(calibration: Path | None) -> tuple[str, str]:
    """Give name and SHA-256 of a calibration's file; both empty without one."""
    return (calibration.name, file_digest(calibration)) if calibration else ("", "")


def write_compensated_study(
    study: Study, out: Path, frame: Frame | None
) -> Iterator[tuple[str, Written | str]]:
    """Write the C3D file of every trial of a study again with compensated plates.

    Parameters
    ----------
    study
        The study; its ``[treadmill]`` or ``[plates]`` names a calibration.
    out
        Folder for the files, which keep their names relative to the study's folder.
    frame
        As for `write_compensated`.

    Yields
    ------
    tuple
        Name of each recording, in the study's order, and its compensated file, or the reason why
        there is none. A failure stops no other one.

    Raises
    ------
    ValueError
        The study has no calibration, or it cannot be read or fitted.
    OSError
        The calibration cannot be read.
    """
    treadmill = study.file.treadmill
    laboratory = read_study_laboratory(study)
    if laboratory.calibration is None and not laboratory.belts and laboratory.plates is None:
        raise ValueError(
            f"{study.folder}: study.toml names no calibration in [treadmill] or [plates], so that "
            "there is nothing to compensate its plates with"
        )
    calibrations = Calibrations(
        laboratory,
        study.path(treadmill.calibration) if treadmill.calibration else None,
        study.path(treadmill.belt.calibration) if treadmill.belt else None,
    )
    for name, trial in recordings_of(study).items():
        try:
            if PurePath(name).is_absolute() or ".." in PurePath(name).parts:
                raise ValueError(f"{name}: lies outside the study's folder")
            recording = read_study_file(study, name, trial)
            written = write_compensated(
                recording,
                calibrations,
                out / name,
                frame=frame,
                plate_delay_s=study.file.settings.plate_delay_s,
            )
        except Exception as error:
            yield name, describe_error(error)
        else:
            yield name, written


def recordings_of(study: Study) -> dict[str, Trial]:
    """Give every recording of a study's trials once: name of the file -> its trial."""
    return {
        trial.file: trial
        for trial in study.trials.values()
        if trial.file is not None and trial.exclude is None
    }
