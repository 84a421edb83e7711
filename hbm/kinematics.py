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
from hbm.markers import Markers
from hbm.model import Body
from hbm.motion import Motion
from hbm.native import Kernels, kernels
from hbm.spatial import Array, Indices, Mask
from hbm.start import starting_pose

KEY_EVERY: Final = 10
CHUNK: Final = 4000
LOCK: Final = 1e9
FLOOR: Final = 1e-9
UNSEEN_PIVOT: Final = 1e-6
MAX_STEP: Final = 0.5
MAX_ITERATIONS: Final = 60


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
        self.geometry = body.geometry
        self.lower, self.upper = np.full(N, -np.inf), np.full(N, np.inf)
        for name, (low, high) in limits.items():
            self.lower[INDEX[name]], self.upper[INDEX[name]] = low, high
        shown = {self.segment[k] for k in range(len(known))}
        self.locked = np.array([name in body.locked for name in COORDINATES])
        self.locked |= ~_shown(shown)
        self.kernels: Kernels = kernels()

    def measured(self, frames: Indices) -> tuple[Array, Array]:
        """Positions (gaps as zeros) and weights of some frames."""
        position = self.position[frames][:, self.columns]
        seen = ~np.isnan(position[..., 0])
        return np.where(seen[..., None], position, 0.0), seen * self.weights

    def sums(self, position: Array, weight: Array) -> Array:
        """Sum markers per segment (`hbm.skeleton.N_SUMS`), (T, 23 · segments)."""
        p = self.local
        xx, yy, zz = p.T**2
        xy, xz, yz = p[:, 0] * p[:, 1], p[:, 0] * p[:, 2], p[:, 1] * p[:, 2]
        plain = np.column_stack([np.ones(len(p)), p, xx, yy, zz, xy, xz, yz])
        crossed = np.column_stack([np.ones(len(p)), p])
        out = np.zeros((len(position), len(SEGMENTS), 23))
        for s, name in enumerate(SEGMENTS):
            own = [k for k, x in enumerate(self.segment) if x == name]
            if not own:
                continue
            w, m = weight[:, own], position[:, own]
            out[:, s, :10] = w @ plain[own]
            weighted = w[..., None] * m
            products = np.einsum("tki,ka->tai", weighted, crossed[own])
            out[:, s, 10:22] = products.reshape(len(position), 12)
            out[:, s, 22] = np.einsum("tki,tki->t", weighted, m)
        return out.reshape(len(position), 23 * len(SEGMENTS))

    def solve(self) -> Motion:
        frames = len(self.time)
        start = self.coarse()
        q, error = np.full((frames, N), np.nan), np.full((frames, len(self.names)), np.nan)
        converged, observed = np.zeros(frames, bool), np.zeros((frames, N), bool)
        for at in _pieces(np.flatnonzero(~np.isnan(start[:, 0]))):
            q[at], converged[at], observed[at] = self.newton(at, start[at])
        retry = np.flatnonzero(~converged)
        for some in _pieces(retry):
            fresh = self.rigid(some)
            good = ~np.isnan(fresh[:, 0])
            at = some[good]
            q[at], converged[at], observed[at] = self.newton(at, fresh[good])
        q[~converged] = np.nan
        q = _unwrapped(q)
        self.bridge(q, converged, observed)
        for at in _pieces(np.arange(frames)):
            error[at] = self.errors(at, q[at])
        nothing = np.full((frames, N), np.nan)
        return Motion(self.time, q, nothing, nothing, self.names, error, converged, observed)

    def coarse(self) -> Array:
        """Give every frame a starting point: every tenth solved from scratch, splines between."""
        frames = len(self.time)
        keys = np.unique(np.append(np.arange(0, frames, KEY_EVERY), frames - 1))
        q = np.full((len(keys), N), np.nan)
        for some in _pieces(np.arange(len(keys))):
            guess = self.rigid(keys[some])
            good = ~np.isnan(guess[:, 0])
            solved, converged, _ = self.newton(keys[some][good], guess[good])
            q[some[good]] = np.where(converged[:, None], solved, np.nan)
        solved = ~np.isnan(q[:, 0])
        if solved.sum() < 4:
            return self.rigid(np.arange(frames))
        spline = make_interp_spline(keys[solved], _unwrapped(q)[solved], k=3)
        return np.asarray(spline(np.clip(np.arange(frames), keys[solved][0], keys[solved][-1])))

    def rigid(self, frames: Indices) -> Array:
        position, weight = self.measured(frames)
        body = self.body
        pose = starting_pose(
            position, weight, self.local, self.segment, dict(body.offsets), dict(body.axes)
        )
        return np.where(np.isnan(pose), np.nan, np.clip(pose, self.lower, self.upper))

    def newton(
        self, frames: Indices, start: Array, held: tuple[Mask, Array] | None = None
    ) -> tuple[Array, Mask, Mask]:
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
            ``q`` (F, 46), whether converged (F,), which coordinates were observed (F, 46).
        """
        total = len(frames)
        sums = self.sums(*self.measured(frames))
        prior = np.tile(np.where(self.locked, LOCK, 0.0), (total, 1))
        reference = np.zeros((total, N))
        if held is not None:
            prior, reference = np.where(held[0], LOCK, prior), np.where(held[0], held[1], 0.0)
        begin = np.where(prior > 0, reference, start)
        q, done, pivots = self.descend(begin, sums, prior, reference)
        if np.isfinite(self.lower).any() or np.isfinite(self.upper).any():
            q, done = self.bounded(q, done, sums, prior, reference)
        return q, done, (pivots > UNSEEN_PIVOT) & (prior == 0)

    def descend(
        self, start: Array, sums: Array, prior: Array, reference: Array
    ) -> tuple[Array, Mask, Array]:
        """Newton's method with halving steps; Gauss–Newton where the Hessian is not positive."""
        total = len(start)
        q, best = start.copy(), start.copy()
        cost_best, step = np.full(total, np.inf), np.zeros((total, N))
        curvature, halvings = np.ones(total), np.zeros(total, int)
        done, pivots = np.zeros(total, bool), np.zeros((total, N))
        active = np.arange(total)
        for _ in range(MAX_ITERATIONS):
            new, report = self.kernels.newton_step(
                *(x[active] for x in (q, sums, prior, reference)),
                np.full((len(active), 1), FLOOR),
                curvature[active, None],
                self.geometry,
                jobs=self.jobs,
            )
            cost, pivot = report[:, 0], report[:, 2:]
            worse = ~(cost <= cost_best[active] * (1 + 1e-9) + 1e-12)
            bent = ~worse & (pivot.min(axis=1) <= 0) & (curvature[active] > 0)
            fine = ~worse & ~bent
            back = active[worse]
            halvings[back] += 1
            step[back] /= 4
            q[back] = best[back] + step[back]
            curvature[active[bent]] = 0
            good = active[fine]
            size = np.abs(new[fine]).max(axis=1, initial=0)
            step[good] = new[fine] * np.minimum(1, MAX_STEP / np.maximum(size, 1e-300))[:, None]
            best[good], cost_best[good] = q[good], cost[fine]
            pivots[good] = pivot[fine]
            q[good] = best[good] + step[good]
            finished = good[size < self.tolerance]
            done[finished] = True
            near = good[size < 0.1]
            curvature[near] = 1
            stuck = halvings > 20
            active = np.flatnonzero(~done & ~stuck)
            if not len(active):
                break
        return q, done, pivots

    def bounded(
        self, q: Array, done: Mask, sums: Array, prior: Array, reference: Array
    ) -> tuple[Array, Mask]:
        """Hold coordinates at the limits they would pass; release those that pull back inside."""
        held = np.zeros(q.shape, bool)
        free = prior == 0
        for _ in range(10):
            low, high = free & (q < self.lower), free & (q > self.upper)
            pull = LOCK * (reference - q)
            inward = held & np.where(reference <= self.lower, pull < 0, pull > 0)
            changed = low | high | inward
            rows = np.flatnonzero(changed.any(axis=1))
            if not len(rows):
                break
            held = (held | low | high) & ~inward
            reference = np.where(low, self.lower, np.where(high, self.upper, reference))
            lock = np.where(held, LOCK, prior)
            begin = np.where(lock > 0, reference, q)
            q[rows], done[rows], _ = self.descend(
                begin[rows], sums[rows], lock[rows], reference[rows]
            )
        return q, done

    def bridge(self, q: Array, converged: Mask, observed: Mask) -> None:
        """Give coordinates that lost their markers the values between their neighbours in time."""
        lost = ~observed & ~self.locked & converged[:, None]
        rows = np.flatnonzero(lost.any(axis=1))
        value = np.zeros_like(q)
        for i in np.flatnonzero(lost.any(axis=0)):
            known = np.flatnonzero(observed[:, i] & converged)
            if len(known):
                value[:, i] = np.interp(np.arange(len(q)), known, q[known, i])
        for some in _pieces(rows):
            begin = np.where(lost[some], value[some], q[some])
            q[some], converged[some], _ = self.newton(some, begin, (lost[some], value[some]))

    def errors(self, frames: Indices, q: Array) -> Array:
        """Distance of every marker from the model, (F, K) [m]."""
        poses = self.kernels.segment_poses(q, self.geometry, jobs=self.jobs)[0]
        poses = poses.reshape(len(q), len(SEGMENTS), 4, 3)
        own = [SEGMENTS.index(s) for s in self.segment]
        local = np.column_stack([self.local, np.ones(len(own))])
        model = np.einsum("tkai,ka->tki", poses[:, own], local)
        away = model - self.position[frames][:, self.columns]
        return np.asarray(np.linalg.norm(away, axis=-1))


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
    out = q.copy()
    solved = ~np.isnan(q[:, 0])
    turning = [i for i, c in enumerate(TREE) if not c.translates]
    continuous = np.unwrap(q[solved], axis=0)
    for i in turning:
        out[solved, i] = continuous[:, i]
    return out
