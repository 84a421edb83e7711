"""A laboratory's treadmill in a trial: compensated plates, and where the platform was."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from compensation import (
    BeltModel,
    Calibration,
    InertiaModel,
    PlatformPose,
    check_calibration,
    check_trial,
    moment_error_of_pivot,
    to_lab,
)
from hbm.notes import Note
from hbm.signals.resampling import resample
from hbm.spatial import Array, transform_wrench
from pipeline.config.schema import Platform, Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.belts import belt_wrenches
from pipeline.trial.ground.calibration_recording import (
    fit_calibration,
    read_calibration,
    read_empty,
    setup_of,
)
from pipeline.trial.ground.instruments import accelerations, platform_pose

__all__ = [
    "Ground",
    "Laboratory",
    "accelerations",
    "fit_calibration",
    "ground_wrenches",
    "models_of",
    "platform_pose",
    "read_calibration",
    "read_empty",
]

PIVOT_OFF_M: Final = 0.01


@dataclass(frozen=True, slots=True)
class Laboratory:
    """The treadmill as stated, its calibration and its plates' belt models where there are any."""

    treadmill: Treadmill
    calibration: Calibration | None = None
    belts: tuple[BeltModel, ...] = ()


@dataclass(frozen=True, slots=True)
class Ground:
    """What acted on the subject.

    Attributes
    ----------
    variants
        "measured" and, with a calibration of platform or belts, "compensated" -> per plate its
        wrench at the markers' times, lab axes about the lab origin, unfiltered, (T, 6) [N, N·m].
    pose
        The platform's pose at the markers' times; None where it stands still.
    notes
        How it was compensated and placed, and what is doubtful about that.
    """

    variants: dict[str, list[Array]]
    pose: PlatformPose | None
    notes: tuple[Note, ...]


def ground_wrenches(
    recording: Recording, laboratory: Laboratory, time: Array, plate_delay_s: float
) -> Ground:
    """Bring every plate to the markers' times and into the lab, as measured and compensated.

    Parameters
    ----------
    recording
        The trial.
    laboratory
        The treadmill.
    time
        Marker times, (T,) [s].
    plate_delay_s
        How much later the plates are than the markers [s].

    Returns
    -------
    Ground
        Both variants are moved with the platform. Inertia is taken off in each plate's own moving
        frame, before any rotation; the gains are static, so it makes no difference that this is
        done at the markers' rate on equally resampled signals. What the belts' acceleration adds
        is taken off before.

    Raises
    ------
    ValueError
        If the calibration does not fit the trial, or a channel or platform marker is missing.
    """
    plates = recording.plates
    variants = {
        "measured": [resample(p.time, p.wrench_in_plate, time + plate_delay_s) for p in plates]
    }
    notes = [
        Note.of("plate_constant", plate=plate.number)
        for plate in plates
        if not np.ptp(plate.wrench_in_plate, axis=0).any()
    ]
    belt = laboratory.treadmill.belt
    if laboratory.belts and belt is not None:
        added = belt_wrenches(recording, laboratory.belts, belt, time + plate_delay_s)
        variants["compensated"] = [
            wrench - extra for wrench, extra in zip(variants["measured"], added, strict=True)
        ]
        notes.append(Note.of("belts_compensated", channels=belt.speed_channels))
    if laboratory.calibration is not None:
        names = laboratory.treadmill.accelerometers
        clock, readings = accelerations(recording, laboratory.treadmill)
        models = models_of(recording, laboratory)
        later = plate_delay_s + laboratory.treadmill.accelerometer_delay_s
        setup = setup_of(recording, laboratory.treadmill)
        felt = resample(clock, setup.low_pass(readings, clock), time + later)
        variants["compensated"] = [
            _compensated(model, felt, wrench)
            for model, wrench in zip(
                models, variants.get("compensated", variants["measured"]), strict=True
            )
        ]
        for plate, model in zip(plates, models, strict=True):
            notes += check_calibration(model, f"plate {plate.number}")
        known = readings[np.isfinite(readings).all(axis=1)]
        notes += check_trial(models[0], known, laboratory.treadmill.accelerometer_range_g)
        notes.append(
            Note.of(
                "plates_compensated",
                accelerometers=tuple(names),
                filter=setup.filter_method,
                cutoff_hz=laboratory.treadmill.cutoff_hz,
            )
        )
    platform = laboratory.treadmill.platform
    pose, said = platform_pose(recording, platform, time)
    notes += said
    if pose is None and laboratory.calibration is not None:
        notes.append(Note.of("platform_taken_as_level"))
    if pose is not None and platform is not None and platform.pitch_channel is not None:
        notes.append(_pivot_budget(pose, np.sum(variants["measured"], axis=0)[:, :3]))
    placed = {}
    for name, wrenches in variants.items():
        still = [
            transform_wrench(wrench, plate.rotation, plate.center)
            for wrench, plate in zip(wrenches, plates, strict=True)
        ]
        placed[name] = still if pose is None else [to_lab(wrench, pose) for wrench in still]
    return Ground(placed, pose, tuple(notes))


