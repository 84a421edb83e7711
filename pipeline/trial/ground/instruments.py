"""What a moving treadmill's instruments tell of it: specific force, and the platform's pose."""

from collections.abc import Callable
from typing import Final

import numpy as np

from compensation import PlatformPose, check_pose, commanded_pose, fit_pose, neutral_markers
from hbm.notes import Note
from hbm.signals.resampling import resample
from hbm.spatial import Array
from pipeline.config.schema import Platform, Treadmill
from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2, angle_in_rad, length_in_m

NEUTRAL_FRAMES: Final = 100
OUTLIER_M: Final = 0.01


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
    columns = []
    for channels in treadmill.accelerometers.values():
        for name in channels:
            time, signal, unit = _channel(recording, name)
            columns.append(signal * _scale(recording, name, treadmill.accelerometer_unit or unit))
    return time, np.column_stack(columns)


def platform_pose(
    recording: Recording, platform: Platform | None, time: Array
) -> tuple[PlatformPose | None, tuple[Note, ...]]:
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
        return None, ()
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
        origin = Note.of("platform_pose_from_markers", markers=platform.markers)
        return fit.pose, (origin, *check_pose(fit, platform.markers, OUTLIER_M))
    channels = {"sway": platform.sway_channel, "pitch": platform.pitch_channel}
    if not any(channels.values()):
        raise ValueError("the platform's pose needs its markers, or its sway or pitch channel")
    motion = {}
    for kind, name in channels.items():
        if name is None:
            motion[kind] = np.zeros(len(time))
            continue
        clock, signal, unit = _channel(recording, name)
        signal = signal * _scale(
            recording, name, unit, length_in_m if kind == "sway" else angle_in_rad
        )
        motion[kind] = resample(clock, signal, time + platform.delay_s)
    pose = _commanded(motion["sway"], motion["pitch"], platform.pivot_m)
    x, y, z = platform.pivot_m
    note = Note.of(
        "platform_pose_commanded",
        channels=tuple(platform.channels),
        pivot_x_m=x,
        pivot_y_m=y,
        pivot_z_m=z,
    )
    return pose, (note,)


def _commanded(sway: Array, pitch: Array, pivot_m: tuple[float, float, float]) -> PlatformPose:
    """Give the pose where both channels are known; a delay leaves none at one end."""
    known = np.isfinite(sway) & np.isfinite(pitch)
    pose = commanded_pose(sway[known], pitch[known], pivot_m)
    rotation, position = np.full((len(sway), 3, 3), np.nan), np.full((len(sway), 3), np.nan)
    rotation[known], position[known] = pose.rotation, pose.position
    return PlatformPose(rotation, position)


def _channel(recording: Recording, name: str) -> tuple[Array, Array, str]:
    """Give times, samples and unit of an analog channel."""
    analog = recording.analog
    if analog is None:
        raise ValueError(f"{recording.source.name}: no analog channel {name!r}; there are none")
    try:
        return analog.time, analog.channel(name), analog.units[analog.names.index(name)]
    except KeyError as error:
        raise ValueError(f"{recording.source.name}: {error.args[0]}") from error


def _scale(
    recording: Recording, name: str, unit: str, of: Callable[[str], float] = acceleration_in_mps2
) -> float:
    try:
        return of(unit)
    except ValueError as error:
        raise ValueError(f"{recording.source.name}: channel {name!r}: {error}") from error
