"""Inverse kinematics of a trial: of all frames at once, or frame by frame while it is measured.

Every frame is a least-squares problem of its own (Lu and O'Connor 1999, J Biomech 32:129), solved
by damped Newton steps until the undamped step is below the tolerance (`hbm.ik.descent`). The
optimum of a frame does not depend on its neighbours, only its starting point does: it is
interpolated between coarsely spaced frames, which in turn start from a segment-wise rigid fit
(`hbm.ik.start`). Where an optimum is far from its start, the frame is solved again from the rigid
fit. Where that leads lower, and in the spaced frames where markers show a limb only weakly, still
lower optima are looked for (`look_for_lower`); so they are in all frames of a recording that is not
continuous, if the first tries find any. The result therefore depends neither on how many frames are
solved at once nor on the number of threads.

Frame by frame (`FrameTracker`), each starts from the one before and knows none after it.
Where the start is no good (the first frame, after frames without a solution, where the optimum is
far from it or markers return and do not fit) the frame is solved from a segment-wise rigid fit too,
and the lower optimum is kept. Where that is the rigid fit's and still does not fit, lower optima
are looked for: at once in the first frame, and else by one try in each of the frames that follow,
since one frame has no time for all of them. Coordinates that markers do not show keep their last
shown values.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from hbm.coordinates import FIRST_Q, LAST_Q, LIMBS, N_Q, TREE
from hbm.ik.continuity import MIN_JUMP_RAD, continuous, nearest_equivalent
from hbm.ik.descent import MAX_ABSOLUTE_RISE, ROW, OneFrame, Solved
from hbm.ik.problem import OF_CARRIERS, ROTATES, Problem
from hbm.ik.upright import HEADING_CUTOFF_HZ, TRUNK, YAW, standing_trunk, upright_trunk
from hbm.markers import Markers
from hbm.model import Body
from hbm.motion import Motion
from hbm.numbers import read_numbers
from hbm.signals.filtering import RealtimeFilter
from hbm.signals.samples import cubic_spline
from hbm.spatial import Array, Indices, Mask

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "observed")

TRIES: Final = 45
"""Of 6,000 random bodies and poses, 20 tries leave 5 above SciPy's best of five starts, 40 none."""

SPREADS_RAD: Final = (0.5, 1.0, 3.0)
"""Standard deviations of the changes, in turn: from another bend of a joint to any pose at all."""

FIRST_TRIES: Final = slice(len(SPREADS_RAD))
"""One of each: of a person whose markers allow several poses, they find a lower optimum in nearly
all frames."""


EQUAL_RELATIVE: Final = 1e-9
EQUAL_ABSOLUTE: Final = 1e-15
"""Difference of costs [m² times the weights] that is rounding."""

FRAMES_AT_ONCE: Final = 4000
"""Bounds the memory for the tries that are solved at once."""


def look_for_lower(problem: Problem, optima: Solved, which: Indices) -> None:
    """Replace some optima, (R,), by lower ones where tries from other starts find any.

    The tries are the same for every frame, so that the result does not depend on which others are
    solved with it.
    """
    which = which[np.isfinite(optima.q[which]).all(axis=1)]
    step = FRAMES_AT_ONCE // TRIES
    for first in range(0, len(which), step):
        block = which[first : first + step]
        # nearly always, the second round finds nothing lower
        for _ in range(3):
            # again only where the last round found a lower optimum
            before = optima.select(block)
            after = lowest_of_tries(problem, before)
            optima.overwrite(block, after)
            block = block[_lower(problem, before, after)]
            if not len(block):
                break


def some_lower(problem: Problem, optima: Solved, which: Indices) -> bool:
    """Whether the first tries lead to a lower optimum in any of some frames, (R,)."""
    step = FRAMES_AT_ONCE // FIRST_TRIES.stop
    blocks = (optima.select(which[k : k + step]) for k in range(0, len(which), step))
    return any(_lower(problem, b, lowest_of_tries(problem, b, FIRST_TRIES)).any() for b in blocks)


