"""Angles that run on without leaps: of all that say the same, those nearest to the frame before."""

from typing import Final

import numpy as np

from hbm.coordinates import TREE, N
from hbm.spatial import Array

TURNING: Final = tuple(i for i, c in enumerate(TREE) if not c.translates)
LEAP: Final = np.pi / 2


def _balls() -> tuple[int, ...]:
    """First coordinates of joints that turn about three axes at right angles."""
    triples = [TREE[i : i + 3] for i in range(N - 2)]
    return tuple(
        i
        for i, joint in enumerate(triples)
        if len({c.segment for c in joint}) == 1
        and all(not c.translates and c.axis is not None for c in joint)
    )


BALLS: Final = _balls()


def continuous(q: Array) -> Array:
    """Choose among equal coordinates those that make each angle run on from frame to frame.

    Parameters
    ----------
    q
        Coordinates, (T, 46) [m and rad]; frames without a solution are NaN and are passed over.

    Returns
    -------
    Array
        The same poses, (T, 46). In the first frame the middle angle of each joint with three axes
        is within ±90° and all angles are within ±180°.

    Notes
    -----
    A turn is known up to full turns; three turns (a, b, c) about axes at right angles are the same
    as (a + π, π − b, c + π).
    """
    solved = ~np.isnan(q[:, 0])
    angles = q[solved]
    if not len(angles):
        return q.copy()
    leaps = np.abs(np.diff(angles, axis=0)).max(axis=0, initial=0)
    beyond = np.abs(angles[0])
    for i in BALLS:
        trio = slice(i, i + 3)
        if leaps[trio].max() > LEAP or np.abs(angles[:, i + 1]).max() > LEAP:
            angles[:, trio] = _ball(angles[:, trio])
            leaps[trio] = np.inf
    for i in TURNING:
        if leaps[i] > np.pi or beyond[i] > np.pi:
            angles[0, i] = _within_half_turn(angles[0, i])
            angles[:, i] = np.unwrap(angles[:, i])
    result = q.copy()
    result[solved] = angles
    return result


def _ball(angles: Array) -> Array:
    """Give three consecutive angles in the set, of the two, that is nearer to the frame before."""
    first = _within_half_turn(angles)
    first = np.where(np.abs(first[:, 1:2]) > LEAP, _other(first), first)
    second = _other(first)
    stay, leap = (
        np.square(_within_half_turn(x[1:] - first[:-1])).sum(axis=1) for x in (first, second)
    )
    crossings = np.concatenate([np.zeros(min(1, len(angles)), int), np.cumsum(leap < stay)])
    return np.where((crossings % 2 == 1)[:, None], second, first)


def _other(angles: Array) -> Array:
    """Give the other set of three angles for the same rotation."""
    return np.asarray(_within_half_turn(angles * [1, -1, 1] + np.pi))


def _within_half_turn(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
