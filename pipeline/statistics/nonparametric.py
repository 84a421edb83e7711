"""Tests of a repeated-measures design that do not assume normality."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hbm.spatial import Array
from pipeline.statistics.rm_glm import ROUNDING, orthonormal_contrasts

MAX_SUBJECTS_ENUMERATED = 18
"""2¹⁷ sign patterns are computed within a second; every further subject doubles them."""
RANDOM_PATTERNS = 99_999
"""Monte Carlo standard error of p = 0.05: 0.0007."""
EQUAL_EFFECTS = 1e-10
"""Relative difference up to which two effects are equal but for rounding."""
ALIGNED_DIGITS = 10
"""Aligned values that agree to this many digits of the largest value are ties."""


@dataclass(frozen=True, slots=True)
class SignFlip:
    """Result of a sign-flip permutation test.

    Attributes
    ----------
    p
        Share of the sign patterns whose effect is at least as large as the one observed.
    patterns
        Patterns evaluated; a pattern and its negative give the same effect and count once.
    exact
        True if these are all patterns, False if they are a random sample.
    """

    p: float
    patterns: int
    exact: bool


def sign_flip(values: Array, tested: Sequence[bool], *, seed: int = 0) -> SignFlip:
    """Test a within effect by flipping the signs of the subjects' contrast vectors.

    Parameters
    ----------
    values
        One value per subject and cell, (n, levels of factor 1, levels of factor 2, …).
    tested
        For each factor, whether it takes part in the effect.
    seed
        Of the random patterns that replace the full enumeration beyond 18 subjects.

    Returns
    -------
    SignFlip
        The p-value and how it was found.

    Raises
    ------
    ValueError
        If there are fewer than two subjects.

    Notes
    -----
    Under the null hypothesis a subject's contrast vector is as likely as its negative, so all sign
    patterns are equally likely (Fisher 1935; Pesarin & Salmaso 2010). The sum of squares of the
    effect orders the patterns as F does, because flips leave the total unchanged. Sphericity is
    not assumed. The smallest possible p is 2 / 2ⁿ.
    """
    values = np.asarray(values, float)
    n, *levels = values.shape
    if n < 2:
        raise ValueError(f"a sign-flip test needs at least 2 subjects, got {n}")
    contrasts = values.reshape(n, -1) @ orthonormal_contrasts(levels, tested)
    contrasts[np.abs(contrasts) < ROUNDING * np.abs(values).max()] = 0
    exact = n <= MAX_SUBJECTS_ENUMERATED
    if exact:
        bits = np.arange(2 ** (n - 1))[:, None] >> np.arange(n)
    else:
        bits = np.random.default_rng(seed).integers(0, 2, (RANDOM_PATTERNS + 1, n))
        bits[0] = 0  # the observed pattern belongs to the sample
    signs = 1 - 2 * (bits & 1)
    effect = np.sum((signs @ contrasts) ** 2, axis=1)
    at_least = effect >= effect[0] * (1 - EQUAL_EFFECTS)
    return SignFlip(float(at_least.mean()), len(signs), exact)


def aligned_ranks(values: Array, tested: Sequence[bool]) -> Array:
    """Align the values to one effect and rank them.

    Parameters
    ----------
    values
        One value per subject and cell, (n, levels of factor 1, levels of factor 2, …).
    tested
        For each factor, whether it takes part in the effect.

    Returns
    -------
    Array
        Mid-ranks over all values, of the same shape; to be analysed like the values, for this
        effect only.

    Notes
    -----
    Aligned rank transform (Wobbrock et al. 2011): the deviation of each value from its cell's mean
    plus the estimate of this effect alone, so that no other effect reaches the ranks.
    """
    values = np.asarray(values, float)
    cell_means = values.mean(axis=0)
    estimate = cell_means
    for axis, is_tested in enumerate(tested):
        mean = estimate.mean(axis=axis, keepdims=True)
        estimate = estimate - mean if is_tested else np.broadcast_to(mean, estimate.shape)
    aligned = values - cell_means + estimate
    size = np.abs(values).max() or 1.0
    return stats.rankdata(np.round(aligned / size, ALIGNED_DIGITS)).reshape(values.shape)


def kendalls_w(scores: Array) -> tuple[float, float, float]:
    """Give Kendall's W with Friedman's chi-square and its p-value.

    Parameters
    ----------
    scores
        Scores that each judge (row) gives to each item (column), (judges, items); ties are
        corrected for. In Friedman's test the judges are subjects and the items conditions; in a
        ranking of calibration trials they are validation trials and calibration trials.

    Returns
    -------
    tuple
        Concordance W from 0 (no agreement) to 1, chi-square with items − 1 degrees of freedom,
        and p.

    Raises
    ------
    ValueError
        If there are fewer than two judges or three items.

    Notes
    -----
    Kendall & Babington Smith (1939); W = chi-square / (judges · (items − 1)). Without any
    differences between items W is undefined: NaN.
    """
    scores = np.asarray(scores, float)
    judges, items = scores.shape
    if judges < 2 or items < 3:
        raise ValueError(f"expected at least 2 judges and 3 items, got {judges} and {items}")
    if np.all(np.ptp(scores, axis=1) == 0):
        return np.nan, np.nan, np.nan
    chi2, p = stats.friedmanchisquare(*scores.T)
    return float(chi2 / (judges * (items - 1))), float(chi2), float(p)
