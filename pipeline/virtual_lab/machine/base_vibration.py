"""Vibration of the platform on its base.

The platform follows its commands, but its base yields elastically: people, rollers and the
platform's own inertia make it vibrate a little in all six directions. Accelerometers and plates
measure that too.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.spatial import Array
from pipeline.virtual_lab.machine.platform import PlatformMotion, specific_force
from pipeline.virtual_lab.machine.treadmill import Assembly

PLATFORM_KG: Final = 600.0
"""Moving mass: the thesis' two belt assemblies of 150 kg, and as much for the frame; assumed."""
PLATFORM_INERTIA: Final = np.array([PLATFORM_KG] * 3 + [100.0, 300.0, 350.0])
"""Inertia by direction (forward, left, up [kg], roll, pitch, yaw [kg·m²]): about those of a flat
body of 2.4 m by 1.4 m; assumed."""
PLATFORM_CENTER_M: Final = np.array([0.0, 0.0, -0.3])
"""Centre of the moving mass in the platform frame; assumed, between belts and drives."""


@dataclass(frozen=True, slots=True)
class ElasticBase:
    """How the platform's base yields, each direction by itself.

    Attributes
    ----------
    natural_hz
        Natural frequencies (forward, left, up, roll, pitch, yaw), (6,) [Hz].
    damping
        Damping ratio of all of them.
    """

    natural_hz: tuple[float, ...]
    damping: float


@dataclass(frozen=True, slots=True)
class BaseVibration:
    """Small motion of the platform on its base, in the platform's own axes.

    Attributes
    ----------
    acceleration
        Of the platform's origin, (N, 3) [m/s²].
    rotation
        Small rotation vector, (N, 3) [rad].
    angular_acceleration
        (N, 3) [rad/s²].
    """

    acceleration: Array
    rotation: Array
    angular_acceleration: Array

    def specific_force(self, motion: PlatformMotion, point: Array) -> Array:
        """Give what it adds to the specific force of a point of the platform, (N, 3) [m/s²]."""
        weight = specific_force(motion, np.zeros(3))
        return np.asarray(
            self.acceleration
            + np.cross(self.angular_acceleration, point)
            - np.cross(self.rotation, weight)
        )

    def assembly_wrench(self, motion: PlatformMotion, assembly: Assembly) -> Array:
        """Give what it adds to an assembly's wrench on its load cells, (N, 6) [N, N·m].

        In the platform frame about its origin.
        """
        center = np.array(assembly.center)
        force = assembly.mass * self.specific_force(motion, center)
        moment = np.cross(center, force) + self.angular_acceleration @ np.array(assembly.tensor)
        return np.hstack([force, moment])


def vibrate(
    base: ElasticBase | None, motion: PlatformMotion, load: Array, rate_hz: float
) -> BaseVibration:
    """Give the vibration that a load and the platform's own inertia excite.

    Parameters
    ----------
    base
        How the base yields; None for one that does not.
    motion
        Of the platform as its actuators move it, N samples.
    load
        Other wrench on the platform, about the platform's origin, (N, 6) [N, N·m].
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    BaseVibration
        Zero throughout on a base that does not yield.
    """
    count = motion.sway.shape[1]
    if base is None:
        return BaseVibration(*np.zeros((3, count, 3)))
    accelerating = specific_force(motion, PLATFORM_CENTER_M)
    accelerating -= specific_force(motion.at_rest(), PLATFORM_CENTER_M)
    force = PLATFORM_KG * accelerating
    inertia = np.hstack([force, np.cross(PLATFORM_CENTER_M, force)])
    inertia[:, 4] += PLATFORM_INERTIA[4] * motion.pitch[2]
    exciting = load - inertia
    place, acceleration = np.empty((2, count, 6))
    for k, hz in enumerate(base.natural_hz):
        omega = 2 * np.pi * hz
        denominator = np.array([1, 2 * base.damping * omega, omega**2])
        push = (exciting[:, k] - exciting[0, k]) / PLATFORM_INERTIA[k]
        for result, numerator, scale in (
            (place, np.array([omega**2]), omega**2),
            (acceleration, np.array([1.0, 0, 0]), 1.0),
        ):
            b, a, _ = cont2discrete((numerator, denominator), 1 / rate_hz, method="bilinear")
            result[:, k] = lfilter(b.ravel(), a, push / scale)
    return BaseVibration(acceleration[:, :3], place[:, 3:], acceleration[:, 3:])
