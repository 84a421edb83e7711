"""Balance: a centre of mass above its centre of pressure, in the lab and on the tilted platform."""

from typing import Final

import numpy as np
from scipy.linalg import solve_banded

from compensation.platform.pose import PlatformPose
from hbm.spatial import GRAVITY_MPS2, Array

RATE_HZ: Final = 100.0
"""Sampling rate at which walks are computed: the cameras'."""


def balanced(pressure: Array, height: float) -> Array:
    """Give the bounded motion of a mass above a moving centre of pressure.

    Parameters
    ----------
    pressure
        Horizontal place of the centre of pressure at 100 Hz, (T, 2) [m].
    height
        Height of the mass above it [m].

    Returns
    -------
    Array
        Horizontal place of the mass, (T, 2) [m].

    Notes
    -----
    Solves ``c - (h/g) c̈ = p``, the linear inverted pendulum, as a boundary value problem (Kajita
    et al. 2003, IEEE ICRA 1620).
    """
    stiffness = height / GRAVITY_MPS2 * RATE_HZ**2
    bands = np.empty((3, len(pressure)))
    bands[0], bands[1], bands[2] = -stiffness, 1 + 2 * stiffness, -stiffness
    bands[1, [0, -1]] = 1 + stiffness
    return np.asarray(solve_banded((1, 1), bands, pressure))


def pressure_on_platform(wrench: Array, pose: PlatformPose) -> Array:
    """Give the centre of pressure of a wrench on the platform's surface, in its frame, (T, 2) [m].

    The wrench is in lab axes about the lab origin, (T, 6) [N, N·m].
    """
    to_platform = np.swapaxes(pose.rotation, 1, 2)
    force = (to_platform @ wrench[:, :3, None])[..., 0]
    moment = wrench[:, 3:] - np.cross(pose.position, wrench[:, :3])
    moment = (to_platform @ moment[..., None])[..., 0]
    return np.column_stack([-moment[:, 1], moment[:, 0]]) / force[:, 2:]


def surface_height(pose: PlatformPose, place: Array) -> Array:
    """Give the height of the platform's surface at a place (2,) [m] in the lab, (T,) [m]."""
    normal, away = pose.rotation[:, :, 2], place - pose.position[:, :2]
    sideways = np.sum(normal[:, :2] * away, axis=1)
    return np.asarray(pose.position[:, 2] - sideways / normal[:, 2])


def in_lab(points: Array, pose: PlatformPose) -> Array:
    """Transform points of the platform, (T, 3) or, on its surface, (T, 2), to the lab, (T, 3)."""
    if points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    return pose.to_lab(points)


def on_platform(points: Array, pose: PlatformPose) -> Array:
    """Transform points of the lab to the platform's frame, (T, 3) [m]."""
    away = points - pose.position
    return np.asarray((np.swapaxes(pose.rotation, 1, 2) @ away[..., None])[..., 0])