def _pivot_budget(pose: PlatformPose, force: Array) -> Note:
    """Give what a stated pivot that is a little off would do to the moments."""
    pitch = np.arctan2(pose.rotation[:, 0, 2], pose.rotation[:, 0, 0])
    off = [moment_error_of_pivot(PIVOT_OFF_M * axis, pitch, force) for axis in np.eye(3)[[0, 2]]]
    worst = np.nanmax(np.linalg.norm(off, axis=2))
    return Note.of("pivot_error_budget", pivot_error_m=PIVOT_OFF_M, moment_nm=float(worst))


def models_of(recording: Recording, laboratory: Laboratory) -> list[InertiaModel]:
    """Give the model of every plate of a trial.

    Parameters
    ----------
    recording
        The trial.
    laboratory
        The treadmill and its calibration.

    Returns
    -------
    list of InertiaModel
        In order of the plates; empty without a calibration.

    Raises
    ------
    ValueError
        If the calibration was made for other plates, sensors, rates or units.
    """
    if laboratory.calibration is None:
        return []
    known, name = laboratory.calibration.plates, recording.source.name
    wanted = [f"plate {plate.number}" for plate in recording.plates]
    if unknown := [plate for plate in wanted if plate not in known]:
        raise ValueError(f"{name}: the calibration has no {unknown[0]}; it has {', '.join(known)}")
    for plate in wanted:
        try:
            known[plate].require(setup_of(recording, laboratory.treadmill))
        except ValueError as error:
            raise ValueError(f"{name}: {plate}: {error}") from error
    return [known[plate] for plate in wanted]


def _compensated(model: InertiaModel, felt: Array, wrench: Array) -> Array:
    """Compensate the samples that have both; the others stay gaps."""
    both = np.isfinite(felt).all(axis=1) & np.isfinite(wrench).all(axis=1)
    result = np.full(wrench.shape, np.nan)
    result[both] = model.compensate(felt[both], wrench[both])
    return result


def read_laboratory(file: Path, platform_markers: tuple[str, ...], axes: str | None) -> Laboratory:
    """Give the laboratory that a calibration file describes.

    Parameters
    ----------
    file
        JSON that `fit` wrote.
    platform_markers
        Markers on the platform; none for a treadmill that stands still.
    axes
        Where the files' axes point.

    Returns
    -------
    Laboratory
        With the accelerometers' channels as the calibration names them.

    Raises
    ------
    ValueError
        If the file is not such a calibration.
    """
    if file.suffix.lower() != ".json":
        raise ValueError(
            f"{file.name}: --calibration takes a fitted calibration; make one with "
            f"'hbm calibration fit {file.name} -o lab.json'"
        )
    calibration = read_calibration(file, Treadmill(), axes)
    try:
        channels = json.loads(calibration.provenance["channels"])
    except (KeyError, ValueError) as error:
        raise ValueError(
            f"{file.name}: the calibration does not name its channels; fit it again with "
            "'hbm calibration fit'"
        ) from error
    cutoff_hz = next(iter(calibration.plates.values())).setup.cutoff_hz  # type: ignore[union-attr]
    platform = Platform(markers=platform_markers) if platform_markers else None
    treadmill = Treadmill(
        accelerometers=channels,
        accelerometer_unit=calibration.provenance.get("accelerometer_unit") or None,
        cutoff_hz=cutoff_hz or 20.0,
        platform=platform,
    )
    return Laboratory(treadmill, calibration)
