"""Which foot stood on which plate, and when."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from compensation import center_of_pressure
from hbm.body import Body
from hbm.coordinates import MOVING
from hbm.motion import Motion
from hbm.poses import segment_frames
from hbm.spatial import Array, Mask

FEET: Final = ("left_foot", "right_foot")
MIN_DISTANCE_DIFFERENCE_M: Final = 0.1
"""How much nearer a foot must be: one that swings may pass a shoe's length from the pressure."""
MAX_PRESSURE_DISTANCE_M: Final = 0.2
"""Farther from the middle of a foot, ankle to toes, there is no pressure under it."""
MAX_HEIGHT_DIFFERENCE_M: Final = 0.03
"""Two feet that both stand are level; one that swings past is not."""


def feet_of(body: Body, motion: Motion) -> Array:
    """Give the middle of the left and right foot, ankle to toes, in the lab, (T, 2, 3) [m]."""
    _, origin = segment_frames(body, motion.q)
    ends = [
        [MOVING.index(f"{side}_{part}") for part in ("foot", "toes")] for side in ("left", "right")
    ]
    return np.asarray(origin[:, ends].mean(axis=2))


def share_between_feet(
    wrenches: Sequence[Array],
    feet: Array,
    threshold_n: float,
    *,
    judged_by: Sequence[Array] | None = None,
) -> tuple[dict[str, Array], Mask]:
    """Give each plate's wrench to the foot that stood on it.

    Parameters
    ----------
    wrenches
        Per plate, action on the subject in lab axes about the lab origin, (T, 6) [N, N·m].
    feet
        Middle of the left and the right foot in the lab, (T, 2, 3) [m].
    threshold_n
        Vertical force above which a plate is loaded [N].
    judged_by
        Per plate, the wrench whose centre of pressure decides, if not ``wrenches``: that of the
        subject alone where these contain a moving platform's inertia too.

    Returns
    -------
    by_foot
        "left_foot" and "right_foot" -> wrench, (T, 6); their sum is the plates' sum at any time.
    ambiguous
        Frames in which a plate is loaded while its centre of pressure lies under neither foot, or
        between two feet that both stand, so that the split between the joints is uncertain, (T,).

    Notes
    -----
    A loaded frame belongs to the foot whose middle is nearer to the centre of pressure by
    ``MIN_DISTANCE_DIFFERENCE_M`` at least. Of the frames between two such frames, unloaded or
    undecided, each half belongs to the nearer one's foot. Residuals do not depend on this choice,
    joint moments do.
    """
    by_foot = {foot: np.zeros((len(feet), 6)) for foot in FEET}
    ambiguous = np.zeros(len(feet), bool)
    for wrench, judged in zip(wrenches, judged_by or wrenches, strict=True):
        foot_index, uncertain = _foot_on_plate(judged, feet, threshold_n)
        ambiguous |= uncertain
        for k, foot in enumerate(FEET):
            by_foot[foot] += np.where((foot_index == k)[:, None], wrench, 0.0)
    return by_foot, ambiguous


def _foot_on_plate(wrench: Array, feet: Array, threshold_n: float) -> tuple[Array, Mask]:
    """Find the foot (0 left, 1 right) of each frame of a plate, and doubtful frames."""
    pressure = center_of_pressure(wrench, threshold_n, feet[..., 2].min(axis=1))[:, :2]
    distance = np.linalg.norm(feet[..., :2] - pressure[:, None], axis=-1)
    loaded = np.isfinite(distance).all(axis=1)
    left, right = np.where(loaded[:, None], distance, 0.0).T
    nearer = (right < left).astype(int)
    undecided = np.abs(left - right) < MIN_DISTANCE_DIFFERENCE_M
    level = np.abs(np.diff(feet[..., 2], axis=1)[:, 0]) < MAX_HEIGHT_DIFFERENCE_M
    under_none = np.minimum(left, right) > MAX_PRESSURE_DISTANCE_M
    uncertain = loaded & (under_none | (undecided & level))
    known = np.flatnonzero(loaded & ~undecided)
    if not len(known):
        return nearer, uncertain
    nearest = known[np.searchsorted((known[1:] + known[:-1]) / 2, np.arange(len(feet)))]
    return nearer[nearest], uncertain
