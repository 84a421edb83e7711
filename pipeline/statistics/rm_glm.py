"""The general linear model for repeated measures: within factors, groups and covariates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isfinite, isnan, nan
from typing import Final

import numpy as np
import scipy

from hbm.spatial import Array
from pipeline.statistics.design import CONFIDENCE

ROUNDING: Final = 1e-12
"""What is smaller than this fraction of the values is rounding, not data."""


@dataclass(frozen=True, slots=True)
class GlmTerm:
    """One row of the analysis of variance.

    Attributes
    ----------
    within
        Within-subject factors of the effect; empty for an effect between subjects.
    between
        Group or covariate that the effect interacts with; empty for the within effect itself.
    ss, ss_error
        Sums of squares of the effect and of its error.
    df1, df2
        Degrees of freedom with sphericity assumed.
    contrasts
        Independent contrasts of the within effect; sphericity is a matter of two or more.
    f, p
        F statistic and its p-value with sphericity assumed.
    epsilon, p_gg
        Greenhouse–Geisser epsilon and the p-value that it gives; 1 and p with one contrast.
    mauchly_w, mauchly_p
        Mauchly's test of sphericity; NaN with one contrast or too few subjects.
    partial_eta_squared
        ss / (ss + ss_error).
    """

    within: tuple[str, ...]
    between: str
    ss: float
    ss_error: float
    df1: float
    df2: float
    contrasts: int
    f: float
    p: float
    epsilon: float
    p_gg: float
    mauchly_w: float
    mauchly_p: float
    partial_eta_squared: float


def repeated_measures_glm(
    values: Array, factors: Sequence[str], between: Mapping[str, Array] | None = None
) -> tuple[GlmTerm, ...]:
    """Fit a univariate repeated-measures model and test every term with type III sums of squares.

    Parameters
    ----------
    values
        One value per subject and cell, (n, levels of factor 1, levels of factor 2, …), none of
        them missing.
    factors
        Names of the within-subject factors, in the order of the axes of `values`.
    between
        One value per subject, (n,), none missing: texts make a group (effect-coded), numbers a
        covariate, which is centred, so that the within effects are tested for the average subject.

    Returns
    -------
    tuple of GlmTerm
        Between terms first, then each within effect followed by its interactions.

    Raises
    ------
    ValueError
        If between variables are constant or linearly dependent, or subjects are too few for an
        error term.

    Notes
    -----
    Orthonormal contrasts of each within effect turn the cells into a small multivariate
    regression on the between variables; its hypothesis and error matrices give F by their
    traces, epsilon by Greenhouse & Geisser (1959), and sphericity by Mauchly (1940).

    Deviations from the original: SPSS does not centre covariates, so its within effects are those
    of a body height of 0 m; terms that hold a covariate are the same. Mauchly's p uses the
    dimension of the contrasts throughout, as Anderson (2003), section 10.7.4; R and pingouin put
    the number of cells into one term of the small-sample correction. Without more than two
    contrasts the two are identical.
    """
    values = np.asarray(values, float)
    n, *levels = values.shape
    blocks = {"": np.ones((n, 1))}
    blocks |= {name: effect_coded(name, column) for name, column in (between or {}).items()}
    design = np.hstack(list(blocks.values()))
    df_error = n - design.shape[1]
    if df_error < 1:
        raise ValueError(
            f"{n} subjects are too few: {design.shape[1]} coefficients need at least "
            f"{design.shape[1] + 1}"
        )
    if np.linalg.matrix_rank(design) < design.shape[1]:
        raise ValueError(f"{', '.join(between or {})}: linearly dependent")

    inverse = np.linalg.inv(design.T @ design)
    stops = np.cumsum([block.shape[1] for block in blocks.values()])
    columns = {
        name: slice(stop - block.shape[1], stop)
        for stop, (name, block) in zip(stops, blocks.items(), strict=True)
    }
    cells = values.reshape(n, -1)
    rounding = np.sum(cells**2) * ROUNDING**2
    terms = []
    for size in range(len(factors) + 1):
        for within in combinations(factors, size):
            contrasts = cells @ orthonormal_contrasts(levels, [name in within for name in factors])
            # ordinary least squares of the subjects' contrasts on the between variables
            coefficients = inverse @ design.T @ contrasts
            residuals = contrasts - design @ coefficients
            error = residuals.T @ residuals
            if np.trace(error) < rounding:
                error[:] = 0
            for name, of_term in columns.items():
                if within or name:
                    # type III: what the fit loses without the term's columns, by Wald's form
                    beta = coefficients[of_term]
                    ss = np.trace(beta.T @ np.linalg.solve(inverse[of_term, of_term], beta))
                    terms.append(_term(within, name, ss, error, len(beta), df_error))
    return tuple(terms)


def effect_coded(name: str, column: Array) -> Array:
    """Code a group by its effects, or centre a covariate, (n, columns)."""
    column = np.asarray(column)
    if np.issubdtype(column.dtype, np.number):
        column = column.astype(float)
        block = (column - column.mean())[:, None]
    else:
        # the last level is minus one in all columns, so that effects sum to zero
        group = (column[:, None] == np.unique(column)).astype(float)
        block = group[:, :-1] - group[:, -1:]
    if block.size == 0 or np.ptp(block) == 0:
        raise ValueError(f"{name}: the same for all subjects, so its effect cannot be tested")
    return np.asarray(block)


def orthonormal_contrasts(levels: Sequence[int], tested: Sequence[bool]) -> Array:
    """Give orthonormal contrasts of one within effect, (cells, contrasts).

    The last factor runs fastest over the cells; factors that are not tested are averaged over.
    """
    matrix = np.ones((1, 1))
    for level, is_tested in zip(levels, tested, strict=True):
        # the first column of Q is the mean over the levels, the others are contrasts
        basis, _ = np.linalg.qr(np.hstack([np.ones((level, 1)), np.eye(level)[:, 1:]]))
        matrix = np.kron(matrix, basis[:, 1:] if is_tested else basis[:, :1])
    return np.asarray(matrix)


def _term(
    within: tuple[str, ...], name: str, ss: float, error: Array, rank: int, df_error: int
) -> GlmTerm:
    """Test an effect by its sum of squares and the matrix of its error."""
    d = len(error)
    ss_error = np.trace(error)
    df1, df2 = rank * d, df_error * d
    f = (ss / df1) / (ss_error / df2) if ss_error > 0 else nan
    # Greenhouse and Geisser: tr(E)² / (d tr(E²)), 1 where all contrasts vary alike
    epsilon = ss_error**2 / (d * np.sum(error**2)) if ss_error > 0 else nan
    w, p_sphericity = _mauchly(error, df_error)
    return GlmTerm(
        within=within,
        between=name,
        ss=float(ss),
        ss_error=float(ss_error),
        df1=df1,
        df2=df2,
        contrasts=d,
        f=float(f),
        p=float(scipy.stats.f.sf(f, df1, df2)),
        epsilon=float(epsilon),
        p_gg=float(scipy.stats.f.sf(f, df1 * epsilon, df2 * epsilon)),
        mauchly_w=w,
        mauchly_p=p_sphericity,
        partial_eta_squared=float(ss / (ss + ss_error)) if ss + ss_error > 0 else nan,
    )


def _mauchly(error: Array, df: int) -> tuple[float, float]:
    """Give Mauchly's W and its p-value, of an error matrix of d contrasts."""
    d = len(error)
    if d < 2 or df < d or np.trace(error) <= 0:
        return nan, nan
    # W is 1 where the contrasts vary alike and are uncorrelated
    w = float(np.linalg.det(error / (np.trace(error) / d)))
    if w <= ROUNDING:  # a contrast does not vary at all
        return 0.0, 0.0
    # Box's expansion of -df ρ log W: χ² and a second term of the order of 1/df²
    rho = 1 - (2 * d**2 + d + 2) / (6 * d * df)
    cubic = (d + 2) * (d - 1) * (d - 2) * (2 * d**3 + 6 * d**2 + 3 * d + 2)
    second = cubic / (288 * (d * df * rho) ** 2)
    chi2, df_chi2 = -df * rho * np.log(w), d * (d + 1) / 2 - 1
    first, next_term = scipy.stats.chi2.sf(chi2, df_chi2), scipy.stats.chi2.sf(chi2, df_chi2 + 4)
    return w, float(first + second * (next_term - first))


