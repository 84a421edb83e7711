"""A trial's frames: from starting points to optima, through gaps, to a motion.

The optimum of a frame does not depend on its neighbours, only its starting point does: it is
interpolated between coarsely spaced frames, which in turn start from a segment-wise rigid fit
(`hbm.ik.start`). Where an optimum is far from its start, the frame is solved again from the rigid
fit. Where that leads lower, and in the spaced frames where markers show a limb only weakly, still
lower optima are looked for (`lowest`); so they are in all frames of a recording that is not
continuous. The result therefore depends neither on how many frames are solved at once nor on the
number of threads.
"""

from functools import cache
from itertools import combinations
from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline

from hbm.coordinates import CARRIERS, FIRST_Q, LAST_Q, LIMBS, N_Q, TREE
from hbm.ik.continuity import continuous
from hbm.ik.descent import MAX_ABSOLUTE_RISE, Solved
from hbm.ik.problem import Problem
from hbm.motion import Motion
from hbm.spatial import Array, Indices, Mask

TRIES: Final = 45
"""Of 6,000 random bodies and poses, 20 tries leave 5 above SciPy's best of five starts, 40 none."""

SPREADS_RAD: Final = (0.5, 1.0, 3.0)
"""Standard deviations of the changes, in turn: from another bend of a joint to any pose at all."""

MAX_ROUNDS: Final = 3
"""Rounds of tries; nearly always, the second finds nothing lower."""

EQUAL_RELATIVE: Final = 1e-9
EQUAL_ABSOLUTE: Final = 1e-15
"""Difference of costs [m² times the weights] that is rounding."""

FRAMES_AT_ONCE: Final = 4000
"""Bounds the memory for the tries that are solved at once."""


