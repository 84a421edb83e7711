"""Two plates side by side, each under its belt: which foot is on which."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.spatial import Array, shift_wrench, transform_wrench
from pipeline.io.recording import Plate
from pipeline.virtual_lab.person.walk import Walk

LENGTH_M: Final = 1.8
WIDTH_M: Final = 0.5
CENTERS: Final = np.array([[0.0, WIDTH_M / 2, 0.0], [0.0, -WIDTH_M / 2, 0.0]])


def plate(number: int, time: Array, wrench: Array) -> Plate:
    """Give a plate with its wrenches.

    Parameters
    ----------
    number
        1 for the left plate, 2 for the right.
    time
        Sample times, (N,) [s].
    wrench
        In the platform's frame about its origin, (N, 6) [N, N·m].

    Returns
    -------
    Plate
        Axes parallel to the platform's.
    """
    center = CENTERS[number - 1]
    x, y = LENGTH_M / 2, WIDTH_M / 2
    corners = center + np.array([[x, y, 0], [x, -y, 0], [-x, -y, 0], [-x, y, 0]])
    return Plate(number, time, shift_wrench(wrench, center), np.eye(3), center, corners)


def plate_wrenches(walk: Walk, feet: Mapping[str, Array], time: Array) -> list[Array]:
    """Give what the person puts on each plate.

    Parameters
    ----------
    walk
        The walk.
    feet
        Side -> wrench on the foot in the lab, (N, 6) [N, N·m].
    time
        When, (N,) [s].

    Returns
    -------
    list[Array]
        Left and right plate, in the moving platform's frame about its origin, (N, 6) each. A foot
        is on one plate for the whole of a step, also where it crosses to the other's side.
    """
    pose = walk.platform.pose(time)
    back = np.swapaxes(pose.rotation, 1, 2)
    away = -(back @ pose.position[..., None])[..., 0]
    plates = [np.zeros((len(time), 6)), np.zeros((len(time), 6))]
    for side, wrench in feet.items():
        local = transform_wrench(wrench, back, away)
        on_left = walk.placement.lateral(side, time) > 0
        plates[0] += np.where(on_left[:, None], local, 0.0)
        plates[1] += np.where(on_left[:, None], 0.0, local)
    return plates
