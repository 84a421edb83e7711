"""The platform's pose, by markers or as commanded; plates that move with it, and their timing."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

import compensation
from compensation import Delay, PlatformPose
from compensation.inertia.sensors import QUANTILE_95
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.resampling import resample
from hbm.signals.samples import stretches, without_short_gaps
from hbm.spatial import Array, Mask, fit_rotation, rotate_wrench, shift_wrench, transform_wrench
from pipeline.config.schema import Platform
from pipeline.io.input_file import naming
from pipeline.io.recording import Plate, Recording
from pipeline.io.units import angle_in_rad, length_in_m
from pipeline.trial.ground.accelerometers import find_commands, hold_ends, read_channel

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "platform")

LEVEL: Final = (
    "taken as level and in neutral, because none is recorded; if it moved, name its markers "
    "(--platform-markers, or treadmill.platform in a study)"
)
"""What is taken for a pose that is not known."""


def platform_pose(
    recording: Recording,
    platform: Platform | None,
    time: Array,
    at_markers: Callable[[Array, Array, Array], Array] = resample,
) -> tuple[PlatformPose | None, tuple[Note, ...]]:
    """Find the platform's pose at the markers' times, (T,) [s], and say where it comes from.

    The first frames of a recording show it in neutral. It is None where the treadmill stands still.
    Channels are brought to the markers' times by `at_markers`. A ValueError where a platform marker
    or channel is missing, or none is stated.
    """
    if platform is None:
        return None, ()
    if platform.markers:
        return _pose_from_markers(recording, platform.markers)
    if not platform.channels:
        raise ValueError("the platform's pose needs its markers, or its sway or pitch channel")
    return _commanded_pose(recording, platform, time, at_markers)


def empty_pose(recording: Recording, wanted: Platform | None = None) -> PlatformPose | None:
    """Give the pose of an empty treadmill, (T,); NaN where unknown.

    As stated; else by all markers of the recording, which are on the platform where they move as
    one body; else by channels named sway and pitch. None where none of these moves. A ValueError as
    of `platform_pose` for what is stated.
    """
    names = recording.markers.names
    # three points determine a pose
    by_markers = Platform(markers=names if len(names) >= 3 else ())
    for platform in [wanted] if wanted else [by_markers, find_commands(recording)]:
        try:
            pose, _ = platform_pose(recording, platform, recording.markers.time)
        except ValueError:  # also where there is nothing by which it would be is_known
            if wanted:
                raise
            continue
        is_known = pose is not None and np.isfinite(pose.position).all(axis=1)
        if pose is not None and np.mean(is_known) > LIMITS.least_known:
            # vertical axis and place: of a platform that moves they change
            moved = np.ptp(np.hstack([pose.rotation[is_known, 2], pose.position[is_known]]), axis=0)
            if moved.max() > LIMITS.least_motion:
                return pose
    return None


def turned_rad(pose: PlatformPose) -> Array:
    """Give by how much the platform is turned from neutral, (T,) [rad]."""
    # cos of the angle = (trace − 1) / 2
    trace = np.trace(pose.rotation, axis1=1, axis2=2)
    return np.asarray(np.arccos(np.clip((trace - 1) / 2, -1, 1)))


def uncompensated_motion(recording: Recording, body_markers: Sequence[str]) -> tuple[Note, ...]:
    """Say that a platform of which nothing is stated moves, and how far.

    By the markers that are not the body's, if they move as one, else by channels named sway and
    pitch.
    """
    markers, names = recording.markers, recording.markers.names
    others = [k for k, name in enumerate(names) if name not in body_markers]
    left_over = tuple(names[k] for k in others)
    on_platform = replace(markers, names=left_over, position=markers.position[:, others])
    pose = empty_pose(replace(recording, markers=on_platform))
    if pose is None:
        return ()
    is_known = np.isfinite(pose.position).all(axis=1)
    # largest turn, and largest shift along an axis
    turned_deg = float(np.degrees(turned_rad(pose)[is_known]).max())
    moved_m = float(np.ptp(pose.position[is_known], axis=0).max())
    if moved_m < LIMITS.least_sway and turned_deg < LIMITS.least_pitch:
        return ()
    return (Note.of("platform_moves", moved_m=moved_m, turned_deg=turned_deg),)


def pose_at(recording: Recording, pose: PlatformPose, time: Array) -> PlatformPose:
    """Give a trial's pose at other times on the markers' clock, (N,) [s], without gaps.

    Before and after the markers it is the nearest known one, for 0.5 s at most; a ValueError where
    it has a gap or is unknown for longer.
    """
    # splines through places and rotation vectors, then the nearest known pose at both ends
    between = compensation.interpolate_pose(pose, recording.markers.time, time)
    values = np.hstack([between.rotation.reshape(-1, 9), between.position])
    with naming(recording.source):
        values = hold_ends(time, values, "the platform's pose")
    return PlatformPose(values[:, :9].reshape(-1, 3, 3), values[:, 9:])


def turned_to_lab(plate: Plate, wrench_in_plate: Array, pose: PlatformPose) -> Array:
    """Turn wrenches (N, 6) from a plate that moves to the same plate in neutral.

    Both are about the centre of its surface, in its own axes, where it is.
    """
    (moved,) = in_lab([wrench_in_plate], [plate], pose)
    return rotate_wrench(shift_wrench(moved, plate.center), plate.rotation.T)


def in_lab(
    wrenches: Sequence[Array], plates: Sequence[Plate], pose: PlatformPose | None
) -> list[Array]:
    """Bring wrenches in plate axes to the lab, by the plates' neutral places and the pose."""
    # from the plate to the lab in neutral, then with the platform
    neutral = [
        transform_wrench(wrench, plate.rotation, plate.center)
        for wrench, plate in zip(wrenches, plates, strict=True)
    ]
    return neutral if pose is None else [compensation.to_lab(wrench, pose) for wrench in neutral]


