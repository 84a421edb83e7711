"""Newton's method for the coordinates of many frames, from starting points to optima.

In one native call per stretch of frames (``descent.c``) or, without a compiler, in NumPy around the
same kernels on the virtual machine. Each frame goes its own way: it goes back most of a step where
the cost rises, does without the curvature where the Hessian is not positive, and ends once its step
is below the tolerance.
"""

import ctypes
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hbm.coordinates import SEGMENTS, N
from hbm.native import Kernels, kernels
from hbm.skeleton import N_SUMS
from hbm.spatial import Array, Indices, Mask

FLOOR: Final = 1e-9
LARGEST_STEP: Final = 0.5
NEAR: Final = 0.1
MOST_ITERATIONS: Final = 60
MOST_RETREATS: Final = 20
LEAST_SHARE: Final = 64


@dataclass(frozen=True, slots=True)
class Wearing:
    """Markers on a skeleton.

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
    """

    segment: Indices
    local: Array
    weight: Array
    geometry: Array


@dataclass(frozen=True, slots=True)
class Solved:
    """Optima of many frames.

    Attributes
    ----------
    q
        Coordinates, (T, 46) [m and rad].
    converged
        Whether the last step was below the tolerance, (T,).
    gradient
        Largest entry of the cost's gradient before that step, (T,) [m and m²/rad].
    pivots
        Of the Hessian's factorisation, (T, 46): near zero where no marker shows a coordinate.
    error
        Distance of each marker from the model, (T, K) [m]; NaN where it was missing.
    """

    q: Array
    converged: Mask
    gradient: Array
    pivots: Array
    error: Array

    def only(self, frames: Mask) -> "Solved":
        """Give some of the frames."""
        return Solved(
            self.q[frames],
            self.converged[frames],
            self.gradient[frames],
            self.pivots[frames],
            self.error[frames],
        )


def solve_frames(
    wearing: Wearing,
    position: Array,
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
    position
        Measured markers in the lab, (T, K, 3) [m]; NaN where missing.
    start
        Starting points, (T, 46).
    prior, reference
        Strength of the pull on each coordinate and where it pulls to, (T, 46).
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
    here = np.zeros((len(position), N))
    here[:, :3] = start[:, :3]
    given = (
        np.ascontiguousarray(position - here[:, None, :3]),
        np.ascontiguousarray(start - here),
        np.ascontiguousarray(prior, float),
        np.ascontiguousarray(reference - here),
    )
    ready = kernels()
    solve = _native if ready.solve_frames is not None else _interpreted
    solved = solve(ready, wearing, *given, tolerance, jobs)
    return Solved(solved.q + here, solved.converged, solved.gradient, solved.pivots, solved.error)


def _native(
    ready: Kernels,
    wearing: Wearing,
    position: Array,
    start: Array,
    prior: Array,
    reference: Array,
    tolerance: float,
    jobs: int,
) -> Solved:
    """Hand stretches of frames to the compiled descent."""
    assert ready.solve_frames is not None
    call = ready.solve_frames
    frames, markers = position.shape[:2]
    segment = np.ascontiguousarray(wearing.segment, np.int64)
    fixed = [np.ascontiguousarray(x, float) for x in (wearing.weight, wearing.local)]
    geometry = np.ascontiguousarray(wearing.geometry, float)
    q, pivots = start.copy(), np.empty((frames, N))
    error, gradient = np.empty((frames, markers)), np.full(frames, np.nan)
    converged = np.zeros(frames, np.uint8)

    def at(array: NDArray[Any], frame: int = 0) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data + frame * array.strides[0])

    def stretch(first: int, last: int) -> None:
        call(
            ctypes.c_longlong(last - first),
            ctypes.c_longlong(markers),
            at(position, first),
            *(at(x) for x in fixed),
            at(segment),
            at(prior, first),
            at(reference, first),
            at(geometry),
            ctypes.c_double(tolerance),
            *(at(x, first) for x in (q, pivots, error, gradient, converged)),
        )

    shares = max(1, min(jobs, frames // LEAST_SHARE))
    borders = [frames * k // shares for k in range(shares + 1)]
    if shares == 1:
        stretch(0, frames)
    else:
        with ThreadPoolExecutor(shares) as pool:
            list(pool.map(stretch, borders[:-1], borders[1:]))
    return Solved(q, converged.astype(bool), gradient, pivots, error)


def _interpreted(
    ready: Kernels,
    wearing: Wearing,
    position: Array,
    start: Array,
    prior: Array,
    reference: Array,
    tolerance: float,
    jobs: int,
) -> Solved:
    """Do what ``descent.c`` does, for all frames that are still on their way at once."""
    total = len(start)
    sums = _sum_markers(wearing, position)
    q, best = start.copy(), start.copy()
    cost_best, move = np.full(total, np.inf), np.zeros((total, N))
    curvature, retreats = np.ones(total), np.zeros(total, int)
    converged, pivots, gradient = (
        np.zeros(total, bool),
        np.empty((total, N)),
        np.full(total, np.nan),
    )
    active = np.arange(total)
    for _ in range(MOST_ITERATIONS):
        if not len(active):
            break
        step, report = ready.newton_step(
            *(x[active] for x in (q, sums, prior, reference)),
            np.full((len(active), 1), FLOOR),
            curvature[active, None],
            wearing.geometry,
            jobs=jobs,
        )
        cost, pivot = report[:, 0], report[:, 2:]
        worse = ~(cost <= cost_best[active] * (1 + 1e-9) + 1e-12)
        bent = ~worse & (pivot.min(axis=1) <= 0) & (curvature[active] > 0)
        back = active[worse]
        retreats[back] += 1
        move[back] /= 4
        q[back] = best[back] + move[back]
        curvature[active[bent]] = 0

        fine = ~worse & ~bent
        good, size = active[fine], np.abs(step[fine]).max(axis=1, initial=0)
        share = np.where(size > LARGEST_STEP, LARGEST_STEP / np.maximum(size, LARGEST_STEP), 1.0)
        cost_best[good], gradient[good], pivots[good] = cost[fine], report[fine, 1], pivot[fine]
        best[good], move[good] = q[good], share[:, None] * step[fine]
        q[good] += move[good]
        curvature[good[size < NEAR]] = 1
        converged[good[size < tolerance]] = True
        active = np.flatnonzero(~converged & (retreats <= MOST_RETREATS))
    return Solved(q, converged, gradient, pivots, _errors(ready, wearing, position, q, jobs))


def _sum_markers(wearing: Wearing, position: Array) -> Array:
    """Sum markers per segment (`hbm.skeleton.N_SUMS`), (T, 23 · segments)."""
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