def _lower(problem: Problem, before: Solved, after: Solved) -> Mask:
    just_below = problem.cost(before) * (1 - EQUAL_RELATIVE) - EQUAL_ABSOLUTE
    return np.asarray(problem.cost(after) < just_below)


def lowest_of_tries(problem: Problem, solved: Solved, tries: slice = slice(None)) -> Solved:
    """Give the lowest optima of one round of tries, or of some of a round, and of those given.

    Every start is solved with trunk and pelvis held, so that the limbs are independent, and freely,
    since trunk and pelvis may be wrong; limbs are exchanged between the former and between all.
    """
    changes = _changes()[tries]
    starts = (solved.q + changes).reshape(-1, N_Q)
    again = np.tile(solved.row, len(changes))
    # first with pelvis and trunk held, so that limbs change alone, then with all free
    held = np.tile(OF_CARRIERS, (len(starts), 1)), np.tile(solved.q, (len(changes), 1))
    limbs_alone = Solved.joined(solved, problem.newton(again, starts, held))
    every = Solved.joined(limbs_alone, problem.newton(again, starts))
    frames = len(solved.row)
    # the best solution of each limb may come from another try: together they start once more
    exchanged = [
        problem.newton(solved.row, _best_limbs(problem, solutions, frames))
        for solutions in (limbs_alone, every)
    ]
    optima = Solved.joined(every, *exchanged)
    return optima.select(_lowest_nearest_to_neutral(problem.cost(optima), optima.q, frames))


def _best_limbs(problem: Problem, solved: Solved, frames: int) -> Array:
    """Give the first solutions with each limb as in the one where it costs least, (F, 46)."""
    square = np.nan_to_num(problem.attachment.weight * solved.error**2)
    square[~solved.converged] = np.inf
    prior = problem.pull(solved)
    q = solved.q[:frames].copy()
    for segments in LIMBS.values():
        limb = slice(FIRST_Q[segments[0]], LAST_Q[segments[-1]] + 1)
        # markers and priors of a limb depend on no other limb
        cost = square[:, problem.markers_on(segments)].sum(axis=1) + prior[:, limb].sum(axis=1)
        best = _lowest_nearest_to_neutral(cost, solved.q[:, limb], frames)
        q[:, limb] = solved.q[best, limb]
    return q


def _lowest_nearest_to_neutral(cost: Array, q: Array, frames: int) -> Indices:
    """Give the number of the best solution of each frame, (F,).

    From the costs, (S · F,), and coordinates, (S · F, n), of S solutions, one after the other.
    """
    costs = cost.reshape(-1, frames)
    # equal costs are one pose in other angles, or several: the nearest to neutral is human
    from_neutral = np.abs((q + np.pi) % (2 * np.pi) - np.pi).sum(axis=1).reshape(-1, frames)
    least = costs.min(axis=0)
    equal = costs <= least * (1 + EQUAL_RELATIVE) + EQUAL_ABSOLUTE
    best = np.where(equal, from_neutral, np.inf).argmin(axis=0)
    return np.asarray(best * frames + np.arange(frames))


@cache
def _changes() -> Array:
    """Give the random changes of the coordinates, (TRIES, 1, 46) [rad]; translations stay."""
    # the same in every trial, so that results can be repeated
    random = np.random.default_rng(0).normal(size=(TRIES, 1, N_Q))
    return np.asarray(random * ROTATES * np.resize(SPREADS_RAD, (TRIES, 1, 1)))


KEY_FRAME_SPACING: Final = 15
"""Frames per key frame: 0.15 s at 100 Hz, so that a spline between them starts near the optimum."""


