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

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from hbm.spatial import Array, Indices, Mask
from pipeline.explain.cause import Cause, groups
from pipeline.explain.series import CycleSeries

ROUNDS: Final = 80
"""Of drawing what no cause describes, after the faults were drawn in some sweeps."""
SWEEPS: Final = 6
SETTLING: Final = 10
"""Rounds that do not count, in which the draws forget where they began."""
START: Final = 0.25
"""Of the mean square of a residual that no cause describes, to begin with."""
LEAST: Final = 0.01
"""Of the mean square, that is never described."""
RARE: Final = 0.1
"""Share of the faults that may be there which are."""
LOG_ODDS: Final = float(np.log(RARE / (1 - RARE)))
MOST_ODDS: Final = 300.0
"""Logarithm of the odds beyond which nothing is more certain."""
VARIANCE: Final = np.array([0.5, 6.0]) ** 2
"""Of a size without and with a fault, in squared usual sizes: what is published of plates in use is
a mixture of both."""
MOST_CERTAIN: Final = 1 - 1e-9
"""Chance of a fault at most; 1 is that of what is usually there."""
MIN_VARIANCE: Final = 1e-10
"""So that nothing is divided by zero."""
PATTERNS_SHARE: Final = 0.99
MOST_PATTERNS: Final = 10
"""Of what follows the platform, by how it varies over cycles, and patterns that are told apart."""
HELD: Final = 1e-3
"""Of the standard deviation of a size that was found elsewhere: so near the residuals leave it."""


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Sizes of K causes and how sure they are.

    Attributes
    ----------
    size, covariance
        Mean over all that may be, (K,), and covariance, (K, K): a fault that is hardly there counts
        as the usual errors that instruments have without one.
    unexplained
        One standard deviation of a coefficient of what no cause describes, (6,) [N, N·m].
    chance
        That a fault is there which is one only rarely, where that is as likely as not before the
        trial is looked at, (K,); 1 of other causes.
    if_there
        Sizes if they are there and one standard deviation of each, (2, K).
    """

    size: Array
    covariance: Array
    unexplained: Array
    chance: Array
    if_there: Array


def estimate_sizes(
    residual: Array,
    effects: Array,
    prior: Array,
    of_platform: Mask,
    rare: Mask,
    noise: Array | float = 0.0,
) -> Posterior:
    """Estimate the sizes of causes.

    Parameters
    ----------
    residual
        Fourier coefficients of the residual of each gait cycle, (C, B, 6) [N, N·m], in the order of
        `CycleSeries`.
    effects
        The same of what each cause adds per unit, (K, C, B, 6).
    prior
        One standard deviation of each size, (K,).
    of_platform
        Causes that follow the platform, (K,): what differs between cycles tells of them too. Of
        the others it does not, because what the model misses of a person differs with them.
    rare
        Causes that are faults, (K,): mostly absent, and large where they are there.
    noise
        Its root mean square in each axis, (6,), of which the differences between cycles tell where
        there are some.

    Returns
    -------
    Posterior
        By Gibbs sampling; equal input gives equal numbers.

    Notes
    -----
    Coefficients of different frequencies and axes are taken as independent given the causes, which
    is what makes the noise coloured: each frequency has a variance of its own.

    The prior of a fault is a mixture of two normal distributions (spike and slab: George and
    McCulloch 1993, J Am Stat Assoc 88:881), a narrow one of instruments without a fault and a wide
    one of faults. Which of the two holds for each is drawn again and again, given the others, with
    all sizes integrated out; then the size of what no cause describes, for each axis, given these.

    What the model misses of a person changes with a slope or a push too, so that cycles that differ
    by them are no independent evidence. The causes that follow the platform vary over cycles in a
    few patterns, their principal components; the part of the residual in each of them is treated
    as the mean cycle is, with a size of its own of what no cause describes. What is left beside all
    patterns shows the variance between cycles.
    """
    names = tuple(map(str, range(len(prior))))
    sharing = (Sharing.TRIAL,) * len(prior)
    seen = _coefficients(residual, effects, prior, of_platform, noise)
    found = _posterior(trial := Evidence(*seen, names, rare, sharing), find_faults([trial]))
    return _in_units(found, prior, len(residual))


def _in_units(found: Posterior, prior: Array, cycles: int) -> Posterior:
    """Give sizes in their units from those in usual sizes."""
    return Posterior(
        found.size * prior,
        found.covariance * np.outer(prior, prior),
        found.unexplained[:6] / np.sqrt(cycles),
        found.chance,
        found.if_there * prior,
    )


def _coefficients(
    residual: Array, effects: Array, prior: Array, of_platform: Mask, noise: Array | float
) -> tuple[Array, Array, Indices, Array]:
    """Give values, their noise, their axes and the effects of usual sizes, as of `Evidence`."""
    cycles = len(residual)
    effect = effects.mean(axis=1)
    moving = (effects - effect[:, None]) * of_platform[:, None, None, None]
    pattern = _patterns(moving[of_platform] * prior[of_platform, None, None, None], residual)
    beside = np.eye(cycles) - pattern.T @ pattern
    degrees = max(cycles - len(pattern), 1)
    along = np.tensordot(pattern, residual, 1)
    added = np.einsum("pc,kcbx->kpbx", pattern, moving)
    added[:, 0] = np.sqrt(cycles) * effect
    rest = np.tensordot(beside, residual, 1)
    between = np.zeros_like(rest[0]) + np.square(noise) / len(rest[0])
    if cycles > 1:
        between = _by_frequency((rest**2).sum(axis=0) / degrees)
    axis = np.arange(6 * len(along)).reshape(-1, 1, 6)
    return (
        along.ravel(),
        np.broadcast_to(between + MIN_VARIANCE, along.shape).ravel(),
        np.broadcast_to(axis, along.shape).ravel(),
        prior[:, None] * added.reshape(len(prior), -1),
    )


class Sharing(StrEnum):
    """What has one size of a cause, by the names of `groups.toml`."""

    TRIAL = "trial"
    SUBJECT = "subject"
    LABORATORY = "laboratory"


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
    rare
        Causes that are faults, (K,).
    sharing
        What has one size of each cause, K.
    subject
        Whose trial it is.
    """

    values: Array
    noise: Array
    axis: Indices
    effects: Array
    names: tuple[str, ...]
    rare: Mask
    sharing: tuple[Sharing, ...]
    subject: str = ""

    def information(self, undescribed: Array) -> "Information":
        """Give its normal equations, with variances of what no cause describes, (A,)."""
        weighted = self.effects / (self.noise + undescribed[self.axis])
        return Information(self.names, weighted @ self.effects.T, weighted @ self.values)

    def others(self, sharing: Sharing) -> set[str]:
        """Give the causes that are no faults and have one size in a trial, subject, laboratory."""
        every = zip(self.names, self.rare, self.sharing, strict=True)
        return {name for name, rare, own in every if own == sharing and not rare}


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
        names = tuple(dict.fromkeys(name for part in parts for name in part.names))
        place = {name: k for k, name in enumerate(names)}
        precision, pull = np.zeros((len(names), len(names))), np.zeros(len(names))
        for part in parts:
            own = np.array([place[name] for name in part.names], int)
            precision[np.ix_(own, own)] += part.precision
            pull[own] += part.pull
        return Information(names, precision, pull)

    def without(self, names: Collection[str]) -> tuple["Information", "Given"]:
        """Integrate sizes of a usual variance out; also give how they follow the others."""
        gone = np.array([name in names for name in self.names], bool)
        factor = np.linalg.cholesky(self.precision[np.ix_(gone, gone)] + np.eye(gone.sum()))
        across = self.precision[np.ix_(gone, ~gone)]
        solved = cho_solve((factor, True), np.column_stack([across, self.pull[gone]]))
        slope, mean = solved[:, :-1], solved[:, -1]
        kept = tuple(name for name in self.names if name not in names)
        rest = self.precision[np.ix_(~gone, ~gone)] - across.T @ slope
        left = Information(kept, rest, self.pull[~gone] - across.T @ mean)
        integrated = tuple(name for name in self.names if name in names)
        return left, Given(integrated, kept, mean, slope, factor)


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """Sizes given others: normally distributed.

    Attributes
    ----------
    names, others
        Of M sizes, and of those that they follow.
    mean, slope
        Their mean is ``mean - slope @ others``.
    factor
        Cholesky factor of their precision, (M, M).
    """

    names: tuple[str, ...]
    others: tuple[str, ...]
    mean: Array
    slope: Array
    factor: Array

    def drawn(self, sizes: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw the sizes."""
        others = np.array([sizes[name] for name in self.others])
        random = rng.standard_normal(len(self.names))
        spread = solve_triangular(self.factor, random, lower=True, trans="T")
        return dict(zip(self.names, self.mean - self.slope @ others + spread, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class Faults:
    """What trials say of their faults, in usual sizes.

    Attributes
    ----------
    names
        Of F faults.
    size, covariance
        Mean over all that may be, (F,) and (F, F).
    chance, if_there
        As those of a `Posterior`.
    undescribed
        Per trial the variance of a coefficient of what no cause describes, (A,).
    """

    names: tuple[str, ...]
    size: Array
    covariance: Array
    chance: Array
    if_there: Array
    undescribed: tuple[Array, ...]


def find_faults(trials: Sequence[Evidence]) -> Faults:
    """Find which faults are there and how large they are, from one trial or several together.

    Parameters
    ----------
    trials
        What each says. A cause that they share has one size.

    Returns
    -------
    Faults
        By Gibbs sampling; equal input gives equal numbers.

    Notes
    -----
    Drawn in turn are: which faults are there, each given the others, with all sizes integrated out;
    all sizes; what no cause describes; its variance in each axis of each trial. Sizes that are no
    faults are integrated out within each trial first, then within each subject, then within the
    laboratory.
    """
    rng = np.random.default_rng(0)
    count = [np.bincount(trial.axis) for trial in trials]
    power = [np.bincount(t.axis, t.values**2) / n for t, n in zip(trials, count, strict=True)]
    undescribed, kept = [START * own for own in power], list[list[Array]]()
    faults, given = _faults(trials, undescribed)
    there, draws = np.zeros(len(faults.names), bool), list[tuple[Array, ...]]()
    for number in range(ROUNDS):
        if number:
            faults, given = _faults(trials, undescribed)
        known = faults.precision + np.diag(1 / VARIANCE[there.astype(int)])
        covariance: Array = np.asarray(np.linalg.inv(known), float)
        size = covariance @ faults.pull
        for _ in range(SWEEPS):
            chance, if_there = _sweep(there, size, covariance, rng)
            if number >= SETTLING:
                draws.append((chance, *if_there, size.copy(), covariance.copy()))
        spread = np.linalg.cholesky(covariance) @ rng.standard_normal(len(size))
        sizes = dict(zip(faults.names, size + spread, strict=True))
        for level in given:
            sizes |= level.drawn(sizes, rng)
        undescribed = [
            _drawn_variance(trial, sizes, before, LEAST * mean_square, rng)
            for trial, before, mean_square in zip(trials, undescribed, power, strict=True)
        ]
        if number >= SETTLING:
            kept.append(undescribed)
    averages = tuple(np.mean(own, axis=0) for own in zip(*kept, strict=True))
    return Faults(faults.names, *_averaged(draws), averages)


def _faults(
    trials: Sequence[Evidence], undescribed: Sequence[Array]
) -> tuple[Information, list[Given]]:
    """Give the normal equations of faults alone, and the other sizes, those shared most first."""
    of_subjects, given = dict[str, list[Information]](), list[Given]()
    for trial, own in zip(trials, undescribed, strict=True):
        rest, level = trial.information(own).without(trial.others(Sharing.TRIAL))
        of_subjects.setdefault(trial.subject, []).append(rest)
        given.append(level)
    others = {
        sharing: {name for trial in trials for name in trial.others(sharing)}
        for sharing in (Sharing.SUBJECT, Sharing.LABORATORY)
    }
    of_laboratory = []
    for parts in of_subjects.values():
        rest, level = Information.sum(parts).without(others[Sharing.SUBJECT])
        of_laboratory.append(rest)
        given.append(level)
    rest, level = Information.sum(of_laboratory).without(others[Sharing.LABORATORY])
    return rest, [*given, level][::-1]


def _drawn_variance(
    trial: Evidence,
    sizes: Mapping[str, float],
    undescribed: Array,
    least: Array,
    rng: np.random.Generator,
) -> Array:
    """Draw the variance of what no cause describes in each axis, given all sizes."""
    size = np.array([sizes[name] for name in trial.names])
    left, own = trial.values - size @ trial.effects, undescribed[trial.axis]
    missed = left * own / (own + trial.noise)
    missed += np.sqrt(own * trial.noise / (own + trial.noise)) * rng.standard_normal(len(left))
    count = np.bincount(trial.axis)
    squares = np.bincount(trial.axis, missed**2) + least
    return np.asarray(squares / rng.chisquare(count - 1))  # all deviations equally likely before


def _sweep(
    there: Mask, size: Array, covariance: Array, rng: np.random.Generator
) -> tuple[Array, tuple[Array, Array]]:
    """Draw for each fault whether it is there, given the others; all arrays but the last change.

    Returns
    -------
    chance, (size, variance)
        That each is there, and its size and variance if it is, given the others, (F,) each.
    """
    chance, if_there = np.empty(len(there)), np.empty((2, len(there)))
    absent, present = 1 / VARIANCE
    for k in range(len(there)):
        own = covariance[k, k]
        before = present if there[k] else absent
        told, pull = max(1 / own - before, 0.0), size[k] / own  # without its prior
        wide, narrow = told + present, told + absent
        odds = LOG_ODDS + (np.log(narrow * present / (wide * absent))) / 2
        odds += pull**2 * (1 / wide - 1 / narrow) / 2
        chance[k] = 1 / (1 + np.exp(-np.clip(odds, -MOST_ODDS, MOST_ODDS)))
        if_there[:, k] = pull / wide, 1 / wide
        now = rng.random() < chance[k]
        if now != there[k]:
            there[k] = now
            change = (present if now else absent) - before
            column = covariance[:, k].copy()
            gain = change / (1 + change * own)
            size -= gain * size[k] * column
            covariance -= np.outer(gain * column, column)
    return chance, (if_there[0], if_there[1])


def _averaged(draws: Sequence[tuple[Array, ...]]) -> tuple[Array, Array, Array, Array]:
    """Average the draws of faults: mean and covariance, chance, size and deviation if there."""
    chance, size, variance, mean, covariance = (np.array(own) for own in zip(*draws, strict=True))
    weight = chance / chance.sum(axis=0)
    named = (weight * size).sum(axis=0)
    spread = (weight * (variance + size**2)).sum(axis=0) - named**2
    odds = chance.mean(axis=0)
    odds = odds / np.maximum(1 - odds, np.exp(-MOST_ODDS)) * np.exp(-LOG_ODDS)
    apart = mean - mean.mean(axis=0)
    between = covariance.mean(axis=0) + apart.T @ apart / len(mean)
    if_there = np.array([named, np.sqrt(spread)])
    chance = np.minimum(odds / (1 + odds), MOST_CERTAIN)
    return mean.mean(axis=0), between, chance, if_there


def _posterior(trial: Evidence, faults: Faults) -> Posterior:
    """Give the sizes of all causes of one trial, those that are no faults given the faults."""
    _, given = trial.information(faults.undescribed[0]).without(
        {name for name, rare in zip(trial.names, trial.rare, strict=True) if not rare}
    )
    rare, size = trial.rare, np.empty(len(trial.rare))
    covariance = np.empty((len(rare), len(rare)))
    size[rare], size[~rare] = faults.size, given.mean - given.slope @ faults.size
    across = -given.slope @ faults.covariance
    own = cho_solve((given.factor, True), np.eye(len(given.names)))
    covariance[np.ix_(rare, rare)] = faults.covariance
    covariance[np.ix_(~rare, rare)], covariance[np.ix_(rare, ~rare)] = across, across.T
    covariance[np.ix_(~rare, ~rare)] = own - across @ given.slope.T
    chance, if_there = np.ones(len(rare)), np.array([size, np.sqrt(np.diag(covariance))])
    chance[rare], if_there[:, rare] = faults.chance, faults.if_there
    return Posterior(size, covariance, np.sqrt(faults.undescribed[0]), chance, if_there)


def _patterns(moving: Array, residual: Array) -> Array:
    """Give how effects vary over cycles, as orthonormal rows after that of their mean, (P, C)."""
    cycles = len(residual)
    constant = np.full((1, cycles), cycles**-0.5)
    rms = np.sqrt(np.mean(residual**2, axis=(0, 1)) + MIN_VARIANCE)
    table = np.moveaxis(moving / rms, 1, 0).reshape(cycles, -1)
    if not table.any():
        return constant
    rows, sizes, _ = np.linalg.svd(table, full_matrices=False)
    explained = np.cumsum(sizes**2) / np.sum(sizes**2)
    count = min(int(np.searchsorted(explained, PATTERNS_SHARE)) + 1, MOST_PATTERNS)
    return np.vstack([constant, rows[:, : min(count, (cycles - 1) // 2)].T])


def _by_frequency(variance: Array) -> Array:
    """Take the mean of sine's and cosine's variance, (B, 6)."""
    of_both = variance[1:].reshape(-1, 2, variance.shape[1]).mean(axis=1)
    return np.vstack([variance[:1], np.repeat(of_both, 2, axis=0)])


def evidence_of(
    residual: Array,
    effects: Array,
    causes: Sequence[Cause],
    series: CycleSeries,
    noise: Array | float = 0.0,
    of: tuple[str, str] = ("", ""),
) -> Evidence:
    """Give what some gait cycles say of their causes.

    Parameters
    ----------
    residual
        (T, 6) [N, N·m].
    effects
        What each cause adds per unit, (K, T, 6).
    causes
        The causes.
    series
        The gait cycles.
    noise
        As for `estimate_sizes`.
    of
        The subject, and the trial.

    Returns
    -------
    Evidence
        Around the sizes that are expected (`expected`). What a calibration leaves is a cause of
        each trial, as its directions are.
    """
    mean, prior, _ = expected(causes)
    usual = residual - np.tensordot(mean, effects, 1)
    of_platform = np.array([cause.of_platform for cause in causes])
    rare = np.array([cause.prior.rare and not cause.found for cause in causes])
    sharing = tuple(
        Sharing.TRIAL if cause.along is not None else Sharing(groups()[cause.group]["within"])
        for cause in causes
    )
    subject, trial = of
    owner = {Sharing.TRIAL: trial, Sharing.SUBJECT: subject, Sharing.LABORATORY: ""}
    names = [
        f"{owner[own]}: {cause.name}".removeprefix(": ")
        for cause, own in zip(causes, sharing, strict=True)
    ]
    coefficients = series.coefficients(usual), series.coefficients(effects)
    seen = _coefficients(*coefficients, prior, of_platform, noise)
    return Evidence(*seen, tuple(names), rare, sharing, subject)


def expected(causes: Sequence[Cause]) -> tuple[Array, Array, dict[int, float]]:
    """Give the mean and usual size of each cause, and the deviation of those found elsewhere."""
    mean = np.array([cause.prior.mean for cause in causes])
    prior = np.array([cause.prior.size for cause in causes])
    found = {k: cause.found for k, cause in enumerate(causes) if cause.found}
    for k, (size, deviation) in found.items():
        mean[k], prior[k] = size, HELD * deviation
    return mean, prior, {k: deviation for k, (_, deviation) in found.items()}


def sizes_from_cycles(
    residual: Array,
    effects: Array,
    causes: Sequence[Cause],
    series: CycleSeries,
    noise: Array | float = 0.0,
) -> Posterior:
    """Estimate the sizes of causes from some gait cycles; parameters as for `evidence_of`.

    Returns
    -------
    Posterior
        Of all causes. Those whose size was found elsewhere keep it, and the others are as unsure as
        that makes them.
    """
    trial = evidence_of(residual, effects, causes, series, noise)
    mean, prior, found = expected(causes)
    posterior = _in_units(_posterior(trial, find_faults([trial])), prior, len(series))
    covariance, if_there = posterior.covariance, posterior.if_there.copy()
    for k, deviation in found.items():  # the others follow it
        follow = deviation * covariance[:, k] / covariance[k, k]
        covariance = covariance + np.outer(follow, follow)
        if_there[1] = np.hypot(if_there[1], follow)
    if_there[0] += mean
    size = posterior.size + mean
    return Posterior(size, covariance, posterior.unexplained, posterior.chance, if_there)
