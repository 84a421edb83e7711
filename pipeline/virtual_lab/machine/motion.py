"""What the treadmill does in a trial: when the belts run, and how the platform moves."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation.platform.pose import PlatformPose, commanded_pose
from hbm.spatial import Array
from pipeline.virtual_lab.machine.treadmill import PlatformMotion
from pipeline.virtual_lab.trajectories import Trajectory, fit_trajectory, smooth_step

ANALOG_HZ: Final = 1000.0


@dataclass(frozen=True, slots=True)
class BeltRamp:
    """A belt that starts smoothly and then runs at constant speed.

    Attributes
    ----------
    speed_mps
        Final speed [m/s].
    start, ramp
        When it starts, and how long it takes to its final speed [s].
    """

    speed_mps: float
    start: float = 4.0
    ramp: float = 4.0

    def speed(self, time: Array) -> Array:
        """Give its speed, (T,) [m/s]."""
        return self.speed_mps * smooth_step((time - self.start) / self.ramp)

    def travelled(self, time: Array) -> Array:
        """Give how far it has run, (T,) [m]."""
        since = time - self.start
        x = np.clip(since / self.ramp, 0.0, 1.0)
        ramping = self.ramp * (x**6 - 3 * x**5 + 2.5 * x**4)
        return np.asarray(self.speed_mps * (ramping + np.maximum(since - self.ramp, 0.0)))


@dataclass(frozen=True, slots=True)
class TreadmillMotion:
    """What the treadmill does in a trial, sample by sample.

    Attributes
    ----------
    time
        (N,) [s], at 1000 Hz.
    platform
        The platform's true motion at these times.
    belt
        Speed of both belts, (N,) [m/s].
    onsets
        When perturbations start [s].
    """

    time: Array
    platform: PlatformMotion
    belt: Array
    onsets: Array


@dataclass(frozen=True, slots=True)
class PlatformTrajectory:
    """Where the platform takes the belts: sway to the left [m] and pitch [rad], front down.

    Attributes
    ----------
    trajectory
        Two columns over time.
    pivot
        A point of the pitch axis with the platform in neutral, (3,) [m].
    """

    trajectory: Trajectory
    pivot: Array

    def sway(self, time: Array) -> Array:
        """Give the sideways position, (T,) [m]."""
        return self._at(time)[:, 0]

    def slope(self, time: Array) -> Array:
        """Give how far the belts rise forward, (T,) [rad]."""
        return -self._at(time)[:, 1]

    def pose(self, time: Array) -> PlatformPose:
        """Give the platform's pose at T times; beyond the ends it stays."""
        sway, pitch = self._at(time).T
        return commanded_pose(sway, pitch, self.pivot)

    def _at(self, time: Array) -> Array:
        begin = self.trajectory.start
        return self.trajectory.at(np.clip(time, begin, begin + self.trajectory.duration))


def platform_trajectory(motion: PlatformMotion, rate_hz: float) -> PlatformTrajectory:
    """Give the platform's motion between its samples."""
    values = np.column_stack([motion.sway[0], motion.pitch[0]])
    return PlatformTrajectory(fit_trajectory(values, rate_hz), motion.pivot)


def stationary_platform(duration: float) -> PlatformTrajectory:
    """Give a platform that does not move."""
    return PlatformTrajectory(fit_trajectory(np.zeros((int(duration) + 40, 2)), 1.0), np.zeros(3))