def solve_ik(
    body: Body,
    markers: Markers,
    *,
    tolerance: float = 1e-6,
    jobs: int = 1,
    near: Array | None = None,
) -> Motion:
    """Find the coordinates whose markers lie nearest to the measured ones.

    Parameters
    ----------
    body
        The subject.
    markers
        Measured trajectories, lab axes; gaps are NaN. Labels that the body does not know are
        ignored.
    tolerance
        Largest last step of any coordinate [rad or m]; convergence is quadratic, so the error that
        remains is far smaller.
    jobs
        Threads.
    near
        Coordinates of almost the same body and markers, (T, 46), from which frames start; those
        where they are NaN are not solved.

    Returns
    -------
    Motion
        ``q``, marker errors and which coordinates were observed; ``v`` and ``a`` are NaN until
        `filter_motion`. A prior holds near zero what the markers of the trial do not determine
        (`hbm.ik.problem`); what none of them shows is zero. A trunk is held upright in the lab
        instead (`hbm.ik.upright`). Coordinates that lose their markers for a while, and limbs whose
        markers fit no pose, are interpolated in time.
        Only a pelvis or a trunk that markers do not show leaves a frame unsolved.

    Raises
    ------
    ValueError
        If none of the body's markers is in the trial.

    Examples
    --------
    With ``static``, the markers of a T-pose, and ``body``, built from them:

    >>> import hbm, numpy as np
    >>> motion = hbm.solve_ik(body, static)
    >>> f"{1000 * motion.marker_error.max():.3f} mm"
    '0.000 mm'
    >>> f"{np.degrees(motion.coordinate('LShoulderAbduction').mean()):.0f}°"
    '94°'
    """
    problem = Problem(body, markers, tolerance, jobs)
    problem.stand_upright()
    frames = np.arange(len(problem.time))
    start, usual_pivots = _starting_points(problem, frames) if near is None else (near, None)
    optima = problem.newton(frames, start)
    if near is not None:
        usual_pivots = np.median(optima.pivots[optima.converged], axis=0)
    # where no marker is, there is nothing to find, and nothing to tell of other frames
    shown = np.isfinite(optima.error).any(axis=1)
    # an optimum far from its start may be the wrong one of several
    far = shown & (~optima.converged | _far(optima.q, start))
    # frames that jump are no recording in time: each is judged by itself
    if np.count_nonzero(far) > LIMITS.most_far * np.count_nonzero(shown):
        usual_pivots = None
    doubted = np.flatnonzero(far)
    which = doubted[try_start(problem, optima, doubted, problem.rigid_fit(doubted))]
    if usual_pivots is None:
        # all frames are tried where one that looks sound has a lower optimum
        likely = doubtful(problem, optima)
        some_others = some_lower(problem, optima, np.flatnonzero(shown & ~likely))
        which = np.flatnonzero(shown & (likely | some_others))
    look_for_lower(problem, optima, which)
    left_out = leave_limbs_out(problem, optima)
    expected: Mask = np.asarray(np.isfinite(optima.error).any(axis=0))
    observed = observed_by(problem, optima, usual_pivots, expected) & ~left_out
    # without pelvis and trunk nothing else has a place
    placed: Mask = np.asarray(observed[:, problem.carriers].all(axis=1))
    # unsolved frames are no neighbours for angles and gaps
    optima.q[~placed | ~optima.converged & observed[:, ~problem.locked].all(axis=1)] = np.nan
    optima.q[:] = continuous(optima.q)
    _bridge_gaps(problem, optima, observed & placed[:, None], left_out, usual_pivots is None)
    optima.converged[~placed] = False
    optima.q[~optima.converged] = np.nan
    optima.error[~optima.converged] = np.nan
    if problem.unseen_trunk:
        optima.q[:, TRUNK] = standing_trunk(problem.time, optima.q)
    unknown = np.full(optima.q.shape, np.nan)
    return Motion(
        problem.time,
        optima.q,
        unknown,
        unknown,
        problem.names,
        optima.error,
        optima.converged,
        observed & optima.converged[:, None],
    )


