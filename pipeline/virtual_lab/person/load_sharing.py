"""Load sharing: how both feet together exert the wrench that the body's motion requires."""

import numpy as np

from compensation.platform import PlatformPose
from hbm.spatial import Array, transform_wrench
from pipeline.virtual_lab.person.balance import pressure_on_platform
from pipeline.virtual_lab.person.foot_placement import FootPlacement
from pipeline.virtual_lab.person.sole import SIDES


def left_wrench(
    total: Array, placement: FootPlacement, pose: PlatformPose, time: Array, height: float
) -> Array:
    """Give the wrench on the left foot; the right one carries the rest.

    Parameters
    ----------
    total
        Of both feet, lab axes about the lab origin, (T, 6) [N, N·m].
    placement
        Where the feet are, and how they share the weight.
    pose
        The platform's.
    time
        (T,) [s].
    height
        Height of the centre of mass above the feet, roughly [m].

    Returns
    -------
    Array
        Action on the subject, lab axes about the lab origin, (T, 6) [N, N·m].

    Notes
    -----
    In single support the stance foot carries all. In double support the weight is transferred
    smoothly; the total's centre of pressure is split into one under each foot, and each foot's
    force is inclined from there towards the centre of mass as the total is from its own centre of
    pressure, so that the leading foot brakes and the trailing foot pushes; the free moment is
    shared in proportion to the weight.
    """
    to_platform = np.swapaxes(pose.rotation, 1, 2)
    origin = (to_platform @ pose.position[..., None])[..., 0]
    on_platform = transform_wrench(total, to_platform, -origin)
    share = placement.left_share(time)
    pressure = pressure_on_platform(total, pose)
    intended = {side: placement.pressure(side, time) for side in SIDES}
    error = pressure - (
        share[:, None] * intended["left"] + (1 - share)[:, None] * intended["right"]
    )

    vertical = on_platform[:, 2:3]
    left = np.zeros_like(on_platform)
    left_pressure = intended["left"] + error
    left[:, 2] = share * on_platform[:, 2]
    inclined = vertical * (pressure - left_pressure) / height
    left[:, :2] = share[:, None] * (on_platform[:, :2] + inclined)
    right_pressure = intended["right"] + error
    inclined = vertical * (pressure - right_pressure) / height
    right_shear = (1 - share)[:, None] * (on_platform[:, :2] + inclined)
    free_moment = (
        on_platform[:, 5]
        - _moment_of_shear(left_pressure, left[:, :2])
        - _moment_of_shear(right_pressure, right_shear)
    )
    left[:, 3] = left_pressure[:, 1] * left[:, 2]
    left[:, 4] = -left_pressure[:, 0] * left[:, 2]
    left[:, 5] = _moment_of_shear(left_pressure, left[:, :2]) + share * free_moment
    left[share == 0] = 0.0
    return np.asarray(transform_wrench(left, pose.rotation, pose.position))


def _moment_of_shear(place: Array, shear: Array) -> Array:
    """Give the vertical moment of horizontal forces at places of the surface, (T,) [N·m]."""
    return np.asarray(place[:, 0] * shear[:, 1] - place[:, 1] * shear[:, 0])
