"""Which foot a force plate carried when."""

from collections.abc import Sequence

import numpy as np

from hbm.spatial import Array, Mask

FEET = ("left_foot", "right_foot")


def share_between_feet(
    wrenches: Sequence[Array], feet: Array, threshold_n: float
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

    Returns
    -------
    shared
        "left_foot" and "right_foot" -> wrench, (T, 6); their sum is the plates' sum at any time.
    ambiguous
        Frames in which one plate alone is loaded while its centre of pressure lies between two
        feet close together, so that the split between the joints is uncertain, (T,).

    Notes
    -----
    A stretch of contact belongs to the foot nearer to its centre of pressure, averaged over the
    stretch by load; an unloaded stretch is halved between its neighbours. Residuals do not depend
    on this choice, joint moments do.
    """
    frames = len(feet)
    shared = {foot: np.zeros((frames, 6)) for foot in FEET}
    ambiguous = np.zeros(frames, bool)
    for wrench in wrenches:
        owner, unsure = _owners(wrench, feet, threshold_n)
        ambiguous |= unsure
        for k, foot in enumerate(FEET):
            shared[foot] += np.where((owner == k)[:, None], wrench, 0.0)
    return shared, ambiguous


def center_of_pressure(wrench: Array, height: Array, threshold_n: float) -> Array:
    """Find where a wrench's line of action meets a level.

    Parameters
    ----------
    wrench
        In lab axes about the lab origin, (T, 6) [N, N·m].
    height
        The level, (T,) or a number [m].
    threshold_n
        Below this vertical force there is none [N].

    Returns
    -------
    Array
        x and y of the centre of pressure, (T, 2) [m]; NaN where the plate is not loaded.
    """
    fx, fy, fz, mx, my, _ = np.asarray(wrench, float).T
    loaded = np.abs(fz) > threshold_n
    vertical = np.where(loaded, fz, np.nan)
    return np.column_stack([(height * fx - my) / vertical, (height * fy + mx) / vertical])


def _owners(wrench: Array, feet: Array, threshold_n: float) -> tuple[Array, Mask]:
    """Find the foot (0 left, 1 right) that each frame of a plate belongs to."""
    frames = len(wrench)
    at = center_of_pressure(wrench, feet[..., 2].min(axis=1), threshold_n)
    distance = np.linalg.norm(feet[..., :2] - at[:, None], axis=-1)
    loaded = np.isfinite(distance).all(axis=1)
    edges = np.flatnonzero(np.diff(loaded.astype(int)))
    owner = np.full(frames, -1)
    unsure = np.zeros(frames, bool)
    for start, stop in zip(np.r_[0, edges + 1], np.r_[edges + 1, frames], strict=True):
        if not loaded[start]:
            continue
        load = wrench[start:stop, 2]
        left, right = np.average(distance[start:stop], axis=0, weights=load)
        owner[start:stop] = int(right < left)
        near, far = np.sort(distance[start:stop], axis=1).T
        unsure[start:stop] = (far < 0.15) & (near > 0.05)
    known = np.flatnonzero(owner >= 0)
    if not len(known):
        return np.zeros(frames, int), unsure
    nearest = known[np.searchsorted((known[1:] + known[:-1]) / 2, np.arange(frames))]
    return owner[nearest], unsure
