"""How plates and commands are timed against the platform's markers, by its own motion."""

from typing import Final

import numpy as np

from compensation import Delay, PlatformPose, Sensor, estimate_delay, pose_delay, specific_force
from hbm.notes import Note
from hbm.spatial import Array
from pipeline.config.schema import Platform, Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import accelerations, at_plate_times
from pipeline.trial.ground.empty_plates import setup_of
from pipeline.trial.ground.platform import platform_pose

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
    return Delay(-late.seconds, late.standard_error, late.explained)


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
