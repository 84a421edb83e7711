"""The least-squares problem of every frame of a trial: markers, priors, limits; its optima."""

from collections.abc import Collection, Mapping
from copy import copy
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.coordinates import INDEX, MOVING, N_Q, TREE
from hbm.ik.attachment import MarkerAttachment
from hbm.ik.descent import Solved, solve_frames
from hbm.ik.posture import MARKER_SD_M, POSTURE_PRECISION, covariance, neutral_slopes, shown
from hbm.ik.start import starting_pose
from hbm.markers import Markers
from hbm.model import Body
from hbm.spatial import Array, Indices, Mask

LOCK: Final = 1e9
"""Prior weight of a coordinate that is held [m²/rad², or 1 for a translation]: markers, which weigh
about 1, move it by about 1e-9 rad."""

MAX_ACTIVE_SET_ROUNDS: Final = 10
"""Rounds of holding coordinates at limits and releasing them; a few suffice."""

FRAMES_AT_ONCE: Final = 4000
"""Bounds the memory of the rigid fits."""


class Problem:
    """One trial's markers against one body.

    Parameters
    ----------
    body, markers, weights, limits, priors, tolerance, jobs
        As for `hbm.kinematics.solve_ik`.

    Raises
    ------
    ValueError
        If none of the body's markers is in the trial.
    """

    def __init__(
        self,
        body: Body,
        markers: Markers,
        weights: Mapping[str, float],
        limits: Mapping[str, tuple[float, float]],
        priors: Mapping[str, tuple[float, float]],
        *,
        tolerance: float,
        jobs: int,
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
        self.lower, self.upper = np.full(N_Q, -np.inf), np.full(N_Q, np.inf)
        for name, (low, high) in limits.items():
            self.lower[INDEX[name]], self.upper[INDEX[name]] = low, high
        self.prior_weight, self.prior_value = np.zeros(N_Q), np.zeros(N_Q)
        for name, (weight, value) in priors.items():
            self.prior_weight[INDEX[name]], self.prior_value[INDEX[name]] = weight, value
        self.rotates = np.array([not c.translates for c in TREE])
        self.slope = neutral_slopes(body)[:, known]
        self.prior, self.reference = np.empty((2, N_Q))
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
        variance = np.diag(covariance(self.slope, weight / usual, self.prior_weight / usual))
        doubt = variance * POSTURE_PRECISION - 1
        self.locked = (POSTURE_PRECISION > 0) & ~shown(self.slope, weight)
        self.undetermined = (doubt > 0) | self.locked
        held = self.undetermined & (self.prior_weight == 0)
        posture = usual * MARKER_SD_M**2 * POSTURE_PRECISION * np.minimum(doubt, 1)
        self.prior[:] = np.where(held, posture, self.prior_weight)
        self.reference[:] = np.where(held, 0.0, self.prior_value)

    def without(self, segments: Collection[str]) -> "Problem":
        """Give the problem with the markers of some segments without weight."""
        other = copy(self)
        own = np.array([s in segments for s in self.segment])
        weight = np.where(own, 0.0, self.attachment.weight)
        other.attachment = replace(self.attachment, weight=weight)
        other.prior, other.reference = np.empty((2, N_Q))
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
        return np.clip(start, self.lower, self.upper)

    def cost(self, solved: Solved) -> Array:
        """Give twice the sum that is minimised, (F,); infinite where it did not converge."""
        prior = self.prior * (solved.q - self.reference) ** 2
        markers = np.nansum(self.attachment.weight * solved.error**2, axis=1)
        return np.where(solved.converged, markers + prior.sum(axis=1), np.inf)

    def newton(self, rows: Indices, start: Array, held: tuple[Mask, Array] | None = None) -> Solved:
        """Solve some frames.

        Parameters
        ----------
        rows
            Frame numbers, (F,).
        start
            Starting points, (F, 46).
        held
            Whether coordinates are held, (F, 46), and at which values.

        Returns
        -------
        Solved
            The optima.
        """
        locked, prior, reference = self.locked, self.prior, self.reference
        if held is not None:
            locked = locked | held[0]
            prior, reference = np.where(held[0], LOCK, prior), np.where(held[0], held[1], reference)
        return self.bounded(rows, np.where(locked, reference, start), prior, reference, locked)

    def bounded(
        self, rows: Indices, start: Array, prior: Array, reference: Array, locked: Mask
    ) -> Solved:
        """Hold coordinates at limits that they would pass; release those that return inside."""
        solved = self.unbounded(rows, start, prior, reference)
        if np.isinf(self.lower).all() and np.isinf(self.upper).all():
            return solved
        held, value = np.zeros(start.shape, bool), reference
        for _ in range(MAX_ACTIVE_SET_ROUNDS):
            low, high = ~locked & (solved.q < self.lower), ~locked & (solved.q > self.upper)
            inward = held & np.where(value == self.lower, solved.q > value, solved.q < value)
            if not ((low | high) & ~held | inward).any():
                break
            held = (held | low | high) & ~inward
            limit = np.where(low, self.lower, np.where(high, self.upper, value))
            value = np.where(held, limit, reference)
            solved = self.unbounded(
                rows, np.where(held, value, solved.q), np.where(held, LOCK, prior), value
            )
        return replace(solved, q=np.clip(solved.q, self.lower, self.upper))

    def unbounded(self, rows: Indices, start: Array, prior: Array, reference: Array) -> Solved:
        """Solve without limits."""
        return solve_frames(
            self.attachment,
            rows,
            start,
            prior,
            reference,
            tolerance=self.tolerance,
            jobs=self.jobs,
        )
