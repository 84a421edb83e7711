"""Why a trial's residuals are as large as they are: the causes, their sizes and their shares."""

from collections.abc import Sequence

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from pipeline.explain.budget import Budget, EstimatedCause, GroupShare
from pipeline.explain.cause import OF_PERSON, Cause
from pipeline.explain.joint import trial_evidence
from pipeline.explain.linearise import (
    MIN_CYCLES,
    ExplainedPart,
    explained_part,
    left_by_filter,
    linearised,
    rms,
)
from pipeline.explain.shares import NORMAL_95, indistinct, shares_of_groups
from pipeline.explain.sizes import Posterior, sizes_from_cycles
from pipeline.explain.uncertainty import measured_uncertainty, noise_of_samples
from pipeline.io.recording import Recording
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.result import TrialResult


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
    chain, causes, counts = part.chain, part.causes, part.counts
    left = left_by_filter(chain)
    noise = noise_of_samples(chain)
    as_measured, effects, posterior = linearised(chain, causes, left, part.series, noise)
    of = result.subject.id, str(result.name)
    uncertainty, of_window, bands = measured_uncertainty(part, as_measured, noise, result)

    residual, of_causes = chain.residual[counts], effects[:, counts]
    whole, middle = rms(residual), uncertainty[-1].rms
    half = NORMAL_95 * uncertainty[-1].deviation
    groups, unexplained = _shares(posterior, causes, residual, of_causes, left[counts])
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
            causes, *posterior.if_there, posterior.chance, of_causes, strict=True
        )
    ]
    cycles = len(part.series) if part.found_cycles else 0
    notes = []
    if cycles < MIN_CYCLES:
        duration_s = float(np.median(np.diff(chain.time))) * len(residual)
        few = {"cycles": cycles, "wanted": MIN_CYCLES, "duration_s": duration_s}
        notes.append(Note.of("explained_few_cycles", **few))
    return Budget(
        source=result.source,
        compensated=result.compensated is not None,
        rms=whole,
        low=np.maximum(middle - half, 0.0),
        high=middle + half,
        cycles=cycles,
        found_cycles=part.found_cycles,
        groups=groups,
        unexplained=unexplained,
        causes=tuple(sorted(estimated, key=lambda each: float((each.left / whole).min()))),
        held_out=_held_out(chain.residual - left, effects, part, noise),
        notes=tuple(notes),
        uncertainty=uncertainty,
        of_window=of_window,
        bands=bands,
        evidence=trial_evidence(part, chain.residual - left, effects, noise, of),
    )


def _shares(
    posterior: Posterior,
    causes: Sequence[Cause],
    residual: Array,
    effects: Array,
    left: Array,
) -> tuple[tuple[GroupShare, ...], Array]:
    """Give the shares of groups of causes and what the filter leaves, and what none describes."""
    names = list(dict.fromkeys(cause.group for cause in causes))
    members = [[k for k, c in enumerate(causes) if c.group == name] for name in names]
    # what the filter leaves is known: a cause of size one
    size = np.append(posterior.size, 1.0)
    covariance = np.pad(posterior.covariance, (0, 1))
    members.append([len(causes)])
    names.append("filter")
    every = np.concatenate([effects, left[None]])
    shares = shares_of_groups(residual, every, size, covariance, members)
    named: dict[str, list[int]] = {}
    for g, name in enumerate(names):
        named.setdefault("person" if name in OF_PERSON else name, []).append(g)
    together = indistinct(shares, list(named.values()))
    joined = shares.joined(together)
    groups = [
        GroupShare(tuple(names[g] for g in own), share, deviation)
        for own, share, deviation in zip(together, joined.share, joined.deviation, strict=True)
    ]
    return tuple(groups), shares.unexplained


def _held_out(residual: Array, effects: Array, part: ExplainedPart, noise: Array) -> Array:
    """Give the share of one half's mean square that causes found in the other half take away."""
    before, after = np.zeros(6), np.zeros(6)
    for own, other in (part.halves, part.halves[::-1]):
        size = sizes_from_cycles(residual, effects, part.causes, own, noise).size
        frames = np.concatenate(other.frames)
        left = residual[frames] - np.tensordot(size, effects[:, frames], 1)
        before += (residual[frames] ** 2).sum(axis=0)
        after += (left**2).sum(axis=0)
    return np.asarray(1 - after / before)
