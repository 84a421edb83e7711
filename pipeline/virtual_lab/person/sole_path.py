"""The path of the soles: rolling over the belt in stance, swinging from one stance to the next."""

from typing import Final

import numpy as np

from compensation.platform import PlatformPose
from hbm.spatial import Array
from pipeline.virtual_lab.person.balance import RATE_HZ, in_lab, on_platform
from pipeline.virtual_lab.person.body.kinematics import segment_poses
from pipeline.virtual_lab.person.foot_placement import FootPlacement
from pipeline.virtual_lab.person.gait_pattern import foot_angles
from pipeline.virtual_lab.person.leg_ik import SoleTarget
from pipeline.virtual_lab.person.sole import orientation, rolled
from pipeline.virtual_lab.person.stance import LEAVING, STANCE, sole_weights
from pipeline.virtual_lab.person.subject import VirtualSubject

STANDING_LOAD: Final = 0.5
"""Share of the weight on a foot in standing, where the shoe's height is the sole's."""


def sole_targets(
    subject: VirtualSubject,
    placement: FootPlacement,
    reference: Array,
    pose: PlatformPose,
    time: Array,
) -> dict[str, SoleTarget]:
    """Give the soles' poses in the lab and their weights: rolling in stance, free in swing.

    Parameters
    ----------
    subject
        Who walks.
    placement
        Where the feet come down.
    reference
        Coordinates of the gait pattern, (55, T), which the feet follow in swing.
    pose
        The platform's pose at the same times.
    time
        (T,) [s], at `RATE_HZ`.

    Returns
    -------
    dict of str to SoleTarget
        By side.
    """
    targets = {}
    names = [sole.segment for sole in placement.soles.values()]
    feet = segment_poses(subject.skeleton, reference, names)
    left = placement.left_share(time)
    for (side, sole), (_, ankle) in zip(placement.soles.items(), feet, strict=True):
        phase, extent = placement.phase(side, time), placement.extent(time)
        pitch, _ = foot_angles(phase)
        pitch = pitch * extent
        heading = placement.heading(side, time)
        rotation = pose.rotation @ orientation(pitch, heading)
        swinging = on_platform(ankle - (rotation @ sole.origin), pose)
        rolling = rolled(sole, pitch, heading)
        path = _path(placement, side, swinging, rolling, time)
        load = left if side == "left" else 1 - left
        path[:, 2] -= subject.sole_yield_m * (load - STANDING_LOAD)
        position = in_lab(path, pose)
        walking = np.minimum(extent, 1.0)[:, None]
        weight = 1 - walking * (1 - sole_weights(pitch, phase))
        targets[side] = SoleTarget(sole, rotation, position, weight)
    return targets


def _path(
    placement: FootPlacement, side: str, swinging: Array, rolling: Array, time: Array
) -> Array:
    """Join stances and swings: a swing ends where the next stance begins, (T, 3) [m].

    ``swinging`` is the sole's place in the gait pattern, ``rolling`` its displacement while it
    rolls over the belt, both on the platform, (T, 3) [m].
    """
    end = len(time) - 1
    own = list(range(0 if side == "left" else 1, len(placement.steps.contact), 2))
    path = np.empty_like(swinging)
    departure, left_at = None, 0
    for number in own if side == "left" else [-1, *own]:
        standing = number < 1 if side == "left" else number < 0
        contact = 0.0 if standing else placement.steps.contact[number]
        release = placement.release(number) if number >= 0 else _first_release(placement)
        first, last = int(np.ceil(contact * RATE_HZ)), int(np.floor(release * RATE_HZ))
        stance = slice(min(first, end), min(last, end) + 1)
        held = rolling[stance] + np.pad(
            placement.anchor(side, np.full(len(time[stance]), number), time[stance]),
            ((0, 0), (0, 1)),
        )
        if departure is not None:
            swing = np.arange(left_at, min(first, end + 1))
            u = ((swing - left_at) / (first - left_at))[:, None]
            arrival = held[0] - swinging[stance.start]
            blend = u * u * (3 - 2 * u)
            path[swing] = swinging[swing] + departure + blend * (arrival - departure)
        if first > end:
            break
        path[stance] = held
        left_at = stance.stop - 1
        departure = held[-1] - swinging[left_at]
    return path


def _first_release(placement: FootPlacement) -> float:
    """Give when the right foot leaves its standing place [s]."""
    released = (LEAVING[0] - 0.5) * placement.steps.overlap / (STANCE - 0.5)
    return float(placement.steps.contact[0]) + released * placement.step_s
