"""Newton's method for the coordinates of many frames, from starting points to optima.

In one native call per block of frames (``descent.c``) or, without a compiler, in Python around the
same kernels on the virtual machine. Each frame iterates independently: a step that raises the cost
is computed again with more damping (Levenberg 1944, Marquardt 1963), the curvature is dropped where
the Hessian is indefinite, and the frame is done once the step of the undamped, exact Hessian is
below the tolerance. The damping is a multiple of the second derivative along the step that went too
far, so that it slows the directions that markers hardly show and no others.
"""

import ctypes
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np

from hbm.coordinates import MOVING, N_Q
from hbm.kernels.kernel import N_SUMS, Kernels, OneFrameKernel, in_threads
from hbm.kernels.native import ONE_FRAME, kernels
from hbm.spatial import Array, Indices, Mask

ROW: Final = np.zeros(1, np.int64)


@dataclass(frozen=True, slots=True)
class MarkerAttachment:
    """Markers attached to a skeleton, and where they were measured.

    Attributes
    ----------
    segment
        Number of the segment that each marker is attached to, (K,).
    local
        Position of each marker in its segment, (K, 3) [m].
    weight
        Of each marker in the sum of squares, (K,).
    geometry
        The body's offsets and hinge axes, as the kernels take them.
    position
        Measured markers of the whole trial in the lab, (T, M, 3) [m]; NaN where missing.
    column
        Column of each marker among the measured ones, (K,).
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

    def sums(self, position: Array) -> Array:
        """Sum markers at given positions, (K, 3), per segment (`N_SUMS`), (23 · segments,)."""
        is_finite = np.isfinite(position[:, 0])
        p, m = self.local, np.where(is_finite[:, None], position, 0.0)
        # Σ w, Σ w p, Σ w p pᵀ, Σ w m, Σ w m pᵀ, Σ w mᵀm: all that cost and derivatives need
        squares = [p[:, i] * p[:, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        crossed = (p[:, :, None] * m[:, None]).reshape(-1, 9)
        of_marker = np.column_stack([np.ones(len(p)), p, *squares, m, crossed, np.vecdot(m, m)])
        sums = np.zeros((len(MOVING), N_SUMS))
        np.add.at(sums, self.segment, (is_finite * self.weight)[:, None] * of_marker)
        return sums.ravel()

    def errors(self, kernels: Kernels, position: Array, q: Array) -> Array:
        """Give the distance of given positions, (F, K, 3), from the model, (F, K) [m]."""
        # p_lab = [R o] [p 1]ᵀ of each marker's segment
        poses = kernels.segment_poses(q, self.geometry)[0].reshape(len(q), len(MOVING), 4, 3)
        local = np.column_stack([self.local, np.ones(len(self.local))])
        model = np.einsum("tkai,ka->tki", poses[:, self.segment], local)
        return np.asarray(np.linalg.norm(model - position, axis=-1))


DAMPING: Final = 1e-9
"""Added to the Hessian's diagonal: coordinates that no marker determines stay where they are
instead of dividing by zero, and no other coordinate changes by more than rounding."""

MAX_STEP: Final = 0.5
"""Longest step of any coordinate [rad or m]: sine and cosine are nearly parabolas that far."""

NEAR_OPTIMUM: Final = 0.1
"""Below this step [rad or m] the exact Hessian is tried again after it was indefinite."""

MAX_ITERATIONS: Final = 300
"""Per frame: a recorded walk takes about four from interpolated starts and ten at most; the others
are for starts far from the optimum and for directions that markers hardly show."""

DAMPING_FACTOR: Final = 10.0
"""Of the second derivative along a step that raised the cost, or of its damping: the damping of the
next try, which shortens that step to a tenth or less and leaves steeper directions nearly as they
were."""

DAMPING_DIVISOR: Final = 4.0
"""By which the damping falls with every accepted step."""

NEGLIGIBLE_DAMPING: Final = 1e-7
"""Below it [m²/rad², or 1 for a translation] a step is computed without damping."""

MAX_RELATIVE_RISE: Final = 1e-9
MAX_ABSOLUTE_RISE: Final = 1e-12
"""Rise of the cost [m² times the weights] that is taken for rounding, not for a step too far."""

NEGLIGIBLE_GAIN: Final = 1e-18
"""Twice the reduction of the cost [m² times the weights] that the next step promises, below which a
frame is done whatever the step: where no marker shows a direction, steps along it are rounding
errors, divided by next to nothing. A step of 1e-6 rad promises more wherever a coordinate counts as
observed."""

SLOW: Final = 30
"""Iterations after which a frame is done where the next step promises less than rounding: along the
floor of a curved valley, which markers hardly show, steps lead from one side to the other."""

MAX_SADDLE_CURVATURE: Final = 1e-5
"""Negative curvature, per unit of weight, that a minimum may seem to have [m²/rad², or 1]: less
than a marker 3 mm from the axis contributes, and of the order of what its distance from the model
takes away again."""


class Solved(NamedTuple):
    """Optima of many frames.

    Attributes
    ----------
    row
        Numbers of the frames in the trial, (F,).
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

    row: Indices
    q: Array
    converged: Mask
    gradient: Array
    pivots: Array
    error: Array

    @classmethod
    def empty(cls, row: Indices, markers: int) -> "Solved":
        """Allocate arrays for the optima of some frames."""
        frames = len(row)
        q, pivots = np.empty((2, frames, N_Q))
        error, gradient = np.empty((frames, markers)), np.full(frames, np.nan)
        return cls(row, q, np.zeros(frames, bool), gradient, pivots, error)

    @classmethod
    def joined(cls, *parts: "Solved") -> "Solved":
        """Put the frames of several solutions one after the other."""
        return cls._make(map(np.concatenate, zip(*parts, strict=True)))

    def overwrite(self, rows: Indices | slice, other: "Solved") -> None:
        """Replace some frames by those of another solution."""
        for array, others in zip(self, other, strict=True):
            array[rows] = others

    def select(self, frames: Mask | Indices) -> "Solved":
        """Give some of the frames."""
        return Solved._make(array[frames] for array in self)


