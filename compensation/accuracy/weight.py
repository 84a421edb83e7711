"""The wrench that a plate should measure under a known weight."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inputs import read_rate, read_table
from hbm.spatial import GRAVITY_MPS2, Array

MAX_MASS_KG: Final = 1000.0
"""Of a known weight; larger numbers are grams."""
MAX_DISTANCE_M: Final = 20.0
"""Of a marker from the lab's origin; larger numbers are millimetres."""
MAX_ACCELERATION_MPS2: Final = 50.0
"""Median of a weight on a belt: five times gravity. Raw markers and millimetres show more."""


def wrench_of_weight(
    mass_kg: float, marker: ArrayLike, rate_hz: float, center_height_m: float
) -> Array:
    """Give the wrench that a plate should measure under a weight with a marker on top.

    Parameters
    ----------
    mass_kg
        Mass of the weight [kg].
    marker
        Low-passed positions of the marker above the weight's centre, lab axes, (T, 3) [m].
    rate_hz
        Their sampling rate [Hz].
    center_height_m
        Height of the weight's centre of mass in the lab while it stands still [m]; with 0, as in
        the thesis, the centre of pressure is always below the marker.

    Returns
    -------
    Array
        Action of the plate on the weight, lab axes about the lab origin, (T, 6) [N, N·m]: force
        ``m (a - g)`` with the twice differentiated marker, through the centre of mass.

    Raises
    ------
    ValueError
        Wrong shape, fewer than 3 samples, gaps, a mass that is not positive, or positions that
        are not in metres.

    Notes
    -----
    After van de Loosdrecht (2018), II.A and D.1. The weight does not rotate, so the force goes
    through its centre of mass, which moves with the marker.

    Examples
    --------
    >>> wrench = wrench_of_weight(10.0, [[0.5, 0.1, 0.3]] * 3, 100.0, center_height_m=0.15)
    >>> print(wrench[0].round(3) + 0.0)
    [  0.     0.    98.1    9.81 -49.05   0.  ]
    """
    position, rate = read_table(marker, "marker", 3), read_rate(rate_hz)
    if len(position) < 3:
        raise ValueError(f"marker has {len(position)} samples; an acceleration needs at least 3")
    if not 0 < mass_kg < MAX_MASS_KG:
        raise ValueError(
            f"mass_kg must be a weight in kilograms up to {MAX_MASS_KG:g}, got {mass_kg}"
        )
    acceleration = np.gradient(np.gradient(position, 1 / rate, axis=0), 1 / rate, axis=0)
    fastest = float(np.median(np.linalg.norm(acceleration, axis=1)))
    if np.max(np.abs(position)) > MAX_DISTANCE_M or fastest > MAX_ACCELERATION_MPS2:
        raise ValueError(
            f"marker lies {np.max(np.abs(position)):.3g} m away and is accelerated by "
            f"{fastest:.3g} m/s²; is it in metres and low-passed?"
        )
    force = mass_kg * (acceleration + np.array([0, 0, GRAVITY_MPS2]))
    rise = position[:, 2] - position[0, 2]
    center = np.column_stack([position[:, :2], center_height_m + rise])
    return np.hstack([force, np.cross(center, force)])
