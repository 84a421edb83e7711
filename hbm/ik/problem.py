"""The least-squares problem of every frame of a trial: markers and priors; its optima.

A coordinate has a prior where the markers of a trial, in the neutral pose, leave it more uncertain
than human posture does: it holds the coordinate near neutral. There the optimum is the most
probable pose; elsewhere no prior pulls.
"""

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType
from typing import Final

import numpy as np

from hbm.coordinates import FIXED_TO, MOVING, N_Q, SEGMENTS, TREE
from hbm.ik.descent import MarkerAttachment, Solved, solve_frames
from hbm.ik.start import starting_pose
from hbm.markers import Markers
from hbm.model import Body
from hbm.poses import marker_positions, segment_frames
from hbm.spatial import Array, Indices, Mask

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


def covariance(slope: Array, weight: Array) -> Array:
    """Give the covariance of coordinates that are fitted to markers with errors of 10 mm.

    From the markers' slopes along n coordinates, (n, K, 3), and their weights, (K,), 0 where not
    seen; (n, n) [rad and m], standard deviations half a turn at most.
    """
    own = np.flatnonzero(weight)
    weighted = (slope[:, own] * np.sqrt(weight[own])[:, None]).reshape(len(slope), -1)
    information = weighted @ weighted.T
    total = information / MARKER_SD_M**2 + np.eye(len(slope)) / FLAT_SD**2
    return np.asarray(np.linalg.inv(total))


def shown(slope: Array, weight: Array) -> Mask:
    """Whether any marker depends on each coordinate, (46,)."""
    moves = np.linalg.norm(slope[:, weight > 0], axis=2)
    return np.asarray(moves.max(axis=1, initial=0) > MIN_SLOPE_M)


def undetermined(body: Body, markers: Sequence[str]) -> tuple[Mask, tuple[str, ...]]:
    """Find what some markers of a body, by their labels, do not determine in its neutral pose.

    Gives the coordinates that a prior holds near neutral, (46,), and the segments whose centre of
    mass the markers alone leave uncertain by more than 5 cm.
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


LOCK: Final = 1e9
"""Prior weight of a coordinate that is held [m²/rad², or 1 for a translation]: markers, which weigh
about 1, move it by about 1e-9 rad."""

FRAMES_AT_ONCE: Final = 4000
"""Bounds the memory of the rigid fits."""


class Problem:
    """One trial's markers against one body; arguments as of `hbm.kinematics.solve_ik`."""

    def __init__(
        self,
        body: Body,
        markers: Markers,
        weights: Mapping[str, float] = MappingProxyType({}),
        *,
        tolerance: float = 1e-6,
        jobs: int = 1,
    ) -> None:
        known = [k for k, name in enumerate(body.markers) if name in markers.names]
        if not known:
            raise ValueError(
                f"none of the body's markers is in the trial; the body has "
                f"{', '.join(body.markers[:6])}, …, the trial {', '.join(markers.names[:6])}, …"
            )
        self.body, self.time, self.tolerance, self.jobs = body, markers.time, tolerance, jobs
        self.names = tuple(body.markers[k] for k in known)
        self.segment = tuple(body.marker_segment[k] for k in known)
        self.attachment = MarkerAttachment(
            np.array([MOVING.index(s) for s in self.segment]),
            body.marker_position[known],
            np.array([weights.get(name, 1.0) for name in self.names]),
            body.geometry,
            markers.position,
            np.array([markers.names.index(name) for name in self.names]),
        )
        self.rotates = np.array([not c.translates for c in TREE])
        self.slope = neutral_slopes(body)[:, known]
        self.prior = np.empty(N_Q)
        position = markers.position[:, self.attachment.column, 0]
        self.hold(np.asarray(np.isfinite(position).any(axis=0)))

    def hold(self, seen: Mask) -> None:
        """Hold near neutral, by priors, what these markers, (K,), do not determine.

        The prior sets in where markers leave a coordinate as uncertain as posture does, and has all
        its weight where they leave it twice the variance: small changes of a body have small
        effects. Coordinates that no marker shows at all count as locked: there the prior is alone.
        """
        self.seen, weight = seen, self.attachment.weight * seen
        usual = np.median(weight[weight > 0]) if weight.any() else 1.0
        variance = np.diag(covariance(self.slope, weight / usual))
        doubt = variance * POSTURE_PRECISION - 1
        self.locked = (POSTURE_PRECISION > 0) & ~shown(self.slope, weight)
        self.undetermined = (doubt > 0) | self.locked
        posture = usual * MARKER_SD_M**2 * POSTURE_PRECISION * np.minimum(doubt, 1)
        self.prior[:] = np.where(self.undetermined, posture, 0.0)

    def without(self, segments: Collection[str]) -> "Problem":
        """Give the problem with the markers of some segments without weight."""
        other = copy(self)
        own = np.array([s in segments for s in self.segment])
        weight = np.where(own, 0.0, self.attachment.weight)
        other.attachment = replace(self.attachment, weight=weight)
        other.prior = np.empty(N_Q)
        other.hold(self.seen)
        return other

    def rigid_fit(self, rows: Indices) -> Array:
        """Give starting points that depend on the frame itself alone, (F, 46)."""
        start = np.empty((len(rows), N_Q))
        for first in range(0, len(rows), FRAMES_AT_ONCE):
            block = slice(first, first + FRAMES_AT_ONCE)
            measured = self.attachment.measured(rows[block])
            seen = np.isfinite(measured[..., 0])
            start[block] = starting_pose(
                np.where(seen[..., None], measured, 0.0),
                seen * self.attachment.weight,
                self.attachment.local,
                self.segment,
                self.body.joints,
            )
        return start

    def cost(self, solved: Solved) -> Array:
        """Give twice the sum that is minimised, (F,); infinite where it did not converge."""
        prior = self.prior * solved.q**2
        markers = np.nansum(self.attachment.weight * solved.error**2, axis=1)
        return np.where(solved.converged, markers + prior.sum(axis=1), np.inf)

    def newton(self, rows: Indices, start: Array, held: tuple[Mask, Array] | None = None) -> Solved:
        """Solve some frames, (F,), from starting points, (F, 46).

        Coordinates that are ``held``, (F, 46), stay at values, (F, 46).
        """
        locked, prior, reference = self.locked, self.prior, np.zeros(N_Q)
        if held is not None:
            locked = locked | held[0]
            prior, reference = np.where(held[0], LOCK, prior), np.where(held[0], held[1], reference)
        return solve_frames(
            self.attachment,
            rows,
            np.where(locked, reference, start),
            prior,
            reference,
            tolerance=self.tolerance,
            jobs=self.jobs,
        )