def _starting_points(problem: Problem, frames: Indices) -> tuple[Array, Array | None]:
    """Give every frame a starting point: splines between key frames solved from rigid fits.

    Starting points, (T, 46), NaN where nothing is known, and the median pivots of the key frames,
    (46,): None where there are too few of them, so that frames tell nothing of each other, and the
    starting points are rigid fits.
    """
    keys = _key_frames(problem)
    optima = problem.newton(keys, problem.rigid_fit(keys))
    look_for_lower(problem, optima, np.flatnonzero(doubtful(problem, optima)))
    solved = np.flatnonzero(optima.converged)
    # a cubic spline needs four
    if len(solved) < 4:
        return problem.rigid_fit(frames), None
    optima.q[solved] = continuous(optima.q[solved])
    inner = solved[1:-1]
    # a key frame away from the mean of its neighbours is tried from there
    between = (optima.q[solved[:-2]] + optima.q[solved[2:]]) / 2
    isolated = _far(optima.q[inner], between)
    try_start(problem, optima, inner[isolated], between[isolated])
    spline = cubic_spline(keys[solved].astype(float), continuous(optima.q[solved]))
    start = np.asarray(spline(np.clip(frames, keys[solved[0]], keys[solved[-1]])))
    return start, np.median(optima.pivots[solved], axis=0)


