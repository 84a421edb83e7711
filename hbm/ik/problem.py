"""The least-squares problem of every frame of a trial: markers and priors; its optima.

A coordinate has a prior where the markers of a trial, in the neutral pose, leave it more uncertain
than human posture does: it holds the coordinate near neutral, the trunk near upright in the lab.
There the optimum is the most probable pose; elsewhere no prior pulls.
"""

from collections.abc import Collection
from copy import copy
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from hbm.coordinates import CARRIERS, FIXED_TO, MOVING, N_Q, SEGMENTS, TREE
from hbm.ik.descent import MarkerAttachment, Solved, solve_frames
from hbm.ik.start import Start
from hbm.ik.upright import TRUNK, standing_trunk
from hbm.markers import Markers
from hbm.model import Body
from hbm.numbers import read_numbers
from hbm.poses import marker_positions, segment_frames
from hbm.spatial import Array, Indices, Mask
from hbm.spelling import packaged_toml

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "observed")

MARKER_SD_M: Final = 0.01
"""Error of a marker on its segment, from skin and from the calibration pose."""


CACHED_BODIES: Final = 8

STEP: Final = 1e-6
"""Of each coordinate, for slopes [rad or m]."""


def _posture_precision() -> Array:
    """Give the inverse variance of every coordinate in human posture, (46,); 0 of the pelvis."""
    parts = [c.segment.removeprefix("right_").removeprefix("left_") for c in TREE]
    # standard deviations in human posture; none of the pelvis: infinite, and no precision
    sd_deg = packaged_toml("hbm", "joint_ranges.toml")["posture_sd_deg"]
    angle = [np.radians(sd_deg.get(part, np.inf)) for part in parts]
    # up, forward and inward by some 12 cm [m]
    shoulder = np.array([part == "shoulder" for part in parts])
    return np.where(shoulder, 0.03, angle) ** -2.0


POSTURE_PRECISION: Final = _posture_precision()
ROTATES: Final[Mask] = np.array([not c.translates for c in TREE])
OF_CARRIERS: Final[Mask] = np.array([c.segment in CARRIERS for c in TREE])
"""Which coordinates are angles, and which are those of pelvis and trunk, (46,)."""


NEAR_NEUTRAL: Final = np.concatenate([STEP * np.eye(N_Q), -STEP * np.eye(N_Q)])
"""The neutral pose with each coordinate a little more and, below, a little less, (92, 46)."""


@lru_cache(maxsize=CACHED_BODIES)
def neutral_slopes(body: Body) -> Array:
    """Give by how much each coordinate moves each marker in the neutral pose, (46, K, 3)."""
    return _slopes(marker_positions(body, NEAR_NEUTRAL))


def _slopes(moved: Array) -> Array:
    # central differences: their error is of second order in the step
    return np.asarray((moved[:N_Q] - moved[N_Q:]) / (2 * STEP))


def covariance(slope: Array, seen: Mask) -> Array:
    """Give the covariance of coordinates that are fitted to markers with errors of 10 mm.

    From the markers' slopes along n coordinates, (n, K, 3), and which are seen, (K,); (n, n) [rad
    and m], standard deviations half a turn at most.
    """
    # inverse of the information: JᵀJ / σ² of the markers, and a flat prior that keeps it regular
    shown = slope[:, seen].reshape(len(slope), -1)
    total = shown @ shown.T / MARKER_SD_M**2 + np.eye(len(slope)) / np.pi**2
    return np.asarray(np.linalg.inv(total))


@lru_cache(maxsize=CACHED_BODIES)
def undetermined(body: Body, markers: tuple[str, ...]) -> tuple[Mask, tuple[str, ...]]:
    """Find what some markers of a body, by their labels, do not determine in its neutral pose.

    Gives the coordinates that a prior holds near neutral, (46,), and the segments whose centre of
    mass the markers alone leave uncertain by more than 5 cm.
    """
    used = np.array([name in markers for name in body.markers])
    # propagated to each segment's centre of mass: trace of Jᵀ Σ J
    spread = covariance(neutral_slopes(body), used)
    rotation, origin = segment_frames(body, NEAR_NEUTRAL)
    unplaced = []
    for s in SEGMENTS:
        moving = MOVING.index(FIXED_TO.get(s, s))
        slope = _slopes(rotation[:, moving] @ body.segments[s].center + origin[:, moving])
        if np.trace(slope.T @ spread @ slope) > LIMITS.largest_place_sd**2:
            unplaced.append(s)
    return np.diag(spread) * POSTURE_PRECISION > 1, tuple(unplaced)


FRAMES_AT_ONCE: Final = 4000
"""Bounds the memory of the rigid fits."""


def known_markers(body: Body, markers: Markers) -> list[int]:
    """Give the numbers of the body's markers that are in the trial; a ValueError where none is."""
    if in_trial := [k for k, name in enumerate(body.markers) if name in markers.names]:
        return in_trial
    raise ValueError(
        f"none of the body's markers is in the trial; the body has "
        f"{', '.join(body.markers[:6])}, …, the trial {', '.join(markers.names[:6])}, …"
    )


