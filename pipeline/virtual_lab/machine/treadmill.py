"""The treadmill: a platform that sways and pitches, with belt assemblies on its plates.

The load cells of a plate carry a belt assembly. What they measure is what the person puts on the
plate, and the assembly's own inertia and changing weight, in the platform's moving frame. All
formulas are those of a rigid body with one rotation axis, written out.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from compensation import Limits, PlatformPose, commanded_pose
from hbm.spatial import GRAVITY_MPS2, Array

LEFTWARD: Final = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class Assembly:
    """A belt assembly on its load cells, in the platform frame.

    Attributes
    ----------
    mass
        [kg].
    center
        Centre of mass, (3,) [m].
    tensor
        Moment of inertia about it, (3, 3) [kg·m²].
    """

    mass: float
    center: tuple[float, float, float]
    tensor: tuple[tuple[float, float, float], ...]


# The motor and its drum sit at the front of a belt, so the centres of mass do too.
LEFT_ASSEMBLY: Final = Assembly(
    150.0, (0.34, 0.27, -0.12), ((5.2, 0.3, -0.6), (0.3, 46.0, 0.2), (-0.6, 0.2, 47.0))
)
RIGHT_ASSEMBLY: Final = Assembly(
    150.0, (0.31, -0.26, -0.13), ((5.0, -0.4, 0.5), (-0.4, 45.0, -0.2), (0.5, -0.2, 46.0))
)


@dataclass(frozen=True, slots=True)
class Machine:
    """What the treadmill is made of.

    Attributes
    ----------
    assemblies
        Of the left and the right plate.
    pivot_m
        A point of the pitch axis with the platform in neutral, (3,) [m].
    limits
        Ranges and speeds that the platform's actuators do not exceed, whatever they are told.
    sway_hz, pitch_hz
        Bandwidth of the actuators: they follow as critically damped second-order systems. At 7 Hz
        a move of 5 cm reaches its 0.3 m/s, with the 5 m/s² that `compensation.Limits` assumes.
    servo_hz
        Bandwidth of the belts' speed control, critically damped.
    belt_hz, belt_damping
        Response of the belts' pitch moment to belt acceleration, a second-order system.
    belt_moment_kg_m
        Pitch moment per belt acceleration in the steady state [N·m per m/s²].
    """

    assemblies: tuple[Assembly, Assembly] = (LEFT_ASSEMBLY, RIGHT_ASSEMBLY)
    pivot_m: tuple[float, float, float] = (0.0, 0.0, -0.25)
    limits: Limits = field(default_factory=Limits)
    sway_hz: float = 7.0
    pitch_hz: float = 3.0
    servo_hz: float = 10.0
    belt_hz: float = 9.0
    belt_damping: float = 0.4
    belt_moment_kg_m: float = 4.0


@dataclass(frozen=True, slots=True)
class PlatformMotion:
    """How the platform moves; rows of ``sway`` and ``pitch`` are value, velocity, acceleration.

    Attributes
    ----------
    sway
        Along the lab's left axis, (3, N) [m, m/s, m/s²].
    pitch
        About the lab's left axis, positive lowers the front, (3, N) [rad, rad/s, rad/s²].
    pivot
        Of the pitch axis in neutral, (3,) [m].
    """

    sway: Array
    pitch: Array
    pivot: Array

    @property
    def pose(self) -> PlatformPose:
        """The platform's true pose."""
        return commanded_pose(self.sway[0], self.pitch[0], self.pivot)


def move_platform(machine: Machine, sway: Array, pitch: Array, rate_hz: float) -> PlatformMotion:
    """Let the actuators follow their commands as far as they can, starting at rest.

    Parameters
    ----------
    machine
        The machine.
    sway, pitch
        Commanded, (N,) [m] and [rad].
    rate_hz
        Of the commands [Hz].

    Returns
    -------
    PlatformMotion
        Positions with their exact derivatives.
    """
    most = machine.limits
    angle, turning = np.radians([most.pitch_deg, most.pitch_deg_per_s])
    return PlatformMotion(
        _follow(_possible(sway, most.sway_m, most.sway_m_per_s, rate_hz), machine.sway_hz, rate_hz),
        _follow(_possible(pitch, angle, turning, rate_hz), machine.pitch_hz, rate_hz),
        np.array(machine.pivot_m),
    )


