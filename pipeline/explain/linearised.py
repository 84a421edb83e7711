"""Effects of causes on a trial's residual, linearised around the sizes that explain it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.explain.cause import Cause
from pipeline.explain.cycle_series import CycleSeries
from pipeline.explain.posterior import Posterior, estimate_sizes
from pipeline.explain.processing_chain import ProcessingChain

TOLERANCE: Final = 0.05
"""Of a residual's RMS that a change of all causes together may differ from the sum of their
effects."""
ROUNDS: Final = 3
HELD: Final = 1e-3
"""Of the standard deviation of a size that was found elsewhere: so near the residuals leave it."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Causes of a trial, linearised where they explain it.

    Attributes
    ----------
    effects
        What each cause adds per unit, (K, T, 6).
    posterior
        Sizes of the causes.
    as_measured
        Effects on the trial as it was measured, (K, T, 6).
    """

    effects: Array
    posterior: Posterior
    as_measured: Array


def linearised(
    chain: ProcessingChain, causes: Sequence[Cause], left: Array, series: CycleSeries
) -> Linearised:
    """Estimate the sizes of causes, again around the sizes found until that changes nothing.

    Parameters
    ----------
    chain
        The trial.
    causes
        What may be wrong with it.
    left
        What the filter leaves, (T, 6), which needs no cause.
    series
        Its gait cycles.

    Returns
    -------
    Linearised
        Effects and sizes.
    """
    corrected, size = chain, np.zeros(len(causes))
    frames = np.concatenate(series.frames)
    before = rms(chain.residual[frames])
    every: list[Array] = []
    for _ in range(ROUNDS):
        measured = corrected.residual - left  # first: chains with effects keep its steps
        effects = np.nan_to_num([cause.effect(corrected) for cause in causes])
        every = [*every[:1], effects]
        residual = measured + np.tensordot(size, effects, 1)
        posterior = sizes_from_cycles(residual, effects, causes, series)
        expected = residual - np.tensordot(posterior.size, effects, 1)
        corrected, size = chain, posterior.size
        for cause, own in zip(causes, size, strict=True):
            corrected = cause.change(corrected, -own)
        missed = rms((corrected.residual - left - expected)[frames])
        if (missed < TOLERANCE * before).all():
            break
    return Linearised(effects, posterior, every[0])


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
    posterior = estimate_sizes(
        series.coefficients(usual),
        series.coefficients(effects),
        prior,
        series.frequency,
        of_platform,
    )
    covariance = posterior.covariance
    for k, (_, deviation) in found.items():  # the others follow it
        follow = covariance[:, k] / covariance[k, k]
        covariance = covariance + deviation**2 * np.outer(follow, follow)
    return Posterior(posterior.size + mean, covariance, posterior.unexplained)


def rms(residual: Array) -> Array:
    """Give the root mean square of each axis, (T, 6) to (6,)."""
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)))