class Problem:
    """One trial's markers against one body; arguments as of `hbm.ik.tracking.solve_ik`."""

    def __init__(
        self, body: Body, markers: Markers, tolerance: float = 1e-6, jobs: int = 1
    ) -> None:
        in_trial = known_markers(body, markers)
        self.body, self.time, self.tolerance, self.jobs = body, markers.time, tolerance, jobs
        self.names = tuple(body.markers[k] for k in in_trial)
        self.segment = tuple(body.marker_segment[k] for k in in_trial)
        self.attachment = MarkerAttachment(
            np.array([MOVING.index(s) for s in self.segment]),
            body.marker_position[in_trial],
            np.ones(len(self.names)),
            body.geometry,
            markers.position,
            np.array([markers.names.index(name) for name in self.names]),
        )
        self.start = Start(self.attachment, body.joints)
        self.slope = neutral_slopes(body)[:, in_trial]
        self.prior, self.reference = np.empty(N_Q), np.zeros((1, N_Q))
        position = markers.position[:, self.attachment.column, 0]
        self.hold(np.asarray(np.isfinite(position).any(axis=0)))

    def hold(self, seen: Mask) -> None:
        """Hold near neutral, by priors, what these markers, (K,), do not determine.

        The prior sets in where markers leave a coordinate as uncertain as posture does, and has all
        its weight where they leave it twice the variance: small changes of a body have small
        effects. Coordinates that no marker shows at all count as locked: there the prior is alone.
        A frame is lost without the ``carriers``: the coordinates of the pelvis, and of a trunk with
        markers.
        """
        self.seen, used = seen, seen & (self.attachment.weight > 0)
        variance = np.diag(covariance(self.slope, used))
        # above 0 the markers leave more uncertainty than posture itself has
        doubt = variance * POSTURE_PRECISION - 1
        moves = np.linalg.norm(self.slope[:, used], axis=2).max(axis=1, initial=0)
        # a coordinate that moves no marker is no unknown
        self.locked = (POSTURE_PRECISION > 0) & (moves <= LIMITS.least_slope)
        undetermined = (doubt > 0) | self.locked
        # the prior in units of a marker's weight; it fades in with the doubt, without a jump
        posture = MARKER_SD_M**2 * POSTURE_PRECISION * np.minimum(doubt, 1)
        self.prior[:] = np.where(undetermined, posture, 0.0)
        self.carriers = OF_CARRIERS & ~self.locked
        self.unseen_trunk = bool(self.locked[TRUNK].all())
        self.weak_trunk = bool((self.prior[TRUNK] * ~self.locked[TRUNK]).any())
        # what a prior holds counts as observed always, what is locked never
        self.least_pivots = np.full(N_Q, LIMITS.least_pivot * self.attachment.weight.max())
        self.least_pivots[undetermined] = -np.inf
        self.least_pivots[self.locked] = np.inf

    def stand_upright(self) -> None:
        """Refer the prior of a trunk that markers show weakly to the lab's vertical."""
        if not self.weak_trunk:
            return
        # the pelvis of the rigid fits shows where the trunk faces
        fitted = self.rigid_fit(np.arange(len(self.time)))
        self.reference = np.zeros(fitted.shape)
        self.reference[:, TRUNK] = np.nan_to_num(standing_trunk(self.time, fitted))

    def markers_on(self, segments: Collection[str]) -> Indices:
        """Give the numbers of the markers on some segments."""
        return np.flatnonzero([s in segments for s in self.segment])

    def without(self, segments: Collection[str]) -> "Problem":
        """Give the problem with the markers of some segments without weight."""
        other, weight = copy(self), self.attachment.weight.copy()
        # without these markers other coordinates are undetermined: priors are set anew
        weight[self.markers_on(segments)] = 0.0
        other.attachment = replace(self.attachment, weight=weight)
        other.prior = np.empty(N_Q)
        other.hold(self.seen)
        return other

    def rigid_fit(self, rows: Indices) -> Array:
        """Give starting points that depend on the frame itself alone, (F, 46)."""
        start = np.empty((len(rows), N_Q))
        for first in range(0, len(rows), FRAMES_AT_ONCE):
            block, markers = slice(first, first + FRAMES_AT_ONCE), self.attachment
            measured = markers.measured(rows[block])
            start[block] = self.start.coordinates(measured, markers.weight)
        return start

    def cost(self, solved: Solved) -> Array:
        """Give twice the sum that is minimised, (F,); infinite where it did not converge."""
        prior = self.pull(solved)
        markers = np.nansum(self.attachment.weight * solved.error**2, axis=1)
        return np.where(solved.converged, markers + prior.sum(axis=1), np.inf)

    def pull(self, solved: Solved) -> Array:
        """Give what the prior of each coordinate adds to twice that sum, (F, 46)."""
        return np.asarray(self.prior * (solved.q - self.references(solved.row)) ** 2)

    def references(self, rows: Indices) -> Array:
        """Give where the priors hold the coordinates in some frames, (F, 46) or (1, 46)."""
        return self.reference if len(self.reference) == 1 else self.reference[rows]

    def newton(self, rows: Indices, start: Array, held: tuple[Mask, Array] | None = None) -> Solved:
        """Solve some frames, (F,), from starting points, (F, 46).

        Coordinates that are ``held``, (F, 46), stay at values, (F, 46).
        """
        locked, prior, reference = self.locked, self.prior, self.references(rows)
        # a prior of so much weight holds a coordinate as a constraint would
        if held is not None:
            locked = locked | held[0]
            prior, reference = np.where(held[0], 1e9, prior), np.where(held[0], held[1], reference)
        terms = np.where(locked, reference, start), prior, reference
        return solve_frames(self.attachment, rows, terms, self.tolerance, self.jobs)
