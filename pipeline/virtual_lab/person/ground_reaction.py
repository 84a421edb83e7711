"""The ground reaction of a walk: under each foot, when it begins and ends, and on each plate."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.spatial import Array, transform_wrench
from pipeline.io.recording import Event
from pipeline.virtual_lab.person.walk import Walk

CONTACT_N: Final = 20.0
"""Vertical force at which a foot strikes, and at which it leaves the ground: the definition."""
COARSE_HZ: Final = 100.0
FINE_STEPS: Final = 10
"""How often the force is evaluated to find the intervals in which it passes that value, and into
how many steps these are divided: a foot is loaded and unloaded in a tenth of a second."""


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
    """
    total, left = walk.ground.at(time), walk.left.at(time)
    share = walk.placement.left_share(time)
    left[share == 0] = 0.0
    left[share == 1] = total[share == 1]
    return {"left": left, "right": total - left}


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
    coarse = np.linspace(0.0, duration_s, round(duration_s * COARSE_HZ) + 1)
    within = np.linspace(0.0, coarse[1] - coarse[0], FINE_STEPS + 1)
    for side, wrench in foot_wrenches(walk, coarse).items():
        passing = np.flatnonzero(np.diff(wrench[:, 2] > CONTACT_N))
        time = coarse[passing, None] + within
        force = foot_wrenches(walk, time.ravel())[side][:, 2].reshape(time.shape)
        for own, above in zip(time, force - CONTACT_N, strict=True):
            for k in np.flatnonzero((above[:-1] > 0) != (above[1:] > 0)):
                at = own[k] + (own[k + 1] - own[k]) * above[k] / (above[k] - above[k + 1])
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
