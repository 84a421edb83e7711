"""A laboratory's treadmill in a trial: compensated plates, and where the platform was."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from compensation import (
    Calibration,
    InertiaModel,
    PlatformPose,
    Setup,
    check_trial,
    commanded_pose,
    fit_inertia,
    fit_pose,
    from_json,
    neutral_markers,
    to_lab,
)
from hbm.filtering import low_pass, resample
from hbm.spatial import Array, transform_wrench
from pipeline.c3d import read_c3d
from pipeline.recording import Recording
from pipeline.study import Platform, Treadmill
from pipeline.units import acceleration_in_mps2, angle_in_rad, length_in_m

NEUTRAL_FRAMES: Final = 100
OUTLIER_M: Final = 0.01
UPRIGHT: Final = ("forward,left,up", "forward,up,right", "up,forward,left")


@dataclass(frozen=True, slots=True)
class Laboratory:
    """The treadmill as stated, and its calibration where there is one."""

    treadmill: Treadmill
    calibration: Calibration | None = None


@dataclass(frozen=True, slots=True)
class Ground:
    """What acted on the subject.

    Attributes
    ----------
    variants
        "measured" and, with a calibration, "compensated" -> per plate its wrench at the markers'
        times, lab axes about the lab origin, unfiltered, (T, 6) [N, N·m].
    pose
        The platform's pose at the markers' times; None where it stands still.
    notes
        What was found on the way, as sentences.
    """

    variants: dict[str, list[Array]]
    pose: PlatformPose | None
    notes: tuple[str, ...]


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
        done at the markers' rate on equally resampled signals.

    Raises
    ------
    ValueError
        If the calibration does not fit the trial, or a channel or platform marker is missing.
    """
    plates = recording.plates
    variants = {
        "measured": [resample(p.time, p.wrench_in_plate, time + plate_delay_s) for p in plates]
    }
    notes: list[str] = []
    if laboratory.calibration is not None:
        names = laboratory.treadmill.accelerometers
        clock, readings = accelerations(recording, laboratory.treadmill)
        models = _models(recording, laboratory)
        later = plate_delay_s + laboratory.treadmill.accelerometer_delay_s
        felt = resample(clock, readings, time + later)
        variants["compensated"] = [
            _compensated(model, felt, wrench)
            for model, wrench in zip(models, variants["measured"], strict=True)
        ]
        notes += check_trial(models[0], readings)
        notes.append(f"compensated by {len(names)} accelerometers: {', '.join(names)}")
    pose, said = platform_pose(recording, laboratory.treadmill.platform, time)
    notes += said
    placed = {}
    for name, wrenches in variants.items():
        still = [
            transform_wrench(wrench, plate.rotation, plate.center)
            for wrench, plate in zip(wrenches, plates, strict=True)
        ]
        placed[name] = still if pose is None else [to_lab(wrench, pose) for wrench in still]
    return Ground(placed, pose, tuple(notes))


def fit_calibration(recording: Recording, treadmill: Treadmill) -> Calibration:
    """Learn what the empty plates of a moving treadmill measure.

    Parameters
    ----------
    recording
        The empty treadmill, moving.
    treadmill
        Names of its accelerometers' channels and the cut-off for the fit.

    Returns
    -------
    Calibration
        One model per plate, named "plate 1", "plate 2", ….

    Raises
    ------
    ValueError
        If there are no plates or accelerometers, or the fit is not possible.
    """
    if not recording.plates:
        raise ValueError(f"{recording.source.name}: the calibration recording has no force plates")
    clock, readings = accelerations(recording, treadmill)
    setup = _setup(recording, treadmill)
    smooth = low_pass(readings, setup.rate_hz, treadmill.cutoff_hz)
    models = {}
    for plate in recording.plates:
        wrench = low_pass(plate.wrench_in_plate, setup.rate_hz, treadmill.cutoff_hz)
        at = plate.time + treadmill.accelerometer_delay_s
        felt = smooth if at is clock else resample(clock, smooth, at)
        inside = np.isfinite(felt).all(axis=1) & np.isfinite(wrench).all(axis=1)
        models[f"plate {plate.number}"] = fit_inertia(felt[inside], wrench[inside], setup)
    return Calibration(models, {"recording": recording.source.name})


