"""One trial's frames: from starting points to optima, through gaps, to a motion.

No frame's answer depends on its neighbours, only its starting point does: it comes from
interpolating coarsely spaced frames, which in turn start from a segment-wise rigid fit
(`hbm.ik.start`). Where the answer is far from such a start, the rigid fit gets its say as well, and
the pose that meets the markers better is kept. Chunks and workers therefore cannot show in the
result.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline

from hbm.coordinates import COORDINATES, INDEX, SEGMENTS, TREE, N
from hbm.ik.attachment import MarkerAttachment
from hbm.ik.continuity import continuous
from hbm.ik.descent import Solved, solve_frames
from hbm.ik.start import starting_pose
from hbm.markers import Markers
from hbm.model import Body
from hbm.motion import Motion
from hbm.spatial import Array, Indices, Mask

KEY_EVERY: Final = 15
CHUNK: Final = 4000
LOCK: Final = 1e9
LEAST_PIVOT: Final = 1e-6
UNFELT: Final = 1e-8
LEAST_SHARE: Final = 0.01
FAR: Final = 0.5
LEAST_KEYS: Final = 4
PELVIS: Final = 6
MOST_ROUNDS: Final = 10


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
            np.array([SEGMENTS.index(s) for s in self.segment]),
            body.marker_position[known],
            np.array([weights.get(name, 1.0) for name in self.names]),
            body.geometry,
            markers.position,
            np.array([markers.names.index(name) for name in self.names]),
        )
        self.lower, self.upper = np.full(N, -np.inf), np.full(N, np.inf)
        for name, (low, high) in limits.items():
            self.lower[INDEX[name]], self.upper[INDEX[name]] = low, high
        self.pull, self.toward = np.zeros(N), np.zeros(N)
        for name, (weight, value) in priors.items():
            self.pull[INDEX[name]], self.toward[INDEX[name]] = weight, value
        self.locked = np.array([name in body.locked for name in COORDINATES])
        self.locked |= ~_shown(set(self.segment))
        self.prior = np.where(self.locked, LOCK, self.pull)
        self.reference = np.where(self.locked, 0.0, self.toward)

    def motion(self) -> Motion:
        """Solve all frames."""
        frames = np.arange(len(self.time))
        start, usual = self.coarse()
        found = self.newton(frames, start)
        doubtful = np.flatnonzero(~found.converged | self.far(found.q, start))
        self.second_opinion(found, doubtful, self.rigid(doubtful))
        observed = self.observed(found, usual)
        pelvis: Mask = np.asarray(observed[:, :PELVIS].all(axis=1))
        found.q[~pelvis | ~found.converged & observed[:, ~self.locked].all(axis=1)] = np.nan
        found.q[:] = continuous(found.q)
        self.bridge(found, observed & pelvis[:, None])
        found.converged[~pelvis] = False
        found.q[~found.converged] = np.nan
        found.error[~found.converged] = np.nan
        nothing = np.full(found.q.shape, np.nan)
        return Motion(
            self.time,
            found.q,
            nothing,
            nothing,
            self.names,
            found.error,
            found.converged,
            observed & found.converged[:, None],
            found.gradient,
        )

    def coarse(self) -> tuple[Array, Array]:
        """Give every frame a starting point: some solved from scratch, splines between them.

        Returns
        -------
        start
            Starting points, (T, 46); NaN where nothing is known.
        usual
            The usual pivots of the solved frames, (46,).
        """
        frames = np.arange(len(self.time))
        keys = self.key_frames()
        found = self.newton(keys, self.rigid(keys))
        solved = np.flatnonzero(found.converged)
        usual = np.median(found.pivots[solved], axis=0) if len(solved) else np.zeros(N)
        if len(solved) < LEAST_KEYS:
            return self.rigid(frames), usual
        found.q[solved] = continuous(found.q[solved])
        inner = solved[1:-1]
        between = (found.q[solved[:-2]] + found.q[solved[2:]]) / 2
        lonely = self.far(found.q[inner], between)
        self.second_opinion(found, inner[lonely], between[lonely], keys)
        spline = make_interp_spline(keys[solved], continuous(found.q[solved]), k=3)
        return np.asarray(spline(np.clip(frames, keys[solved[0]], keys[solved[-1]]))), usual

    def far(self, q: Array, start: Array) -> Mask:
        """Whether poses are far from where they began, (F,)."""
        return np.asarray(np.abs(q - start).max(axis=1, initial=0) > FAR)

    def second_opinion(
        self, found: Solved, rows: Indices, start: Array, frames: Indices | None = None
    ) -> None:
        """Solve rows of what has been found from elsewhere, too, and keep what is nearer."""
        solved = self.newton(rows if frames is None else frames[rows], start)
        before, after = (
            np.where(some.converged, self.cost(some), np.inf)
            for some in (found.select(rows), solved)
        )
        better = after < before
        found.overwrite(rows[better], solved.select(better))

    def cost(self, solved: Solved) -> Array:
        """Give the sum that is minimised, twice, (F,)."""
        pulled = self.pull * (solved.q - self.toward) ** 2
        missed = np.nansum(self.attachment.weight * solved.error**2, axis=1)
        return np.asarray(missed + pulled.sum(axis=1))

    def observed(self, found: Solved, usual: Array) -> Mask:
        """Which coordinates the visible markers determine, (T, 46).

        The curvature that is left to a coordinate once all beyond it are free tells: nothing, or
        where markers are missing, a hundredth of what is usual in the trial, is too little.
        """
        missing = np.isnan(found.error)
        gaps = (missing & ~missing.all(axis=0)).any(axis=1)
        least = np.full(N, LEAST_PIVOT * self.attachment.weight.max())
        observed = found.pivots - self.pull > least
        observed[gaps] &= found.pivots[gaps] - self.pull > LEAST_SHARE * usual
        return np.asarray(observed & ~self.locked)

    def key_frames(self) -> Indices:
        """Choose the frame with the most markers of every few, and both ends."""
        frames = len(self.time)
        seen = np.isfinite(self.attachment.position[:, self.attachment.column, 0]).sum(axis=1)
        padded = np.full(-(-frames // KEY_EVERY) * KEY_EVERY, -1)
        padded[:frames] = seen
        windows = padded.reshape(-1, KEY_EVERY)
        best = windows.argmax(axis=1) + KEY_EVERY * np.arange(len(windows))
        return np.unique([0, *best, frames - 1])

    def rigid(self, rows: Indices) -> Array:
        """Give starting points that know of nothing but the frame itself, (F, 46)."""
        start, body = np.empty((len(rows), N)), self.body
        for first in range(0, len(rows), CHUNK):
            some = slice(first, first + CHUNK)
            measured = self.attachment.measured(rows[some])
            seen = np.isfinite(measured[..., 0])
            start[some] = starting_pose(
                np.where(seen[..., None], measured, 0.0),
                seen * self.attachment.weight,
                self.attachment.local,
                self.segment,
                dict(body.offsets),
                dict(body.axes),
            )
        return np.clip(start, self.lower, self.upper)

    def newton(self, rows: Indices, start: Array, held: tuple[Mask, Array] | None = None) -> Solved:
        """Solve some frames.

        Parameters
        ----------
        rows
            Frame numbers, (F,).
        start
            Where to begin, (F, 46).
        held
            Which coordinates are held, (F, 46), and at which values.

        Returns
        -------
        Solved
            The optima.
        """
        lock, prior, reference = self.locked, self.prior, self.reference
        if held is not None:
            lock = lock | held[0]
            prior, reference = np.where(held[0], LOCK, prior), np.where(held[0], held[1], reference)
        return self.bounded(rows, np.where(lock, reference, start), prior, reference, lock)

    def descend(self, rows: Indices, start: Array, prior: Array, reference: Array) -> Solved:
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
        self, rows: Indices, start: Array, prior: Array, reference: Array, lock: Mask
    ) -> Solved:
        """Hold coordinates at the limits they would pass; release those that pull back inside."""
        solved = self.descend(rows, start, prior, reference)
        if np.isinf(self.lower).all() and np.isinf(self.upper).all():
            return solved
        held, at = np.zeros(start.shape, bool), reference
        for _ in range(MOST_ROUNDS):
            low, high = ~lock & (solved.q < self.lower), ~lock & (solved.q > self.upper)
            inward = held & np.where(at == self.lower, solved.q > at, solved.q < at)
            if not ((low | high) & ~held | inward).any():
                break
            held = (held | low | high) & ~inward
            at = np.where(
                held, np.where(low, self.lower, np.where(high, self.upper, at)), reference
            )
            solved = self.descend(
                rows,
                np.where(held, at, solved.q),
                np.where(held, LOCK, prior),
                at,
            )
        return replace(solved, q=np.clip(solved.q, self.lower, self.upper))

    def bridge(self, found: Solved, observed: Mask) -> None:
        """Give coordinates that lost their markers the values between their neighbours in time.

        Where a marker still feels them the other coordinates adapt.
        """
        present = ~np.isnan(found.q[:, 0])
        lost = ~(observed | self.locked) & present[:, None]
        felt = ~found.converged[:, None] | (found.pivots - self.pull > UNFELT)
        rows = np.flatnonzero((lost & felt).any(axis=1))
        for i in np.flatnonzero(lost.any(axis=0)):
            gone = np.flatnonzero(lost[:, i])
            known = np.flatnonzero(observed[:, i] & found.converged)
            found.q[gone, i] = np.interp(gone, known, found.q[known, i]) if len(known) else 0.0
        found.overwrite(rows, self.newton(rows, found.q[rows], (lost[rows], found.q[rows])))


def _shown(segments: set[str]) -> Mask:
    """Which coordinates have a marker somewhere beyond them."""
    shown = np.zeros(N, bool)
    for i in reversed(range(N)):
        last = i + 1 == N or TREE[i + 1].segment != TREE[i].segment
        if last and TREE[i].segment in segments:
            shown[i] = True
        if shown[i] and TREE[i].parent >= 0:
            shown[TREE[i].parent] = True
    return shown
