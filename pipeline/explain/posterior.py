"""Sizes of causes from the residuals of gait cycles: linear, Gaussian, with a model that is wrong.

The mean gait cycle of a residual is what its causes add, plus what no cause describes, plus the
mean of what differs between cycles. What no cause describes has one size per axis at all
frequencies, as forces of motions that the model does not know: they follow accelerations, which do
not decrease with frequency as motions do. It is estimated with the causes (Kennedy and O'Hagan
2001, J R Stat Soc B 63:425); without it, intervals would shrink with every cycle although the model
stays wrong.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, Mask, read_only

ROUNDS: Final = 60
START: Final = 0.5
"""Of a residual that no cause describes, to begin with."""
MIN_VARIANCE: Final = 1e-10
PATTERNS_SHARE: Final = 0.99
MOST_PATTERNS: Final = 10
"""Of what follows the platform, by how it varies over cycles, and patterns that are told apart."""


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

    def __post_init__(self) -> None:
        for name in ("size", "covariance", "unexplained"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def deviation(self) -> Array:
        """One standard deviation of each size, (K,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def estimate_sizes(
    residual: Array, effects: Array, prior: Array, frequency: Array, of_platform: Mask
) -> Posterior:
    """Estimate the sizes of causes.

    Parameters
    ----------
    residual
        Fourier coefficients of the residual of each gait cycle, (C, B, 6) [N, N·m].
    effects
        The same of what each cause adds per unit, (K, C, B, 6).
    prior
        One standard deviation of each size, (K,).
    frequency
        Of each coefficient, (B,) [Hz].
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
    between = _by_frequency((rest**2).sum(axis=0) / degrees, frequency)
    for _ in range(ROUNDS):
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


def _by_frequency(variance: Array, frequency: Array) -> Array:
    """Take the mean of sine's and cosine's variance, (B, 6)."""
    result = np.empty_like(variance)
    for each in np.unique(frequency):
        same = frequency == each
        result[same] = variance[same].mean(axis=0)
    return result
