"""The ground wrench shared between the feet."""

import numpy as np

from hbm.spatial import Array, transform_wrench
from pipeline.virtual_lab.person.balance import pressure_on_platform
from pipeline.virtual_lab.person.sole import SIDES
from pipeline.virtual_lab.person.walk import Walk, ground_wrench


def foot_wrenches(walk: Walk, time: Array, jobs: int = 1) -> dict[str, Array]:
    """Give the wrench on each foot.

    Parameters
    ----------
    walk
        The walk.
    time
        When, (T,) [s].
    jobs
        Threads.

    Returns
    -------
    dict[str, Array]
        "left" and "right" -> action on the subject, lab axes about the lab origin, (T, 6) [N,
        N·m]. Their sum is what the equations of motion ask for, to rounding.

    Notes
    -----
    In single support the stance foot carries all. In double support the weight passes smoothly;
    the total's centre of pressure splits into one under each foot, and each foot's force leans
    from there to the centre of mass as the total does from its own, so that the leading foot
    brakes and the trailing foot pushes; the free moment is shared as the weight.
    """
    total = ground_wrench(walk.subject, walk.motion, time, jobs)
    pose = walk.platform.pose(time)
    back = np.swapaxes(pose.rotation, 1, 2)
    away = (back @ pose.position[..., None])[..., 0]
    local = transform_wrench(total, back, -away)
    share = walk.placement.left_share(time)
    pressure = pressure_on_platform(total, pose)
    under = {side: walk.placement.pressure(side, time) for side in SIDES}
    error = pressure - (share[:, None] * under["left"] + (1 - share)[:, None] * under["right"])

    height = float(walk.subject.standing[2])
    left = np.zeros_like(local)
    place = under["left"] + error
    left[:, 2] = share * local[:, 2]
    lean = local[:, 2:3] * (pressure - place) / height
    left[:, :2] = share[:, None] * (local[:, :2] + lean)
    other = under["right"] + error
    lean = local[:, 2:3] * (pressure - other) / height
    right_force = (1 - share)[:, None] * (local[:, :2] + lean)
    twist = local[:, 5] - _twist(place, left[:, :2]) - _twist(other, right_force)
    left[:, 3] = place[:, 1] * left[:, 2]
    left[:, 4] = -place[:, 0] * left[:, 2]
    left[:, 5] = _twist(place, left[:, :2]) + share * twist
    left[share == 0] = 0.0
    in_lab = transform_wrench(left, pose.rotation, pose.position)
    return {"left": in_lab, "right": total - in_lab}


def _twist(place: Array, force: Array) -> Array:
    return np.asarray(place[:, 0] * force[:, 1] - place[:, 1] * force[:, 0])
