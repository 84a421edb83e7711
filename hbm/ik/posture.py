"""What markers do not determine: a prior holds it near the neutral posture.

A coordinate has a prior where the markers of a trial, in the neutral pose, leave it more uncertain
than human posture does. There the optimum is the most probable pose; elsewhere no prior pulls.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from hbm.coordinates import FIXED_TO, MOVING, N_Q, SEGMENTS, TREE
from hbm.model import Body
from hbm.poses import marker_positions, segment_frames
from hbm.spatial import Array, Mask

MARKER_SD_M: Final = 0.01
"""Error of a marker on its segment, from skin and from the calibration pose."""

POSTURE_SD_DEG: Final = {
    "thorax": 20.0,
    "head": 30.0,
    "upper_arm": 50.0,
    "forearm": 40.0,
    "hand": 30.0,
    "thigh": 25.0,
    "shank": 35.0,
    "foot": 15.0,
    "toes": 20.0,
}
"""Standard deviation of a joint's angles about neutral: about a quarter of the range of active
motion, so that ±2 SD is as wide as the range; ranges of limbs by Boone and Azen 1979, J Bone Joint
Surg Am 61:756."""

SHOULDER_SD_M: Final = 0.03
"""The same of the shoulders' translations: up, forward and inward by some 12 cm."""

FLAT_SD: Final = np.pi
"""Of every coordinate before anything is known [rad or m]: any angle at all."""

MIN_SLOPE_M: Final = 1e-3
"""Of markers along a coordinate [m/rad, or 1]: those nearer to its axis do not show it."""

MAX_PLACE_SD_M: Final = 0.05
"""Of a segment's centre of mass, from which on markers do not show where it is."""

CACHED_BODIES: Final = 8

STEP: Final = 1e-6
"""Of each coordinate, for slopes [rad or m]."""


def _posture_precision() -> Array:
    """Give the inverse variance of every coordinate in human posture, (46,); 0 of the pelvis."""
    parts = [c.segment.removeprefix("right_").removeprefix("left_") for c in TREE]
    angle = [np.radians(POSTURE_SD_DEG.get(part, np.inf)) for part in parts]
    shoulder = np.array([part == "shoulder" for part in parts])
    return np.where(shoulder, SHOULDER_SD_M, angle) ** -2.0


POSTURE_PRECISION: Final = _posture_precision()


def marker_slopes(body: Body, q: Array) -> Array:
    """Give by how much each coordinate of a pose, (46,), moves each marker, (46, K, 3)."""
    moved = marker_positions(body, _steps(q))
    return np.asarray((moved[:N_Q] - moved[N_Q:]) / (2 * STEP))


@lru_cache(maxsize=CACHED_BODIES)
def neutral_slopes(body: Body) -> Array:
    """Give the same in the neutral pose."""
    return marker_slopes(body, np.zeros(N_Q))


def covariance(slope: Array, weight: Array, prior: Array | float = 0.0) -> Array:
    """Give the covariance of coordinates that are fitted to markers with errors of 10 mm.

    Parameters
    ----------
    slope
        Of the markers along the coordinates, (n, K, 3).
    weight
        Of each marker, 0 where it is not seen, (K,).
    prior
        Weights of priors on the coordinates, (n,).

    Returns
    -------
    Array
        (n, n) [rad and m]; standard deviations are half a turn at most.
    """
    own = np.flatnonzero(weight)
    weighted = (slope[:, own] * np.sqrt(weight[own])[:, None]).reshape(len(slope), -1)
    information = weighted @ weighted.T + np.diag(np.broadcast_to(prior, len(slope)))
    total = information / MARKER_SD_M**2 + np.eye(len(slope)) / FLAT_SD**2
    return np.asarray(np.linalg.inv(total))


def shown(slope: Array, weight: Array) -> Mask:
    """Whether any marker depends on each coordinate, (46,)."""
    moves = np.linalg.norm(slope[:, weight > 0], axis=2)
    return np.asarray(moves.max(axis=1, initial=0) > MIN_SLOPE_M)


def undetermined(body: Body, markers: Sequence[str]) -> tuple[Mask, tuple[str, ...]]:
    """Find what some markers of a body do not determine in its neutral pose.

    Parameters
    ----------
    body
        The subject.
    markers
        Labels of those that are seen.

    Returns
    -------
    coordinates
        Those that a prior holds near neutral, (46,).
    segments
        Those whose centre of mass the markers alone leave uncertain by more than 5 cm.
    """
    weight = np.array([float(name in markers) for name in body.markers])
    spread = covariance(neutral_slopes(body), weight)
    rotation, origin = segment_frames(body, _steps(np.zeros(N_Q)))
    unplaced = []
    for s in SEGMENTS:
        own = MOVING.index(FIXED_TO.get(s, s))
        centre = rotation[:, own] @ body.segments[s].center + origin[:, own]
        slope = (centre[:N_Q] - centre[N_Q:]) / (2 * STEP)
        if np.trace(slope.T @ spread @ slope) > MAX_PLACE_SD_M**2:
            unplaced.append(s)
    return np.diag(spread) * POSTURE_PRECISION > 1, tuple(unplaced)


def _steps(q: Array) -> Array:
    """Give a pose with each coordinate a little more and, below, a little less, (92, 46)."""
    step = STEP * np.eye(N_Q)
    return np.concatenate([q + step, q - step])
