"""Under which foot the pressure on a plate is, frame by frame."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation import center_of_pressure
from hbm.spatial import Array, Mask

MIN_DISTANCE_DIFFERENCE_M: Final = 0.1
"""How much nearer a foot must be: one that swings may pass a shoe's length from the pressure."""
MAX_PRESSURE_DISTANCE_M: Final = 0.2
"""Farther from the middle of a foot, ankle to toes, there is no pressure under it."""
MAX_HEIGHT_DIFFERENCE_M: Final = 0.03
"""Two feet that both stand are level; one that swings past is not."""


@dataclass(frozen=True, slots=True)
class Pressure:
    """The pressure on one plate beside the feet.

    Attributes
    ----------
    loaded
        Whether there is a centre of pressure, (T,).
    distance
        From it to the middle of the left and the right foot, (T, 2) [m]; 0 without load.
    nearer
        The nearer foot, 0 left and 1 right, (T,).
    decided
        Whether that foot is nearer by so much that the load is its own, (T,).
    uncertain
        Whether the load lies under neither foot, or between two that both stand, (T,).
    """

    loaded: Mask
    distance: Array
    nearer: Array
    decided: Mask
    uncertain: Mask


def pressure_beside(wrench: Array, feet: Array, threshold_n: float) -> Pressure:
    """Find the pressure on a plate beside the feet.

    Parameters
    ----------
    wrench
        Of the plate, lab axes about the lab origin, (T, 6) [N, N·m].
    feet
        Middle of the left and the right foot in the lab, (T, 2, 3) [m].
    threshold_n
        Vertical force above which the plate is loaded [N].

    Returns
    -------
    Pressure
        Frames in which wrench or feet are unknown are not loaded.
    """
    surface = feet[..., 2].min(axis=1)
    pressure = center_of_pressure(wrench, threshold_n, surface)[:, :2]
    apart = feet[..., :2] - pressure[:, None]
    distance = np.sqrt(np.square(apart).sum(axis=-1))
    loaded: Mask = np.isfinite(distance).all(axis=1)
    distance = np.where(loaded[:, None], distance, 0.0)
    left, right = distance.T
    undecided = np.abs(left - right) < MIN_DISTANCE_DIFFERENCE_M
    level = np.abs(feet[:, 1, 2] - feet[:, 0, 2]) < MAX_HEIGHT_DIFFERENCE_M
    under_none = np.minimum(left, right) > MAX_PRESSURE_DISTANCE_M
    return Pressure(
        loaded,
        distance,
        (right < left).astype(int),
        loaded & ~undecided,
        loaded & (under_none | (undecided & level)),
    )
