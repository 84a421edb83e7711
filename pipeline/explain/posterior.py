"""Sizes of causes from the residuals of gait cycles: linear, Gaussian, with a model that is wrong.

The mean gait cycle of a residual is what its causes add, plus what no cause describes, plus the
mean of what differs between cycles. What no cause describes is as smooth in time as a residual is,
and its size per axis is estimated with the causes (Kennedy and O'Hagan 2001, J R Stat Soc B
63:425); without it, intervals would shrink with every cycle although the model stays wrong.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, Mask, read_only

SMOOTH_HZ: Final = 3.0
"""Up to this frequency what no cause describes is as large as any part of a residual."""
ROUNDS: Final = 60
START: Final = 0.5
"""Of a residual that no cause describes, to begin with."""
MIN_VARIANCE: Final = 1e-10


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
        One standard deviation of a coefficient at low frequency of what no cause describes, (6,)
        [N, N·m].
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
        By expectation and maximisation of the size of what no cause describes and of the variance
        between cycles.

    Notes
    -----
    Coefficients of different frequencies and axes are taken as independent given the causes, which
    is what makes the noise coloured: each frequency has a variance of its own.
    """
    cycles = len(residual)
    mean, effect = residual.mean(axis=0), effects.mean(axis=1)
    deviation, moving = residual - mean, (effects - effect[:, None])[of_platform]
    shape = 1 / (1 + (frequency / SMOOTH_HZ) ** 4)
    spread = START * np.sqrt((mean**2).sum(axis=0) / shape.sum())
    between = _by_frequency((deviation**2).sum(axis=0) / max(cycles - 1, 1), frequency)
    precision = np.diag(1 / prior**2)
    follow = np.flatnonzero(of_platform)
    size, covariance = np.zeros(len(prior)), np.zeros((len(prior), len(prior)))
    for _ in range(ROUNDS):
        unexplained = spread**2 * shape[:, None]
        variance = unexplained + between / cycles + MIN_VARIANCE
        weighted = (effect / variance).reshape(len(effect), -1)
        information = weighted @ effect.reshape(len(effect), -1).T + precision
        evidence = weighted @ mean.ravel()
        if cycles > 1 and len(follow):
            own = (moving / (between + MIN_VARIANCE)).reshape(len(moving), -1)
            information[np.ix_(follow, follow)] += own @ moving.reshape(len(moving), -1).T
            evidence[follow] += own @ deviation.ravel()
        covariance = np.linalg.inv(information)
        size = covariance @ evidence

        left = mean - np.tensordot(size, effect, 1)
        uncertain = np.einsum("kbx,kl,lbx->bx", effect, covariance, effect, optimize=True)
        gain = unexplained / variance
        square = (gain * left) ** 2 + unexplained * (1 - gain) + gain**2 * uncertain
        spread = np.sqrt((square / shape[:, None]).mean(axis=0))
        if cycles > 1 and len(follow):
            remaining = deviation - np.tensordot(size[follow], moving, 1)
            between = _by_frequency((remaining**2).sum(axis=0) / (cycles - 1), frequency)
    return Posterior(size, covariance, spread)


def _by_frequency(variance: Array, frequency: Array) -> Array:
    """Take the mean of sine's and cosine's variance, (B, 6)."""
    result = np.empty_like(variance)
    for each in np.unique(frequency):
        same = frequency == each
        result[same] = variance[same].mean(axis=0)
    return result