def read_calibration(path: Path, treadmill: Treadmill, axes: str | None) -> Calibration:
    """Read a fitted calibration (JSON), or fit one to a recording of the empty treadmill (C3D).

    Parameters
    ----------
    path
        ``.json`` or ``.c3d``.
    treadmill
        Names of the accelerometers' channels.
    axes
        Lab directions of the file's axes; an empty treadmill shows nobody to infer them from.

    Returns
    -------
    Calibration
        One model per plate.

    Raises
    ------
    ValueError, OSError
        If the file cannot be read or used.
    """
    if path.suffix.lower() == ".json":
        try:
            return from_json(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ValueError(f"{path.name}: {error}") from error
    recording = read_empty(path, axes)
    try:
        return fit_calibration(recording, treadmill)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error


def read_empty(path: Path, axes: str | None) -> Recording:
    """Read a recording of the empty treadmill.

    Parameters
    ----------
    path
        C3D file.
    axes
        Where the file's axes point; if None, any directions with the right vertical: nobody shows
        which way is forward, and a calibration in the plates' own axes does not need it.

    Returns
    -------
    Recording
        The trial.

    Raises
    ------
    ValueError, OSError
        If the file cannot be read.
    """
    if axes is not None:
        return read_c3d(path, axes)
    try:
        return read_c3d(path)
    except ValueError as first:
        for guess in UPRIGHT:
            try:
                return read_c3d(path, guess)
            except ValueError:
                continue
        raise first


def accelerations(recording: Recording, treadmill: Treadmill) -> tuple[Array, Array]:
    """Give the accelerometers' readings.

    Parameters
    ----------
    recording
        The trial.
    treadmill
        Sensor name -> its three channels.

    Returns
    -------
    time
        (N,) [s].
    readings
        Specific force, three columns per sensor in the order stated, (N, k) [m/s²].

    Raises
    ------
    ValueError
        If no accelerometers are stated, a channel is missing, or its unit is unknown.
    """
    if not treadmill.accelerometers:
        raise ValueError(
            "compensation needs the accelerometers' channels: treadmill.accelerometers"
        )
    if recording.analog is None:
        raise ValueError(f"{recording.source.name}: the file has no analog channels")
    columns = []
    for channels in treadmill.accelerometers.values():
        for name in channels:
            signal, unit = _channel(recording, name)
            columns.append(signal * acceleration_in_mps2(treadmill.accelerometer_unit or unit))
    return recording.analog.time, np.column_stack(columns)


def platform_pose(
    recording: Recording, platform: Platform | None, time: Array
) -> tuple[PlatformPose | None, list[str]]:
    """Find the platform's pose at the markers' times.

    Parameters
    ----------
    recording
        The trial; its first frames show the platform in neutral.
    platform
        How the pose is known; None for a treadmill that stands still.
    time
        Marker times, (T,) [s].

    Returns
    -------
    pose
        None where the treadmill stands still.
    notes
        Where it came from, and what was wrong with it.
    """
    if platform is None:
        return None, []
    if platform.markers:
        names = recording.markers.names
        missing = [name for name in platform.markers if name not in names]
        if missing:
            raise ValueError(
                f"{recording.source.name}: platform markers {', '.join(missing)} are not in the "
                f"file; markers there: {', '.join(names)}"
            )
        position = recording.markers.position[:, [names.index(n) for n in platform.markers]]
        fit = fit_pose(position, neutral_markers(position[:NEUTRAL_FRAMES]), OUTLIER_M)
        return fit.pose, [f"platform's pose from {len(platform.markers)} markers", *fit.warnings]
    channels = {"sway": platform.sway_channel, "pitch": platform.pitch_channel}
    if not any(channels.values()):
        raise ValueError("the platform's pose needs its markers, or its sway or pitch channel")
    motion = {}
    for kind, name in channels.items():
        if name is None:
            motion[kind] = np.zeros(len(time))
            continue
        signal, unit = _channel(recording, name)
        scale = length_in_m(unit) if kind == "sway" else angle_in_rad(unit)
        assert recording.analog is not None
        motion[kind] = resample(recording.analog.time, signal * scale, time + platform.delay_s)
    pose = commanded_pose(motion["sway"], motion["pitch"], platform.pivot_m)
    used = " and ".join(name for name in channels.values() if name)
    return pose, [f"platform's pose as commanded by {used}, pivot at {platform.pivot_m} m"]


def _channel(recording: Recording, name: str) -> tuple[Array, str]:
    assert recording.analog is not None
    try:
        return recording.analog.channel(name), recording.analog.units[
            recording.analog.names.index(name)
        ]
    except KeyError as error:
        raise ValueError(f"{recording.source.name}: {error.args[0]}") from error


def _setup(recording: Recording, treadmill: Treadmill) -> Setup:
    assert recording.analog is not None
    rate = float(1 / np.median(np.diff(recording.analog.time)))
    return Setup(tuple(treadmill.accelerometers), round(rate, 6), treadmill.cutoff_hz)


def _models(recording: Recording, laboratory: Laboratory) -> list[InertiaModel]:
    """Give the model of every plate of a trial; refuse a calibration made for others."""
    assert laboratory.calibration is not None
    known = laboratory.calibration.plates
    models = []
    for plate in recording.plates:
        name = f"plate {plate.number}"
        if name not in known:
            raise ValueError(
                f"{recording.source.name}: the calibration has no {name}; it has {', '.join(known)}"
            )
        known[name].require(_setup(recording, laboratory.treadmill))
        models.append(known[name])
    return models


def _compensated(model: InertiaModel, felt: Array, wrench: Array) -> Array:
    """Compensate the samples that have both; the others stay gaps."""
    both = np.isfinite(felt).all(axis=1) & np.isfinite(wrench).all(axis=1)
    result = np.full(wrench.shape, np.nan)
    result[both] = model.compensate(felt[both], wrench[both])
    return result
