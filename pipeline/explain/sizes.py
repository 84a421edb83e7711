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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from hbm.spatial import Array, Indices, Mask
from pipeline.explain.cause import Cause

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
MIN_VARIANCE: Final = 1e-10
"""So that nothing is divided by zero."""
PATTERNS_SHARE: Final = 0.99
MOST_PATTERNS: Final = 10
"""Of what follows the platform, by how it varies over cycles, and patterns that are told apart."""
HELD: Final = 1e-3
"""Of the standard deviation of a size that was found elsewhere: so near the residuals leave it."""


@dataclass(frozen=True, slots=True, eq=False)
class CycleSeries:
    """How frames become Fourier coefficients of each gait cycle.

    The coefficients are those of least squares over the frames of a cycle, scaled so that the sum
    of their squares is the mean square over the cycle. In frames that do not count, signals are
    taken as zero.

    Attributes
    ----------
    frames
        Per cycle its frames that count.
    inverse
        Per cycle what gives its coefficients from these frames, (B, N): the mean, and sine and
        cosine of each harmonic.
    """

    frames: tuple[Indices, ...]
    inverse: tuple[Array, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def coefficients(self, signal: Array) -> Array:
        """Give the coefficients of a signal, (…, T, 6) to (…, C, B, 6)."""
        parts = [
            inverse @ signal[..., frames, :]
            for inverse, frames in zip(self.inverse, self.frames, strict=True)
        ]
        return np.stack(parts, axis=-3)

    def some(self, cycles: slice) -> "CycleSeries":
        """Give the same of some of the cycles."""
        return CycleSeries(self.frames[cycles], self.inverse[cycles])


def cycle_series(
    time: Array, spans: Sequence[tuple[float, float]], to_hz: float, counts: Mask | None = None
) -> CycleSeries:
    """Find how the frames of gait cycles become Fourier coefficients.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    spans
        Start and stop of each cycle, half-open, (C, 2) [s].
    to_hz
        Up to which frequency [Hz]; no more than a third of the frames of a cycle allow.
    counts
        Whether each frame counts, (T,); by default all do.

    Returns
    -------
    CycleSeries
        With the mean, and sine and cosine of each harmonic of the cycle.

    Examples
    --------
    >>> time = np.arange(0, 2, 0.01)
    >>> series = cycle_series(time, [(0.0, 1.0), (1.0, 2.0)], 2.0)
    >>> signal = np.tile(3 + 4 * np.sin(2 * np.pi * time)[:, None], (1, 6))
    >>> np.abs(series.coefficients(signal)[0, :3, 0]).round(3).tolist()
    [3.0, 2.828, 0.0]
    """
    counts = np.ones(len(time), bool) if counts is None else counts
    every = [np.arange(*np.searchsorted(time, span)) for span in spans]
    frames = tuple(each[counts[each]] for each in every)
    duration = float(np.median([stop - start for start, stop in spans]))
    harmonics = max(1, min(int(np.ceil(to_hz * duration)), min(map(len, frames)) // 6))
    inverse = []
    for (start, stop), each in zip(spans, every, strict=True):
        phase = 2 * np.pi * (time[each] - start) / (stop - start)
        waves = [np.ones(len(phase))]
        for h in range(1, harmonics + 1):
            waves += [np.sqrt(2) * np.sin(h * phase), np.sqrt(2) * np.cos(h * phase)]
        inverse.append(np.linalg.pinv(np.column_stack(waves))[:, counts[each]])
    return CycleSeries(frames, tuple(inverse))


def stretch_series(time: Array, stretches: Sequence[slice], to_hz: float) -> CycleSeries:
    """Find how stretches of frames that repeat nothing become coefficients: as of one gait cycle.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    stretches
        Frames of each.
    to_hz
        Up to which frequency [Hz].

    Returns
    -------
    CycleSeries
        With the mean and cosines of each stretch, by its share of all frames: half a period of a
        cosine passes from one end of a stretch to the other, which need not be alike.

    Examples
    --------
    >>> series = stretch_series(np.arange(0, 1, 0.01), [slice(0, 40), slice(50, 90)], 2.0)
    >>> abs(series.coefficients(np.full((100, 6), 2.0))[0, :, 0]).round(3).tolist()
    [1.414, 0.0, 1.414, 0.0]
    """
    frames = [np.arange(len(time))[own] for own in stretches]
    whole, inverse = sum(map(len, frames)), []
    for own in frames:
        duration_s = len(own) * (time[-1] - time[0]) / (len(time) - 1)
        waves = np.arange(max(1, min(int(2 * to_hz * duration_s), len(own) // 3)) + 1)
        phase = np.pi * (np.arange(len(own)) + 0.5) / len(own)
        basis = np.cos(np.outer(phase, waves)) * np.where(waves, np.sqrt(2), 1)
        inverse.append(np.linalg.pinv(basis) * np.sqrt(len(own) / whole))
    return CycleSeries((np.concatenate(frames),), (block_diag(*inverse),))


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
    seen = Seen(
        along.ravel(),
        np.broadcast_to(between + MIN_VARIANCE, along.shape).ravel(),
        np.broadcast_to(axis, along.shape).ravel(),
    )
    found = _drawn(seen, prior[:, None] * added.reshape(len(prior), -1), rare)
    return Posterior(
        found.size * prior,
        found.covariance * np.outer(prior, prior),
        found.unexplained[:6] / np.sqrt(cycles),
        found.chance,
        found.if_there * prior,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Coefficients that causes are to explain.

    Attributes
    ----------
    values, noise
        (N,) [N, N·m], and the variance of each between cycles.
    axis
        Which of them have one size of what no cause describes, (N,).
    """

    values: Array
    noise: Array
    axis: Indices


def _drawn(seen: Seen, effects: Array, rare: Mask) -> Posterior:
    """Estimate sizes of causes in usual sizes, of which the effects (K, N) are."""
    rng = np.random.default_rng(0)
    faults, others = effects[rare], effects[~rare]
    count, power = np.bincount(seen.axis), np.bincount(seen.axis, seen.values**2)
    least = LEAST * power / count
    square, kept = START * power / count, list[Array]()
    there, draws = np.zeros(len(faults), bool), list[tuple[Array, ...]]()
    for number in range(ROUNDS):
        # all but the faults: other causes, what no cause describes, and noise
        factor = cho_factor(others.T @ others + np.diag(seen.noise + square[seen.axis]))
        solved = cho_solve(factor, np.column_stack([faults.T, seen.values]))
        precision, pull = faults @ solved[:, :-1], faults @ solved[:, -1]
        known = precision + np.diag(1 / VARIANCE[there.astype(int)])
        covariance: Array = np.asarray(np.linalg.inv(known), float)
        size = covariance @ pull
        for _ in range(SWEEPS):
            chance, if_there = _sweep(there, size, covariance, rng)
            if number >= SETTLING:
                draws.append((chance, *if_there, size.copy(), covariance.copy()))
        # what no cause describes: drawn together with all else, and corrected by what is seen
        deviation = np.sqrt(square[seen.axis])
        missed = deviation * rng.standard_normal(len(deviation))
        drawn = missed + np.sqrt(seen.noise) * rng.standard_normal(len(deviation))
        drawn += rng.standard_normal(len(others)) @ others
        drawn += np.sqrt(VARIANCE[there.astype(int)]) * rng.standard_normal(len(faults)) @ faults
        apart = cho_solve(factor, seen.values - drawn)
        apart -= solved[:, :-1] @ (covariance @ (faults @ apart))
        missed += deviation**2 * apart
        squares = np.bincount(seen.axis, missed**2) + least
        square = squares / rng.chisquare(count - 1)  # all deviations equally likely before
        if number >= SETTLING:
            kept.append(square)
    square = np.mean(kept, axis=0)
    return _joined(seen, others, faults, rare, square, draws)


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


def _joined(
    seen: Seen,
    others: Array,
    faults: Array,
    rare: Mask,
    square: Array,
    draws: Sequence[tuple[Array, ...]],
) -> Posterior:
    """Join the draws of faults, and give the other causes given these."""
    chance, size, variance, mean, covariance = (np.array(own) for own in zip(*draws, strict=True))
    weight = chance / chance.sum(axis=0)
    named = (weight * size).sum(axis=0)
    spread = (weight * (variance + size**2)).sum(axis=0) - named**2
    odds = chance.mean(axis=0)
    odds = odds / np.maximum(1 - odds, np.exp(-MOST_ODDS)) * np.exp(-LOG_ODDS)
    of_faults = mean.mean(axis=0)
    apart = mean - of_faults
    between = covariance.mean(axis=0) + apart.T @ apart / len(mean)

    factor = cho_factor(others.T @ others + np.diag(seen.noise + square[seen.axis]))
    follow = others @ cho_solve(factor, np.column_stack([faults.T, others.T, seen.values]))
    by_faults, own = -follow[:, : len(faults)], np.eye(len(others)) - follow[:, len(faults) : -1]
    result = np.empty(len(rare)), np.empty((len(rare), len(rare)))
    result[0][rare], result[0][~rare] = of_faults, follow[:, -1] + by_faults @ of_faults
    result[1][np.ix_(rare, rare)] = between
    result[1][np.ix_(~rare, rare)] = by_faults @ between
    result[1][np.ix_(rare, ~rare)] = between @ by_faults.T
    result[1][np.ix_(~rare, ~rare)] = own + by_faults @ between @ by_faults.T
    every, if_there = np.ones(len(rare)), np.array([result[0], np.sqrt(np.diag(result[1]))])
    every[rare], if_there[:, rare] = odds / (1 + odds), (named, np.sqrt(spread))
    return Posterior(*result, np.sqrt(square), every, if_there)


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


def sizes_from_cycles(
    residual: Array,
    effects: Array,
    causes: Sequence[Cause],
    series: CycleSeries,
    noise: Array | float = 0.0,
) -> Posterior:
    """Estimate the sizes of causes from some gait cycles.

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

    Returns
    -------
    Posterior
        Of all causes. Those whose size was found elsewhere keep it, and the others are as unsure as
        that makes them.
    """
    mean = np.array([cause.prior.mean for cause in causes])
    prior = np.array([cause.prior.size for cause in causes])
    of_platform = np.array([cause.of_platform for cause in causes])
    rare = np.array([cause.prior.rare and not cause.found for cause in causes])
    found = {k: cause.found for k, cause in enumerate(causes) if cause.found}
    for k, (size, deviation) in found.items():
        mean[k], prior[k] = size, HELD * deviation
    usual = residual - np.tensordot(mean, effects, 1)
    coefficients = series.coefficients(usual), series.coefficients(effects)
    posterior = estimate_sizes(*coefficients, prior, of_platform, rare, noise)
    covariance, if_there = posterior.covariance, posterior.if_there.copy()
    for k, (_, deviation) in found.items():  # the others follow it
        follow = deviation * covariance[:, k] / covariance[k, k]
        covariance = covariance + np.outer(follow, follow)
        if_there[1] = np.hypot(if_there[1], follow)
    if_there[0] += mean
    size = posterior.size + mean
    return Posterior(size, covariance, posterior.unexplained, posterior.chance, if_there)
