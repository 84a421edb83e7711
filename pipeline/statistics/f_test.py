"""Effect size and power of an F test, from the noncentral F distribution."""

from math import isfinite, isnan, nan
from typing import Final

from scipy import optimize, stats

MAX_NONCENTRALITY: Final = 1e6
"""Beyond it SciPy's noncentral F distribution becomes slow, and NaN in the end."""
FAR: Final = 20.0
"""Times the critical value: with an F so large the power is 1 to six decimals."""


def observed_power(f: float, df1: float, df2: float, alpha: float = 0.05) -> float:
    """Give the power of an F test if the effect observed were the true one.

    Notes
    -----
    The probability beyond the critical value under the noncentral F distribution with
    noncentrality F·df1 (IBM SPSS Statistics Algorithms, GLM). It is a function of the p-value alone
    and adds no information (Hoenig & Heisey 2001); it is given because published tables print it.
    """
    critical = stats.f.isf(alpha, df1, df2)
    below = float(stats.ncf.cdf(critical, df1, df2, f * df1))  # SciPy 1.17's sf fails at f = 0
    far = isfinite(f) and f > FAR * critical  # where SciPy 1.17 gives NaN for some F
    return 1.0 if isnan(below) and far else 1 - below


def partial_eta_squared_interval(
    f: float, df1: float, df2: float, confidence: float = 0.95
) -> tuple[float, float]:
    """Give the confidence interval of partial eta squared.

    Parameters
    ----------
    f, df1, df2
        F statistic and its degrees of freedom, multiplied by epsilon where p is.
    confidence
        Of the two-sided interval.

    Returns
    -------
    tuple of float
        Lower and upper bound; NaN where F is.

    Notes
    -----
    The bounds of the noncentrality λ put F at either tail of the noncentral F distribution
    (Steiger & Fouladi 1997) and become η² = λ / (λ + df2), as F·df1 becomes the estimate itself:
    the intervals of R's effectsize.

    Examples
    --------
    >>> low, high = partial_eta_squared_interval(40.72, 2, 18, confidence=0.9)
    >>> print(f"{low:.2f} {high:.2f}")
    0.66 0.89
    """
    if not isfinite(f):
        return nan, nan

    def noncentrality(level: float) -> float:
        if stats.f.cdf(f, df1, df2) <= level:
            return 0.0
        if f * df1 > MAX_NONCENTRALITY:  # only the error varies
            return float(f * df1 / df2 * stats.chi2.isf(level, df2))
        highest = 10 * (f + 10) * (df1 + 1)
        while stats.ncf.cdf(f, df1, df2, highest) > level:
            highest *= 2
        return float(optimize.brentq(lambda x: stats.ncf.cdf(f, df1, df2, x) - level, 0, highest))

    def bound(level: float) -> float:
        found = noncentrality(level)
        return 1 / (1 + df2 / found) if found else 0.0  # rounded too, it grows with λ

    tail = (1 - confidence) / 2
    return bound(1 - tail), bound(tail)
