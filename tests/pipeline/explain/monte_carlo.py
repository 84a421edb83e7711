"""Residuals as they may have been measured: causes of drawn sizes, all at once, measured again.

The reference of the delta method, at some hundred times its cost: markers and body are displaced,
the inverse kinematics is solved again, and plates and markers have other noise.
"""

import numpy as np

from pipeline.explain.uncertainty import with_noise


def draw_residuals(chain, causes, draws, seed=0):
    """Yield the residual with all causes, each of a normally distributed size, (T, 6) [N, N·m]."""
    rng = np.random.default_rng(seed)
    for _ in range(draws):
        size = rng.standard_normal(len(causes)) * [cause.prior.size for cause in causes]
        changed, unseen = chain, np.zeros_like(chain.q)
        for cause, own in zip(causes, size, strict=True):
            before, changed = changed, cause.change(changed, own)
            if "without markers" in cause.name:
                unseen += changed.q - before.q
        yield with_noise(changed, unseen, rng).residual


def drawn_rms(part, draws):
    """Draw the RMS of a part of a trial over its explained frames, (draws, 6)."""
    frames = np.concatenate(part.series.frames)
    drawn = draw_residuals(part.chain, part.causes, draws)
    return np.array([np.sqrt((residual[frames] ** 2).mean(axis=0)) for residual in drawn])
