"""A trial's frames: from starting points to optima, through gaps, to a motion.

The optimum of a frame does not depend on its neighbours, only its starting point does: it is
interpolated between coarsely spaced frames, which in turn start from a segment-wise rigid fit
(`hbm.ik.start`). Where an optimum is far from its start, the frame is solved again from the rigid
fit, and the pose that fits the markers better is kept. The result therefore depends neither on how
many frames are solved at once nor on the number of threads.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline

from hbm.coordinates import COORDINATES, INDEX, MOVING, N_Q, TREE
from hbm.ik.attachment import MarkerAttachment
from hbm.ik.continuity import continuous
from hbm.ik.descent import Solved, solve_frames
from hbm.ik.start import starting_pose
from hbm.markers import Markers
from hbm.model import Body
from hbm.motion import Motion
from hbm.spatial import Array, Indices, Mask

KEY_FRAME_SPACING: Final = 15
"""Frames per key frame: 0.15 s at 100 Hz, so that a spline between them starts near the optimum."""

MIN_KEY_FRAMES: Final = 4
"""Key frames that a cubic spline needs."""

MAX_DISTANCE_FROM_START: Final = 0.5
"""Change of any coordinate from its start [rad or m]: an optimum farther away may be the wrong one
of several."""

FRAMES_AT_ONCE: Final = 4000
"""Bounds the memory of the rigid fits."""

LOCK: Final = 1e9
"""Prior weight of a coordinate that is held [m²/rad², or 1 for a translation]: markers, which weigh
about 1, move it by about 1e-9 rad."""

MIN_PIVOT: Final = 1e-6
"""Curvature, per unit of weight, from which on a coordinate counts as observed [m²/rad² or 1]: that
of a marker 1 mm from the axis."""

MIN_PIVOT_SHARE: Final = 0.01
"""The same in frames with missing markers, as a share of what is usual in the trial."""

MAX_UNRELATED_PIVOT: Final = 1e-8
"""Curvature below which no marker depends on an unobserved coordinate: changing it then moves no
other."""

N_PELVIS: Final = 6
"""The pelvis' coordinates, the first of all: without them a frame cannot be solved."""

MAX_ACTIVE_SET_ROUNDS: Final = 10
"""Rounds of holding coordinates at limits and releasing them; a few suffice."""


