"""The treadmill: its mechanical properties, and how it moves in a trial."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from compensation.signals import MachineLimits
from hbm.spatial import Array
from pipeline.virtual_lab.faults import MachineFaults
from pipeline.virtual_lab.machine.platform import PlatformMotion
from pipeline.virtual_lab.trajectories import smooth_step


@dataclass(frozen=True, slots=True)
class Assembly:
    """A belt with its frame, rollers and motor, carried by the load cells of one plate.

    Attributes
    ----------
    mass
        [kg].
    center
        Centre of mass in the platform frame, (3,) [m].
    tensor
        Moment of inertia about the centre of mass, platform axes, (3, 3) [kg·m²].
    """

    mass: float
    center: tuple[float, float, float]
    tensor: tuple[tuple[float, ...], ...]

    def weighing(self, mass: float) -> "Assembly":
        """Give an assembly of another mass [kg], distributed as this one's."""
        x, y, z = (mass / self.mass * np.array(self.tensor)).tolist()
        return Assembly(mass, self.center, (tuple(x), tuple(y), tuple(z)))


LEFT_ASSEMBLY: Final = Assembly(
    150.0, (0.34, 0.27, -0.12), ((5.2, 0.3, -0.6), (0.3, 46.0, 0.2), (-0.6, 0.2, 47.0))
)
RIGHT_ASSEMBLY: Final = Assembly(
    150.0, (0.31, -0.26, -0.13), ((5.0, -0.4, 0.5), (-0.4, 45.0, -0.2), (0.5, -0.2, 46.0))
)
"""150 kg each is what the thesis states. Centres and tensors are assumed: the motor and the driving
roller are at the front, and the tensors are about those of a box of 1.9 m by 0.6 m by 0.2 m with
small products of inertia, so that no axis of the platform is a principal axis."""


@dataclass(frozen=True, slots=True)
class Machine:
    """Mechanical properties of the treadmill.

    Attributes
    ----------
    assemblies
        Belt assemblies of the left and the right plate.
    pivot_m
        A point of the pitch axis with the platform in neutral, (3,) [m]; its height is assumed.
    limits
        Ranges and speeds that the platform's actuators do not exceed, whatever the command.
    sway_hz, pitch_hz
        Bandwidths of the actuators, which respond as critically damped second-order systems. At
        7 Hz a step of 5 cm reaches its 0.3 m/s with the 5 m/s² that `compensation.MachineLimits`
        assumes; the pitch bandwidth is assumed.
    servo_hz
        Bandwidth of the belts' speed control, critically damped; assumed.
    belt_hz, belt_damping
        Natural frequency and damping ratio of the second-order response of a plate's pitch moment
        to belt acceleration (Hnat and van den Bogert 2014); values assumed.
    belt_moment_kg_m
        Pitch moment per belt acceleration in the steady state [N·m per m/s²]; assumed.
    """

    assemblies: tuple[Assembly, Assembly] = (LEFT_ASSEMBLY, RIGHT_ASSEMBLY)
    pivot_m: tuple[float, float, float] = (0.0, 0.0, -0.25)
    limits: MachineLimits = field(default_factory=MachineLimits)
    sway_hz: float = 7.0
    pitch_hz: float = 3.0
    servo_hz: float = 10.0
    belt_hz: float = 9.0
    belt_damping: float = 0.4
    belt_moment_kg_m: float = 4.0


def make_machine(faults: MachineFaults) -> Machine:
    """Give the treadmill whose mechanical properties a setting states."""
    return Machine(
        assemblies=(
            LEFT_ASSEMBLY.weighing(faults.assembly_kg),
            RIGHT_ASSEMBLY.weighing(faults.assembly_kg),
        ),
        sway_hz=faults.sway_hz,
        pitch_hz=faults.pitch_hz,
    )


@dataclass(frozen=True, slots=True)
class BeltRamp:
    """Belt speed that rises smoothly from rest and then stays constant.

    Attributes
    ----------
    speed_mps
        Final speed [m/s].
    start, ramp
        When the belt starts, and how long it takes to reach its final speed [s].
    """

    speed_mps: float
    start: float
    ramp: float

    def speed(self, time: Array) -> Array:
        """Give the speed, (T,) [m/s]."""
        return self.speed_mps * smooth_step((time - self.start) / self.ramp)

    def travelled(self, time: Array) -> Array:
        """Give the distance that the belt has travelled, the integral of its speed, (T,) [m]."""
        since = time - self.start
        x = np.clip(since / self.ramp, 0.0, 1.0)
        ramping = self.ramp * (x**6 - 3 * x**5 + 2.5 * x**4)
        return np.asarray(self.speed_mps * (ramping + np.maximum(since - self.ramp, 0.0)))


@dataclass(frozen=True, slots=True)
class TreadmillMotion:
    """How the treadmill moves in a trial, sample by sample.

    Attributes
    ----------
    time
        (N,) [s], at 1000 Hz in recordings with a person.
    platform
        The platform's true motion at these times.
    belt
        Commanded speed of both belts, (N,) [m/s].
    onsets
        When perturbations start, (P,) [s].
    """

    time: Array
    platform: PlatformMotion
    belt: Array
    onsets: Array

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]."""
        return round(1 / float(self.time[1] - self.time[0]), 6)
