"""Which foot a force plate carried when."""

from collections.abc import Sequence

import numpy as np

from compensation import center_of_pressure
from hbm.spatial import Array, Mask

FEET = ("left_foot", "right_foot")
CLEARLY_M = 0.1
"""How much nearer a foot must be; a swinging foot may pass a shoe's length from the pressure."""
REACH_M = 0.2
"""Farther from the middle of a foot, ankle to toes, there is no pressure under it."""
SAME_HEIGHT_M = 0.03
"""Two feet that both stand are level; one that swings past is not."""


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
        Per plate, the wrench that tells where the feet stood, if not ``wrenches``: that of the
        subject alone where these hold a moving platform's inertia too.

    Returns
    -------
    shared
        "left_foot" and "right_foot" -> wrench, (T, 6); their sum is the plates' sum at any time.
    ambiguous
        Frames in which a plate is loaded while its centre of pressure lies under neither foot, or
        between two feet that both stand, so that the split between the joints is uncertain, (T,).

    Notes
    -----
    A loaded frame belongs to the foot whose middle is nearer to the centre of pressure by
    ``CLEARLY_M`` at least. What lies between two such frames, unloaded or undecided, is halved
    between them. Residuals do not depend on this choice, joint moments do.
    """
    shared = {foot: np.zeros((len(feet), 6)) for foot in FEET}
    ambiguous = np.zeros(len(feet), bool)
    for wrench, telling in zip(wrenches, judged_by or wrenches, strict=True):
        owner, unsure = _owners(telling, feet, threshold_n)
        ambiguous |= unsure
        for k, foot in enumerate(FEET):
            shared[foot] += np.where((owner == k)[:, None], wrench, 0.0)
    return shared, ambiguous


def _owners(wrench: Array, feet: Array, threshold_n: float) -> tuple[Array, Mask]:
    """Find the foot (0 left, 1 right) that each frame of a plate belongs to, and where in doubt."""
    at = center_of_pressure(wrench, threshold_n, feet[..., 2].min(axis=1))[:, :2]
    away = np.linalg.norm(feet[..., :2] - at[:, None], axis=-1)
    loaded = np.isfinite(away).all(axis=1)
    left, right = np.where(loaded[:, None], away, 0.0).T
    nearer = (right < left).astype(int)
    undecided = np.abs(left - right) < CLEARLY_M
    standing = np.abs(np.diff(feet[..., 2], axis=1)[:, 0]) < SAME_HEIGHT_M
    unsure = loaded & ((np.minimum(left, right) > REACH_M) | (undecided & standing))
    known = np.flatnonzero(loaded & ~undecided)
    if not len(known):
        return nearer, unsure
    nearest = known[np.searchsorted((known[1:] + known[:-1]) / 2, np.arange(len(feet)))]
    return nearer[nearest], unsure
