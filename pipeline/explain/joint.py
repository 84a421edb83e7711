"""Causes of all trials of a study together: what a laboratory or a subject shares has one size."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from hbm.spatial import Array
from pipeline.explain.budget import EstimatedCause, SharedCause, TrialEvidence
from pipeline.explain.cause import HELD
from pipeline.explain.linearise import Linearised
from pipeline.explain.sizes import Evidence, Posterior, find_faults

MENDABLE: Final = ("delay", "zero", "gain", "place", "inertia")
"""Groups of faults that settings can correct."""


def trial_evidence(
    model: Linearised, causes: Iterable[EstimatedCause], subject: str, trial: str
) -> TrialEvidence:
    """Gather what a trial says for its study.

    Parameters
    ----------
    model
        What the causes of the trial add to its residual.
    causes
        Their sizes by this trial alone.
    subject, trial
        Their names.
    """
    parts = (model.part.series, *model.part.halves)
    whole, first, second = (model.evidence(series, subject, trial) for series in parts)
    residual, added = model.residual[model.part.counts], model.effects[:, model.part.counts]
    return TrialEvidence(
        *(whole, first, second, tuple(causes)),
        *model.expected,
        mean_square=np.mean(residual**2, axis=0),
        frames=len(residual),
        along=np.einsum("tx,ktx->kx", residual, added) / len(residual),
        square=np.mean(added**2, axis=1),
    )


class _Usual(NamedTuple):
    """What all trials that share a cause expect of it; the deviation if it was found elsewhere."""

    mean: float
    size: float
    found: float


def explain_together(trials: Mapping[str, TrialEvidence]) -> list[SharedCause]:
    """Estimate the faults of all trials of a study together.

    Parameters
    ----------
    trials
        Name of a trial -> what it says.

    Returns
    -------
    list of SharedCause
        Delay and faults of the laboratory, of subjects and of trials. Those that are certain and
        that a setting can correct are judged on trials or, where it is of one trial, on gait cycles
        in which their size was not found.
    """
    usual = _usual(trials)
    faults = find_faults([_around(trial, trial.whole, usual) for trial in trials.values()])
    sizes = _in_units(faults, usual)
    # what was measured by other means than the residuals keeps that size
    sizes |= {name: [prior.mean, prior.found, 1.0] for name, prior in usual.items() if prior.found}
    shared = [_shared(name, trials, *size) for name, size in sizes.items()]
    certain = [s for s in shared if s.cause.is_certain and s.cause.group in MENDABLE]
    held_out: dict[str, Array] = {}
    # faults of the same trials are judged together, once those of other trials are taken away
    for names in dict.fromkeys(shared_cause.trials for shared_cause in certain):
        judged = [s.name for s in certain if s.trials == names]
        others = {s.name: s.cause.size for s in certain if s.name not in judged}
        without = {name: _without(trials[name], others) for name in names}
        held_out |= _held_out(judged, without, usual)
    return [replace(s, held_out=held_out.get(s.name, s.held_out)) for s in shared]


def _usual(trials: Mapping[str, TrialEvidence]) -> dict[str, _Usual]:
    """Give what is expected of each cause, by all trials that share it.

    A mean that was measured in several trials is weighed by its precision. The delay that the
    motion of a body shows is as unsure in all trials of a subject, whose body it is.
    """
    import pandas as pd  # of one trial it is not needed

    rows = pd.concat(
        pd.DataFrame({"name": trial.whole.names, "mean": trial.mean, "size": trial.size}).assign(
            found=trial.found, subject=trial.whole.subject
        )
        for trial in trials.values()
    )
    result = {}
    for name, of_trials in rows.groupby("name", sort=False):
        mean, deviation = of_trials["mean"], of_trials["size"]
        if not of_trials["found"].all():
            centre = np.average(mean, weights=deviation**-2.0)
            result[str(name)] = _Usual(float(centre), float(deviation.min()), 0.0)
            continue
        # within a subject the error of the body is the same: trials do not average it out
        subjects = [rows for _, rows in of_trials.groupby("subject", sort=False)]
        means = [np.average(s["mean"], weights=s["found"] ** -2.0) for s in subjects]
        squares = [np.mean(s["found"].to_numpy() ** 2) for s in subjects]
        # subjects are independent: precisions add up
        weights = np.sqrt(squares) ** -2.0
        deviation_of_mean = float(weights.sum() ** -0.5)
        centre = np.average(means, weights=weights)
        result[str(name)] = _Usual(float(centre), HELD * deviation_of_mean, deviation_of_mean)
    return result


def _around(trial: TrialEvidence, evidence: Evidence, usual: Mapping[str, _Usual]) -> Evidence:
    """Give evidence around what is expected by all trials, in usual sizes by all of them."""
    mean, size, _ = np.transpose([usual[name] for name in evidence.names])
    # effects are per usual size of the trial's own priors
    values = evidence.values - ((mean - trial.mean) / trial.size) @ evidence.effects
    effects = evidence.effects * (size / trial.size)[:, None]
    return replace(evidence, values=values, effects=effects)


def _in_units(faults: Posterior, usual: Mapping[str, _Usual]) -> dict[str, list[float]]:
    """Give size, deviation and chance of faults by name."""
    mean, unit, _ = np.transpose([usual[name] for name in faults.names])
    size, deviation = faults.if_there * unit
    rows = np.transpose([size + mean, deviation, faults.chance])
    return dict(zip(faults.names, rows.tolist(), strict=True))


def _shared(
    name: str, trials: Mapping[str, TrialEvidence], size: float, deviation: float, chance: float
) -> SharedCause:
    """Give a cause with what it does to the residuals of all trials that share it."""
    sharing = {key: trial for key, trial in trials.items() if name in trial.whole.names}
    frames = sum(float(trial.frames) for trial in sharing.values())
    square, cause = np.zeros((2, 6)), None
    for trial in sharing.values():
        k = trial.whole.names.index(name)
        cause = cause or trial.causes[k]
        # ⟨(r - s e)²⟩ = ⟨r²⟩ - 2 s ⟨r e⟩ + s² ⟨e²⟩, weighed by frames
        without = trial.mean_square - 2 * size * trial.along[k] + size**2 * trial.square[k]
        square += trial.frames / frames * np.array([trial.mean_square, without])
    before, left = np.sqrt(np.maximum(square, 0.0))
    assert cause is not None  # it is that of a trial
    cause = replace(cause, size=size, deviation=deviation, chance=chance, left=left)
    return SharedCause(name, tuple(sharing), cause, before, np.full(6, np.nan))


def _without(trial: TrialEvidence, sizes: Mapping[str, float]) -> TrialEvidence:
    """Give what a trial says once some causes are taken away."""
    expected = zip(trial.whole.names, trial.mean, strict=True)
    size = np.array([sizes.get(name, mean) for name, mean in expected])
    gone = (size - trial.mean) / trial.size
    halves = (trial.whole, trial.first, trial.second)
    whole, first, second = (replace(e, values=e.values - gone @ e.effects) for e in halves)
    return replace(trial, whole=whole, first=first, second=second)


def _held_out(
    names: Sequence[str], trials: Mapping[str, TrialEvidence], usual: Mapping[str, _Usual]
) -> dict[str, Array]:
    """Give what each of some causes takes away from one half with a size found in the other.

    Halves are of subjects, else of trials, else of the gait cycles of the only trial. All causes
    are taken away together; the share of one is that of the mean square with all others gone.
    """
    subjects = [trial.whole.subject for trial in trials.values()]
    units = subjects if len({*subjects}) > 1 else list(trials)
    # every other subject, or trial, is in the same half
    order = list(dict.fromkeys(units))
    halves: list[list[tuple[TrialEvidence, Evidence]]] = [[], []]
    for trial, unit in zip(trials.values(), units, strict=True):
        halves[order.index(unit) % 2].append((trial, trial.whole))
    if len(trials) == 1:
        halves = [[(trial, trial.first)], [(trial, trial.second)]]
    with_all, without = np.zeros(6), {name: np.zeros(6) for name in names}
    for found_in, judged_in in (halves, halves[::-1]):
        faults = find_faults([_around(trial, half, usual) for trial, half in found_in])
        estimates = _in_units(faults, usual)
        sizes = {
            name: estimates[name][0] if name in estimates else usual[name].mean for name in names
        }
        for trial, half in judged_in:
            place = {name: half.names.index(name) for name in sizes if name in half.names}
            effect = {name: half.effects[k] / trial.size[k] for name, k in place.items()}
            # the evidence is around expected means, which are put back before sizes are taken away
            rest = half.values + sum(trial.mean[k] * effect[name] for name, k in place.items())
            rest = rest - sum(sizes[name] * effect[name] for name in place)
            with_all += _by_axis(rest**2, half)
            # what one cause takes away is what its return would add
            for name in place:
                without[name] += _by_axis((rest + sizes[name] * effect[name]) ** 2, half)
    return {name: 1 - with_all / square for name, square in without.items()}


def _by_axis(values: Array, evidence: Evidence) -> Array:
    """Sum coefficients of each axis, (N,) to (6,)."""
    # `Evidence.axis` counts on by six for each pattern of cycles
    return np.asarray(np.bincount(evidence.axis % 6, values, minlength=6), float)
