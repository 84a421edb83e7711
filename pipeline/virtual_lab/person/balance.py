"""Balance: where the mass is above the pressure, in the lab and on the tilted platform."""

from typing import Final

import numpy as np
from scipy.linalg import solve_banded

from compensation.platform.pose import PlatformPose
from hbm.spatial import GRAVITY_MPS2, Array

RATE_HZ: Final = 100.0


def balanced(pressure: Array, height: float) -> Array:
    """Give the bounded motion of a mass above a moving centre of pressure, (T, 2) [m], at 100 Hz.

    Solves ``c - (h/g) c̈ = p``, the linear inverted pendulum, as a boundary value problem (Kajita
    et al. 2003, IEEE ICRA 1620).
    """
    stiffness = height / GRAVITY_MPS2 * RATE_HZ**2
    bands = np.empty((3, len(pressure)))
    bands[0], bands[1], bands[2] = -stiffness, 1 + 2 * stiffness, -stiffness
    bands[1, [0, -1]] = 1 + stiffness
    return np.asarray(solve_banded((1, 1), bands, pressure))


def pressure_on_platform(wrench: Array, pose: PlatformPose) -> Array:
    """Give where a wrench in the lab acts on the platform's surface, in its frame, (T, 2) [m]."""
    back = np.swapaxes(pose.rotation, 1, 2)
    force = (back @ wrench[:, :3, None])[..., 0]
    moment = wrench[:, 3:] - np.cross(pose.position, wrench[:, :3])
    moment = (back @ moment[..., None])[..., 0]
    return np.column_stack([-moment[:, 1], moment[:, 0]]) / force[:, 2:]


def surface_height(pose: PlatformPose, place: Array) -> Array:
    """Give how high the platform's surface is above a place in the lab, (T,) [m]."""
    normal, away = pose.rotation[:, :, 2], place - pose.position[:, :2]
    sideways = np.sum(normal[:, :2] * away, axis=1)
    return np.asarray(pose.position[:, 2] - sideways / normal[:, 2])


def in_lab(points: Array, pose: PlatformPose) -> Array:
    """Bring points of the platform, (T, 3) or, on its surface, (T, 2), to the lab, (T, 3) [m]."""
    if points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    return pose.to_lab(points)


def on_platform(points: Array, pose: PlatformPose) -> Array:
    """Bring points of the lab to the platform's frame, (T, 3) [m]."""
    away = points - pose.position
    return np.asarray((np.swapaxes(pose.rotation, 1, 2) @ away[..., None])[..., 0])