def lowest(problem: Problem, rows: Indices, solved: Solved) -> Solved:
    """Look for lower optima of some frames.

    Parameters
    ----------
    problem
        The trial.
    rows
        Frame numbers, (F,).
    solved
        Their optima so far; poses must be finite, whether converged or not.

    Returns
    -------
    Solved
        The lowest optima found. The tries are the same for every frame, so that the result does not
        depend on which others are solved with it.
    """
    best = solved.select(np.arange(len(rows)))
    step = max(1, FRAMES_AT_ONCE // TRIES)
    for first in range(0, len(rows), step):
        block = np.arange(first, min(first + step, len(rows)))
        for _ in range(MAX_ROUNDS):
            before = problem.cost(best.select(block))
            best.overwrite(block, lowest_of_tries(problem, rows[block], best.select(block)))
            block = block[problem.cost(best.select(block)) < _just_below(before)]
            if not len(block):
                break
    return best


def lowest_of_tries(
    problem: Problem, rows: Indices, solved: Solved, tries: slice = slice(None)
) -> Solved:
    """Give the lowest optima of one round of tries, or of some tries of a round.

    Every start is solved with trunk and pelvis held, so that the limbs are independent, and freely,
    since trunk and pelvis may be wrong; limbs are exchanged between the former and between all.

    Parameters
    ----------
    problem, rows, solved
        As for `lowest`.
    tries
        Which of the `TRIES`.

    Returns
    -------
    Solved
        The lowest optima, of these and of those that are given.
    """
    changes = _changes()[tries]
    starts = (solved.q + changes).reshape(-1, N_Q)
    again = np.tile(rows, len(changes))
    carriers = np.array([c.segment in CARRIERS for c in TREE])
    held = np.tile(carriers, (len(starts), 1)), np.tile(solved.q, (len(changes), 1))
    limbs_alone = Solved.joined(solved, problem.newton(again, starts, held))
    every = Solved.joined(limbs_alone, problem.newton(again, starts))
    exchanged = [
        problem.newton(rows, _best_limbs(problem, s, len(rows))) for s in (limbs_alone, every)
    ]
    found = Solved.joined(every, *exchanged)
    return found.select(_lowest_nearest_to_neutral(problem.cost(found), found.q, len(rows)))


def _best_limbs(problem: Problem, solved: Solved, frames: int) -> Array:
    """Give the first solutions with each limb as in the one where it costs least, (F, 46)."""
    square = np.nan_to_num(problem.attachment.weight * solved.error**2)
    square[~solved.converged] = np.inf
    prior = problem.prior * solved.q**2
    q = solved.q[:frames].copy()
    for segments in LIMBS.values():
        own = [k for k, s in enumerate(problem.segment) if s in segments]
        limb = slice(FIRST_Q[segments[0]], LAST_Q[segments[-1]] + 1)
        cost = square[:, own].sum(axis=1) + prior[:, limb].sum(axis=1)
        best = _lowest_nearest_to_neutral(cost, solved.q[:, limb], frames)
        q[:, limb] = solved.q[best, limb]
    return q


def _lowest_nearest_to_neutral(cost: Array, q: Array, frames: int) -> Indices:
    """Give the number of the best solution of each frame, (F,).

    Parameters
    ----------
    cost
        Of all solutions, (S · F,): those of all frames, one solution after the other.
    q
        Their coordinates, (S · F, n).
    frames
        How many frames there are.
    """
    each = cost.reshape(-1, frames)
    from_neutral = np.abs((q + np.pi) % (2 * np.pi) - np.pi).sum(axis=1).reshape(-1, frames)
    least = each.min(axis=0)
    equal = each <= least * (1 + EQUAL_RELATIVE) + EQUAL_ABSOLUTE
    best = np.where(equal, from_neutral, np.inf).argmin(axis=0)
    return np.asarray(best * frames + np.arange(frames))


def _just_below(cost: Array) -> Array:
    return np.asarray(cost * (1 - EQUAL_RELATIVE) - EQUAL_ABSOLUTE)


@cache
def _changes() -> Array:
    """Give the random changes of the coordinates, (TRIES, 1, 46) [rad]; translations stay."""
    random = np.random.default_rng(0).normal(size=(TRIES, 1, N_Q))
    rotates = np.array([not c.translates for c in TREE])
    return np.asarray(random * rotates * np.resize(SPREADS_RAD, (TRIES, 1, 1)))


KEY_FRAME_SPACING: Final = 15
"""Frames per key frame: 0.15 s at 100 Hz, so that a spline between them starts near the optimum."""

MIN_KEY_FRAMES: Final = 4
"""Key frames that a cubic spline needs."""

MAX_DISTANCE_FROM_START: Final = 0.5
"""Change of any coordinate from its start [rad or m]: an optimum farther away may be the wrong one
of several."""

MAX_SHARE_FAR: Final = 0.5
"""Of the frames: where more are far from their start, the frames are no continuous recording, and
tell nothing of each other."""

MIN_CLEAR_PIVOT: Final = 1e-3
"""Curvature, per unit of weight, of a rotation that markers show well [m²/rad²]: that of a marker
3 cm from the axis."""

MAX_CLEAR_ERROR_M: Final = 0.015
"""RMS distance of a limb's markers from the model; in another optimum than the lowest it is larger,
or the limb is shown weakly."""

MIN_PIVOT: Final = 1e-6
"""Curvature, per unit of weight, from which on a coordinate counts as observed [m²/rad² or 1]: that
of a marker 1 mm from the axis."""

MIN_PIVOT_SHARE: Final = 0.01
"""The same in frames with missing markers, as a share of what is usual in the trial."""

MAX_UNRELATED_PIVOT: Final = 1e-8
"""Curvature below which no marker depends on an unobserved coordinate: changing it then moves no
other."""

EQUAL_COST: Final = 1e-6
"""Relative difference of the costs of one optimum that is reached from two starts."""


class Tracker:
    """One trial, frame by frame."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.frames = np.arange(len(problem.time))

    def motion(self) -> Motion:
        """Solve all frames."""
        problem = self.problem
        start, usual_pivots = self.starting_points()
        found = problem.newton(self.frames, start)
        far = ~found.converged | _far(found.q, start)
        if np.mean(far) > MAX_SHARE_FAR:
            usual_pivots = None
        doubtful = np.flatnonzero(far)
        lower = self.try_start(found, doubtful, problem.rigid_fit(doubtful))
        self.look_for_lower(found, self.frames if usual_pivots is None else doubtful[lower])
        unsolved = self.leave_limbs_out(found)
        observed = self.observed(found, usual_pivots) & ~unsolved
        carriers: Mask = np.asarray(observed[:, self.carriers].all(axis=1))
        found.q[~carriers | ~found.converged & observed[:, ~problem.locked].all(axis=1)] = np.nan
        found.q[:] = continuous(found.q)
        self.bridge_gaps(found, observed & carriers[:, None], unsolved, usual_pivots is None)
        found.converged[~carriers] = False
        found.q[~found.converged] = np.nan
        found.error[~found.converged] = np.nan
        not_yet = np.full(found.q.shape, np.nan)
        return Motion(
            problem.time,
            found.q,
            not_yet,
            not_yet,
            problem.names,
            found.error,
            found.converged,
            observed & found.converged[:, None],
            found.gradient,
        )

    @property
    def carriers(self) -> Mask:
        """Coordinates without which a frame is lost: of the pelvis, and of a trunk with markers."""
        own = np.array([c.segment in CARRIERS for c in TREE])
        return np.asarray(own & ~self.problem.locked)

    def starting_points(self) -> tuple[Array, Array | None]:
        """Give every frame a starting point: splines between key frames solved from rigid fits.

        Returns
        -------
        start
            Starting points, (T, 46); NaN where nothing is known.
        usual_pivots
            The median pivots of the key frames, (46,); None where there are too few of them, so
            that frames tell nothing of each other, and the starting points are rigid fits.
        """
        problem, keys = self.problem, self.key_frames()
        found = problem.newton(keys, problem.rigid_fit(keys))
        self.look_for_lower(found, np.flatnonzero(self.doubtful(found)), keys)
        solved = np.flatnonzero(found.converged)
        if len(solved) < MIN_KEY_FRAMES:
            return problem.rigid_fit(self.frames), None
        found.q[solved] = continuous(found.q[solved])
        inner = solved[1:-1]
        between = (found.q[solved[:-2]] + found.q[solved[2:]]) / 2
        isolated = _far(found.q[inner], between)
        self.try_start(found, inner[isolated], between[isolated], keys)
        spline = make_interp_spline(keys[solved], continuous(found.q[solved]), k=3)
        start = np.asarray(spline(np.clip(self.frames, keys[solved[0]], keys[solved[-1]])))
        return start, np.median(found.pivots[solved], axis=0)

    def doubtful(self, found: Solved) -> Mask:
        """Whether a lower optimum is likely: markers show a limb weakly, or it does not fit them.

        Parameters
        ----------
        found
            Optima of some frames that were solved from rigid fits.

        Returns
        -------
        Mask
            (F,).
        """
        problem = self.problem
        pivots = (found.pivots - problem.prior)[:, problem.rotates & ~problem.locked]
        weight = problem.attachment.weight.max()
        weak = (pivots > MIN_PIVOT * weight) & (pivots < MIN_CLEAR_PIVOT * weight)
        doubtful: Mask = ~found.converged | weak.any(axis=1)
        for segments in LIMBS.values():
            own = [k for k, s in enumerate(problem.segment) if s in segments]
            square = found.error[:, own] ** 2
            seen = np.isfinite(square)
            largest = MAX_CLEAR_ERROR_M**2 * seen.sum(axis=1)
            doubtful |= np.where(seen, square, 0).sum(axis=1) > largest
        return np.asarray(doubtful)

    def look_for_lower(
        self, found: Solved, rows: Indices, frames: Indices | slice = slice(None)
    ) -> None:
        """Replace optima by lower ones where there are any; rows of ``frames``, or of all."""
        rows = rows[np.isfinite(found.q[rows]).all(axis=1)]
        found.overwrite(rows, lowest(self.problem, self.frames[frames][rows], found.select(rows)))

    def try_start(
        self, found: Solved, rows: Indices, start: Array, frames: Indices | slice = slice(None)
    ) -> Mask:
        """Solve some rows of ``frames`` from another start and keep the lower optimum.

        Gives whether that is a lower one, or neither start leads to an optimum, (R,).
        """
        solved = self.problem.newton(self.frames[frames][rows], start)
        before, after = (self.problem.cost(optima) for optima in (found.select(rows), solved))
        better = after < before
        found.overwrite(rows[better], solved.select(better))
        lower = after < before * (1 - EQUAL_COST) - MAX_ABSOLUTE_RISE
        return np.asarray(lower | np.isinf(np.minimum(before, after)))

    def leave_limbs_out(self, found: Solved) -> Mask:
        """Solve frames that did not converge without the fewest limbs that keep them from it.

        Gives the coordinates that are left out, (T, 46).
        """
        left_out = np.zeros(found.q.shape, bool)
        for count in range(1, len(LIMBS) + 1):
            for names in combinations(LIMBS, count):
                rows = np.flatnonzero(~found.converged)
                rows = rows[np.isfinite(found.q[rows]).all(axis=1)]
                if not len(rows):
                    return left_out
                segments = {s for name in names for s in LIMBS[name]}
                without = self.problem.without(segments)
                solved = without.newton(rows, found.q[rows])
                rows, solved = rows[solved.converged], solved.select(solved.converged)
                solved.error[:, [s in segments for s in without.segment]] = np.nan
                found.overwrite(rows, solved)
                left_out[rows] = [c.segment in segments for c in TREE]
        return left_out

    def observed(self, found: Solved, usual_pivots: Array | None) -> Mask:
        """Which coordinates the visible markers determine, (T, 46).

        A coordinate is determined where the curvature that remains to it once all coordinates
        beyond it are free (its pivot) is not nearly zero and, in frames with missing markers, not
        small compared with what is usual in the trial.
        """
        from_markers = found.pivots - self.problem.prior
        observed: Mask = np.asarray(from_markers > self.least_pivots())
        if usual_pivots is not None:
            missing = np.isnan(found.error)
            gaps = (missing & ~missing.all(axis=0)).any(axis=1)
            observed[gaps] &= from_markers[gaps] > MIN_PIVOT_SHARE * usual_pivots
        return observed

    def least_pivots(self) -> Array:
        """Give from which curvature on, of its markers, each coordinate is determined, (46,).

        One with a prior is from any on, so that it does not depend on the pose; a locked one never.
        """
        least = np.full(N_Q, MIN_PIVOT * self.problem.attachment.weight.max())
        least[self.problem.undetermined] = -np.inf
        least[self.problem.locked] = np.inf
        return least

    def key_frames(self) -> Indices:
        """Choose the frame with the most markers in each interval, and both ends."""
        frames, attachment = len(self.frames), self.problem.attachment
        count = np.full(-(-frames // KEY_FRAME_SPACING) * KEY_FRAME_SPACING, -1)
        count[:frames] = np.isfinite(attachment.position[:, attachment.column, 0]).sum(axis=1)
        intervals = count.reshape(-1, KEY_FRAME_SPACING)
        best = intervals.argmax(axis=1) + KEY_FRAME_SPACING * np.arange(len(intervals))
        return np.unique([0, *best, frames - 1])

    def bridge_gaps(self, found: Solved, observed: Mask, unsolved: Mask, unrelated: bool) -> None:
        """Interpolate coordinates that markers do not show between their neighbours in time.

        Where a remaining marker depends on them, the other coordinates are solved again.

        Parameters
        ----------
        found
            Optima of all frames; changed in place.
        observed
            Coordinates that the markers show, (T, 46).
        unsolved
            Coordinates of limbs that are left out, (T, 46): no marker that is used depends on them.
        unrelated
            Whether the frames tell nothing of each other: then only coordinates on which no marker
            depends are interpolated.
        """
        problem = self.problem
        present = ~np.isnan(found.q[:, 0])
        lost = ~(observed | problem.locked) & present[:, None]
        related = ~found.converged[:, None] | (found.pivots - problem.prior > MAX_UNRELATED_PIVOT)
        related &= ~unsolved
        if unrelated:
            lost &= ~related
        rows = np.flatnonzero((lost & related).any(axis=1))
        for i in np.flatnonzero(lost.any(axis=0)):
            gap = np.flatnonzero(lost[:, i])
            known = np.flatnonzero(observed[:, i] & found.converged)
            found.q[gap, i] = np.interp(gap, known, found.q[known, i]) if len(known) else 0.0
        found.overwrite(rows, problem.newton(rows, found.q[rows], (lost[rows], found.q[rows])))


def _far(q: Array, start: Array) -> Mask:
    """Whether poses are far from their starting points, (F,)."""
    return np.asarray(np.abs(q - start).max(axis=1, initial=0) > MAX_DISTANCE_FROM_START)