Terms = tuple[Array, Array, Array]
"""Starting points, weights of the priors and their values, (F, 46) each [m and rad]."""


def solve_frames(
    attachment: MarkerAttachment, rows: Indices, terms: Terms, tolerance: float, jobs: int = 1
) -> Solved:
    """Minimise ``Σ w |r(q) − m|²/2 + Σ prior (q − reference)²/2`` in every frame.

    Parameters
    ----------
    attachment
        Markers on the skeleton.
    rows
        Frames of the trial to solve, (F,).
    terms
        Starting points, (F, 46), NaN in a frame that is not to be solved; weight and value of the
        prior on each coordinate, (F, 46) or (46,).
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
    solved = Solved.empty(rows, len(attachment.segment))
    # a prior that is the same in all frames is repeated without a copy
    start, prior, reference = (
        np.broadcast_to(np.ascontiguousarray(term, float), (len(rows), N_Q)) for term in terms
    )
    terms = start, prior, reference
    native = ready.solve_frames
    if native is None:
        _interpreted(ready, attachment, solved, terms, tolerance)
        return solved

    def solve_block(first: int, last: int) -> None:
        native(ctypes.byref(_structure(attachment, solved, terms, tolerance, range(first, last))))

    in_threads(solve_block, len(rows), jobs)
    return solved


def _limits() -> dict[str, float]:
    """Give the constants of the iteration by their names in ``descent.c``."""
    return {
        "damping": DAMPING,
        "max_step": MAX_STEP,
        "near_optimum": NEAR_OPTIMUM,
        "relative_rise": MAX_RELATIVE_RISE,
        "absolute_rise": MAX_ABSOLUTE_RISE,
        "damping_factor": DAMPING_FACTOR,
        "damping_divisor": DAMPING_DIVISOR,
        "negligible_damping": NEGLIGIBLE_DAMPING,
        "negligible_gain": NEGLIGIBLE_GAIN,
        "saddle": -MAX_SADDLE_CURVATURE,
    }


COUNTS: Final = (
    *("frames", "markers", "measured", "prior_stride", "reference_stride"),
    *("max_iterations", "slow"),
)
ARRAYS: Final = (
    *("row", "column", "segment", "local", "weight", "geometry", "position"),
    *("start", "prior", "reference", "q", "pivots", "error", "gradient", "converged"),
)


class DescentProblem(ctypes.Structure):
    """The structure ``problem`` of ``descent.c``, field by field."""

    _fields_: ClassVar = [
        *((name, ctypes.c_longlong) for name in COUNTS),
        *((name, ctypes.c_double) for name in ("tolerance", *_limits())),
        *((name, ctypes.c_void_p) for name in ARRAYS),
    ]


def _structure(
    attachment: MarkerAttachment, solved: Solved, terms: Terms, tolerance: float, block: range
) -> DescentProblem:
    """Give a block of frames to ``descent.c``; the arrays must live as long as it."""
    fixed = {name: getattr(attachment, name) for name in MarkerAttachment.__slots__}
    per_frame = dict(zip(("start", "prior", "reference"), terms, strict=True))
    per_frame |= solved._asdict()
    _, prior, reference = terms
    return DescentProblem(
        frames=len(block),
        markers=len(attachment.segment),
        measured=attachment.position.shape[1],
        # strides in numbers, 0 where one row serves all frames
        prior_stride=prior.strides[0] // prior.itemsize,
        reference_stride=reference.strides[0] // reference.itemsize,
        max_iterations=MAX_ITERATIONS,
        slow=SLOW,
        tolerance=tolerance,
        **_limits(),
        **{name: x.ctypes.data for name, x in fixed.items()},
        **{name: x.ctypes.data + block.start * x.strides[0] for name, x in per_frame.items()},
    )


def _interpreted(
    ready: Kernels, attachment: MarkerAttachment, solved: Solved, terms: Terms, tolerance: float
) -> None:
    """Do what ``descent.c`` does, frame by frame; arguments as of `_structure`."""
    newton_step = OneFrameKernel(ready.newton_step, attachment.geometry)
    start, prior, reference = terms
    # about the pelvis of the start: far from the lab's origin sums lose digits
    origin = np.zeros(start.shape)
    origin[:, :3] = start[:, :3]
    measured = attachment.measured(solved.row) - origin[:, None, :3]
    for frame in range(len(start)):
        q = accepted_q = start[frame] - origin[frame]
        fixed = attachment.sums(measured[frame]), prior[frame], reference[frame] - origin[frame]
        # curvature 1: exact Hessian; 0: without the markers' distances, which is never indefinite
        cost, gradient, curvature, lowest = np.inf, np.nan, 1.0, 0.0
        damping = step_damping = along = DAMPING
        for iteration in range(MAX_ITERATIONS):
            step, report = newton_step(q, *fixed, np.array(damping), np.array(curvature))
            new_cost, new_gradient, slope, *pivots = report.tolist()
            # the step went too far: go back and damp it (Levenberg–Marquardt)
            if not new_cost <= cost * (1 + MAX_RELATIVE_RISE) + MAX_ABSOLUTE_RISE:
                if np.isinf(cost):  # there is no starting point
                    break
                q, damping = accepted_q, DAMPING_FACTOR * max(along, step_damping)
                continue
            # a pivot below zero: the exact Hessian is indefinite, its step may lead uphill
            if min(pivots) <= 0 < curvature:
                curvature, lowest = 0.0, min(pivots)
                continue
            size, square = float(np.abs(step).max()), float(step @ step)
            undamped, exact = damping <= DAMPING, curvature > 0
            cost, gradient, step_damping = new_cost, new_gradient, damping
            # second derivative along the step: what made it longer than allowed, or too long
            along = (-slope / square if square > 0 else 0.0) - damping
            # too long a step is cut, and damped as much as would have made it so short
            excess, damping = max(size / MAX_STEP, 1.0), damping / DAMPING_DIVISOR
            damping = DAMPING if damping < NEGLIGIBLE_DAMPING else damping
            damping = max(along * (excess - 1), damping) if excess > 1 else damping
            accepted_q, q = q, q + step / excess
            curvature = 1.0 if size < NEAR_OPTIMUM else curvature
            # done by the undamped step alone: damping makes any step small
            no_gain = -slope < (NEGLIGIBLE_GAIN if iteration < SLOW else MAX_ABSOLUTE_RISE)
            if undamped and (no_gain or (exact and size < tolerance)):
                solved.converged[frame] = exact or lowest > -MAX_SADDLE_CURVATURE
                break
        solved.q[frame], solved.pivots[frame], solved.gradient[frame] = q, pivots, gradient
    solved.error[:] = attachment.errors(ready, measured, solved.q)
    solved.q[:] += origin


class OneFrame:
    """Solves the frame in the attachment's only row of positions, with one native call.

    The positions, (1, M, 3), change from frame to frame, and so may prior and reference, (46,).
    """

    def __init__(
        self, attachment: MarkerAttachment, prior: Array, reference: Array, tolerance: float
    ) -> None:
        self.attachment, self.tolerance = attachment, tolerance
        self.start = np.empty((1, N_Q))
        self.terms = self.start, prior[None], reference[None]
        self.solved = Solved.empty(ROW, len(attachment.segment))
        self.native = kernels(lanes=ONE_FRAME).solve_frames
        self.structure = _structure(attachment, self.solved, self.terms, tolerance, range(1))
        self.address = ctypes.byref(self.structure)

    def solve(self, start: Array) -> Solved:
        """Solve it from a starting point, (46,); the next call overwrites the result."""
        self.start[0] = start
        if self.native is not None:
            self.native(self.address)
            return self.solved
        return solve_frames(self.attachment, ROW, self.terms, self.tolerance)
