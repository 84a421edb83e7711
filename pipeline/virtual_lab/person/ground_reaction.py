"""The ground reaction of a walk: under each foot, when it begins and ends, and on each plate."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.spatial import Array, transform_wrench
from pipeline.io.recording import Event
from pipeline.virtual_lab.person.balance import pressure_on_platform
from pipeline.virtual_lab.person.sole import SIDES
from pipeline.virtual_lab.person.walk import Walk

CONTACT_N: Final = 20.0
"""Vertical force at which a foot strikes, and at which it leaves the ground: the definition."""
EVENT_RATE_HZ: Final = 1000.0
EVENT_CHUNK_S: Final = 60.0
"""How finely the force is evaluated, and how much of it at a time, to bound memory."""


def foot_wrenches(walk: Walk, time: Array) -> dict[str, Array]:
    """Give the wrench on each foot.

    Parameters
    ----------
    walk
        The walk.
    time
        When, (T,) [s].

    Returns
    -------
    dict of str to Array
        "left" and "right" -> action on the subject, lab axes about the lab origin, (T, 6) [N,
        N·m]. Their sum is what the equations of motion require, to rounding.

    Notes
    -----
    In single support the stance foot carries all. In double support the weight is transferred
    smoothly; the total's centre of pressure is split into one under each foot, and each foot's
    force is inclined from there towards the centre of mass as the total is from its own centre of
    pressure, so that the leading foot brakes and the trailing foot pushes; the free moment is
    shared in proportion to the weight.
    """
    total = walk.ground.at(time)
    pose = walk.platform.pose(time)
    to_platform = np.swapaxes(pose.rotation, 1, 2)
    origin = (to_platform @ pose.position[..., None])[..., 0]
    on_platform = transform_wrench(total, to_platform, -origin)
    share = walk.placement.left_share(time)
    pressure = pressure_on_platform(total, pose)
    intended = {side: walk.placement.pressure(side, time) for side in SIDES}
    error = pressure - (
        share[:, None] * intended["left"] + (1 - share)[:, None] * intended["right"]
    )

    height = float(walk.subject.standing[2])
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
    in_lab = transform_wrench(left, pose.rotation, pose.position)
    return {"left": in_lab, "right": total - in_lab}


def foot_events(walk: Walk, duration_s: float) -> tuple[Event, ...]:
    """Give when each foot really strikes and leaves the ground.

    Parameters
    ----------
    walk
        The walk.
    duration_s
        Of the trial [s].

    Returns
    -------
    tuple of Event
        In order of time: where the vertical force on a foot passes `CONTACT_N`, to 0.1 ms.
    """
    events = []
    for start in np.arange(0.0, duration_s, EVENT_CHUNK_S):
        stop = min(start + EVENT_CHUNK_S, duration_s)
        time = np.linspace(start, stop, round((stop - start) * EVENT_RATE_HZ) + 1)
        for side, wrench in foot_wrenches(walk, time).items():
            above = wrench[:, 2] - CONTACT_N
            for k in np.flatnonzero((above[:-1] > 0) != (above[1:] > 0)):
                at = time[k] + (time[k + 1] - time[k]) * above[k] / (above[k] - above[k + 1])
                events.append(Event(float(at), "foot_off" if above[k] > 0 else "foot_strike", side))
    return tuple(sorted(events, key=lambda event: event.time))


def plate_wrenches(walk: Walk, feet: Mapping[str, Array], time: Array) -> list[Array]:
    """Give the wrench of the person on each plate.

    Parameters
    ----------
    walk
        The walk.
    feet
        Side -> wrench on the foot in lab axes about the lab origin, (N, 6) [N, N·m].
    time
        When, (N,) [s].

    Returns
    -------
    list of Array
        Left and right plate, in the moving platform's frame about its origin, (N, 6) each [N,
        N·m]. A foot is on one plate for the whole of a step, even if it reaches beyond the
        middle.
    """
    pose = walk.platform.pose(time)
    to_platform = np.swapaxes(pose.rotation, 1, 2)
    origin = -(to_platform @ pose.position[..., None])[..., 0]
    plates = [np.zeros((len(time), 6)), np.zeros((len(time), 6))]
    for side, wrench in feet.items():
        on_platform = transform_wrench(wrench, to_platform, origin)
        on_left = walk.placement.lateral(side, time) > 0
        plates[0] += np.where(on_left[:, None], on_platform, 0.0)
        plates[1] += np.where(on_left[:, None], 0.0, on_platform)
    return plates


def _moment_of_shear(place: Array, shear: Array) -> Array:
    """Give the vertical moment of horizontal forces at places of the surface, (T,) [N·m]."""
    return np.asarray(place[:, 0] * shear[:, 1] - place[:, 1] * shear[:, 0])
