"""Gait events from the motion of the feet relative to the ground that carries them."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import find_peaks

from compensation.platform import PlatformPose
from hbm.body import Body
from hbm.poses import joint_positions
from hbm.signals.filtering import butterworth, low_pass
from hbm.signals.samples import median_of, stretches
from hbm.spatial import Array
from pipeline.io.recording import Event
from pipeline.trial.gait.events import MIN_EXCURSION_M, MIN_STRIDE_S, SIDES, in_order

TURN_CUTOFF_HZ: Final = 6.0
"""For when a foot swings forward and back: gait is below it."""
SPEED_CUTOFF_HZ: Final = 12.0
"""For the speed of a foot, which stops within a tenth of a second."""
STRIKE_SHARE: Final = 0.6
OFF_SHARE: Final = 0.8
"""Of the walking speed, that an ankle has above the ground at foot strike and the ball of a foot at
foot off: where the events of simulated walking are closest to those of the force."""
MID_STANCE: Final = 0.3, 0.6
"""Of the time in which a foot travels backwards against the pelvis: it rests on the ground."""


@dataclass(frozen=True, slots=True)
class FootMotion:
    """How pelvis and feet moved on the surface that carries them.

    Attributes
    ----------
    time
        (T,) [s].
    pelvis
        Its forward place, (T,) [m].
    ankles, balls
        Forward places of the ankle joints and of the joints of the toes, left and right, (T, 2)
        [m]; all in the frame of the platform, the belts moving in it.
    """

    time: Array
    pelvis: Array
    ankles: Array
    balls: Array


def foot_motion(body: Body, time: Array, q: Array, pose: PlatformPose | None) -> FootMotion:
    """Give how pelvis and feet moved on a platform.

    Parameters
    ----------
    body
        The subject.
    time
        (T,) [s].
    q
        Coordinates, not filtered, (T, 46) [m and rad].
    pose
        The platform's pose at these times; None where it stands still.

    Returns
    -------
    FootMotion
        NaN where the pose of body or platform is unknown.
    """
    names = "pelvis", "left_foot", "right_foot", "left_toes", "right_toes"
    places = joint_positions(body, q, names)
    if pose is None:
        forward = places[..., 0]
    else:
        relative = places - pose.position[:, None]
        forward = np.einsum("ti,tki->tk", pose.rotation[:, :, 0], relative)
    return FootMotion(time, forward[:, 0], forward[:, 1:3], forward[:, 3:])


def foot_motion_events(motion: FootMotion) -> tuple[Event, ...]:
    """Find foot strikes and foot offs by the speed of each foot above the ground.

    Parameters
    ----------
    motion
        How pelvis and feet moved.

    Returns
    -------
    tuple of Event
        In order of time, to a fraction of a frame. In a gap there are none, and none of a foot
        that does not swing past the pelvis.

    Raises
    ------
    ValueError
        If the trial is shorter than the filter needs.

    Notes
    -----
    A foot swings between the instants at which it is farthest behind and ahead of the pelvis (Zeni
    et al. 2008). In the middle of the stance between two swings the ball of the foot rests on the
    ground, whose speed it shows: a belt's, or none. A foot strikes when, after it was farthest
    ahead, the speed of the ankle above the ground falls below `STRIKE_SHARE` of the walking speed,
    that of the pelvis above the ground; it leaves when, before it was farthest behind, that of the
    ball rises above `OFF_SHARE` of it. Belts may so differ from each other, change their speed, or
    stand still, and the platform may move.
    """
    time, back, events = motion.time, -motion.time[::-1], []
    pelvis = butterworth(motion.pelvis, time, TURN_CUTOFF_HZ, "zero_phase")
    for side, ankle, ball in zip(SIDES, motion.ankles.T, motion.balls.T, strict=True):
        ahead = _turns(time, ankle - motion.pelvis)
        behind = _turns(time, motion.pelvis - ball)
        ankle_speed, ball_speed = (
            butterworth(place, time, SPEED_CUTOFF_HZ, "zero_phase").velocity
            for place in (ankle, ball)
        )
        known = np.isfinite(ball_speed + pelvis.velocity)
        stances = [(a, b) for a, b in _stances(ahead, behind) if known[a:b].all()]
        if not stances:
            continue
        middle, ground, walking = _ground(time, stances, ball_speed, pelvis.velocity)
        ground, walking = (np.interp(time, middle, values) for values in (ground, walking))
        strike = ankle_speed - ground - STRIKE_SHARE * walking
        off = ball_speed - ground - OFF_SHARE * walking
        strikes = (_falls_through(time, strike, k) for k in ahead)
        offs = (_falls_through(back, off[::-1], len(time) - 1 - k) for k in behind)
        events += [Event(t, "foot_strike", side) for t in strikes if t is not None]
        events += [Event(-t, "foot_off", side) for t in offs if t is not None]
    return in_order(events)


def _turns(time: Array, distance: Array) -> list[int]:
    """Find the frames in which a distance (T,) is largest; in a gap nothing is found."""
    filtered = low_pass(distance, time, TURN_CUTOFF_HZ, "zero_phase")
    apart = max(1, round(MIN_STRIDE_S / np.median(np.diff(time))))
    frames: list[int] = []
    for start, stop in stretches(np.isfinite(filtered)):
        peaks, _ = find_peaks(filtered[start:stop], distance=apart, prominence=MIN_EXCURSION_M)
        frames += [int(start + peak) for peak in peaks]
    return frames


def _stances(ahead: list[int], behind: list[int]) -> list[tuple[int, int]]:
    """Pair each frame in which a foot is farthest ahead with the next in which it is behind."""
    stops = np.searchsorted(behind, ahead, side="right")
    pairs = [(a, behind[k]) for a, k in zip(ahead, stops, strict=True) if k < len(behind)]
    following = [*ahead[1:], np.inf]
    return [(a, b) for (a, b), after in zip(pairs, following, strict=False) if b < after]


def _ground(
    time: Array, stances: list[tuple[int, int]], ball_speed: Array, pelvis_speed: Array
) -> tuple[Array, Array, Array]:
    """Give time, speed of the ground and walking speed in every stance, (S,) each [s], [m/s]."""
    middle, ground, walking = [], [], []
    for start, stop in stances:
        first, last = (round(start + share * (stop - start)) for share in MID_STANCE)
        speed = median_of(ball_speed[first : last + 1])
        middle.append((time[first] + time[last]) / 2)
        ground.append(speed)
        walking.append(float(np.mean(pelvis_speed[start:stop])) - speed)
    return np.array(middle), np.array(ground), np.array(walking)


def _falls_through(time: Array, value: Array, frame: int) -> float | None:
    """Give when a value first falls to zero from a frame on; None if not within a stride."""
    after = value[
        frame : frame + 1 + int(np.searchsorted(time, time[frame] + MIN_STRIDE_S) - frame)
    ]
    below = np.flatnonzero(~(after > 0))
    if not len(below) or not np.isfinite(after[below[0]]):
        return None
    if below[0] == 0:
        return float(time[frame])
    k = frame + int(below[0]) - 1
    return float(time[k] + (time[k + 1] - time[k]) * value[k] / (value[k] - value[k + 1]))
