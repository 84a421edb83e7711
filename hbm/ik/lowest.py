"""The lowest of several optima of a frame.

Where few markers show a limb, the sum of squares has several optima, such as a thigh turned by half
a turn with the knee bent backwards. All rotations are changed at random and the frame is solved
again, many times. As head and limbs hardly affect each other, each then takes the pose in which its
own markers fit best, whatever the others did in that try. Of poses that fit equally well, such as
two of a hand with one marker, the one nearer to neutral is taken.
"""

from functools import cache
from typing import Final

import numpy as np

from hbm.coordinates import CARRIERS, FIRST_Q, LAST_Q, LIMBS, N_Q, TREE
from hbm.ik.descent import Solved
from hbm.ik.problem import Problem
from hbm.spatial import Array, Indices

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
    prior = problem.prior * (solved.q - problem.reference) ** 2
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
