"""What the treadmill itself puts on its load cells.

The load cells of a plate carry a belt assembly. What they measure is what the person puts on the
plate, and the assembly's own inertia and changing weight, in the platform's moving frame.
"""

from typing import Final

import numpy as np

from hbm.spatial import GRAVITY_MPS2, Array, skew
from pipeline.virtual_lab.machine.platform import felt_by_terms
from pipeline.virtual_lab.machine.treadmill import Assembly

LEFTWARD: Final = np.array([0.0, 1.0, 0.0])
"""Direction of the pitch axis in the platform frame."""


def inertial_wrench(assembly: Assembly, pivot: Array) -> Array:
    """Give what the load cells of a rigid platform measure of their own belt assembly.

    Parameters
    ----------
    assembly
        On the cells.
    pivot
        A point of the pitch axis in the platform frame, (3,) [m].

    Returns
    -------
    Array
        By `motion_terms`, tared at rest in neutral, in the platform frame about its origin, with
        the sign of an action on a person standing there, (6, 5) [N, N·m per term].
    """
    force = assembly.mass * felt_by_terms(np.array(assembly.center), pivot)
    moment = skew(assembly.center) @ force
    column = np.array(assembly.tensor) @ LEFTWARD
    moment[:, 1] += column
    moment[:, 2] += np.cross(LEFTWARD, column)
    return np.vstack([force, moment])


def weight_of(assembly: Assembly) -> Array:
    """Give what the cells of an assembly carry at rest in neutral, about the origin, (6,)."""
    force = np.array([0.0, 0.0, assembly.mass * GRAVITY_MPS2])
    return np.concatenate([force, np.cross(assembly.center, force)])