def moved_corners(plate: Plate, pose: PlatformPose) -> Array:
    """Give the corners of a plate in the mean of a pose, in the axes of the plate in neutral.

    About the centre of its surface there, (4, 3) [m].
    """
    is_known = np.isfinite(pose.position).all(axis=1)
    if not is_known.any():
        raise ValueError("the platform's pose is unknown in all frames")
    # the mean of rotation matrices is none: the nearest one
    rotation = fit_rotation(pose.rotation[is_known].mean(axis=0))
    moved = plate.corners @ rotation.T + pose.position[is_known].mean(axis=0)
    return np.asarray((moved - plate.center) @ plate.rotation)


def after_neutral(recording: Recording) -> Mask:
    """Find the frames after those that show the platform in neutral, (T,)."""
    return np.asarray(np.cumsum(_received(recording)) > LIMITS.neutral_frames)


def _received(recording: Recording) -> Mask:
    """Find the frames that hold any marker, (T,): the others were lost."""
    return np.asarray(np.isfinite(recording.markers.position).any(axis=(1, 2)))


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
    # frames without any marker were lost on the way, not hidden
    received, time = _received(recording), recording.markers.time
    position = recording.markers.position[:, [names.index(name) for name in markers]]
    first = position[received][: LIMITS.neutral_frames]
    is_visible = np.isfinite(first.sum(axis=2))
    hidden = [name for k, name in enumerate(markers) if not is_visible[:, k].any()]
    if hidden:
        raise ValueError(
            f"platform markers {', '.join(hidden)} are not seen in the first "
            f"{LIMITS.neutral_frames} frames, which show the platform in neutral; name others"
        )
    fit = compensation.fit_pose(
        position, compensation.neutral_markers(first), LIMITS.largest_marker_error
    )
    lost = ~received & without_short_gaps(received, time, LIMITS.longest_loss)
    if lost.any():
        # a short loss is bridged, since the platform moves evenly
        there = PlatformPose(fit.pose.rotation[received], fit.pose.position[received])
        between = compensation.interpolate_pose(there, time[received], time[lost])
        rotation, place = fit.pose.rotation.copy(), fit.pose.position.copy()
        rotation[lost], place[lost] = between.rotation, between.position
        fit = fit._replace(pose=PlatformPose(rotation, place))
    note = Note.of("platform_pose", source=f"by the markers {', '.join(markers)}")
    return fit.pose, (note, *compensation.check_pose(fit, markers, LIMITS.largest_marker_error))


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

    # a command is later or earlier than the motion by a stated delay
    sway = command(platform.sway_channel, length_in_m)
    pitch = command(platform.pitch_channel, angle_in_rad)
    is_known = np.isfinite(sway) & np.isfinite(pitch)
    pose = compensation.commanded_pose(sway[is_known], pitch[is_known], platform.pivot_m)
    rotation, position = np.full((len(time), 3, 3), np.nan), np.full((len(time), 3), np.nan)
    rotation[is_known], position[is_known] = pose.rotation, pose.position
    pivot = ", ".join(f"{value:g}" for value in platform.pivot_m)
    source = f"as commanded by {', '.join(platform.channels)}, pivot at ({pivot}) m"
    return PlatformPose(rotation, position), (Note.of("platform_pose", source=source),)


