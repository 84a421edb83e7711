"""What the treadmill itself puts on its load cells.

The load cells of a plate carry a belt assembly. What they measure is what the person puts on the
plate, and the assembly's own inertia and changing weight, in the platform's moving frame.
"""

from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.spatial import GRAVITY_MPS2, Array, skew
from pipeline.virtual_lab.machine.platform import felt_by_terms
from pipeline.virtual_lab.machine.treadmill import Assembly, Machine, TreadmillMotion

LEFTWARD: Final = np.array([0.0, 1.0, 0.0])
"""Direction of the pitch axis in the platform frame."""
ROLLER_CIRCUMFERENCE_M: Final = 0.3
"""Belt travel per revolution of a roller; assumed, a roller of about 10 cm diameter."""
ROLLER_PLACE_M: Final = (0.9, 0.25, -0.1)
"""Middle of the left belt's front roller in the platform frame: at the front edge of the plate, one
roller radius and the belt's support below its surface."""


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


def belt_moment(machine: Machine, belt_acceleration: Array, rate_hz: float) -> Array:
    """Give the pitch moment that a motor leaves in its plate when the belt accelerates.

    Parameters
    ----------
    machine
        The response of moment to acceleration.
    belt_acceleration
        (N,) [m/s²].
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    Array
        About the lab's left axis, (N,) [N·m].

    Notes
    -----
    A second-order response, as Hnat and van den Bogert (2014) found it.
    """
    omega = 2 * np.pi * machine.belt_hz
    numerator = np.array([omega**2 * machine.belt_moment_kg_m])
    denominator = np.array([1, 2 * machine.belt_damping * omega, omega**2])
    b, a, _ = cont2discrete((numerator, denominator), 1 / rate_hz, method="bilinear")
    return np.asarray(lfilter(b.ravel(), a, belt_acceleration))


def roller_wrench(
    speed: Array, rate_hz: float, unbalance_kg_per_m: float, start_rad: float, side: int = 1
) -> Array:
    """Give the wrench of an unbalanced front roller on its plate.

    Parameters
    ----------
    speed
        Belt speed, (N,) [m/s].
    rate_hz
        Sampling rate [Hz].
    unbalance_kg_per_m
        Force of the unbalanced roller by the square of the belt speed [N per (m/s)²].
    start_rad
        The roller's angle at the first sample [rad].
    side
        1 of the left belt, -1 of the right.

    Returns
    -------
    Array
        In the platform frame about its origin, (N, 6) [N, N·m].
    """
    angle = start_rad + 2 * np.pi * np.cumsum(speed) / rate_hz / ROLLER_CIRCUMFERENCE_M
    pull = unbalance_kg_per_m * speed**2
    x, y, z = ROLLER_PLACE_M
    fore, up = pull * np.cos(angle), pull * np.sin(angle)
    return np.column_stack([fore, 0 * pull, up, side * y * up, z * fore - x * up, -side * y * fore])


def drive_wrenches(
    machine: Machine, motion: TreadmillMotion, unbalance_kg_per_m: float, rate_hz: float
) -> tuple[Array, Array]:
    """Give what belts, rollers and motors add to what each plate has to carry.

    Parameters
    ----------
    machine
        The response to belt acceleration.
    motion
        Of the belts, and the rollers' angles.
    unbalance_kg_per_m
        As of `roller_wrench`.
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    tuple of Array
        Left and right plate, in the platform frame about its origin, (N, 6) each [N, N·m].
    """
    pitch_moment = belt_moment(machine, np.gradient(motion.belt, 1 / rate_hz), rate_hz)
    wrenches = [
        roller_wrench(motion.belt, rate_hz, unbalance_kg_per_m, start, side)
        for start, side in zip(motion.roller_start_rad, (1, -1), strict=True)
    ]
    for wrench in wrenches:
        wrench[:, 4] += pitch_moment
    return wrenches[0], wrenches[1]
