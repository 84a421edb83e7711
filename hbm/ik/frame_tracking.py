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
from hbm.ik.descent import ROW, OneFrame, Solved
from hbm.ik.problem import Problem
from hbm.ik.tracking import (
    MAX_DISTANCE_FROM_START,
    TRIES,
    depended_on,
    doubtful,
    leave_limbs_out,
    look_for_lower,
    lowest_of_tries,
    observed_by,
    try_start,
)
from hbm.ik.upright import HEADING_CUTOFF_HZ, TRUNK, YAW, upright_trunk
from hbm.markers import Markers
from hbm.model import Body
from hbm.signals.filtering import RealtimeFilter
from hbm.spatial import Array, Mask

USUAL_STEP_S: Final = 0.01
"""From one frame to the next; a longer one is divided for the filter of the heading."""


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
    """

    def __init__(self, body: Body, labels: Sequence[str]) -> None:
        self.position = np.full((1, len(labels), 3), np.nan)
        problem = Problem(body, Markers(np.zeros(1), tuple(labels), self.position))
        problem.attachment = replace(problem.attachment, position=self.position)
        problem.hold(np.ones(len(problem.names), bool))
        self.problem, self.markers, self.columns = problem, problem.names, problem.attachment.column
        self.descent = OneFrame(
            problem.attachment, problem.prior, problem.reference[0], problem.tolerance
        )
        self.q: Array | None = None
        self.tracked = np.zeros(N_Q, bool)
        self.shown, self.usual_pivots = np.zeros((2, N_Q))
        self.seen = np.zeros(len(self.markers), bool)
        self.tries_left = 0
        self.begun = False
        self.heading = RealtimeFilter(HEADING_CUTOFF_HZ, 1, USUAL_STEP_S)

    def solve(self, position: Array) -> FrameSolution:
        """Solve a frame that follows the last one kept, from markers (M, 3), and keep nothing."""
        self.position[0] = position
        if self.q is not None and self.problem.weak_trunk:
            self.problem.reference[0, TRUNK] = self._upright(self.q)
        if not self.seen.all():
            self._hold_what_was_never_seen()
        found, looked = self._first() if self.q is None else self._next(self.q)
        observed, left_out = self._observed(found), np.zeros((1, N_Q), bool)
        if not found.converged[0]:
            left_out = leave_limbs_out(self.problem, found)
            observed = self._observed(found) & ~left_out[0]
        solved = bool(observed[self.problem.carriers].all())
        if solved and not observed[~self.problem.locked].all():
            self._hold(found, ~observed & ~self.problem.locked, left_out)
        solved = solved and bool(found.converged[0])
        q, error = found.q[0].copy(), found.error[0].copy()
        if not solved:
            q[:] = error[:] = np.nan
        elif self.q is None:
            q = continuous(q[None])[0]
        elif np.abs(q - self.q).max() > MIN_JUMP_RAD:
            q = nearest_equivalent(q, self.q)
        if looked:
            observed &= self.problem.carriers
        gradient, pivots = float(found.gradient[0]), found.pivots[0].copy()
        return FrameSolution(q, error, solved, observed & solved, gradient, pivots, looked)

    def keep(self, solution: FrameSolution, time: float) -> FrameSolution:
        """Take a solution as the one that the next frame follows; give it with its whole trunk."""
        self.begun |= bool(np.isfinite(self.position[0, self.columns, 0]).any())
        self.tracked = solution.observed | (solution.looked & ~self.problem.carriers)
        if solution.looked:
            self.tries_left = (self.tries_left or TRIES) - 1
        if not solution.converged:
            return solution
        visible = np.isfinite(solution.marker_error)
        self.q, self.seen = solution.q, self.seen | visible
        self.shown[solution.observed] = solution.q[solution.observed]
        if visible[self.seen].all():
            self.usual_pivots = solution.pivots
        if self.problem.unseen_trunk or self.problem.weak_trunk:
            self.heading.step(time, solution.q[[YAW]])
        if not self.problem.unseen_trunk:
            return solution
        q = solution.q.copy()
        q[TRUNK] = self._upright(q)
        return replace(solution, q=q)

    def _upright(self, q: Array) -> Array:
        """Give the angles, (3,), with which the trunk of a pose stands upright, facing ahead."""
        angles: Array = upright_trunk(q[None], self.heading.value)[0]
        return angles

    def _first(self) -> tuple[Solved, bool]:
        """Solve a frame before which none was solved."""
        found = self.problem.newton(ROW, self.problem.rigid_fit(ROW))
        if not self.begun and doubtful(self.problem, found)[0]:
            look_for_lower(self.problem, found, ROW)
        return found, False

    def _next(self, q: Array) -> tuple[Solved, bool]:
        """Solve a frame from the last one; where that is no good, from a rigid fit too.

        Gives also whether a lower optimum is likely and is looked for.
        """
        problem = self.problem
        found, looked = self.descent.solve(q), self.tries_left > 0
        if self._start_is_no_good(found, q):
            lower = try_start(problem, found, ROW, problem.rigid_fit(ROW))[0]
            looked |= bool(lower and doubtful(problem, found)[0])
        if looked and np.isfinite(found.q[0]).all():
            number = (TRIES - self.tries_left) % TRIES
            found.overwrite(ROW, lowest_of_tries(problem, found, slice(number, number + 1)))
        return found, looked

    def _start_is_no_good(self, found: Solved, q: Array) -> bool:
        if not found.converged[0] or np.abs(found.q[0] - q).max() > MAX_DISTANCE_FROM_START:
            return True
        if self.tracked[~self.problem.locked].all():
            return False
        returned = self._observed(found) & ~self.tracked
        return bool(returned.any() and doubtful(self.problem, found)[0])

    def _observed(self, found: Solved) -> Mask:
        """Which coordinates the markers determine, (46,); as is usual since none was missing."""
        observed = observed_by(self.problem, found, self.usual_pivots, self.seen)
        return np.asarray(observed[0])

    def _hold_what_was_never_seen(self) -> None:
        """Hold near neutral what the markers that were seen until now do not determine."""
        seen = self.seen | np.isfinite(self.position[0, self.columns, 0])
        if (seen != self.problem.seen).any():
            self.problem.hold(seen)

    def _hold(self, found: Solved, lost: Mask, left_out: Mask) -> None:
        """Hold coordinates that markers do not show, and solve the others again if need be."""
        related = depended_on(self.problem, found, left_out)[0]
        found.q[0, lost] = self.shown[lost]
        if (lost & related).any():
            found.overwrite(ROW, self.problem.newton(ROW, found.q, (lost[None], found.q)))
