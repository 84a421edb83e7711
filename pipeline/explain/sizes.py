"""Sizes of causes from the residuals of gait cycles: linear, Gaussian, with a model that is wrong.

Signals of gait cycles become Fourier series. The mean gait cycle of a residual is what its causes
add, plus what no cause describes, plus the mean of what differs between cycles. What no cause
describes has one size per axis at all frequencies, as forces of motions that the model does not
know: they follow accelerations, which do not decrease with frequency as motions do. It is estimated
with the causes (Kennedy and O'Hagan 2001, J R Stat Soc B 63:425); without it, intervals would
shrink with every cycle although the model stays wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, Indices, Mask
from pipeline.explain.cause import Cause

EM_ROUNDS: Final = 60
"""Of expectation and maximisation."""
START: Final = 0.5
"""Of a residual that no cause describes, to begin with."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Sizes of K causes and how sure they are.

    Attributes
    ----------
    size
        Most probable sizes, (K,).
    covariance
        Of the sizes, (K, K).
    unexplained
        One standard deviation of a coefficient of what no cause describes, (6,) [N, N·m].
    """

    size: Array
    covariance: Array
    unexplained: Array

    @property
    def deviation(self) -> Array:
        """One standard deviation of each size, (K,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def estimate_sizes(residual: Array, effects: Array, prior: Array, of_platform: Mask) -> Posterior:
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

    Returns
    -------
    Posterior
        By expectation and maximisation of the size of what no cause describes.

    Notes
    -----
    Coefficients of different frequencies and axes are taken as independent given the causes, which
    is what makes the noise coloured: each frequency has a variance of its own.

    The size of what no cause describes is uncertain itself, as few coefficients tell of it when the
    causes have described what they can. Expectation and maximisation find the mode of an inverse χ²
    distribution with that many degrees of freedom, n; intervals take its mean, larger by
    ``n / (n - 2)``.

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
    spread = START * np.sqrt((along**2).mean(axis=1))
    rest = np.tensordot(beside, residual, 1)
    between = _by_frequency((rest**2).sum(axis=0) / degrees)
    for _ in range(EM_ROUNDS):
        unexplained = spread[:, None] ** 2
        variance = unexplained + between + MIN_VARIANCE
        size, covariance = _conditional(along, added, variance, prior)
        left = along - np.tensordot(size, added, 1)
        uncertain = np.einsum("kpbx,kl,lpbx->pbx", added, covariance, added, optimize=True)
        gain = unexplained / variance
        doubt = unexplained * (1 - gain) + gain**2 * uncertain
        spread = np.sqrt(((gain * left) ** 2 + doubt).mean(axis=1))
    told = (1 - doubt / np.maximum(unexplained, MIN_VARIANCE)).sum(axis=1)
    spread *= np.sqrt(np.maximum(told / np.maximum(told - 2, 1), 1))
    variance = spread[:, None] ** 2 + between + MIN_VARIANCE
    size, covariance = _conditional(along, added, variance, prior)
    return Posterior(size, covariance, spread[0] / np.sqrt(cycles))


def _conditional(along: Array, added: Array, variance: Array, prior: Array) -> tuple[Array, Array]:
    """Give sizes and their covariance where the variance of all else is known."""
    weighted = (added / variance).reshape(len(added), -1)
    precision = weighted @ added.reshape(len(added), -1).T + np.diag(1 / prior**2)
    covariance = np.asarray(np.linalg.inv(precision))
    return covariance @ (weighted @ along.ravel()), covariance


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
    residual: Array, effects: Array, causes: Sequence[Cause], series: CycleSeries
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

    Returns
    -------
    Posterior
        Of all causes. Those whose size was found elsewhere keep it, and the others are as unsure as
        that makes them.
    """
    mean = np.array([cause.prior.mean for cause in causes])
    prior = np.array([cause.prior.size for cause in causes])
    of_platform = np.array([cause.of_platform for cause in causes])
    found = {k: cause.found for k, cause in enumerate(causes) if cause.found}
    for k, (size, deviation) in found.items():
        mean[k], prior[k] = size, HELD * deviation
    usual = residual - np.tensordot(mean, effects, 1)
    coefficients = series.coefficients(usual), series.coefficients(effects)
    posterior = estimate_sizes(*coefficients, prior, of_platform)
    covariance = posterior.covariance
    for k, (_, deviation) in found.items():  # the others follow it
        follow = covariance[:, k] / covariance[k, k]
        covariance = covariance + deviation**2 * np.outer(follow, follow)
    return Posterior(posterior.size + mean, covariance, posterior.unexplained)
