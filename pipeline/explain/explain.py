"""Why a trial's residuals are as large as they are: the causes, their sizes and their shares."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from compensation.inertia.sensors import QUANTILE_95
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.explain.budget import Budget, EstimatedCause, GroupShare
from pipeline.explain.cause import OF_PERSON
from pipeline.explain.joint import trial_evidence
from pipeline.explain.linearise import (
    LIMITS,
    Linearised,
    explained_part,
    left_by_filter,
    linearised,
    rms,
)
from pipeline.explain.sizes import Posterior
from pipeline.explain.uncertainty import measured_uncertainty, noise_of_samples
from pipeline.io.recording import Recording
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.result import TrialResult

SHARES: Final = read_numbers("pipeline.explain", "thresholds.toml", "shares")


def explain_trial(recording: Recording, laboratory: Laboratory, result: TrialResult) -> Budget:
    """Find what the residuals of a trial are made of.

    Parameters
    ----------
    recording
        The trial as read.
    laboratory
        The treadmill and its calibrations, as when it was processed.
    result
        The processed trial.

    Returns
    -------
    Budget
        Of the compensated residuals where there are some.

    Raises
    ------
    ValueError
        If no frame of the trial counts.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.config.schema import Treadmill
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=12.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> budget = explain_trial(walk, Laboratory(Treadmill()), result)
    >>> whole = sum(group.share for group in budget.groups) + budget.unexplained
    >>> whole.round(6).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    """
    part = explained_part(recording, laboratory, result)
    chain, counts = part.chain, part.counts
    left, noise = left_by_filter(chain), noise_of_samples(chain)
    as_measured, model, posterior = linearised(part, left, noise)
    uncertainty, of_window, bands = measured_uncertainty(part, as_measured, noise, result)

    # the last is the RMS of what is explained: compensated where the plates are
    residual, effects = chain.residual[counts], model.effects[:, counts]
    whole, middle = rms(residual), uncertainty[-1].rms
    half = QUANTILE_95 * uncertainty[-1].deviation
    groups, unexplained = _shares(model, posterior, residual, left[counts])
    estimated = [
        EstimatedCause(
            name=cause.name,
            group=cause.group,
            unit=cause.prior.unit,
            size=float(size),
            deviation=float(deviation),
            usual=cause.prior.usual,
            chance=float(chance),
            left=rms(residual - size * effect),
            in_lab=cause.in_lab,
        )
        for cause, size, deviation, chance, effect in zip(
            part.causes, *posterior.if_there, posterior.chance, effects, strict=True
        )
    ]
    cycles, notes = len(part.series) if part.found_cycles else 0, []
    if cycles < LIMITS.fewest_cycles:
        duration_s = float(np.median(np.diff(chain.time))) * len(residual)
        few = {"cycles": cycles, "wanted": LIMITS.fewest_cycles, "duration_s": duration_s}
        notes.append(Note.of("explained_few_cycles", **few))
    return Budget(
        source=Path(result.source.name),
        compensated=result.compensated is not None,
        rms=whole,
        low=np.maximum(middle - half, 0.0),
        high=middle + half,
        cycles=cycles,
        found_cycles=part.found_cycles,
        groups=groups,
        unexplained=unexplained,
        causes=tuple(sorted(estimated, key=lambda cause: float((cause.left / whole).min()))),
        held_out=_held_out(model),
        notes=tuple(notes),
        uncertainty=uncertainty,
        of_window=of_window,
        bands=bands,
        evidence=trial_evidence(model, estimated, result.subject.id, str(result.name)),
    )


def _shares(
    model: Linearised, posterior: Posterior, residual: Array, left: Array
) -> tuple[tuple[GroupShare, ...], Array]:
    """Give the shares of groups of causes and what the filter leaves, and what none describes."""
    members: dict[str, list[int]] = {}
    for k, cause in enumerate(model.part.causes):
        members.setdefault(cause.group, []).append(k)
    # what the filter leaves is known: a cause of size one
    members["filter"] = [len(model.part.causes)]
    size, covariance = np.append(posterior.size, 1.0), np.pad(posterior.covariance, (0, 1))
    effects = np.concatenate([model.effects[:, model.part.counts], left[None]])
    shares = shares_of_groups(residual, effects, size, covariance, [*members.values()])
    # body and markers are one group from the start: no trial tells them apart
    names, sets = list(members), dict[str, list[int]]()
    for g, name in enumerate(names):
        sets.setdefault("person" if name in OF_PERSON else name, []).append(g)
    together = indistinct(shares, list(sets.values()))
    joined = shares.joined(together)
    groups = [
        GroupShare(tuple(names[g] for g in alike), share, deviation)
        for alike, share, deviation in zip(together, joined.share, joined.deviation, strict=True)
    ]
    return tuple(groups), shares.unexplained


def _held_out(model: Linearised) -> Array:
    """Give the share of one half's mean square that causes found in the other half take away."""
    before, after = np.zeros(6), np.zeros(6)
    for half, other in (model.part.halves, model.part.halves[::-1]):
        # sizes of one half, taken away from the other
        size, frames = model.sizes(half).size, np.concatenate(other.frames)
        rest = model.residual[frames] - np.tensordot(size, model.effects[:, frames], 1)
        before += (model.residual[frames] ** 2).sum(axis=0)
        after += (rest**2).sum(axis=0)
    return np.asarray(1 - after / before)