def observed_power(f: float, df1: float, df2: float, alpha: float = 0.05) -> float:
    """Give the power of an F test if the effect observed were the true one.

    Notes
    -----
    The probability beyond the critical value under the noncentral F distribution with
    noncentrality F·df1 (IBM SPSS Statistics Algorithms, GLM). It is a function of the p-value alone
    and adds no information (Hoenig & Heisey 2001); it is given because published tables print it.
    """
    critical = scipy.stats.f.isf(alpha, df1, df2)
    # SciPy 1.17's sf fails at f = 0
    below = float(scipy.stats.ncf.cdf(critical, df1, df2, f * df1))
    # with an F so large the power is 1 to six decimals, where SciPy 1.17 gives NaN for some F
    is_far = isfinite(f) and f > 20.0 * critical
    return 1.0 if isnan(below) and is_far else 1 - below


def partial_eta_squared_interval(
    f: float, df1: float, df2: float, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Give the two-sided confidence interval of partial eta squared; NaN where F is.

    Degrees of freedom are multiplied by epsilon where p is.

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
        """Find the noncentrality that puts F at a level."""
        if scipy.stats.f.cdf(f, df1, df2) <= level:
            return 0.0
        # SciPy's noncentral F becomes slow beyond, and NaN in the end; there only the error varies
        if f * df1 > 1e6:
            return float(f * df1 / df2 * scipy.stats.chi2.isf(level, df2))
        # bracket the root: the probability below F falls as noncentrality rises
        highest = 10 * (f + 10) * (df1 + 1)
        while scipy.stats.ncf.cdf(f, df1, df2, highest) > level:
            highest *= 2
        return float(
            scipy.optimize.brentq(lambda x: scipy.stats.ncf.cdf(f, df1, df2, x) - level, 0, highest)
        )

    def bound(level: float) -> float:
        """Give η² at a level."""
        at_level = noncentrality(level)
        return 1 / (1 + df2 / at_level) if at_level else 0.0  # rounded too, it grows with λ

    tail = (1 - confidence) / 2
    return bound(1 - tail), bound(tail)
