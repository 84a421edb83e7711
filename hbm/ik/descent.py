"""Newton's method for the coordinates of many frames, from starting points to optima.

In one native call per stretch of frames (``descent.c``) or, without a compiler, in NumPy around the
same kernels on the virtual machine. Each frame goes its own way: it goes back most of a step where
the cost rises, does without the curvature where the Hessian is not positive, and ends once its step
is below the tolerance.
"""

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from hbm.coordinates import SEGMENTS, N
from hbm.kernels.native import Kernels, kernels
from hbm.kernels.skeleton import N_SUMS
from hbm.spatial import Array, Indices, Mask

FLOOR: Final = 1e-9
LARGEST_STEP: Final = 0.5
NEAR: Final = 0.1
MOST_ITERATIONS: Final = 60
MOST_RETREATS: Final = 20
LEAST_SHARE: Final = 64
CHUNK: Final = 4000


@dataclass(frozen=True, slots=True)
class Wearing:
    """Markers on a skeleton, and where they were measured.

    Attributes
    ----------
    segment
        Number of the segment that each marker rides on, (K,).
    local
        Place of each marker in its segment, (K, 3) [m].
    weight
        Of each marker in the sum of squares, (K,).
    geometry
        The body's offsets and hinge axes, as the kernels take them.
    position
        Measured markers of the whole trial in the lab, (T, M, 3) [m]; NaN where missing.
    column
        Which of the measured markers each one is, (K,).
    """

    segment: Indices
    local: Array
    weight: Array
    geometry: Array
    position: Array
    column: Indices

    def __post_init__(self) -> None:
        for name in ("segment", "column"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), np.int64))
        for name in ("local", "weight", "geometry", "position"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), float))

    def measured(self, rows: Indices) -> Array:
        """Give the markers in some frames of the trial, (F, K, 3) [m]."""
        return self.position[rows[:, None], self.column]


@dataclass(frozen=True, slots=True)
class Solved:
    """Optima of many frames.

    Attributes
    ----------
    q
        Coordinates, (F, 46) [m and rad].
    converged
        Whether the last step was below the tolerance, (F,).
    gradient
        Largest entry of the cost's gradient before that step, (F,) [m and m²/rad].
    pivots
        Of the Hessian's factorisation, (F, 46): near zero where no marker shows a coordinate.
    error
        Distance of each marker from the model, (F, K) [m]; NaN where it was missing.
    """

    q: Array
    converged: Mask
    gradient: Array
    pivots: Array
    error: Array

    @classmethod
    def empty(cls, frames: int, markers: int) -> "Solved":
        """Make room for frames."""
        return cls(
            np.empty((frames, N)),
            np.zeros(frames, bool),
            np.full(frames, np.nan),
            np.empty((frames, N)),
            np.empty((frames, markers)),
        )

    def take(self, rows: Indices | slice, other: "Solved") -> None:
        """Replace some frames by those of another solution."""
        for name in self.__slots__:
            getattr(self, name)[rows] = getattr(other, name)

    def only(self, frames: Mask | Indices) -> "Solved":
        """Give some of the frames."""
        return Solved(*(getattr(self, name)[frames] for name in self.__slots__))


def solve_frames(
    wearing: Wearing,
    rows: Indices,
    start: Array,
    prior: Array,
    reference: Array,
    *,
    tolerance: float,
    jobs: int = 1,
) -> Solved:
    """Minimise ``Σ w |r(q) − m|²/2 + Σ prior (q − reference)²/2`` in every frame.

    Parameters
    ----------
    wearing
        Markers on the skeleton.
    rows
        Frames of the trial to solve, (F,).
    start
        Starting points, (F, 46); a frame whose start is NaN is not solved.
    prior, reference
        Strength of the pull on each coordinate and where it pulls to, (F, 46) or (46,).
    tolerance
        Largest last step [rad or m].
    jobs
        Threads; the result does not depend on it.

    Returns
    -------
    Solved
        One optimum per frame.

    Notes
    -----
    Each frame is solved about the pelvis of its starting point, so that rounding does not grow with
    the distance from the lab's origin.
    """
    ready = kernels()
    rows = np.ascontiguousarray(rows, np.int64)
    start, prior, reference = (np.ascontiguousarray(x, float) for x in (start, prior, reference))
    given = (start, np.broadcast_to(prior, start.shape), np.broadcast_to(reference, start.shape))
    if ready.solve_frames is not None:
        return _native(ready.solve_frames, wearing, rows, *given, tolerance, jobs)
    solved = Solved.empty(len(rows), len(wearing.segment))
    for first in range(0, len(rows), CHUNK):
        some = slice(first, first + CHUNK)
        begin, pull, toward = (x[some] for x in given)
        found = _interpreted(ready, wearing, rows[some], begin, pull, toward, tolerance, jobs)
        solved.take(some, found)
    return solved


class _Task(ctypes.Structure):
    """What ``descent.c`` is told."""

    _fields_: ClassVar = [
        *((name, ctypes.c_longlong) for name in ("frames", "markers", "measured")),
        *((name, ctypes.c_longlong) for name in ("prior_stride", "reference_stride")),
        *((name, ctypes.c_void_p) for name in ("row", "column", "segment", "local", "weight")),
        *((name, ctypes.c_void_p) for name in ("geometry", "position", "start", "prior")),
        ("reference", ctypes.c_void_p),
        ("tolerance", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("q", "pivots", "error", "gradient", "converged")),
    ]