def plate_marker_delay(pose: PlatformPose, accelerations: Array, rate_hz: float) -> Delay | None:
    """Estimate how much later the plates are than the markers on their platform.

    From the pose at the markers' frames and what its accelerometers measure then, timed as the
    plates, (T, k) [m/s²]. None where the motion does not show it to 4 ms.
    """
    # the motion must be known without a gap from its first to its last frame
    is_known = np.asarray(np.isfinite(np.hstack([accelerations, pose.position])).all(axis=1))
    inside = np.flatnonzero(is_known)
    if not len(inside) or not is_known[inside[0] : inside[-1] + 1].all():
        return None
    part = slice(inside[0], inside[-1] + 1)
    there = PlatformPose(pose.rotation[part], pose.position[part])
    try:
        force = compensation.specific_force(there, rate_hz)
        late = compensation.estimate_delay(accelerations[part], force, rate_hz)
    except ValueError:
        return None
    if not late.standard_error < LIMITS.largest_delay_error:
        return None
    # it is the plates' lateness against the markers, the other way round
    return Delay(-late.seconds, late.standard_error)


def plates_note(
    pose: PlatformPose, accelerations: Array, rate_hz: float, stated_s: float
) -> tuple[Note, ...]:
    """Say how much later plates are than the platform's markers; nothing where unknown.

    Parameters are those of `plate_marker_delay`, and the delay that is stated; more beside it than
    the interval and 1 ms is a warning.
    """
    if (late := plate_marker_delay(pose, accelerations, rate_hz)) is None:
        return ()
    interval_s = QUANTILE_95 * late.standard_error
    beyond = abs(late.seconds) > interval_s + LIMITS.least_delay
    code = "platform_plates_delay_differs" if beyond else "platform_plates_delay"
    delay_s = stated_s + late.seconds
    return (Note.of(code, delay_s=delay_s, interval_s=interval_s, stated_s=stated_s),)


def command_delay(recording: Recording, markers: tuple[str, ...], commands: Platform) -> Note:
    """Say how much later the platform moves, by its markers, than it was commanded.

    By the longest part in which all markers are seen. A ValueError where a marker or channel is
    missing, or the command does not move.
    """
    pose, _ = _pose_from_markers(recording, markers)
    commanded, _ = _commanded_pose(recording, commands, recording.markers.time, resample)
    is_known = np.isfinite(np.hstack([pose.position, commanded.position])).all(axis=1)
    parts = stretches(np.asarray(is_known))
    if not len(parts):
        raise ValueError(f"the platform markers {', '.join(markers)} are never seen together")
    part = slice(*max(parts, key=np.ptp))
    there, then = (
        PlatformPose(one.rotation[part], one.position[part]) for one in (commanded, pose)
    )
    late = compensation.pose_delay(there, then, recording.markers.rate_hz)
    return Note.of(
        "platform_command_delay",
        delay_s=late.seconds,
        interval_s=QUANTILE_95 * late.standard_error,
        channels=commands.channels,
        stated_s=-late.seconds,
    )
