"""Newton's method for one frame after another: one native call, in arrays that stay."""

import ctypes

import numpy as np

from hbm.coordinates import N_Q
from hbm.ik.attachment import MarkerAttachment
from hbm.ik.descent import Solved, descent_problem, solve_frames
from hbm.kernels.native import kernels
from hbm.spatial import Array

ROW = np.zeros(1, np.int64)


class OneFrame:
    """Solves the frame that stands in the attachment's only row of positions.

    Parameters
    ----------
    attachment
        Markers on the skeleton; its positions, (1, M, 3), change from frame to frame.
    prior, reference
        As for `hbm.ik.descent.solve_frames`, (46,).
    tolerance
        Largest last step [rad or m].
    """

    def __init__(
        self, attachment: MarkerAttachment, prior: Array, reference: Array, tolerance: float
    ) -> None:
        self.attachment, self.tolerance = attachment, tolerance
        self.start, self.prior, self.reference = np.empty((1, N_Q)), prior[None], reference[None]
        self.solved = Solved.empty(1, len(attachment.segment))
        per_frame = {name: getattr(self, name) for name in ("start", "prior", "reference")}
        per_frame |= {name: getattr(self.solved, name) for name in Solved.__slots__}
        self.native = kernels().solve_frames
        self.structure = descent_problem(attachment, {"row": ROW, **per_frame}, tolerance, 0, 1)
        self.address = ctypes.byref(self.structure)

    def solve(self, start: Array) -> Solved:
        """Solve it from a starting point, (46,); the next call overwrites the result."""
        self.start[0] = start
        if self.native is not None:
            self.native(self.address)
            return self.solved
        terms = self.start, self.prior, self.reference
        return solve_frames(self.attachment, ROW, *terms, tolerance=self.tolerance)
