"""Perturbations of a trial: when they begin, and for how long the platform moves."""

from typing import Final

import numpy as np

from compensation.platform import PlatformPose
from hbm.signals.filtering import low_pass
from hbm.signals.samples import stretches
from hbm.spatial import Array, Mask
from pipeline.config.schema import Condition
from pipeline.io.recording import Recording

MIN_ONSET_INTERVAL_S: Final = 1.0
"""What follows sooner belongs to the same perturbation; perturbations are strides apart."""
MIN_PLATFORM_SPEED_MPS: Final = 0.1
"""A third of the perturbation's 0.3 m/s; the slow return, and 10° of pitch in 30 s, stay below."""
CORNERS_M: Final = tuple((x, y, 0.0) for x in (-0.8, 0.8) for y in (-0.5, 0.5))
"""About those of a treadmill's surface, in the platform's frame: where a rotation shows."""
MOTION_CUTOFF_HZ: Final = 6.0
"""Low-pass on their paths before their speed is taken."""
MIN_PULSE_TO_NOISE: Final = 10.0
"""Largest by median excursion: a channel that never pulses has only noise."""


def perturbation_onsets(
    recording: Recording, condition: Condition, platform: PlatformPose | None
) -> Array:
    """Find the perturbations of a trial: from the pulse channel, else from the platform's motion.

    Parameters
    ----------
    recording
        The trial.
    condition
        Names the pulse channel, if there is one.
    platform
        The platform's pose at the markers' times.

    Returns
    -------
    Array
        Onsets, (P,) [s].

    Raises
    ------
    ValueError
        If there is neither a pulse channel nor a pose, or no perturbation.
    """
    name = recording.source.name
    if condition.pulse_channel is not None:
        onsets, source = pulse_onsets(recording, condition.pulse_channel), condition.pulse_channel
    elif platform is not None:
        onsets = motion_onsets(recording.markers.time, platform)
        source = "the platform's motion"
    else:
        raise ValueError(
            f"{name}: a perturbed condition needs a pulse_channel, or the platform's pose"
        )
    if not len(onsets):
        raise ValueError(f"{name}: {source} shows no perturbation, but the condition is perturbed")
    return onsets


def pulse_onsets(recording: Recording, channel: str) -> Array:
    """Find perturbation onsets in a pulse channel, at the channel's own rate.

    Parameters
    ----------
    recording
        The trial.
    channel
        Name of the analog channel that rises when a perturbation starts.

    Returns
    -------
    Array
        Onsets, (P,) [s]: where the signal first leaves its median, up or down, by half of the
        largest excursion; what follows within a second belongs to the same pulse. Empty where the
        signal never pulses.

    Raises
    ------
    ValueError
        If the channel is not there.
    """
    if recording.analog is None:
        raise ValueError(f"{recording.source.name}: no analog channels, so no {channel!r}")
    try:
        signal = recording.analog.channel(channel)
    except KeyError as error:
        raise ValueError(f"{recording.source.name}: {error.args[0]}") from error
    excursion = np.abs(signal - float(np.nanmedian(signal)))
    peak = float(np.nanmax(excursion, initial=0.0))
    noise = float(np.nanmedian(excursion))
    if peak <= MIN_PULSE_TO_NOISE * noise or peak == 0:
        return np.empty(0)
    high = excursion > peak / 2
    return _first_of_each(recording.analog.time[1:][high[1:] & ~high[:-1]])


def motion_onsets(time: Array, platform: PlatformPose) -> Array:
    """Find perturbation onsets from the platform's pose.

    Parameters
    ----------
    time
        (T,) [s].
    platform
        Its pose, (T,) frames.

    Returns
    -------
    Array
        Where a corner of its surface first moves faster than 0.1 m/s, (P,) [s]: some 0.05 s after
        the platform starts to move 5 cm at 0.3 m/s. A slow return does not count.
    """
    fast = _moves_fast(time, platform)
    return _first_of_each(time[1:][fast[1:] & ~fast[:-1]])


def motion_stops(onsets: Array, time: Array, platform: PlatformPose) -> Array:
    """Find until when the platform moves fast after each perturbation.

    Parameters
    ----------
    onsets
        Perturbation onsets, (P,) [s].
    time
        (T,) [s].
    platform
        Its pose, (T,) frames.

    Returns
    -------
    Array
        First frame after the onset, and after the motion has begun, in which no corner of its
        surface moves faster than 0.1 m/s, (P,) [s]; NaN where none does within a second of the
        onset. A slow return does not count.

    Examples
    --------
    >>> time = np.arange(1000) / 100
    >>> position = np.outer(0.3 * np.clip(time - 2.0, 0, 1 / 6), [0, 1, 0])
    >>> platform = PlatformPose(np.tile(np.eye(3), (1000, 1, 1)), position)
    >>> [f"{stop:.2f}" for stop in motion_stops(np.array([2.0, 6.0]), time, platform)]
    ['2.18', 'nan']
    """
    moving = stretches(_moves_fast(time, platform))
    begins, ends = time[moving[:, 0]], np.append(time, time[-1])[moving[:, 1]]
    stops = np.full(len(onsets), np.nan)
    for k, onset in enumerate(onsets):
        own = (ends > onset) & (begins < onset + MIN_ONSET_INTERVAL_S)
        if own.any():
            stops[k] = ends[own][0]
    return stops


def _moves_fast(time: Array, platform: PlatformPose) -> Mask:
    """Give whether any corner of the platform's surface moves fast, (T,); straight over gaps."""
    rate_hz, fast = 1 / np.median(np.diff(time)), np.zeros(len(time), bool)
    known = np.isfinite(platform.position[:, 0])
    if not known.any():
        return fast
    for corner in CORNERS_M:
        place = platform.to_lab(corner)
        bridged = np.column_stack([np.interp(time, time[known], x) for x in place[known].T])
        path = low_pass(bridged, rate_hz, MOTION_CUTOFF_HZ, "zero_phase")
        speed = np.linalg.norm(np.gradient(path, time, axis=0), axis=1)
        fast |= speed > MIN_PLATFORM_SPEED_MPS
    return fast


def _first_of_each(times: Array) -> Array:
    """Keep the first of times that follow one another closely."""
    return times[np.diff(times, prepend=-np.inf) > MIN_ONSET_INTERVAL_S]