class Tracker:
    """One trial's markers against one body."""

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
        self.locked = np.array([name in body.locked for name in COORDINATES])
        self.locked |= ~_with_markers_beyond(set(self.segment))
        self.prior = np.where(self.locked, LOCK, self.prior_weight)
        self.reference = np.where(self.locked, 0.0, self.prior_value)

    def motion(self) -> Motion:
        """Solve all frames."""
        frames = np.arange(len(self.time))
        start, usual_pivots = self.starting_points()
        found = self.newton(frames, start)
        doubtful = np.flatnonzero(~found.converged | self.far(found.q, start))
        self.try_alternative_start(found, doubtful, doubtful, self.rigid_fit(doubtful))
        observed = self.observed(found, usual_pivots)
        pelvis: Mask = np.asarray(observed[:, :N_PELVIS].all(axis=1))
        found.q[~pelvis | ~found.converged & observed[:, ~self.locked].all(axis=1)] = np.nan
        found.q[:] = continuous(found.q)
        self.bridge_gaps(found, observed & pelvis[:, None])
        found.converged[~pelvis] = False
        found.q[~found.converged] = np.nan
        found.error[~found.converged] = np.nan
        not_yet = np.full(found.q.shape, np.nan)
        return Motion(
            self.time,
            found.q,
            not_yet,
            not_yet,
            self.names,
            found.error,
            found.converged,
            observed & found.converged[:, None],
            found.gradient,
        )

    def starting_points(self) -> tuple[Array, Array]:
        """Give every frame a starting point: splines between key frames solved from rigid fits.

        Returns
        -------
        start
            Starting points, (T, 46); NaN where nothing is known.
        usual_pivots
            The median pivots of the key frames, (46,).
        """
        frames = np.arange(len(self.time))
        keys = self.key_frames()
        found = self.newton(keys, self.rigid_fit(keys))
        solved = np.flatnonzero(found.converged)
        pivots = np.median(found.pivots[solved], axis=0) if len(solved) else np.zeros(N_Q)
        if len(solved) < MIN_KEY_FRAMES:
            return self.rigid_fit(frames), pivots
        found.q[solved] = continuous(found.q[solved])
        inner = solved[1:-1]
        between = (found.q[solved[:-2]] + found.q[solved[2:]]) / 2
        isolated = self.far(found.q[inner], between)
        rows = inner[isolated]
        self.try_alternative_start(found, rows, keys[rows], between[isolated])
        spline = make_interp_spline(keys[solved], continuous(found.q[solved]), k=3)
        return np.asarray(spline(np.clip(frames, keys[solved[0]], keys[solved[-1]]))), pivots

    def far(self, q: Array, start: Array) -> Mask:
        """Whether poses are far from their starting points, (F,)."""
        return np.asarray(np.abs(q - start).max(axis=1, initial=0) > MAX_DISTANCE_FROM_START)

    def try_alternative_start(
        self, found: Solved, rows: Indices, frames: Indices, start: Array
    ) -> None:
        """Solve some of the frames again, from another start; keep the lower optimum."""
        solved = self.newton(frames, start)
        before, after = (
            np.where(optima.converged, self.cost(optima), np.inf)
            for optima in (found.select(rows), solved)
        )
        better = after < before
        found.overwrite(rows[better], solved.select(better))

    def cost(self, solved: Solved) -> Array:
        """Give twice the sum that is minimised, (F,)."""
        prior = self.prior_weight * (solved.q - self.prior_value) ** 2
        markers = np.nansum(self.attachment.weight * solved.error**2, axis=1)
        return np.asarray(markers + prior.sum(axis=1))

    def observed(self, found: Solved, usual_pivots: Array) -> Mask:
        """Which coordinates the visible markers determine, (T, 46).

        A coordinate is determined where the curvature that remains to it once all coordinates
        beyond it are free (its pivot) is not nearly zero and, in frames with missing markers, not
        small compared with what is usual in the trial.
        """
        missing = np.isnan(found.error)
        gaps = (missing & ~missing.all(axis=0)).any(axis=1)
        least = np.full(N_Q, MIN_PIVOT * self.attachment.weight.max())
        from_markers = found.pivots - self.prior_weight
        observed = from_markers > least
        observed[gaps] &= from_markers[gaps] > MIN_PIVOT_SHARE * usual_pivots
        return np.asarray(observed & ~self.locked)

    def key_frames(self) -> Indices:
        """Choose the frame with the most markers in each interval, and both ends."""
        frames = len(self.time)
        position, column = self.attachment.position, self.attachment.column
        count = np.full(-(-frames // KEY_FRAME_SPACING) * KEY_FRAME_SPACING, -1)
        count[:frames] = np.isfinite(position[:, column, 0]).sum(axis=1)
        intervals = count.reshape(-1, KEY_FRAME_SPACING)
        best = intervals.argmax(axis=1) + KEY_FRAME_SPACING * np.arange(len(intervals))
        return np.unique([0, *best, frames - 1])

    def rigid_fit(self, rows: Indices) -> Array:
        """Give starting points that depend on the frame itself alone, (F, 46)."""
        start, body = np.empty((len(rows), N_Q)), self.body
        for first in range(0, len(rows), FRAMES_AT_ONCE):
            block = slice(first, first + FRAMES_AT_ONCE)
            measured = self.attachment.measured(rows[block])
            seen = np.isfinite(measured[..., 0])
            start[block] = starting_pose(
                np.where(seen[..., None], measured, 0.0),
                seen * self.attachment.weight,
                self.attachment.local,
                self.segment,
                body.joints,
            )
        return np.clip(start, self.lower, self.upper)

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

    def bridge_gaps(self, found: Solved, observed: Mask) -> None:
        """Interpolate coordinates that lost their markers between their neighbours in time.

        Where a remaining marker depends on them, the other coordinates are solved again.
        """
        present = ~np.isnan(found.q[:, 0])
        lost = ~(observed | self.locked) & present[:, None]
        related = ~found.converged[:, None] | (
            found.pivots - self.prior_weight > MAX_UNRELATED_PIVOT
        )
        rows = np.flatnonzero((lost & related).any(axis=1))
        for i in np.flatnonzero(lost.any(axis=0)):
            gap = np.flatnonzero(lost[:, i])
            known = np.flatnonzero(observed[:, i] & found.converged)
            found.q[gap, i] = np.interp(gap, known, found.q[known, i]) if len(known) else 0.0
        found.overwrite(rows, self.newton(rows, found.q[rows], (lost[rows], found.q[rows])))


def _with_markers_beyond(segments: set[str]) -> Mask:
    """Which coordinates have one of these segments beyond them, (46,)."""
    carries = np.zeros(N_Q, bool)
    for i in reversed(range(N_Q)):
        last = i + 1 == N_Q or TREE[i + 1].segment != TREE[i].segment
        if last and TREE[i].segment in segments:
            carries[i] = True
        if carries[i] and TREE[i].parent >= 0:
            carries[TREE[i].parent] = True
    return carries
