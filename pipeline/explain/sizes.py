"""Sizes of causes from the residuals of gait cycles: linear, faults rare, with a wrong model.

Signals of gait cycles become Fourier series. The mean gait cycle of a residual is what its causes
add, plus what no cause describes, plus the mean of what differs between cycles. What no cause
describes has one size per axis at all frequencies, as forces of motions that the model does not
know: they follow accelerations, which do not decrease with frequency as motions do. It is estimated
with the causes (Kennedy and O'Hagan 2001, J R Stat Soc B 63:425); without it, intervals would
shrink with every cycle although the model stays wrong. People differ from a model by usual amounts,
so that sizes of their causes are normally distributed; instruments have faults rarely, and large
ones.
"""

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, compress
from typing import Annotated, Any, Final

import numpy as np
import scipy
from pydantic import PlainSerializer, PlainValidator

from hbm.numbers import read_numbers
from hbm.spatial import Array, Mask

PRIOR: Final = read_numbers("pipeline.explain", "thresholds.toml", "fault")
LOG_ODDS: Final = float(np.log(PRIOR.fraction / (1 - PRIOR.fraction)))
MOST_ODDS: Final = 300.0
"""Logarithm of the odds beyond which nothing is more certain."""
VARIANCE: Final = PRIOR.deviations**2
"""Of a size without and with a fault, in squared usual sizes."""
FAULT: Final = "fault"
"""Level of a cause that is a fault."""
Stored = Annotated[
    np.ndarray[Any, Any], PlainValidator(np.array), PlainSerializer(np.ndarray.tolist)
]
"""Numbers of any shape; in JSON they are lists."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What one trial says of its causes: coefficients that they are to explain.

    Attributes
    ----------
    values, noise
        (N,) [N, N·m], and the variance of each between cycles.
    axis
        Which of them have one size of what no cause describes, (N,).
    effects
        Of each cause of its usual size, (K, N).
    names
        Identity of each cause: trials that share a cause give it the same.
    levels
        Of each cause: a fault, or what has one size of it: "trial", "subject", "laboratory".
    subject
        Whose trial it is.
    """

    values: Stored
    noise: Stored
    axis: Stored
    effects: Stored
    names: tuple[str, ...]
    levels: tuple[str, ...]
    subject: str

    def information(self, undescribed: Array) -> "Information":
        """Give its normal equations, with variances of what no cause describes, (A,)."""
        # coefficients are independent given the causes: weighed by their own deviations
        deviation = np.sqrt(self.noise + undescribed[self.axis])
        weighted = self.effects / deviation
        return Information(self.names, weighted @ weighted.T, weighted @ (self.values / deviation))

    @property
    def rare(self) -> Mask:
        """Causes that are faults, (K,)."""
        return np.array([level == FAULT for level in self.levels], bool)

    def condensed(self, shared: Collection[str], name: str) -> "Evidence":
        """Replace causes that are no faults, nor shared, by no more than there are coefficients.

        Sizes are independent and of variance one, so that what causes E add is distributed alike
        for all E of the same E'E: with the singular values S, E = U S V', so it is for S V'.
        """
        kept = self.rare | np.isin(self.names, [*shared])
        _, values, rows = np.linalg.svd(self.effects[~kept], full_matrices=False)
        # singular values at the level of rounding are zero
        count = int(np.sum(values > 1e-12 * values.max(initial=0.0)))
        effects = np.vstack([self.effects[kept], (values[:, None] * rows)[:count]])
        names = (*compress(self.names, kept), *(f"{name} {k}" for k in range(count)))
        levels = (*compress(self.levels, kept), *["trial"] * count)
        return replace(self, effects=effects, names=names, levels=levels)


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """Normal equations of sizes with names.

    Attributes
    ----------
    names
        Of K causes.
    precision, pull
        (K, K) and (K,), without priors, in usual sizes.
    """

    names: tuple[str, ...]
    precision: Array
    pull: Array

    @staticmethod
    def sum(parts: Sequence["Information"]) -> "Information":
        """Add up what independent trials say."""
        if len(parts) == 1:
            return parts[0]
        names = tuple(dict.fromkeys(name for part in parts for name in part.names))
        place = {name: k for k, name in enumerate(names)}
        precision, pull = np.zeros((len(names), len(names))), np.zeros(len(names))
        # normal equations of independent data add up, each in the rows of its own causes
        for part in parts:
            rows = [place[name] for name in part.names]
            precision[np.ix_(rows, rows)] += part.precision
            pull[rows] += part.pull
        return Information(names, precision, pull)

    def without(self, names: Collection[str]) -> tuple["Information", "Given"]:
        """Integrate sizes of a usual variance out; also give how they follow the others."""
        gone = np.array([name in names for name in self.names], bool)
        # in usual sizes the prior's precision is the identity
        factor = np.linalg.cholesky(self.precision[np.ix_(gone, gone)] + np.eye(gone.sum()))
        across = np.column_stack([self.precision[np.ix_(gone, ~gone)], self.pull[gone]])
        # with the factor L, one triangular solve: across' (L L')^-1 across = half' half
        half, _ = scipy.linalg.lapack.dtrtrs(factor.T, across, trans=1)
        kept, integrated = (tuple(compress(self.names, which)) for which in (~gone, gone))
        # Schur complement: what the others lose of precision and pull
        taken = half[:, :-1].T @ half
        precision = self.precision[np.ix_(~gone, ~gone)] - taken[:, :-1]
        rest = Information(kept, precision, self.pull[~gone] - taken[:, -1])
        return rest, Given(integrated, kept, half, factor)


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """Sizes given others: normally distributed.

    Attributes
    ----------
    names, others
        Of M sizes, and of F that they follow.
    half
        Coupling to the others, and pull in the last column, divided by the factor, (M, F + 1).
    factor
        Cholesky factor of their precision, (M, M).
    """

    names: tuple[str, ...]
    others: tuple[str, ...]
    half: Array
    factor: Array

    def divided(self, values: Array) -> Array:
        """Divide values, (M, …), by the factor's transpose."""
        return np.asarray(scipy.linalg.lapack.dtrtrs(self.factor.T, values)[0])

    def drawn(self, sizes: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw the sizes."""
        others = np.array([sizes[name] for name in self.others])
        # with precision L L', noise of variance one divided by L' has its covariance
        random = rng.standard_normal(len(self.names))
        size = self.divided(self.half[:, -1] - self.half[:, :-1] @ others + random)
        return dict(zip(self.names, size.tolist(), strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Sizes of K causes and how sure they are.

    Attributes
    ----------
    names
        Of the causes.
    size, covariance
        Mean over all that may be, (K,), and covariance, (K, K): a fault that is hardly there counts
        as the usual errors that instruments have without one.
    chance
        That a fault is there which is one only rarely, where that is as likely as not before the
        trial is looked at, (K,); 1 of other causes.
    if_there
        Sizes if they are there and one standard deviation of each, (2, K).
    undescribed
        Per trial the variance of a coefficient of what no cause describes, (A,).
    """

    names: tuple[str, ...]
    size: Array
    covariance: Array
    chance: Array
    if_there: Array
    undescribed: tuple[Array, ...]


def find_faults(trials: Sequence[Evidence]) -> Posterior:
    """Find which faults are there and how large they are, from one trial or several together.

    Parameters
    ----------
    trials
        What each says. A cause that they share has one size.

    Returns
    -------
    Posterior
        Of faults alone, in usual sizes. By Gibbs sampling; equal input gives equal numbers.

    Notes
    -----
    The prior of a fault is a mixture of two normal distributions (spike and slab: George and
    McCulloch 1993, J Am Stat Assoc 88:881), a narrow one of instruments without a fault and a wide
    one of faults. Drawn in turn are: which faults are there, each given the others, with all sizes
    integrated out; all sizes; what no cause describes; its variance in each axis of each trial.
    Sizes that are no faults are integrated out within each trial first, then within each subject,
    then within the laboratory; those that trials do not share in the space of their coefficients
    (`Evidence.condensed`), which changes draws, but not what they are drawn from.
    """
    rng, used = np.random.default_rng(0), Counter(chain(*(trial.names for trial in trials)))
    shared = [name for name, number in used.items() if number > 1]
    trials = [trial.condensed(shared, f"{number}") for number, trial in enumerate(trials)]
    count = [np.bincount(trial.axis) for trial in trials]
    power = [np.bincount(t.axis, t.values**2) / n for t, n in zip(trials, count, strict=True)]
    # to begin with, no cause describes a quarter of each mean square, and no fault is there
    undescribed, kept = [0.25 * square for square in power], list[list[Array]]()
    there = np.zeros(len({*chain(*(compress(t.names, t.rare) for t in trials))}), bool)
    draws = list[tuple[Array, ...]]()
    for number in range(80):
        faults, others = _faults(trials, undescribed)
        precision = faults.precision + np.diag(1 / VARIANCE[there.astype(int)])
        covariance: Array = np.asarray(np.linalg.inv(precision), float)
        size = covariance @ faults.pull
        # in the first ten rounds the draws forget where they began
        has_settled = number >= 10
        for _ in range(6):
            drawn = _sweep(there, size, covariance, rng)
            if has_settled:
                draws.append((*drawn, size.copy(), covariance.copy()))
        # sizes of faults, then those that follow them, from what most trials share to what one has
        spread = np.linalg.cholesky(covariance) @ rng.standard_normal(len(size))
        sizes = dict(zip(faults.names, size + spread, strict=True))
        for level in others:
            sizes |= level.drawn(sizes, rng)
        # a hundredth of the mean square is never described
        undescribed = [
            _drawn_variance(trial, sizes, before, 0.01 * mean_square, rng)
            for trial, before, mean_square in zip(trials, undescribed, power, strict=True)
        ]
        if has_settled:
            kept.append(undescribed)
    averages = tuple(np.mean(variances, axis=0) for variances in zip(*kept, strict=True))
    return Posterior(faults.names, *_averaged(draws), averages)


def _faults(
    trials: Sequence[Evidence], undescribed: Sequence[Array]
) -> tuple[Information, list[Given]]:
    """Give the normal equations of faults alone, and the other sizes, those shared most first."""
    levels: dict[str, set[str]] = {}
    for trial in trials:
        for name, level in zip(trial.names, trial.levels, strict=True):
            levels.setdefault(level, set()).add(name)
    others = list[Given]()

    def without(level: str, part: Information) -> Information:
        if level not in levels:
            return part
        rest, sizes = part.without(levels[level])
        others.append(sizes)
        return rest

    # sizes are integrated out where all data on them are together: trial, subject, laboratory
    of_subjects: dict[str, list[Information]] = {}
    for trial, variance in zip(trials, undescribed, strict=True):
        rest = without("trial", trial.information(variance))
        of_subjects.setdefault(trial.subject, []).append(rest)
    subjects = [without("subject", Information.sum(parts)) for parts in of_subjects.values()]
    return without("laboratory", Information.sum(subjects)), others[::-1]


def _drawn_variance(
    trial: Evidence,
    sizes: Mapping[str, float],
    undescribed: Array,
    least: Array,
    rng: np.random.Generator,
) -> Array:
    """Draw the variance of what no cause describes in each axis, given all sizes."""
    size = np.array([sizes[name] for name in trial.names])
    rest, variance = trial.values - size @ trial.effects, undescribed[trial.axis]
    # the rest is noise and what no cause describes, in proportion to their variances
    missed = rest * variance / (variance + trial.noise)
    deviation = np.sqrt(variance * trial.noise / (variance + trial.noise))
    missed += deviation * rng.standard_normal(len(rest))
    count = np.bincount(trial.axis)
    squares = np.bincount(trial.axis, missed**2) + least
    return np.asarray(squares / rng.chisquare(count - 1))  # all deviations equally likely before


def _sweep(
    there: Mask, size: Array, covariance: Array, rng: np.random.Generator
) -> tuple[Array, ...]:
    """Draw for each fault whether it is there, given the others; all arrays but the last change.

    Returns
    -------
    chance, size, variance
        That each is there, and its size and variance if it is, given the others, (F,) each.
    """
    drawn, (absent, present) = list[tuple[float, ...]](), (1 / VARIANCE).tolist()
    for k, random in enumerate(rng.random(len(there)).tolist()):
        variance, before = covariance.item(k, k), present if there[k] else absent
        data, pull = max(1 / variance - before, 0.0), size.item(k) / variance  # without prior
        wide, narrow = data + present, data + absent
        # prior odds times the ratio of the marginal likelihoods, with the size integrated out
        odds = LOG_ODDS + math.log(narrow * present / (wide * absent)) / 2
        odds += pull**2 * (1 / wide - 1 / narrow) / 2
        chance = 1 / (1 + math.exp(-max(odds, -MOST_ODDS)))
        drawn.append((chance, pull / wide, 1 / wide))
        if (random < chance) == there[k]:
            continue
        # one element of the precision changes: Sherman and Morrison's update of mean and covariance
        there[k] = not there[k]
        change = present - absent if there[k] else absent - present
        column = covariance[:, k].copy()
        gain = change / (1 + change * column[k])
        size -= gain * size[k] * column
        covariance -= np.outer(gain * column, column)
    return tuple(np.reshape(drawn, (-1, 3)).T)


def _averaged(draws: Sequence[tuple[Array, ...]]) -> tuple[Array, Array, Array, Array]:
    """Average the draws of faults: mean and covariance, chance, size and deviation if there."""
    chance, size, variance, mean, covariance = map(np.array, zip(*draws, strict=True))
    # moments of a mixture of normal distributions, by how likely the fault is there in each draw
    weight = chance / chance.sum(axis=0)
    middle = (weight * size).sum(axis=0)
    spread = (weight * (variance + size**2)).sum(axis=0) - middle**2
    # odds had both been as likely before: the prior's odds are divided out
    odds = chance.mean(axis=0)
    odds = odds / np.maximum(1 - odds, np.exp(-MOST_ODDS)) * np.exp(-LOG_ODDS)
    # law of total covariance: mean of the covariances and covariance of the means
    apart = mean - mean.mean(axis=0)
    between = covariance.mean(axis=0) + apart.T @ apart / len(mean)
    # below 1, which is the chance of what is usually there
    chance = np.minimum(odds / (1 + odds), 1 - 1e-9)
    return mean.mean(axis=0), between, chance, np.array([middle, np.sqrt(spread)])


def with_others(trial: Evidence, faults: Posterior) -> Posterior:
    """Give the sizes of all causes of one trial, those that are no faults given the faults."""
    rare, (undescribed,) = trial.rare, faults.undescribed
    _, given = trial.information(undescribed).without({*compress(trial.names, ~rare)})
    size, covariance = np.empty(len(rare)), np.empty((len(rare), len(rare)))
    # regression of the other sizes on the faults; the last column is their mean without any
    slope = given.divided(given.half)
    size[rare], size[~rare] = faults.size, slope[:, -1] - slope[:, :-1] @ faults.size
    # their covariance: what is their own, and what they take over from the faults
    across = -slope[:, :-1] @ faults.covariance
    alone = scipy.linalg.cho_solve((given.factor, True), np.eye(len(given.names)))
    covariance[np.ix_(rare, rare)] = faults.covariance
    covariance[np.ix_(~rare, rare)], covariance[np.ix_(rare, ~rare)] = across, across.T
    covariance[np.ix_(~rare, ~rare)] = alone - across @ slope[:, :-1].T
    chance, if_there = np.ones(len(rare)), np.array([size, np.sqrt(np.diag(covariance))])
    chance[rare], if_there[:, rare] = faults.chance, faults.if_there
    return Posterior(trial.names, size, covariance, chance, if_there, faults.undescribed)
