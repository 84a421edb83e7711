"""Inverse kinematics: all coordinates of all frames from all markers at once.

Every frame is its own least-squares problem (Lu and O'Connor 1999, J Biomech 32:129), solved by
Newton's method until the step is below the tolerance, so no frame depends on its neighbours: not
the answer, only the starting point comes from interpolating coarsely spaced frames, which in turn
start from a segment-wise rigid fit. Chunks and workers therefore cannot show in the result.
"""

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline

from hbm.coordinates import COORDINATES, INDEX, SEGMENTS, TREE, N
from hbm.descent import Solved, Wearing, solve_frames
from hbm.markers import Markers
from hbm.model import Body
from hbm.motion import Motion
from hbm.spatial import Array, Indices, Mask
from hbm.start import starting_pose

KEY_EVERY: Final = 15
CHUNK: Final = 4000
LOCK: Final = 1e9
UNSEEN_PIVOT: Final = 1e-6
MOST_ROUNDS: Final = 10


def solve_ik(
    body: Body,
    markers: Markers,
    *,
    weights: Mapping[str, float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    tolerance: float = 1e-6,
    jobs: int = 1,
) -> Motion:
    """Find the coordinates whose markers lie nearest to the measured ones.

    Parameters
    ----------
    body
        The subject.
    markers
        Measured trajectories, lab axes; gaps are NaN. Labels that the body does not know are
        ignored.
    weights
        Marker -> weight in the sum of squares; 1 where not named.
    limits
        Coordinate -> lowest and highest value [m or rad]; unbounded where not named.
    tolerance
        Largest last step of any coordinate [rad or m]; after it one more order is gained.
    jobs
        Threads.

    Returns
    -------
    Motion
        ``q``, errors and what was observed; ``v`` and ``a`` are NaN until `filter_motion`.
        Coordinates that no marker of the trial shows stay at zero; those that lose their markers
        for a while are bridged in time from their neighbours.

    Raises
    ------
    ValueError
        If none of the body's markers is in the trial, or a weight, limit or label is unknown.
    """
    trial = _Trial(body, markers, weights or {}, limits or {}, tolerance, jobs)
    return trial.solve()


class _Trial:
    """One trial's markers against one body."""

    def __init__(
        self,
        body: Body,
        markers: Markers,
        weights: Mapping[str, float],
        limits: Mapping[str, tuple[float, float]],
        tolerance: float,
        jobs: int,
    ) -> None:
        known = [k for k, name in enumerate(body.markers) if name in markers.names]
        if not known:
            raise ValueError(
                f"none of the body's markers is in the trial; the body has "
                f"{', '.join(body.markers[:6])}, …, the trial {', '.join(markers.names[:6])}, …"
            )
        for name in weights:
            if name not in body.markers:
                raise ValueError(f"weight for {name!r}, which is no marker of the body")
        for name in limits:
            if name not in INDEX:
                raise ValueError(f"limit for {name!r}, which is no coordinate")
        self.body, self.time, self.tolerance, self.jobs = body, markers.time, tolerance, jobs
        self.names = tuple(body.markers[k] for k in known)
        self.segment = tuple(body.marker_segment[k] for k in known)
        self.local = body.marker_position[known]
        self.weights = np.array([weights.get(name, 1.0) for name in self.names])
        self.position = markers.position
        self.columns = [markers.names.index(name) for name in self.names]
        numbers = np.array([SEGMENTS.index(s) for s in self.segment])
        self.wearing = Wearing(numbers, self.local, self.weights, body.geometry)
        self.lower, self.upper = np.full(N, -np.inf), np.full(N, np.inf)
        for name, (low, high) in limits.items():
            self.lower[INDEX[name]], self.upper[INDEX[name]] = low, high
        shown = {self.segment[k] for k in range(len(known))}
        self.locked = np.array([name in body.locked for name in COORDINATES])
        self.locked |= ~_shown(shown)

    def measured(self, frames: Indices) -> Array:
        """Give the trial's markers in some frames, (F, K, 3) [m]."""
        return self.position[frames][:, self.columns]

    def solve(self) -> Motion:
        """Solve all frames: from the coarse start, else from a rigid fit, else not at all."""
        frames = len(self.time)
        start = self.coarse()
        found = _Found(frames, len(self.names))
        for at in _pieces(np.flatnonzero(~np.isnan(start[:, 0]))):
            found.take(at, *self.newton(at, start[at]))
        for some in _pieces(np.flatnonzero(~found.converged)):
            fresh = self.rigid(some)
            good = ~np.isnan(fresh[:, 0])
            found.take(some[good], *self.newton(some[good], fresh[good]))
        found.q[~found.converged] = np.nan
        found.q = _unwrapped(found.q)
        self.bridge(found)
        nothing = np.full((frames, N), np.nan)
        return Motion(
            self.time,
            found.q,
            nothing,
            nothing,
            self.names,
            found.error,
            found.converged,
            found.observed,
            found.gradient,
        )

    def coarse(self) -> Array:
        """Give every frame a starting point: some solved from scratch, splines between them."""
        frames = len(self.time)
        keys = self.key_frames()
        q = np.full((len(keys), N), np.nan)
        for some in _pieces(np.arange(len(keys))):
            guess = self.rigid(keys[some])
            good = ~np.isnan(guess[:, 0])
            solved, _ = self.newton(keys[some][good], guess[good])
            q[some[good]] = np.where(solved.converged[:, None], solved.q, np.nan)
        solved = ~np.isnan(q[:, 0])
        if solved.sum() < 4:
            return self.rigid(np.arange(frames))
        spline = make_interp_spline(keys[solved], _unwrapped(q)[solved], k=3)
        return np.asarray(spline(np.clip(np.arange(frames), keys[solved][0], keys[solved][-1])))

    def key_frames(self) -> Indices:
        """Choose the frame with the most markers of every few, and both ends."""
        frames = len(self.time)
        seen = np.isfinite(self.position[:, self.columns, 0]).sum(axis=1)
        padded = np.full(-(-frames // KEY_EVERY) * KEY_EVERY, -1)
        padded[:frames] = seen
        windows = padded.reshape(-1, KEY_EVERY)
        best = windows.argmax(axis=1) + KEY_EVERY * np.arange(len(windows))
        return np.unique([0, *best, frames - 1])

    def rigid(self, frames: Indices) -> Array:
        measured, body = self.measured(frames), self.body
        seen = np.isfinite(measured[..., 0])
        position, weight = np.where(seen[..., None], measured, 0.0), seen * self.weights
        pose = starting_pose(
            position, weight, self.local, self.segment, dict(body.offsets), dict(body.axes)
        )
        return np.where(np.isnan(pose), np.nan, np.clip(pose, self.lower, self.upper))

    def newton(
        self, frames: Indices, start: Array, held: tuple[Mask, Array] | None = None
    ) -> tuple[Solved, Mask]:
        """Solve some frames.

        Parameters
        ----------
        frames
            Frame numbers, (F,).
        start
            Where to begin, (F, 46).
        held
            Which coordinates are held, (F, 46), and at which values.

        Returns
        -------
        tuple
            The optima, and which coordinates were observed, (F, 46).
        """
        prior = np.tile(np.where(self.locked, LOCK, 0.0), (len(frames), 1))
        reference = np.zeros((len(frames), N))
        if held is not None:
            prior, reference = np.where(held[0], LOCK, prior), np.where(held[0], held[1], 0.0)
        solved = self.bounded(self.measured(frames), start, prior, reference)
        return solved, (solved.pivots > UNSEEN_PIVOT) & (prior == 0)

    def descend(self, measured: Array, start: Array, prior: Array, reference: Array) -> Solved:
        begin = np.where(prior > 0, reference, start)
        return solve_frames(
            self.wearing,
            measured,
            begin,
            prior,
            reference,
            tolerance=self.tolerance,
            jobs=self.jobs,
        )

    def bounded(self, measured: Array, start: Array, prior: Array, reference: Array) -> Solved:
        """Hold coordinates at the limits they would pass; release those that pull back inside."""
        solved = self.descend(measured, start, prior, reference)
        if np.isinf(self.lower).all() and np.isinf(self.upper).all():
            return solved
        held, free = np.zeros(start.shape, bool), prior == 0
        for _ in range(MOST_ROUNDS):
            low, high = free & (solved.q < self.lower), free & (solved.q > self.upper)
            pull = LOCK * (reference - solved.q)
            inward = held & np.where(reference <= self.lower, pull < 0, pull > 0)
            if not (low | high | inward).any():
                break
            held = (held | low | high) & ~inward
            reference = np.where(low, self.lower, np.where(high, self.upper, reference))
            lock = np.where(held, LOCK, prior)
            solved = self.descend(measured, solved.q, lock, reference)
        return solved

    def bridge(self, found: "_Found") -> None:
        """Give coordinates that lost their markers the values between their neighbours in time."""
        lost = ~found.observed & ~self.locked & found.converged[:, None]
        rows = np.flatnonzero(lost.any(axis=1))
        value = np.zeros_like(found.q)
        for i in np.flatnonzero(lost.any(axis=0)):
            known = np.flatnonzero(found.observed[:, i] & found.converged)
            if len(known):
                value[:, i] = np.interp(np.arange(len(value)), known, found.q[known, i])
        for some in _pieces(rows):
            begin = np.where(lost[some], value[some], found.q[some])
            solved, _ = self.newton(some, begin, (lost[some], value[some]))
            found.take(some, solved, found.observed[some])


class _Found:
    """What has been found of a trial so far."""

    def __init__(self, frames: int, markers: int) -> None:
        self.q, self.error = np.full((frames, N), np.nan), np.full((frames, markers), np.nan)
        self.converged, self.observed = np.zeros(frames, bool), np.zeros((frames, N), bool)
        self.gradient = np.full(frames, np.nan)

    def take(self, frames: Indices, solved: Solved, observed: Mask) -> None:
        self.q[frames], self.converged[frames] = solved.q, solved.converged
        self.observed[frames], self.gradient[frames] = observed, solved.gradient
        self.error[frames] = np.where(solved.converged[:, None], solved.error, np.nan)


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


def _pieces(frames: Indices) -> Iterator[Indices]:
    """Cut frame numbers into pieces of bounded memory."""
    return (frames[start : start + CHUNK] for start in range(0, len(frames), CHUNK))


def _unwrapped(q: Array) -> Array:
    """Make turning coordinates continuous over the frames that were solved."""
    turning = np.array([i for i, c in enumerate(TREE) if not c.translates])
    solved = np.flatnonzero(~np.isnan(q[:, 0]))
    leaps = np.abs(np.diff(q[solved], axis=0)).max(axis=0, initial=0) > np.pi
    for i in turning[leaps[turning]]:
        q[solved, i] = np.unwrap(q[solved, i])
    return q
