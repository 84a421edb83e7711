"""The platform's pose, by markers or as commanded; plates that move with it, and their timing."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from compensation import (
    Delay,
    PlatformPose,
    Sensor,
    check_pose,
    commanded_pose,
    estimate_delay,
    fit_pose,
    interpolate_pose,
    mean_pose,
    moment_error_of_pivot,
    neutral_markers,
    pose_delay,
    specific_force,
    to_lab,
)
from hbm.notes import Note
from hbm.signals.resampling import resample
from hbm.spatial import Array, rotate_wrench, shift_wrench, transform_wrench
from pipeline.config.schema import Platform, Treadmill
from pipeline.io.recording import Plate, Recording
from pipeline.io.units import angle_in_rad, length_in_m
from pipeline.trial.ground.accelerometers import (
    accelerations,
    at_plate_times,
    hold_ends,
    read_channel,
)
from pipeline.trial.ground.calibration_recording import setup_of

NEUTRAL_FRAMES: Final = 100
"""Frames at the start in which the platform is in neutral: one second at 100 Hz."""
MAX_MARKER_ERROR_M: Final = 0.01
"""Farther from the rigid fit a marker is left out; cameras err by a millimetre or less."""

ASSUMED_PIVOT_ERROR_M: Final = 0.01
"""Of a pivot that is measured by hand; its effect on the moments is noted."""


def platform_pose(
    recording: Recording,
    platform: Platform | None,
    time: Array,
    at_markers: Callable[[Array, Array, Array], Array] = resample,
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
    at_markers
        Brings a channel, its times and samples, to other times.

    Returns
    -------
    pose
        None where the treadmill stands still.
    notes
        Where the pose comes from, and what is doubtful about it.

    Raises
    ------
    ValueError
        If a platform marker or channel is missing, or none is stated.
    """
    if platform is None:
        return None, ()
    if platform.markers:
        return _pose_from_markers(recording, platform.markers)
    if not platform.channels:
        raise ValueError("the platform's pose needs its markers, or its sway or pitch channel")
    return _commanded_pose(recording, platform, time, at_markers)


def pose_at(recording: Recording, pose: PlatformPose, time: Array) -> PlatformPose:
    """Give a trial's pose at other times than those of its markers.

    Parameters
    ----------
    recording
        The trial.
    pose
        The platform's pose at the markers' times.
    time
        Wanted times on the markers' clock, (N,) [s].

    Returns
    -------
    PlatformPose
        Without gaps; before and after the markers the nearest known pose, for 0.5 s at most.

    Raises
    ------
    ValueError
        The pose has a gap, or is unknown for longer at an end.
    """
    between = interpolate_pose(pose, recording.markers.time, time)
    values = np.hstack([between.rotation.reshape(-1, 9), between.position])
    try:
        values, _ = hold_ends(time, values, "the platform's pose")
    except ValueError as error:
        raise ValueError(f"{recording.source.name}: {error}") from error
    return PlatformPose(values[:, :9].reshape(-1, 3, 3), values[:, 9:])


def turned_to_lab(plate: Plate, wrench_in_plate: Array, pose: PlatformPose) -> Array:
    """Turn wrenches from a plate that moves to the same plate in neutral.

    Parameters
    ----------
    plate
        The plate.
    wrench_in_plate
        Action on the subject in the moving plate's axes about the centre of its surface, (N, 6)
        [N, N·m].
    pose
        The platform's pose at the same instants.

    Returns
    -------
    Array
        The same action in the axes of the plate in neutral about the centre of its surface there,
        (N, 6) [N, N·m].
    """
    on_platform = transform_wrench(wrench_in_plate, plate.rotation, plate.center)
    about_center = shift_wrench(to_lab(on_platform, pose), plate.center)
    return rotate_wrench(about_center, plate.rotation.T)


def in_lab(
    wrenches: Sequence[Array], plates: Sequence[Plate], pose: PlatformPose | None
) -> list[Array]:
    """Bring wrenches in plate axes to the lab, by the plates' neutral places and the pose."""
    neutral = [
        transform_wrench(wrench, plate.rotation, plate.center)
        for wrench, plate in zip(wrenches, plates, strict=True)
    ]
    return neutral if pose is None else [to_lab(wrench, pose) for wrench in neutral]


def pivot_error_budget(pose: PlatformPose, force: Array) -> Note:
    """Give the largest moment that a small error of the stated pivot would add."""
    pitch = np.arctan2(pose.rotation[:, 0, 2], pose.rotation[:, 0, 0])
    directions = np.eye(3)[[0, 2]]
    moments = [moment_error_of_pivot(ASSUMED_PIVOT_ERROR_M * d, pitch, force) for d in directions]
    largest_nm = float(np.nanmax(np.linalg.norm(moments, axis=2)))
    return Note.of("pivot_error_budget", pivot_error_m=ASSUMED_PIVOT_ERROR_M, moment_nm=largest_nm)


def moved_corners(plate: Plate, pose: PlatformPose) -> Array:
    """Give the corners of a plate in the mean of a pose.

    Parameters
    ----------
    plate
        The plate.
    pose
        The platform's pose over the trial.

    Returns
    -------
    Array
        In the axes of the plate in neutral about the centre of its surface there, (4, 3) [m].
    """
    mean = mean_pose(pose)
    in_lab = plate.corners @ mean.rotation[0].T + mean.position[0]
    return np.asarray((in_lab - plate.center) @ plate.rotation)


