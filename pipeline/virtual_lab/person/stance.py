"""The stance phase: when a foot carries weight in its gait cycle, and where along the sole."""

from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.trajectories import smooth_step

STANCE: Final = 0.605
"""Stance phase as a share of the gait cycle, from initial contact to foot off, at 1.3 m/s."""
LANDING: Final = 0.97, 1.0
LEAVING: Final = 0.565, 0.615
"""Phases of the gait cycle between which the floor gradually begins to hold a foot, and releases it
again: about initial contact and foot off; assumed."""
ROLL_OVER: Final = (
    (0.0, 0.08, 0.20, 0.50, 0.80, 0.92, 1.0),
    (0.22, 0.30, 0.44, 0.63, 0.81, 0.90, 0.95),
)
"""Centre of pressure: share of the stance phase, and place between heel (0) and toe tip (1). It
passes quickly from the heel, slowly under the mid-foot, and stays under the metatarsal heads before
push-off (Han et al. 1999, Gait Posture 10:248)."""

RELEASING_DEG: Final = 2.0, 12.0
"""Pitch of a foot at which the end that leaves the floor begins to be free, and at which it is;
assumed."""
MIN_END_WEIGHT: Final = 0.05
"""Weight in the leg's inverse kinematics of an end of the sole that is free; small but positive,
so that the foot's pose stays determined."""
SWING_WEIGHT: Final = 0.3
"""Weight of a swinging foot's sole; chosen, so that a leg that is too short does not jerk the
body."""
ARRIVING: Final = 0.90, 1.0
"""Phases of the gait cycle between which a swinging foot regains its full weight; assumed."""


def load_share(phase: Array) -> Array:
    """Give the share of body weight on a foot at phases of its own gait cycle, (T,)."""
    overlap = STANCE - 0.5
    cycle = phase % 1
    return np.asarray(smooth_step(cycle / overlap) - smooth_step((cycle - 0.5) / overlap))


def floor_contact(phase: Array) -> Array:
    """Give how firmly the floor holds a foot at phases of its own gait cycle, (T,), 0 to 1."""
    cycle = phase % 1
    released, landed = (smooth_step((cycle - a) / (b - a)) for a, b in (LEAVING, LANDING))
    return np.asarray(1 - released + landed)


def roll_over(phase: Array) -> Array:
    """Give the place of the centre of pressure between heel (0) and toe tip (1), (T,)."""
    return np.interp(np.clip((phase % 1) / STANCE, 0, 1), *ROLL_OVER)


def sole_weights(pitch: Array, phase: Array) -> Array:
    """Give how closely a sole's points follow their path: weights of the leg's inverse kinematics.

    Parameters
    ----------
    pitch
        How far the foot points down, (T,) [rad].
    phase
        Phase of the foot's own gait cycle, (T,).

    Returns
    -------
    Array
        Weights of heel, inner and outer ball, and ankle, (T, 4). The heel is free where only the
        ball is on the floor, and the ball where only the heel is; a swinging foot has little weight
        altogether.
    """
    low, high = np.radians(RELEASING_DEG)
    heel, ball = (
        1 - (1 - MIN_END_WEIGHT) * smooth_step((angle - low) / (high - low))
        for angle in (pitch, -pitch)
    )
    cycle = phase % 1
    released, arrived = (smooth_step((cycle - a) / (b - a)) for a, b in (LEAVING, ARRIVING))
    whole = 1 - (1 - SWING_WEIGHT) * (released - arrived)
    ends = np.stack([heel, ball, ball, np.minimum(heel, ball)], axis=1)
    return np.asarray(whole[:, None] * ends)
