"""Causes of all trials of a study together: what a laboratory or a subject shares has one size."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.explain.budget import EstimatedCause, SharedCause, TrialEvidence
from pipeline.explain.linearise import ExplainedPart
from pipeline.explain.sizes import HELD, Evidence, Faults, evidence_of, expected, find_faults

MENDABLE: Final = ("delay", "zero", "gain", "place", "inertia")
"""Groups of faults that settings can correct."""


def trial_evidence(
    part: ExplainedPart, residual: Array, effects: Array, noise: Array, of: tuple[str, str]
) -> TrialEvidence:
    """Gather what a trial says for its study.

    Parameters
    ----------
    part
        The part of the trial that is explained.
    residual, effects
        Without what the filter leaves, (T, 6), and of each cause per unit, (K, T, 6).
    noise
        Of samples, in each axis, (6,).
    of
        The subject, and the trial.
    """
    causes, counts = part.causes, part.counts
    say = partial(evidence_of, residual, effects, causes, noise=noise, of=of)
    mean, size, found = expected(causes)
    own, added = residual[counts], effects[:, counts]
    return TrialEvidence(
        subject=of[0],
        whole=say(series=part.series),
        first=say(series=part.halves[0]),
        second=say(series=part.halves[1]),
        titles=tuple(cause.name for cause in causes),
        groups=tuple(cause.group for cause in causes),
        units=tuple(cause.prior.unit for cause in causes),
        in_lab=tuple(cause.in_lab for cause in causes),
        usual=np.array([cause.prior.usual for cause in causes]),
        size=size,
        mean=mean,
        found=np.array([found.get(k, np.nan) for k in range(len(causes))]),
        mean_square=np.mean(own**2, axis=0),
        frames=len(own),
        along=np.einsum("tx,ktx->kx", own, added) / len(own),
        square=np.mean(added**2, axis=1),
    )


@dataclass(frozen=True, slots=True)
class _Usual:
    """What is expected of a cause in all trials that share it: mean, usual size, if found, how."""

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
    sizes = {name: _in_units(faults, k, usual[name]) for k, name in enumerate(faults.names)}
    late = (name for name, own in usual.items() if not np.isnan(own.found))
    sizes |= {name: (usual[name].mean, usual[name].found, 1.0) for name in late}
    shared = [_shared(name, trials, *own) for name, own in sizes.items()]
    certain = [own for own in shared if own.cause.is_certain and own.cause.group in MENDABLE]
    judged: dict[str, Array] = {}
    for names in dict.fromkeys(own.trials for own in certain):
        asked = [own for own in certain if own.trials == names]
        known = {own.name: own.cause.size for own in certain if own not in asked}
        own_trials = {name: _without(trials[name], known) for name in names}
        judged |= _held_out(asked, own_trials, usual)
    return [replace(own, held_out=judged.get(own.name, own.held_out)) for own in shared]


def _usual(trials: Mapping[str, TrialEvidence]) -> dict[str, _Usual]:
    """Give what is expected of each cause, by all trials that share it.

    A mean that was measured in several trials is weighed by its precision. The delay that the
    motion of a body shows is as unsure in all trials of a subject, whose body it is.
    """
    rows: dict[str, list[tuple[str, float, float, float]]] = {}
    for trial in trials.values():
        of_causes = zip(trial.whole.names, trial.mean, trial.size, trial.found, strict=True)
        for name, mean, size, found in of_causes:
            rows.setdefault(name, []).append((trial.subject, mean, size, found))
    result = {}
    for name, of_trials in rows.items():
        subject, *numbers = zip(*of_trials, strict=True)
        mean, size, found = np.array(numbers, float)
        if np.isnan(found).any():
            centre = np.average(mean, weights=size**-2.0)
            result[name] = _Usual(float(centre), float(size.min()), np.nan)
            continue
        means, deviations = [], []
        for one in dict.fromkeys(subject):
            own = np.array(subject) == one
            means.append(np.average(mean[own], weights=found[own] ** -2.0))
            deviations.append(np.sqrt(np.mean(found[own] ** 2)))
        weights = np.array(deviations) ** -2.0
        deviation = float(weights.sum() ** -0.5)
        result[name] = _Usual(
            float(np.average(means, weights=weights)), HELD * deviation, deviation
        )
    return result


def _around(trial: TrialEvidence, own: Evidence, usual: Mapping[str, _Usual]) -> Evidence:
    """Give evidence around what is expected by all trials, in usual sizes by all of them."""
    mean = np.array([usual[name].mean for name in own.names])
    size = np.array([usual[name].size for name in own.names])
    values = own.values - ((mean - trial.mean) / trial.size) @ own.effects
    return replace(own, values=values, effects=own.effects * (size / trial.size)[:, None])


def _in_units(faults: Faults, k: int, usual: _Usual) -> tuple[float, float, float]:
    """Give size, deviation and chance of a fault."""
    size, deviation = faults.if_there[:, k] * usual.size
    return float(size + usual.mean), float(deviation), float(faults.chance[k])


def _shared(
    name: str, trials: Mapping[str, TrialEvidence], size: float, deviation: float, chance: float
) -> SharedCause:
    """Give a cause with what it does to the residuals of all trials that share it."""
    own = {each: trial for each, trial in trials.items() if name in trial.whole.names}
    frames = np.array([trial.frames for trial in own.values()], float)
    square = np.zeros((2, 6))
    for trial in own.values():
        k = trial.whole.names.index(name)
        without = trial.mean_square - 2 * size * trial.along[k] + size**2 * trial.square[k]
        square += trial.frames / frames.sum() * np.array([trial.mean_square, without])
    before, left = np.sqrt(np.maximum(square, 0.0))
    first = next(iter(own.values()))
    k = first.whole.names.index(name)
    cause = EstimatedCause(
        name=first.titles[k],
        group=first.groups[k],
        unit=first.units[k],
        size=size,
        deviation=deviation,
        usual=float(first.usual[k]),
        chance=chance,
        left=left,
        in_lab=first.in_lab[k],
    )
    return SharedCause(name, tuple(own), cause, before, np.full(6, np.nan))


def _without(trial: TrialEvidence, sizes: Mapping[str, float]) -> TrialEvidence:
    """Give what a trial says once some causes are taken away."""

    def left(own: Evidence) -> Evidence:
        gone = np.zeros(len(own.names))
        for k, name in enumerate(own.names):
            if name in sizes:
                gone[k] = (sizes[name] - trial.mean[k]) / trial.size[k]
        return replace(own, values=own.values - gone @ own.effects)

    first, second = left(trial.first), left(trial.second)
    return replace(trial, whole=left(trial.whole), first=first, second=second)


def _held_out(
    causes: Sequence[SharedCause], trials: Mapping[str, TrialEvidence], usual: Mapping[str, _Usual]
) -> dict[str, Array]:
    """Give what each of some causes takes away from one half with a size found in the other.

    Halves are of subjects, else of trials, else of the gait cycles of the only trial. All causes
    are taken away together; the share of one is that of the mean square with all others gone.
    """
    subjects = list(dict.fromkeys(trial.subject for trial in trials.values()))
    one = next(iter(trials.values()))
    if len(trials) == 1:
        halves = [[(one, one.first)], [(one, one.second)]]
    elif len(subjects) > 1:
        halves = [
            [(t, t.whole) for t in trials.values() if subjects.index(t.subject) % 2 == half]
            for half in (0, 1)
        ]
    else:
        halves = [[(t, t.whole) for t in list(trials.values())[half::2]] for half in (0, 1)]
    with_all, without = np.zeros(6), {cause.name: np.zeros(6) for cause in causes}
    for found_in, judged_in in (halves, halves[::-1]):
        faults = find_faults([_around(trial, own, usual) for trial, own in found_in])
        sizes = {
            cause.name: _in_units(faults, faults.names.index(cause.name), usual[cause.name])[0]
            if cause.name in faults.names
            else usual[cause.name].mean
            for cause in causes
        }
        for trial, own in judged_in:
            place = {name: own.names.index(name) for name in sizes if name in own.names}
            effect = {name: own.effects[k] / trial.size[k] for name, k in place.items()}
            left = own.values + sum(trial.mean[k] * effect[name] for name, k in place.items())
            left = left - sum(sizes[name] * effect[name] for name in place)
            with_all += _by_axis(left**2, own)
            for name in place:
                without[name] += _by_axis((left + sizes[name] * effect[name]) ** 2, own)
    return {name: 1 - with_all / square for name, square in without.items()}


def _by_axis(values: Array, own: Evidence) -> Array:
    """Sum coefficients of each axis, (N,) to (6,)."""
    return np.asarray(np.bincount(own.axis % 6, values, minlength=6), float)
