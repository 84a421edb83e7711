"""Sizes of causes from coefficients that are given: each gait cycle is its own series."""

from types import SimpleNamespace

from pipeline.explain.cause import Cause, Prior
from pipeline.explain.linearise import Linearised

AS_GIVEN = SimpleNamespace(coefficients=lambda signal: signal)


def estimate_sizes(residual, effects, prior, of_platform, rare):
    """Sizes by coefficients of each cycle, (C, B, 6), and of each cause's effects, (K, C, B, 6)."""
    causes = [
        Cause(str(k), "gain", Prior(size, "1", "", rare=bool(is_fault)), None, bool(follows))
        for k, (size, follows, is_fault) in enumerate(zip(prior, of_platform, rare, strict=True))
    ]
    part = SimpleNamespace(causes=causes)
    return Linearised(part, residual, effects, 0.0).sizes(AS_GIVEN)
