"""Paired comparisons in small samples: tests, effect sizes, confidence intervals."""

from dataclasses import dataclass
from math import ceil, exp, isnan, lgamma, log10, nan, sqrt

import numpy as np
import scipy

from hbm.spatial import Array
from pipeline.statistics.design import TAIL


@dataclass(frozen=True, slots=True)
class IntervalEstimate:
    """A value with its 95 % confidence interval; NaN where the sample is too small for one."""

    value: float = nan
    low: float = nan
    high: float = nan


@dataclass(frozen=True, slots=True)
class PairedComparison:
    """Paired t-test, Wilcoxon signed-rank test and effect sizes of one comparison.

    Attributes
    ----------
    mean
        Mean difference, in the unit of the values; interval by Student's t.
    t, p_t
        Paired t statistic and its two-sided p-value with n − 1 degrees of freedom.
    dz
        Cohen's dz, mean / SD of the differences; interval from the noncentral t distribution.
    g
        Hedges' g: dz corrected for its small-sample bias.
    w
        Smaller of the two sums of signed ranks.
    p_exact, p_asymptotic
        Two-sided Wilcoxon p-values: from all sign patterns of the ranks (ties included), and
        from the normal distribution with tie but without continuity correction, as SPSS.
    rank_biserial
        Matched-pairs rank-biserial correlation, −1 to 1.
    """

    mean: IntervalEstimate
    t: float
    p_t: float
    dz: IntervalEstimate
    g: IntervalEstimate
    w: float
    p_exact: float
    p_asymptotic: float
    rank_biserial: float


def compare_paired(differences: Array) -> PairedComparison:
    """Compare paired values by their differences.

    Parameters
    ----------
    differences
        One per subject, (n,) of at least two, in any unit.

    Returns
    -------
    PairedComparison
        Tests and estimates.

    Notes
    -----
    Interval of dz: Cumming & Finch (2001). Bias of dz: Hedges (1981). Rank-biserial: Kerby
    (2014). Zeros are dropped before ranking, as Wilcoxon (1945) did. The t-test of differences that
    are all equal is undefined: NaN.
    """
    differences = np.asarray(differences, float)
    # differences that agree to twelve digits of the largest are ties: the rest is rounding
    size = np.abs(differences).max() or 1.0
    rounded = np.round(differences, 12 - ceil(log10(size)))
    n, mean, sd = len(differences), float(differences.mean()), float(differences.std(ddof=1))
    t = p_t = nan
    if np.ptp(rounded) > 0:
        t = mean / sd * sqrt(n)
        p_t = float(2 * scipy.stats.t.sf(abs(t), n - 1))
    half = float(scipy.stats.t.isf(TAIL, n - 1)) * sd / sqrt(n)
    dz = _cohens_dz(t, n)
    # Hedges' exact factor with n - 1 degrees of freedom; by logarithms, as gamma functions overflow
    bias = exp(lgamma((n - 1) / 2) - lgamma((n - 2) / 2)) / sqrt((n - 1) / 2) if n > 2 else nan
    return PairedComparison(
        mean=IntervalEstimate(mean, mean - half, mean + half),
        t=t,
        p_t=p_t,
        dz=dz,
        g=IntervalEstimate(bias * dz.value, bias * dz.low, bias * dz.high),
        **_signed_ranks(rounded[rounded != 0]),
    )


def _cohens_dz(t: float, n: int) -> IntervalEstimate:
    """Give Cohen's dz of a paired t statistic."""
    dz = t / sqrt(n)
    # SciPy's noncentral t distribution returns NaN beyond
    if not abs(t) < 1e4:
        return IntervalEstimate(dz)

    def bound(level: float) -> float:
        """Find the effect size that puts t at a level."""
        lowest, highest = -5.0, 10 + 5 * abs(t)  # brackets both bounds

        def beyond(delta: float) -> float:
            """Give the probability below t beyond the level."""
            below = float(scipy.stats.nct.cdf(abs(t), n - 1, delta))
            return (1.0 if isnan(below) else below) - level  # SciPy's NaN is nearly 1

        # t of a true effect dz has noncentrality dz √n
        noncentrality = scipy.optimize.brentq(beyond, lowest, highest)
        return float(np.copysign(1, t) * noncentrality / sqrt(n))

    return IntervalEstimate(dz, *sorted((bound(TAIL), bound(1 - TAIL))))


def _signed_ranks(differences: Array) -> dict[str, float]:
    """Test differences, none of them zero, by their signed ranks."""
    if len(differences) == 0:
        return dict.fromkeys(("w", "p_exact", "p_asymptotic", "rank_biserial"), nan)
    ranks = scipy.stats.rankdata(np.abs(differences))
    positive = ranks[differences > 0].sum()
    w = min(positive, ranks.sum() - positive)
    cumulative = np.cumsum(_rank_sums(ranks))
    # each sign is a fair coin: mean half of the ranks, variance a quarter of their squares
    z = (w - ranks.sum() / 2) / sqrt(np.sum(ranks**2) / 4)
    return {
        "w": float(w),
        "p_exact": min(1.0, float(2 * cumulative[round(2 * w)])),
        "p_asymptotic": float(2 * scipy.stats.norm.sf(abs(z))),
        "rank_biserial": float(2 * positive / ranks.sum() - 1),
    }


def _rank_sums(ranks: Array) -> Array:
    """Give the probability of each sum of positive ranks, in steps of one half from zero."""
    # ranks of ties are whole or half numbers; each rank is added to the sum or not, by even odds
    probability = np.ones(1)
    for doubled in np.round(2 * ranks).astype(int):
        longer = np.append(probability, np.zeros(doubled))
        longer[doubled:] += probability
        probability = longer / 2
    return probability
