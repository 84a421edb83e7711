"""Inverse kinematics frame by frame: each starts from the one before and knows none after it.

Where the start is no good (the first frame, after frames without a solution, where the optimum is
far from it or markers return and do not fit) the frame is solved from a segment-wise rigid fit too,
and the lower optimum is kept. Where that is the rigid fit's and still does not fit, lower optima
are looked for: at once in the first frame, and else by one try in each of the frames that follow,
since one frame has no time for all of them. Coordinates that markers do not show keep their last
shown values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hbm.coordinates import N_Q
from hbm.ik.continuity import MIN_JUMP_RAD, continuous, nearest_equivalent
from hbm.ik.descent import OneFrame, Solved
from hbm.ik.problem import Problem
from hbm.ik.tracking import (
    MAX_DISTANCE_FROM_START,
    MAX_UNRELATED_PIVOT,
    MIN_PIVOT_SHARE,
    TRIES,
    Tracker,
    lowest_of_tries,
)
from hbm.markers import Markers
from hbm.model import Body
from hbm.spatial import Array, Mask

ROW: Final = np.zeros(1, int)


@dataclass(frozen=True, slots=True)
class FrameSolution:
    """One frame, as `hbm.motion.Motion` holds many.

    Attributes
    ----------
    q
        Coordinates, (46,) [m and rad]; NaN where the frame could not be solved.
    marker_error
        Distance of each marker from the model, (K,) [m]; NaN where it was missing.
    converged
        Whether the inverse kinematics converged.
    observed
        Whether the visible markers determined each coordinate, (46,); those of limbs and head are
        not while a lower optimum is looked for.
    gradient
        Largest entry of the cost's gradient at the last step [m and m²/rad].
    pivots
        Of the Hessian's factorisation, (46,).
    looked
        Whether a lower optimum is looked for.
    """

    q: Array
    marker_error: Array
    converged: bool
    observed: Mask
    gradient: float
    pivots: Array
    looked: bool


class FrameTracker:
    """A subject's markers, frame by frame.

    Parameters
    ----------
    body
        The subject.
    labels
        Of the markers that are given, (M,); those that the body does not know are ignored.

    Attributes
    ----------
    markers
        Names of the markers that it solves from, (K,).
    columns
        Their columns among the labels, (K,).

    Raises
    ------
    ValueError
        If none of the body's markers is among the labels.
    """

    def __init__(self, body: Body, labels: Sequence[str]) -> None:
        nowhere = np.full((1, len(labels), 3), np.nan)
        markers = Markers(np.zeros(1), tuple(labels), nowhere)
        problem = Problem(body, markers)
        self.position = nowhere.copy()
        problem.attachment = replace(problem.attachment, position=self.position)
        problem.hold(np.ones(len(problem.names), bool))
        self.problem, self.tracker = problem, Tracker(problem)
        self.descent = OneFrame(problem.attachment, problem.prior, problem.tolerance)
        self.markers, self.columns = problem.names, problem.attachment.column
        self.carriers, self.free = self.tracker.carriers, ~problem.locked
        self.least = self.tracker.least_pivots()
        self.q: Array | None = None
        self.tracked = np.zeros(N_Q, bool)
        self.shown = np.zeros(N_Q)
        self.usual_pivots = np.zeros(N_Q)
        self.seen = np.zeros(len(self.markers), bool)
        self.complete = False
        self.tries_left = 0
        self.begun = False

    def solve(self, position: Array) -> FrameSolution:
        """Solve a frame that follows the last one kept, and keep nothing.

        Parameters
        ----------
        position
            Measured markers in the lab, (M, 3) [m]; NaN where missing.
        """
        self.position[0] = position
        if not self.complete:
            self._hold_what_was_never_seen()
        found, looked = self._first() if self.q is None else self._next(self.q)
        observed, unsolved = self._observed(found), np.zeros(N_Q, bool)
        if not found.converged[0]:
            unsolved = self.tracker.leave_limbs_out(found)[0]
            observed = self._observed(found) & ~unsolved
        solved = bool(observed[self.carriers].all())
        if solved and not observed[self.free].all():
            self._hold(found, observed, unsolved)
        solved = solved and bool(found.converged[0])
        q = found.q[0].copy()
        if not solved:
            q[:] = np.nan
        elif self.q is None:
            q = continuous(q[None])[0]
        elif np.abs(q - self.q).max() > MIN_JUMP_RAD:
            q = nearest_equivalent(q, self.q)
        error = found.error[0].copy() if solved else np.full(len(self.markers), np.nan)
        if looked:
            observed &= self.carriers
        return FrameSolution(
            q,
            error,
            solved,
            observed & solved,
            float(found.gradient[0]),
            found.pivots[0].copy(),
            looked,
        )

    def keep(self, solution: FrameSolution) -> None:
        """Take a solution as the one that the next frame follows."""
        self.begun |= bool(np.isfinite(self.position[0, self.columns, 0]).any())
        self.tracked = solution.observed | (solution.looked & ~self.carriers)
        if solution.looked:
            self.tries_left = (self.tries_left or TRIES) - 1
        if not solution.converged:
            return
        visible = np.isfinite(solution.marker_error)
        self.q, self.seen = solution.q, self.seen | visible
        self.shown[solution.observed] = solution.q[solution.observed]
        if visible[self.seen].all():
            self.usual_pivots = solution.pivots

    def _first(self) -> tuple[Solved, bool]:
        """Solve a frame before which none was solved."""
        found = self.problem.newton(ROW, self.problem.rigid_fit(ROW))
        if not self.begun and self.tracker.doubtful(found)[0]:
            self.tracker.look_for_lower(found, ROW)
        return found, False

    def _next(self, q: Array) -> tuple[Solved, bool]:
        """Solve a frame from the last one; where that is no good, from a rigid fit too.

        Gives also whether a lower optimum is likely and is looked for.
        """
        found, looked = self.descent.solve(q), self.tries_left > 0
        if self._start_is_no_good(found, q):
            start = self.problem.rigid_fit(ROW)
            lower = self.tracker.try_start(found, ROW, start)[0]
            looked |= bool(lower and self.tracker.doubtful(found)[0])
        if looked and np.isfinite(found.q[0]).all():
            number = (TRIES - self.tries_left) % TRIES
            tries = slice(number, number + 1)
            found.overwrite(ROW, lowest_of_tries(self.problem, ROW, found, tries))
        return found, looked

    def _start_is_no_good(self, found: Solved, q: Array) -> bool:
        if not found.converged[0] or np.abs(found.q[0] - q).max() > MAX_DISTANCE_FROM_START:
            return True
        if self.tracked[self.free].all():
            return False
        returned = self._observed(found) & ~self.tracked
        return bool(returned.any() and self.tracker.doubtful(found)[0])

    def _observed(self, found: Solved) -> Mask:
        """Which coordinates the visible markers determine, (46,), as `Tracker.observed`.

        What is usual is what it was when no marker was missing last.
        """
        from_markers = found.pivots[0] - self.problem.prior
        observed: Mask = np.asarray(from_markers > self.least)
        if np.isnan(found.error[0, self.seen]).any():
            observed &= from_markers > MIN_PIVOT_SHARE * self.usual_pivots
        return observed

    def _hold_what_was_never_seen(self) -> None:
        """Hold near neutral what the markers that were seen until now do not determine."""
        seen = self.seen | np.isfinite(self.position[0, self.columns, 0])
        if (seen != self.problem.seen).any():
            self.problem.hold(seen)
            self.least = self.tracker.least_pivots()
        self.complete = bool(self.seen.all())

    def _hold(self, found: Solved, observed: Mask, unsolved: Mask) -> None:
        """Hold coordinates that markers do not show, and solve the others again if need be."""
        lost = ~observed & self.free
        related = (found.pivots[0] - self.problem.prior > MAX_UNRELATED_PIVOT) & ~unsolved
        related |= not found.converged[0]
        found.q[0, lost] = self.shown[lost]
        if (lost & related).any():
            found.overwrite(slice(0, 1), self.problem.newton(ROW, found.q, (lost[None], found.q)))
