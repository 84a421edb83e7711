"""Tests of a repeated-measures design without a normal distribution."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hbm.spatial import Array
from pipeline.statistics.rm_glm import ROUNDING, orthonormal_contrasts

MOST_SUBJECTS_ENUMERATED = 18
RANDOM_PATTERNS = 99_999


@dataclass(frozen=True, slots=True)
class SignFlip:
    """A sign-flip test: its p-value, and out of how many sign patterns.

    Attributes
    ----------
    p
        Share of the sign patterns whose effect is at least as large as the one observed.
    patterns
        Patterns looked at; a pattern and its negative give the same effect and count once.
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
        Of the random patterns that replace the full list beyond 18 subjects.

    Raises
    ------
    ValueError
        If there are fewer than two subjects.

    Notes
    -----
    Without the effect a subject's contrast vector is as likely as its negative, so all sign
    patterns are equally likely (Fisher 1935; Pesarin & Salmaso 2010). The sum of squares of the
    effect orders the patterns as F does, because flips leave the total unchanged. Sphericity is
    not assumed. The smallest p possible is 2 / 2ⁿ.
    """
    values = np.asarray(values, float)
    n, *levels = values.shape
    if n < 2:
        raise ValueError(f"a sign-flip test needs at least 2 subjects, got {n}")
    contrasts = values.reshape(n, -1) @ orthonormal_contrasts(levels, tested)
    contrasts[np.abs(contrasts) < ROUNDING * np.abs(values).max()] = 0
    exact = n <= MOST_SUBJECTS_ENUMERATED
    if exact:
        bits = np.arange(2 ** (n - 1))[:, None] >> np.arange(n)
    else:
        bits = np.random.default_rng(seed).integers(0, 2, (RANDOM_PATTERNS + 1, n))
        bits[0] = 0  # the pattern observed is one of the sample
    signs = 1 - 2 * (bits & 1)
    effect = np.sum((signs @ contrasts) ** 2, axis=1)
    at_least = effect >= effect[0] * (1 - 1e-10)  # equal but for rounding counts as equal
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
        Mid-ranks over all values, of the same shape. Analyse them as values were and read only
        the row of this effect.

    Notes
    -----
    Aligned rank transform (Wobbrock et al. 2011): what remains of a value beside the mean of its
    cell, plus the estimate of this effect alone, so that no other effect reaches the ranks.
    """
    values = np.asarray(values, float)
    cell_means = values.mean(axis=0)
    estimate = cell_means
    for axis, is_tested in enumerate(tested):
        mean = estimate.mean(axis=axis, keepdims=True)
        estimate = estimate - mean if is_tested else np.broadcast_to(mean, estimate.shape)
    aligned = values - cell_means + estimate
    size = np.abs(values).max() or 1.0
    return stats.rankdata(np.round(aligned / size, 10)).reshape(values.shape)


def kendalls_w(scores: Array) -> tuple[float, float, float]:
    """Give Kendall's W with Friedman's chi-square and its p-value.

    Parameters
    ----------
    scores
        Scores that each judge (row) gives to each item (column), (judges, items); ties are
        corrected for. Subjects and conditions in Friedman's test; validation columns and
        calibration trials in a ranking.

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
    Kendall & Babington Smith (1939); W = chi-square / (judges · (items − 1)). Judges who all
    tie all items have no concordance: NaN.
    """
    scores = np.asarray(scores, float)
    judges, items = scores.shape
    if judges < 2 or items < 3:
        raise ValueError(f"expected at least 2 judges and 3 items, got {judges} and {items}")
    if np.all(np.ptp(scores, axis=1) == 0):
        return np.nan, np.nan, np.nan
    chi2, p = stats.friedmanchisquare(*scores.T)
    return float(chi2 / (judges * (items - 1))), float(chi2), float(p)