def drive_belt(machine: Machine, command: Array, rate_hz: float) -> Array:
    """Give the speed of a belt that is told a speed, (N,) [m/s], starting at the first command."""
    return np.asarray(_follow(command, machine.servo_hz, rate_hz)[0])


def specific_force(motion: PlatformMotion, point: Array) -> Array:
    """Give acceleration minus gravity of a point of the platform, in the platform's axes.

    Parameters
    ----------
    motion
        Of the platform.
    point
        In the platform frame, (3,) [m].

    Returns
    -------
    Array
        What an ideal accelerometer there reads, (N, 3) [m/s²].

    Notes
    -----
    With ``d`` from the pitch axis to the point: ``φ̈ ŷ×d − φ̇² (d − (d·ŷ) ŷ) + ÿ ŷ − Rᵀ g``.
    """
    (_, _, sway_acceleration), (angle, rate, acceleration) = motion.sway, motion.pitch
    d = np.asarray(point, float) - motion.pivot
    x = acceleration * d[2] - rate**2 * d[0] - GRAVITY_MPS2 * np.sin(angle)
    z = -acceleration * d[0] - rate**2 * d[2] + GRAVITY_MPS2 * np.cos(angle)
    return np.column_stack([x, sway_acceleration, z])


def assembly_wrench(motion: PlatformMotion, assembly: Assembly) -> Array:
    """Give what the cells measure of their own belt assembly, tared in neutral at rest.

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
    turning = acceleration[:, None] * column + (rate**2)[:, None] * np.cross(LEFTWARD, column)
    return np.hstack([force, np.cross(center, force) + turning])


def belt_moment(machine: Machine, belt_acceleration: Array, rate_hz: float) -> Array:
    """Give the pitch moment that a motor leaves in its plate when the belt accelerates.

    Parameters
    ----------
    machine
        The machine.
    belt_acceleration
        (N,) [m/s²].
    rate_hz
        Of the samples [Hz].

    Returns
    -------
    Array
        About the lab's left axis, (N,) [N·m].

    Notes
    -----
    A second-order response, as Hnat and van den Bogert (2014) found it.
    """
    omega = 2 * np.pi * machine.belt_hz
    above = np.array([omega**2 * machine.belt_moment_kg_m])
    below = np.array([1, 2 * machine.belt_damping * omega, omega**2])
    b, a, _ = cont2discrete((above, below), 1 / rate_hz, method="bilinear")
    return np.asarray(lfilter(b.ravel(), a, belt_acceleration))


def _possible(command: Array, most: float, fastest: float, rate_hz: float) -> Array:
    """Keep a command within a range and a speed.

    A critically damped follower has a positive impulse response of unit area: it exceeds neither.
    """
    within = np.clip(command, -most, most)
    step = fastest / rate_hz
    if np.abs(np.diff(within)).max(initial=0.0) <= step:
        return within
    place, places = float(within[0]), []
    for wanted in within.tolist():
        place += min(max(wanted - place, -step), step)
        places.append(place)
    return np.array(places)


def _follow(command: Array, bandwidth_hz: float, rate_hz: float) -> Array:
    """Follow a command as a critically damped second-order system, straight between samples."""
    omega = 2 * np.pi * bandwidth_hz
    rest = float(command[0])
    rows = []
    for derivative in range(3):
        above = np.array([omega**2, *[0.0] * derivative])
        below = np.array([1, 2 * omega, omega**2])
        b, a, _ = cont2discrete((above, below), 1 / rate_hz, method="foh")
        rows.append(lfilter(b.ravel(), a, command - rest))
    rows[0] += rest
    return np.stack(rows)