def _native(
    call: Callable[..., None],
    wearing: Wearing,
    rows: Indices,
    start: Array,
    prior: Array,
    reference: Array,
    tolerance: float,
    jobs: int,
) -> Solved:
    """Hand stretches of frames to the compiled descent."""
    solved = Solved.empty(len(rows), len(wearing.segment))
    shared = {name: getattr(wearing, name).ctypes.data for name in Wearing.__slots__}
    given = {"row": rows, "start": start, "prior": prior, "reference": reference}
    given |= {name: getattr(solved, name) for name in Solved.__slots__}

    def stretch(first: int, last: int) -> None:
        own = {name: x.ctypes.data + first * x.strides[0] for name, x in given.items()}
        task = _Task(
            frames=last - first,
            markers=len(wearing.segment),
            measured=wearing.position.shape[1],
            prior_stride=prior.strides[0] // prior.itemsize,
            reference_stride=reference.strides[0] // reference.itemsize,
            tolerance=tolerance,
            **shared,
            **own,
        )
        call(ctypes.byref(task))

    shares = max(1, min(jobs, len(rows) // LEAST_SHARE))
    borders = [len(rows) * k // shares for k in range(shares + 1)]
    if shares == 1:
        stretch(0, len(rows))
    else:
        with ThreadPoolExecutor(shares) as pool:
            list(pool.map(stretch, borders[:-1], borders[1:]))
    return solved


def _interpreted(
    ready: Kernels,
    wearing: Wearing,
    rows: Indices,
    start: Array,
    prior: Array,
    reference: Array,
    tolerance: float,
    jobs: int,
) -> Solved:
    """Do what ``descent.c`` does, for all frames that are still on their way at once."""
    total, here = len(start), np.zeros_like(start)
    here[:, :3] = start[:, :3]
    measured = wearing.measured(rows) - here[:, None, :3]
    given = _sum_markers(wearing, measured), prior, reference - here
    q = start - here
    best, move, pivots = q.copy(), np.zeros((total, N)), np.full((total, N), np.nan)
    cost, gradient = np.full(total, np.inf), np.full(total, np.nan)
    curvature, retreats, converged = np.ones(total), np.zeros(total, int), np.zeros(total, bool)
    active = np.flatnonzero(~np.isnan(start).any(axis=1))
    for _ in range(MOST_ITERATIONS):
        if not len(active):
            break
        step, report = ready.newton_step(
            *(x[active] for x in (q, *given)),
            np.full((len(active), 1), FLOOR),
            curvature[active, None],
            wearing.geometry,
            jobs=jobs,
        )
        pivots[active] = report[:, 2:]
        worse = ~(report[:, 0] <= cost[active] * (1 + 1e-9) + 1e-12)
        bent = ~worse & (report[:, 2:].min(axis=1) <= 0) & (curvature[active] > 0)
        back = active[worse]
        retreats[back] += 1
        move[back] /= 4
        q[back] = best[back] + move[back]
        curvature[active[bent]] = 0

        fine = ~worse & ~bent
        good, size = active[fine], np.abs(step[fine]).max(axis=1, initial=0)
        share = np.where(size > LARGEST_STEP, LARGEST_STEP / np.maximum(size, LARGEST_STEP), 1.0)
        cost[good], gradient[good] = report[fine, :2].T
        best[good], move[good] = q[good], share[:, None] * step[fine]
        q[good] += move[good]
        curvature[good[size < NEAR]] = 1
        converged[good] = size < tolerance
        active = active[~converged[active] & (retreats[active] <= MOST_RETREATS)]
    error = _errors(ready, wearing, measured, q, jobs)
    return Solved(q + here, converged, gradient, pivots, error)


def _sum_markers(wearing: Wearing, position: Array) -> Array:
    """Sum markers per segment (`hbm.kernels.skeleton.N_SUMS`), (T, 23 · segments)."""
    seen = np.isfinite(position[..., 0])
    measured, weight = np.where(seen[..., None], position, 0.0), seen * wearing.weight
    p = wearing.local
    products = [p[:, i] * p[:, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    plain = np.column_stack([np.ones(len(p)), p, *products])
    crossed = np.column_stack([np.ones(len(p)), p])
    sums = np.zeros((len(position), len(SEGMENTS), N_SUMS))
    for s in np.unique(wearing.segment):
        own = np.flatnonzero(wearing.segment == s)
        w, m = weight[:, own], measured[:, own]
        weighted = w[..., None] * m
        sums[:, s, :10] = w @ plain[own]
        sums[:, s, 10:22] = np.einsum("tki,ka->tai", weighted, crossed[own]).reshape(-1, 12)
        sums[:, s, 22] = np.einsum("tki,tki->t", weighted, m)
    return sums.reshape(len(position), N_SUMS * len(SEGMENTS))


def _errors(ready: Kernels, wearing: Wearing, position: Array, q: Array, jobs: int) -> Array:
    """Give the distance of every marker from the model, (T, K) [m]."""
    poses = ready.segment_poses(q, wearing.geometry, jobs=jobs)[0]
    poses = poses.reshape(len(q), len(SEGMENTS), 4, 3)
    local = np.column_stack([wearing.local, np.ones(len(wearing.local))])
    model = np.einsum("tkai,ka->tki", poses[:, wearing.segment], local)
    return np.asarray(np.linalg.norm(model - position, axis=-1))
