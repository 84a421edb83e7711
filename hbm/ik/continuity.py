"""Angles without jumps: of all coordinates for the same pose, those nearest to the frame before."""

from typing import Final

import numpy as np

from hbm.coordinates import N_Q, TREE
from hbm.spatial import Array

ROTATIONS: Final = tuple(i for i, c in enumerate(TREE) if not c.translates)
MIN_JUMP_RAD: Final = np.pi / 2
"""No angle truly changes by a quarter turn between frames: so large a change is another set of
angles."""

OF_JOINTS: Final = np.array([not c.translates and c.segment != "pelvis" for c in TREE])
MAX_JOINT_RAD: Final = 1.5 * np.pi
"""No joint turns so far, though a subject may: such an angle went a full turn too far where markers
hardly showed it."""


BALL_JOINTS: Final = tuple(
    i
    for i, c in enumerate(TREE[: N_Q - 2])
    if {(joint.segment, joint.translates, joint.axis is None) for joint in TREE[i : i + 3]}
    == {(c.segment, False, False)}
)
"""First coordinates of joints that rotate about three axes at right angles."""


def continuous(q: Array) -> Array:
    """Choose among equivalent coordinates those that make every angle continuous in time.

    Parameters
    ----------
    q
        Coordinates, (T, 46) [m and rad]; frames without a solution are NaN and are skipped.

    Returns
    -------
    Array
        The same poses, (T, 46). In the first frame the middle angle of each joint with three axes
        is within ±90° and all angles are within ±180°.

    Notes
    -----
    An angle is defined up to full turns; three angles (a, b, c) about axes at right angles give the
    same rotation as (a + π, π − b, c + π).
    """
    solved = ~np.isnan(q[:, 0])
    angles = q[solved]
    if not len(angles):
        return q.copy()
    # most joints never jump: their columns are left as they are
    jumps = np.abs(np.diff(angles, axis=0)).max(axis=0, initial=0)
    first = np.abs(angles[0])
    for i in BALL_JOINTS:
        joint = slice(i, i + 3)
        # the middle angle is to begin within ±90°, where one of the two sets always is
        if jumps[joint].max() > MIN_JUMP_RAD or np.abs(angles[:, i + 1]).max() > np.pi / 2:
            angles[:, joint] = _continuous_joint(angles[:, joint])
            jumps[joint] = np.inf
    for i in ROTATIONS:
        if jumps[i] > np.pi or first[i] > np.pi:
            angles[0, i] = _within_half_turn(angles[0, i])
            angles[:, i] = np.unwrap(angles[:, i])
    result = q.copy()
    result[solved] = angles
    return result


def nearest_equivalent(q: Array, before: Array) -> Array:
    """Give the equivalent coordinates of a pose, (46,), that are nearest to those before, (46,).

    Angles of joints that would be beyond ``MAX_JOINT_RAD`` are within ±180° instead.
    """
    result = q.copy()
    for i in BALL_JOINTS:
        joint, last = slice(i, i + 3), before[i : i + 3]
        # both sets of a joint's angles, compared without their full turns
        sets = np.array([q[joint], other_set(q[joint])])
        apart = np.square(_within_half_turn(sets - last)).sum(axis=1)
        result[joint] = sets[int(apart.argmin())]
    turns = list(ROTATIONS)
    # full turns that bring each angle nearest to the one before
    result[turns] = before[turns] + _within_half_turn(result[turns] - before[turns])
    beyond = np.flatnonzero((np.abs(result) > MAX_JOINT_RAD) & OF_JOINTS)
    result[beyond] = _within_half_turn(result[beyond])
    return result


def _continuous_joint(angles: Array) -> Array:
    """Give a joint's three angles, (F, 3), in the set that is nearer to the frame before."""
    first = _within_half_turn(angles)
    # begin with the set whose middle angle is within ±90°
    first = np.where(np.abs(first[:, 1:2]) > np.pi / 2, other_set(first), first)
    second = other_set(first)
    same, other = (
        np.square(_within_half_turn(x[1:] - first[:-1])).sum(axis=1) for x in (first, second)
    )
    # the nearer set changes wherever the other one is nearer to the frame before: a parity
    crossings = np.concatenate([np.zeros(min(1, len(angles)), int), np.cumsum(other < same)])
    return np.where((crossings % 2 == 1)[:, None], second, first)


def other_set(angles: Array) -> Array:
    """Give the other three angles of the same rotation, (F, 3)."""
    # (a, b, c) and (a + π, π − b, c + π) are the same rotation
    return np.asarray(_within_half_turn(angles * [1, -1, 1] + np.pi))


def _within_half_turn(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