def _pose_from_markers(
    recording: Recording, markers: tuple[str, ...]
) -> tuple[PlatformPose, tuple[Note, ...]]:
    names = recording.markers.names
    missing = [name for name in markers if name not in names]
    if missing:
        raise ValueError(
            f"{recording.source.name}: platform markers {', '.join(missing)} are not in the "
            f"file; markers there: {', '.join(names)}"
        )
    position = recording.markers.position[:, [names.index(name) for name in markers]]
    fit = fit_pose(position, neutral_markers(position[:NEUTRAL_FRAMES]), MAX_MARKER_ERROR_M)
    note = Note.of("platform_pose_from_markers", markers=markers)
    return fit.pose, (note, *check_pose(fit, markers, MAX_MARKER_ERROR_M))


def _commanded_pose(
    recording: Recording,
    platform: Platform,
    time: Array,
    at_markers: Callable[[Array, Array, Array], Array],
) -> tuple[PlatformPose, tuple[Note, ...]]:
    """Give the pose where both commands are known; the delay leaves a gap at one end."""

    def command(channel: str | None, unit_in_si: Callable[[str], float]) -> Array:
        if channel is None:
            return np.zeros(len(time))
        clock, values = read_channel(recording, channel, unit_in_si)
        return at_markers(clock, values, time + platform.delay_s)

    sway = command(platform.sway_channel, length_in_m)
    pitch = command(platform.pitch_channel, angle_in_rad)
    known = np.isfinite(sway) & np.isfinite(pitch)
    pose = commanded_pose(sway[known], pitch[known], platform.pivot_m)
    rotation, position = np.full((len(time), 3, 3), np.nan), np.full((len(time), 3), np.nan)
    rotation[known], position[known] = pose.rotation, pose.position
    x, y, z = platform.pivot_m
    note = Note.of(
        "platform_pose_commanded",
        channels=platform.channels,
        pivot_x_m=x,
        pivot_y_m=y,
        pivot_z_m=z,
    )
    return PlatformPose(rotation, position), (note,)


QUANTILE_95: Final = 1.96
MAX_ERROR_S: Final = 0.002
"""Standard error above which a delay is not worth stating."""
MIN_BEYOND_S: Final = 0.001
"""Beyond its interval, from which a delay that is not stated matters: most filters of instruments
are later by more."""


def plate_marker_delay(pose: PlatformPose, felt: Array, rate_hz: float) -> Delay | None:
    """Estimate how much later the plates are than the markers on their platform.

    Parameters
    ----------
    pose
        Of the platform by its markers, at their frames, (T,).
    felt
        What its accelerometers felt at the same nominal instants, timed as the plates,
        (T, k) [m/s²]; NaN where unknown.
    rate_hz
        Of the frames.

    Returns
    -------
    Delay or None
        Positive where plates are later; None where the motion does not show it to 4 ms.
    """
    known = np.asarray(np.isfinite(np.hstack([felt, pose.position])).all(axis=1))
    inside = np.flatnonzero(known)
    if not len(inside) or not known[inside[0] : inside[-1] + 1].all():
        return None
    part = slice(inside[0], inside[-1] + 1)
    there = PlatformPose(pose.rotation[part], pose.position[part])
    try:
        late = estimate_delay(felt[part], specific_force(there, rate_hz), rate_hz)
    except ValueError:
        return None
    if not late.standard_error < MAX_ERROR_S:
        return None
    return Delay(-late.seconds, late.standard_error)


def plates_note(late: Delay | None, stated_s: float | None = None) -> tuple[Note, ...]:
    """Say how much later plates are than the platform's markers; nothing where unknown.

    Parameters
    ----------
    late
        By how much they are later than is taken into account.
    stated_s
        What is taken into account; None where the recording is no trial, and nothing can be.
    """
    if late is None:
        return ()
    interval_s = QUANTILE_95 * late.standard_error
    if stated_s is None:
        return (Note.of("platform_plates_delay", delay_s=late.seconds, interval_s=interval_s),)
    beyond = abs(late.seconds) > interval_s + MIN_BEYOND_S
    return (
        Note.of(
            "platform_plates_delay_differs" if beyond else "platform_plates_delay_stated",
            delay_s=stated_s + late.seconds,
            interval_s=interval_s,
            stated_s=stated_s,
        ),
    )


def recording_delays(
    recording: Recording, treadmill: Treadmill, sensors: tuple[Sensor, ...], commands: Platform
) -> tuple[Note, ...]:
    """Say how plates and commands of a recording are timed against the platform's markers.

    Parameters
    ----------
    recording
        Of the moving platform.
    treadmill
        Its accelerometers, and its platform with markers.
    sensors
        Of the calibration.
    commands
        Channels of the commanded sway and pitch; none where they were not recorded.

    Returns
    -------
    tuple of Note
        Of what the recording shows.

    Raises
    ------
    ValueError
        If a marker or channel is missing, or the command does not move.
    """
    markers, rate_hz = recording.markers, recording.markers.rate_hz
    pose, _ = platform_pose(recording, treadmill.platform, markers.time)
    assert pose is not None  # the platform has markers
    clock, readings = accelerations(recording, treadmill)
    filtered = setup_of(recording, treadmill).low_pass(readings, clock)
    felt = at_plate_times(clock, filtered, markers.time, treadmill, sensors)
    notes = plates_note(plate_marker_delay(pose, felt, rate_hz))
    if not commands.channels:
        return notes
    commanded, _ = platform_pose(recording, commands, markers.time)
    assert commanded is not None
    late = pose_delay(commanded, pose, rate_hz)
    return (
        *notes,
        Note.of(
            "platform_command_delay",
            delay_s=late.seconds,
            interval_s=QUANTILE_95 * late.standard_error,
            channels=commands.channels,
            stated_s=-late.seconds,
        ),
    )
