"""When a foot carries weight in its gait cycle, and where along the sole."""

from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.trajectories import smooth_step

STANCE: Final = 0.605  # share of the gait cycle from initial contact to foot off
LANDING: Final = 0.97, 1.0  # phases over which the floor takes hold of a foot
LEAVING: Final = 0.565, 0.615  # phases over which it lets go
ROLL_OVER: Final = (  # share of the stance phase, of the sole from heel to toe tip
    (0.0, 0.08, 0.20, 0.50, 0.80, 0.92, 1.0),
    (0.22, 0.30, 0.44, 0.63, 0.81, 0.90, 0.95),
)

GIVING_DEG: Final = 2.0, 12.0  # pitch of a foot from where to where its heel or ball become loose
LOOSE: Final = 0.05  # what is left of their hold then
SWINGING: Final = 0.3  # what is left of a swinging foot's
ARRIVING: Final = 0.90, 1.0  # phases over which it becomes firm again


def loading(phase: Array) -> Array:
    """Give the share of the weight on a foot at phases of its own gait cycle, (T,)."""
    overlap = STANCE - 0.5
    cycle = phase % 1
    return np.asarray(smooth_step(cycle / overlap) - smooth_step((cycle - 0.5) / overlap))


def hold(phase: Array) -> Array:
    """Give how firmly the floor holds a foot at phases of its own gait cycle, (T,), 0 to 1."""
    cycle = phase % 1
    gone, back = (smooth_step((cycle - a) / (b - a)) for a, b in (LEAVING, LANDING))
    return np.asarray(1 - gone + back)


def roll_over(phase: Array) -> Array:
    """Give the place of the centre of pressure, from heel (0) to toe tip (1), (T,).

    Notes
    -----
    Passes quickly from the heel, slowly under the mid-foot, and stays under the metatarsal heads
    before push-off (Han et al. 1999, Gait Posture 10:248).
    """
    return np.interp(np.clip((phase % 1) / STANCE, 0, 1), *ROLL_OVER)


def firmness_of(pitch: Array, phase: Array) -> Array:
    """Give how firmly a sole's heel, ball inside and outside, and ankle keep to their path, (T, 4).

    The heel gives way where only the ball is on the floor, and the ball where only the heel is; a
    swinging foot gives way altogether, so that a leg that is too short need not jerk the body.
    """
    low, high = np.radians(GIVING_DEG)
    heel, ball = (
        1 - (1 - LOOSE) * smooth_step((angle - low) / (high - low)) for angle in (pitch, -pitch)
    )
    cycle = phase % 1
    gone, back = (smooth_step((cycle - a) / (b - a)) for a, b in (LEAVING, ARRIVING))
    firm = 1 - (1 - SWINGING) * (gone - back)
    return np.asarray(firm[:, None] * np.stack([heel, ball, ball, np.minimum(heel, ball)], axis=1))