def _key_frames(problem: Problem) -> Indices:
    """Choose the frame with the most markers in each interval, and both ends."""
    frames, attachment = len(problem.time), problem.attachment
    count = np.full(-(-frames // KEY_FRAME_SPACING) * KEY_FRAME_SPACING, -1)
    count[:frames] = np.isfinite(attachment.position[:, attachment.column, 0]).sum(axis=1)
    intervals = count.reshape(-1, KEY_FRAME_SPACING)
    best = intervals.argmax(axis=1) + KEY_FRAME_SPACING * np.arange(len(intervals))
    return np.unique([0, *best, frames - 1])


def _far(q: Array, start: Array) -> Mask:
    """Whether poses are far from their starting points, (F,)."""
    return np.asarray(np.abs(q - start).max(axis=1, initial=0) > LIMITS.far)


def doubtful(problem: Problem, optima: Solved) -> Mask:
    """Whether an optimum lower than that from a rigid fit is likely, (F,).

    So it is where markers show a limb weakly, or it does not fit them.
    """
    # a pivot without its prior is what the markers alone show of a coordinate
    pivots = (optima.pivots - problem.prior)[:, ROTATES & ~problem.locked]
    weight = problem.attachment.weight.max()
    # not shown at all is no doubt: a prior holds it
    weak = (pivots > LIMITS.least_pivot * weight) & (pivots < LIMITS.clear_pivot * weight)
    doubtful: Mask = ~optima.converged | weak.any(axis=1)
    for segments in LIMBS.values():
        square = optima.error[:, problem.markers_on(segments)] ** 2
        is_finite = np.isfinite(square)
        largest = LIMITS.clear_distance**2 * is_finite.sum(axis=1)
        doubtful |= np.where(is_finite, square, 0).sum(axis=1) > largest
    return np.asarray(doubtful)


def try_start(problem: Problem, earlier: Solved, which: Indices, start: Array) -> Mask:
    """Solve some frames, (R,), from another start too, and keep the lower optimum.

    Gives whether that is a lower one, or neither start leads to an optimum, (R,).
    """
    solved = problem.newton(earlier.row[which], start)
    before, after = (problem.cost(optima) for optima in (earlier.select(which), solved))
    better = after < before
    earlier.overwrite(which[better], solved.select(better))
    # lower by more than rounding, or neither has converged
    lower = after < before * (1 - 1e-6) - MAX_ABSOLUTE_RISE
    return np.asarray(lower | np.isinf(np.minimum(before, after)))


def leave_limbs_out(problem: Problem, optima: Solved) -> Mask:
    """Solve frames that did not converge without the fewest limbs that keep them from it.

    Gives the coordinates that are left out, (F, 46).
    """
    left_out = np.zeros(optima.q.shape, bool)
    # one limb, then two, …: the fewest that keep a frame from converging
    choices = (c for count in range(1, len(LIMBS) + 1) for c in combinations(LIMBS, count))
    for names in choices:
        which = np.flatnonzero(~optima.converged)
        which = which[np.isfinite(optima.q[which]).all(axis=1)]
        if not len(which):
            break
        segments = {s for name in names for s in LIMBS[name]}
        without = problem.without(segments)
        solved = without.newton(optima.row[which], optima.q[which])
        which, solved = which[solved.converged], solved.select(solved.converged)
        solved.error[:, problem.markers_on(segments)] = np.nan
        optima.overwrite(which, solved)
        left_out[which] = [c.segment in segments for c in TREE]
    return left_out


def observed_by(
    problem: Problem, optima: Solved, usual_pivots: Array | None, expected: Mask
) -> Mask:
    """Which coordinates the visible markers determine, (F, 46).

    A coordinate is determined where the curvature that remains to it once all coordinates beyond it
    are free (its pivot) is not nearly zero and, in frames in which an expected marker, (K,), is
    missing, not small compared with what is usual in the trial. One with a prior always is, so that
    it does not depend on the pose; a locked one never.
    """
    from_markers = optima.pivots - problem.prior
    observed: Mask = np.asarray(from_markers > problem.least_pivots)
    # markers that are left may show a coordinate, but far less well than is usual
    if usual_pivots is not None:
        gaps = (np.isnan(optima.error) & expected).any(axis=1)
        if gaps.any():
            observed[gaps] &= from_markers[gaps] > LIMITS.least_of_usual * usual_pivots
    return observed


def _bridge_gaps(
    problem: Problem, optima: Solved, observed: Mask, left_out: Mask, unrelated: bool
) -> None:
    """Interpolate coordinates that are not observed, (T, 46), between their neighbours in time.

    Where a remaining marker depends on them, the other coordinates are solved again; none does on
    those of limbs that are left out, (T, 46). Where frames tell nothing of each other, only
    coordinates on which no marker depends are interpolated.
    """
    present = ~np.isnan(optima.q[:, 0])
    lost = ~(observed | problem.locked) & present[:, None]
    related = depended_on(problem, optima, left_out)
    if unrelated:
        lost &= ~related
    which = np.flatnonzero((lost & related).any(axis=1))
    for i in np.flatnonzero(lost.any(axis=0)):
        gap = np.flatnonzero(lost[:, i])
        # a line between the frames that show it; its ends are constant
        shown = np.flatnonzero(observed[:, i] & optima.converged)
        optima.q[gap, i] = np.interp(gap, shown, optima.q[shown, i]) if len(shown) else 0.0
    q = optima.q[which]
    optima.overwrite(which, problem.newton(optima.row[which], q, (lost[which], q)))


def depended_on(problem: Problem, optima: Solved, left_out: Mask) -> Mask:
    """Whether markers that are used depend on each coordinate, (F, 46)."""
    # changing a coordinate of less curvature moves no marker
    related = ~optima.converged[:, None] | (optima.pivots - problem.prior > 1e-8)
    return np.asarray(related & ~left_out)


class FrameSolution(NamedTuple):
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
    pivots
        Of the Hessian's factorisation, (46,).
    looked
        Whether a lower optimum is looked for.
    """

    q: Array
    marker_error: Array
    converged: bool
    observed: Mask
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
        self.heading = RealtimeFilter(HEADING_CUTOFF_HZ, 1, 0.01)

    def solve(self, position: Array) -> FrameSolution:
        """Solve a frame that follows the last one kept, from markers (M, 3), and keep nothing."""
        self.position[0] = position
        # in real time the prior of the trunk follows the heading so far
        if self.q is not None and self.problem.weak_trunk:
            self.problem.reference[0, TRUNK] = self._upright(self.q)
        if not self.seen.all():  # hold near neutral what no marker that was ever seen determines
            ever_seen = self.seen | np.isfinite(self.position[0, self.columns, 0])
            if (ever_seen != self.problem.seen).any():
                self.problem.hold(ever_seen)
        optimum, looked = self._first() if self.q is None else self._next(self.q)
        observed, left_out = self._observed(optimum), np.zeros((1, N_Q), bool)
        if not optimum.converged[0]:
            left_out = leave_limbs_out(self.problem, optimum)
            observed = self._observed(optimum) & ~left_out[0]
        every = bool((observed | self.problem.locked).all())
        solved = every or bool(observed[self.problem.carriers].all())
        if solved and not every:
            self._hold(optimum, ~observed & ~self.problem.locked, left_out)
        solved = solved and bool(optimum.converged[0])
        q, error = optimum.q[0].copy(), optimum.error[0].copy()
        if not solved:
            q[:] = error[:] = np.nan
        elif self.q is None:
            q = continuous(q[None])[0]
        # a full turn or a joint's other angles: the pose is the same
        elif np.abs(q - self.q).max() > MIN_JUMP_RAD:
            q = nearest_equivalent(q, self.q)
        if looked:
            observed &= self.problem.carriers
        return FrameSolution(q, error, solved, observed & solved, optimum.pivots[0].copy(), looked)

    def keep(self, solution: FrameSolution, time: float) -> FrameSolution:
        """Take a solution as the one that the next frame follows; give it with its whole trunk."""
        self.begun = self.begun or bool(np.isfinite(self.position[0, self.columns, 0]).any())
        self.tracked = solution.observed | (solution.looked & ~self.problem.carriers)
        if solution.looked:
            self.tries_left = (self.tries_left or TRIES) - 1
        if not solution.converged:
            return solution
        visible = np.isfinite(solution.marker_error)
        self.q, self.seen = solution.q, self.seen | visible
        self.shown[solution.observed] = solution.q[solution.observed]
        # what is usual is learnt from frames without gaps
        if visible[self.seen].all():
            self.usual_pivots = solution.pivots
        if self.problem.unseen_trunk or self.problem.weak_trunk:
            self.heading.step(time, solution.q[[YAW]])
        if not self.problem.unseen_trunk:
            return solution
        q = solution.q.copy()
        q[TRUNK] = self._upright(q)
        return solution._replace(q=q)

    def _upright(self, q: Array) -> Array:
        """Give the angles, (3,), with which the trunk of a pose stands upright, facing ahead."""
        angles: Array = upright_trunk(q[None], self.heading.value)[0]
        return angles

    def _first(self) -> tuple[Solved, bool]:
        """Solve a frame before which none was solved."""
        optimum = self.problem.newton(ROW, self.problem.rigid_fit(ROW))
        if not self.begun and doubtful(self.problem, optimum)[0]:
            look_for_lower(self.problem, optimum, ROW)
        return optimum, False

    def _next(self, q: Array) -> tuple[Solved, bool]:
        """Solve a frame from the last one; where that is no good, from a rigid fit too.

        Gives also whether a lower optimum is likely and is looked for.
        """
        problem = self.problem
        optimum, looked = self.descent.solve(q), self.tries_left > 0
        if self._start_is_no_good(optimum, q):
            lower = try_start(problem, optimum, ROW, problem.rigid_fit(ROW))[0]
            looked |= bool(lower and doubtful(problem, optimum)[0])
        if looked and np.isfinite(optimum.q[0]).all():
            # one try in each frame, so that no frame is late
            number = (TRIES - self.tries_left) % TRIES
            optimum.overwrite(ROW, lowest_of_tries(problem, optimum, slice(number, number + 1)))
        return optimum, looked

    def _start_is_no_good(self, optimum: Solved, q: Array) -> bool:
        if not optimum.converged[0] or np.abs(optimum.q[0] - q).max() > LIMITS.far:
            return True
        if (self.tracked | self.problem.locked).all():
            return False
        # a limb that comes back may have moved too far for the last pose to lead to it
        returned = self._observed(optimum) & ~self.tracked
        return bool(returned.any() and doubtful(self.problem, optimum)[0])

    def _observed(self, optimum: Solved) -> Mask:
        """Which coordinates the markers determine, (46,); as is usual since none was missing."""
        observed = observed_by(self.problem, optimum, self.usual_pivots, self.seen)
        return np.asarray(observed[0])

    def _hold(self, optimum: Solved, lost: Mask, left_out: Mask) -> None:
        """Hold coordinates that markers do not show, and solve the others again if need be."""
        related = depended_on(self.problem, optimum, left_out)[0]
        optimum.q[0, lost] = self.shown[lost]
        if (lost & related).any():
            optimum.overwrite(ROW, self.problem.newton(ROW, optimum.q, (lost[None], optimum.q)))
