"""The platform that carries both plates: how it sways and pitches, and what its points undergo.

All formulas are those of a rigid body with one rotation axis, written out.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation.platform import PlatformPose
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.virtual_lab.trajectories import Trajectory, fit_trajectory

TERMS: Final = 5
"""Number of `motion_terms`."""
STATIONARY_KNOTS: Final = 20
"""Enough samples for a spline; a platform that does not move needs no more, however long it is."""


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
        A point of the pitch axis with the platform in neutral, (3,) [m].
    """

    sway: Array
    pitch: Array
    pivot: Array

    @property
    def pose(self) -> PlatformPose:
        """The platform's true pose."""
        return _turned_about(self.pivot, self.sway[0], self.pitch[0])

    def every(self, step: int) -> "PlatformMotion":
        """Give every ``step``-th sample."""
        return PlatformMotion(self.sway[:, ::step], self.pitch[:, ::step], self.pivot)


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
        What an ideal accelerometer there measures, (N, 3) [m/s²].

    Notes
    -----
    With ``d`` from the pitch axis to the point: ``φ̈ ŷ×d − φ̇² (d − (d·ŷ) ŷ) + ÿ ŷ − Rᵀ g``.
    """
    felt = motion_terms(motion) @ felt_by_terms(point, motion.pivot).T
    felt[:, 2] += GRAVITY_MPS2
    return np.asarray(felt)


def motion_terms(motion: PlatformMotion) -> Array:
    """Give what the specific force of every point is linear in, (N, 5) [m/s², 1/s²].

    ``ÿ, φ̈, φ̇², g sin φ, g (1 − cos φ)``: all zero at rest in neutral.
    """
    (_, _, sway_acceleration), (angle, rate, acceleration) = motion.sway, motion.pitch
    falling = GRAVITY_MPS2 * np.sin(angle), 2 * GRAVITY_MPS2 * np.sin(angle / 2) ** 2
    return np.column_stack([sway_acceleration, acceleration, rate**2, *falling])


def felt_by_terms(point: Array, pivot: Array) -> Array:
    """Give a point's specific force, less that at rest in neutral, by `motion_terms`, (3, 5)."""
    x, _, z = np.asarray(point, float) - pivot
    return np.array([[0, z, -x, -1, 0], [1, 0, 0, 0, 0], [0, -x, -z, 0, -1]])


@dataclass(frozen=True, slots=True)
class PlatformTrajectory:
    """The platform's motion at any time: sway to the left [m] and pitch [rad], front down.

    Attributes
    ----------
    trajectory
        Sway and pitch as functions of time, two columns.
    pivot
        A point of the pitch axis with the platform in neutral, (3,) [m].
    """

    trajectory: Trajectory
    pivot: Array

    def sway(self, time: Array) -> Array:
        """Give the sideways position, (T,) [m]."""
        return self._at(time)[:, 0]

    def slope(self, time: Array) -> Array:
        """Give how steeply the belts rise forward, (T,) [rad]."""
        return -self._at(time)[:, 1]

    def pose(self, time: Array) -> PlatformPose:
        """Give the platform's pose at T times.

        Before its start it rests; after its end it goes on as it came, turned about its last pose.
        """
        sway, pitch = self._at(time).T
        return _turned_about(self.pivot, sway, pitch)

    def _at(self, time: Array) -> Array:
        begin = self.trajectory.start
        end = begin + self.trajectory.duration
        mirrored = np.where(time > end, 2 * end - np.asarray(time), time)
        value = self.trajectory.at(np.clip(mirrored, begin, end))
        beyond = np.asarray(time) > end
        value[beyond] = 2 * self.trajectory.at(np.array([end])) - value[beyond]
        return value


def platform_trajectory(motion: PlatformMotion, rate_hz: float) -> PlatformTrajectory:
    """Interpolate the platform's motion between its samples."""
    values = np.column_stack([motion.sway[0], motion.pitch[0]])
    return PlatformTrajectory(fit_trajectory(values, rate_hz), motion.pivot)


def stationary_platform() -> PlatformTrajectory:
    """Give a platform that does not move."""
    return PlatformTrajectory(fit_trajectory(np.zeros((STATIONARY_KNOTS, 2)), 1.0), np.zeros(3))


def _turned_about(pivot: Array, sway: Array, pitch: Array) -> PlatformPose:
    """Give the pose of a platform that is turned about an axis to the left through its pivot.

    A positive pitch lowers the front: ``x = (c, 0, -s)``, ``z = (s, 0, c)``.
    """
    c, s, zero = np.cos(pitch), np.sin(pitch), np.zeros(len(pitch))
    rotation = np.stack([[c, zero, s], [zero, zero + 1, zero], [-s, zero, c]]).transpose(2, 0, 1)
    x, _, z = pivot
    origin = np.column_stack([x - c * x - s * z, sway, z + s * x - c * z])
    return PlatformPose(rotation, origin)