@dataclass(frozen=True, slots=True, eq=False)
class Shares:
    """Shares of the mean square of each axis.

    Attributes
    ----------
    share
        Of each of G groups, (G, 6); with `unexplained` they sum to 1. A group that works against
        the others has a negative share.
    covariance
        Between the shares of each axis, (6, G, G).
    unexplained
        What no group describes, (6,).
    """

    share: Array
    covariance: Array
    unexplained: Array

    @property
    def deviation(self) -> Array:
        """One standard deviation of each share, (G, 6)."""
        return np.asarray(np.sqrt(np.einsum("xgg->gx", self.covariance)))

    def joined(self, sets: Sequence[Sequence[int]]) -> "Shares":
        """Give the shares of sets of groups."""
        sums = _members(sets, len(self.share))
        return Shares(sums @ self.share, sums @ self.covariance @ sums.T, self.unexplained)


def shares_of_groups(
    residual: Array, effects: Array, size: Array, covariance: Array, groups: Sequence[Sequence[int]]
) -> Shares:
    """Split the mean square of a residual among groups of causes.

    Parameters
    ----------
    residual
        At the frames that count, (T, 6) [N, N·m].
    effects
        What each cause adds per unit, (K, T, 6).
    size, covariance
        Sizes of the causes, (K,), and their covariance, (K, K).
    groups
        The causes of each group.

    Returns
    -------
    Shares
        Shapley values of the fall of the mean square when groups are taken away one after the
        other, over all orders: with ``r_g`` of group g, ``r_u`` of no group and ``r`` their sum,
        ``⟨r_g, r + r_u⟩ / ⟨r, r⟩``; and ``⟨r_u, r_u⟩ / ⟨r, r⟩`` is not explained. Their covariance
        is that of the sizes, to first order.

    Notes
    -----
    Taking group g away where the groups of S are gone lowers the mean square by
    ``2⟨r_g, r − r_S⟩ − ⟨r_g, r_g⟩``. Over all orders the mean of ``r_S`` is half of the sum of the
    other groups, which gives the above (Shapley 1953, Ann Math Stud 28:307).
    """
    inside = _members(groups, len(size))
    member = inside * size
    share = np.empty((len(groups), 6))
    between = np.empty((6, len(groups), len(groups)))
    for axis in range(6):
        whole, of_causes = residual[:, axis], effects[:, :, axis]
        square, gram = whole @ whole, of_causes @ of_causes.T
        # r + r_u = 2 r - sum of all groups, so that ⟨e_k, r + r_u⟩ = 2⟨e_k, r⟩ - (gram s)_k
        with_rest = 2 * (of_causes @ whole) - gram @ size
        share[:, axis] = member @ with_rest / square
        # derivative of each share by each size, through r_g and through r_u
        slope = (inside * with_rest - member @ gram) / square
        between[axis] = slope @ covariance @ slope.T
    return Shares(share, between, 1 - share.sum(axis=0))


def _members(sets: Sequence[Sequence[int]], count: int) -> Array:
    """Give which of so many are in each set, (sets, count), 0 or 1."""
    return np.array([np.isin(np.arange(count), members) for members in sets], float)


def indistinct(shares: Shares, together: Sequence[Sequence[int]]) -> list[list[int]]:
    """Join groups that a trial cannot tell apart.

    Two are joined where what one has too much the other has too little, unless one of them is sure:
    its share's 95 % interval leaves out zero.

    Parameters
    ----------
    shares
        Of the groups.
    together
        Sets of groups that are named together anyway.

    Returns
    -------
    list of list of int
        The groups that are named together, in their order.
    """
    sets = [list(groups) for groups in together]
    while len(sets) > 1:
        joined = shares.joined(sets)
        # over all six residuals at once: a pair is told apart in all of them or in none
        covariance = joined.covariance.mean(axis=0)
        spread = np.sqrt(np.diag(covariance))
        size = np.sqrt((joined.share**2).mean(axis=1))
        # a pair is in doubt only if neither of its shares is sure
        unsure = np.where(size < QUANTILE_95 * spread, spread, 0.0)
        doubted = np.minimum.outer(unsure, unsure) > SHARES.least_doubt
        product = np.maximum(np.outer(spread, spread), SHARES.least_doubt**2)
        correlation = np.where(doubted, covariance / product, 0.0)
        # the pair that is most opposed first, since joining it changes the others
        first, second = sorted(np.unravel_index(correlation.argmin(), correlation.shape))
        if correlation[first, second] > SHARES.indistinct_correlation:
            break
        sets[first] = sorted(sets[first] + sets.pop(second))
    return sets
