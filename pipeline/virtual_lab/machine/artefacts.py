"""What the treadmill itself puts on its load cells.

The load cells of a plate carry a belt assembly. What they measure is what the person puts on the
plate, and the assembly's own inertia and changing weight, in the platform's moving frame.
"""

from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ
from pipeline.virtual_lab.machine.platform import PlatformMotion, specific_force
from pipeline.virtual_lab.machine.treadmill import Assembly, Machine, TreadmillMotion

LEFTWARD: Final = np.array([0.0, 1.0, 0.0])
"""Direction of the pitch axis in the platform frame."""
ROLLER_CIRCUMFERENCE_M: Final = 0.3
"""Belt travel per revolution of a roller; assumed, a roller of about 10 cm diameter."""
ROLLER_PLACE_M: Final = (0.9, 0.25, -0.1)
"""Middle of the left belt's front roller in the platform frame: at the front edge of the plate, one
roller radius and the belt's support below its surface."""


def assembly_wrench(motion: PlatformMotion, assembly: Assembly) -> Array:
    """Give what the load cells measure of their own belt assembly, tared at rest in neutral.

    Parameters
    ----------
    motion
        Of the platform.
    assembly
        On the cells.

    Returns
    -------
    Array
        In the platform frame about its origin, with the sign of an action on a person standing
        there, (N, 6) [N, N·m].
    """
    center, tensor = np.array(assembly.center), np.array(assembly.tensor)
    force = assembly.mass * specific_force(motion, center)
    force[:, 2] -= assembly.mass * GRAVITY_MPS2
    column = tensor @ LEFTWARD
    _, rate, acceleration = motion.pitch
    moment = acceleration[:, None] * column + (rate**2)[:, None] * np.cross(LEFTWARD, column)
    return np.hstack([force, np.cross(center, force) + moment])


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
    speed: Array, rate_hz: float, unbalance_kg_per_m: float, start_rad: float
) -> Array:
    """Give the wrench of an unbalanced front roller on the left plate.

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

    Returns
    -------
    Array
        In the platform frame about its origin, (N, 6) [N, N·m].
    """
    angle = start_rad + 2 * np.pi * np.cumsum(speed) / rate_hz / ROLLER_CIRCUMFERENCE_M
    pull = unbalance_kg_per_m * speed**2
    force = np.column_stack([pull * np.cos(angle), 0 * pull, pull * np.sin(angle)])
    return np.hstack([force, np.cross(ROLLER_PLACE_M, force)])


def treadmill_wrenches(machine: Machine, motion: TreadmillMotion) -> list[Array]:
    """Give what each plate's load cells carry of the treadmill itself.

    Parameters
    ----------
    machine
        Belt assemblies, and the response to belt acceleration.
    motion
        Of platform and belts, at `ANALOG_HZ`.

    Returns
    -------
    list of Array
        Left and right plate, in the platform frame about its origin, (N, 6) each [N, N·m].
    """
    pitch_moment = belt_moment(machine, np.gradient(motion.belt, 1 / ANALOG_HZ), ANALOG_HZ)
    wrenches = [assembly_wrench(motion.platform, assembly) for assembly in machine.assemblies]
    for wrench in wrenches:
        wrench[:, 4] += pitch_moment
    return wrenches
