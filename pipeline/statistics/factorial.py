"""Factorial analysis of variance between trials, as experiments 1 and 2 need it.

The only module that uses statsmodels, which is imported when something is tested.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd
from scipy import optimize, special, stats

from hbm.spatial import Array

if TYPE_CHECKING:
    from statsmodels.regression.linear_model import RegressionResults

CONFIDENCE: Final = 0.95
"""Confidence level of the intervals, as everywhere in this project."""
NO_ERROR: Final = 1e-24
"""Error sum of squares, relative to that of the response, up to which it is rounding: (1e-12)²."""


@dataclass(frozen=True, slots=True)
class BoxCox:
    """A power transform towards the normal distribution.

    Attributes
    ----------
    values
        (yᵡ − 1) / λ, or log y at λ = 0, (n,).
    exponent
        The λ of greatest likelihood.
    exponent_low, exponent_high
        Its 95 % confidence interval from the profile of the likelihood.
    """

    values: Array
    exponent: float
    exponent_low: float
    exponent_high: float


def box_cox(values: Array) -> BoxCox:
    """Transform positive values to be as normal as a power can make them.

    Parameters
    ----------
    values
        Positive values, (n,).

    Raises
    ------
    ValueError
        If a value is missing, zero or negative, or all are the same.

    Notes
    -----
    Box & Cox (1964), section 3. The likelihood is that of one normal population: transform the
    values of an experiment before the groups are looked at, as the thesis did. Equal to
    ``scipy.stats.boxcox``, which takes fifty times as long and finds no end of an interval wider
    than ± 50, as that of values that hardly vary.
    """
    values = np.asarray(values, float)
    if not (np.isfinite(values).all() and (values > 0).all()):
        raise ValueError("a Box–Cox transform needs positive values, none missing")
    if np.ptp(values) == 0:
        raise ValueError("a Box–Cox transform needs values that differ")
    logarithms = np.log(values)

    def likelihood(exponent: float) -> float:
        return _box_cox_likelihood(exponent, logarithms)

    best = float(optimize.brent(lambda exponent: -likelihood(exponent), brack=(-2.0, 2.0)))
    drop = float(stats.chi2.ppf(CONFIDENCE, 1)) / 2

    def end(step: float) -> float:
        """Find where the likelihood has dropped, on one side; nothing is beyond floating point."""
        while likelihood(best + step) > likelihood(best) - drop:
            step *= 2
        return float(
            optimize.brentq(lambda x: likelihood(x) - likelihood(best) + drop, best, best + step)
        )

    return BoxCox(np.asarray(special.boxcox(values, best), float), best, end(-0.1), end(0.1))


def _box_cox_likelihood(exponent: float, logarithms: Array) -> float:
    """Give the logarithm of the likelihood; the largest power is taken out, so none overflows."""
    powers = exponent * logarithms
    largest = np.max(powers)
    if exponent == 0:
        log_sd = np.log(np.std(logarithms))
    else:
        log_sd = largest + np.log(np.std(np.expm1(powers - largest)) / abs(exponent))
    return float((exponent - 1) * np.sum(logarithms) - len(logarithms) * log_sd)


def anova(
    data: pd.DataFrame, response: str, factors: Sequence[str], *, interactions: bool = False
) -> pd.DataFrame:
    """Give the analysis of variance of a factorial design, type III.

    Parameters
    ----------
    data
        One row per trial; the levels of a factor are its distinct values, numbers included.
        Groups may be of unequal size.
    response
        Column to explain.
    factors
        Columns with the factors.
    interactions
        False for main effects only, MATLAB's default in anovan; True for the full factorial.

    Returns
    -------
    pandas.DataFrame
        One row per effect and a last one, "residual": effect, ss, df, ms, f, p,
        partial_eta_squared.

    Raises
    ------
    ValueError
        If a value is missing, a factor has one level only, a combination of levels that an
        effect needs was never measured, or nothing is left for the error.

    Notes
    -----
    Effect-coded factors; an effect's sum of squares is what the fit loses without its columns
    (Yates 1934), so it does not depend on the order of the factors. Equal to R's ``car::Anova``.
    """
    fit, columns = _fit(data, response, factors, interactions)
    params, unscaled = fit.params, fit.normalized_cov_params
    lost = [
        params[own] @ np.linalg.solve(unscaled[own, own], params[own]) for own in columns.values()
    ]
    ss = np.array([*lost, fit.ssr])
    df = np.array([*(own.stop - own.start for own in columns.values()), int(fit.df_resid)])
    f = ss[:-1] / df[:-1] / fit.mse_resid
    return pd.DataFrame(
        {
            "effect": [*(":".join(factors[n] for n in term) for term in columns), "residual"],
            "ss": ss,
            "df": df,
            "ms": ss / df,
            "f": np.append(f, np.nan),
            "p": np.append(stats.f.sf(f, df[:-1], fit.df_resid), np.nan),
            "partial_eta_squared": np.append(ss[:-1] / (ss[:-1] + ss[-1]), np.nan),
        }
    )


def compare_levels(
    data: pd.DataFrame,
    response: str,
    factors: Sequence[str],
    factor: str,
    *,
    interactions: bool = False,
) -> pd.DataFrame:
    """Compare the marginal means of all pairs of levels of one factor, Bonferroni-corrected.

    Parameters
    ----------
    data, response, factors, interactions
        As in `anova`, whose model and error are used.
    factor
        The factor whose levels are compared.

    Returns
    -------
    pandas.DataFrame
        One row per pair: first, second, mean_first, mean_second, difference (first − second),
        standard_error, t, df, p_uncorrected, p_bonferroni, ci_low, ci_high. The intervals hold
        together at 95 %.

    Raises
    ------
    ValueError
        As in `anova`, and if `factor` is not one of `factors`.

    Notes
    -----
    Marginal means give every cell of the other factors the same weight however often it was
    measured (Searle, Speed & Milliken 1980), as MATLAB's multcompare and R's emmeans do.
    """
    if factor not in factors:
        raise ValueError(f"{factor!r} is not one of the factors {', '.join(factors)}")
    fit, columns = _fit(data, response, factors, interactions)
    levels = np.unique(data[factor].to_numpy())
    margins = np.zeros((len(levels), len(fit.params)))
    margins[:, 0] = 1  # all other effects sum to zero over their levels
    margins[:, columns[factors.index(factor),]] = _effect_coding(len(levels))
    means = margins @ fit.params

    first, second = np.array(list(combinations(range(len(levels)), 2))).T
    test = fit.t_test(margins[first] - margins[second])
    low, high = test.conf_int(alpha=(1 - CONFIDENCE) / len(first)).T
    p = np.atleast_1d(test.pvalue)
    return pd.DataFrame(
        {
            "first": levels[first],
            "second": levels[second],
            "mean_first": means[first],
            "mean_second": means[second],
            "difference": means[first] - means[second],
            "standard_error": np.ravel(test.sd),
            "t": np.ravel(test.tvalue),
            "df": int(fit.df_resid),
            "p_uncorrected": p,
            "p_bonferroni": np.minimum(1.0, len(p) * p),
            "ci_low": low,
            "ci_high": high,
        }
    )


def residuals(data: pd.DataFrame, response: str, factors: Sequence[str]) -> Array:
    """Give what the main effects of `anova` leave unexplained, (n,), in the unit of the response.

    Parameters
    ----------
    data, response, factors
        As in `anova`.

    Raises
    ------
    ValueError
        As in `anova`.

    Notes
    -----
    An analysis of variance assumes that these are normally distributed, not the response, whose
    distribution has the effects in it.
    """
    return np.asarray(_fit(data, response, factors, interactions=False)[0].resid)


def _fit(
    data: pd.DataFrame, response: str, factors: Sequence[str], interactions: bool
) -> "tuple[RegressionResults, Mapping[tuple[int, ...], slice]]":
    """Fit the linear model with effect-coded factors, or say why it cannot be tested.

    Gives the fit and, by the numbers of an effect's factors, the columns of the effect.
    """
    from statsmodels.regression.linear_model import OLS

    y = _response(data, response, factors)
    coded = []
    for factor in factors:
        if data[factor].isna().any():
            raise ValueError(f"factor {factor!r}: a level is missing")
        levels, index = np.unique(data[factor].to_numpy(), return_inverse=True)
        if len(levels) < 2:
            raise ValueError(f"factor {factor!r} has one level only, {levels}")
        coded.append(_effect_coding(len(levels))[index])
    sizes = range(1, len(factors) + 1 if interactions else 2)
    parts, columns = [np.ones((len(y), 1))], {}
    for term in (term for size in sizes for term in combinations(range(len(factors)), size)):
        parts.append(reduce(_products, (coded[n] for n in term)))
        stop = sum(part.shape[1] for part in parts)
        columns[term] = slice(stop - parts[-1].shape[1], stop)
    design = np.hstack(parts)
    trials, coefficients = design.shape
    if np.linalg.matrix_rank(design) < coefficients:
        raise ValueError(
            "an effect cannot be estimated: a combination of levels was never measured; "
            "fit main effects only, or leave a factor out"
        )
    if trials <= coefficients:
        raise ValueError(f"{trials} trials are too few for {coefficients} coefficients")
    fit = OLS(y, design).fit()
    if fit.ssr <= NO_ERROR * np.sum(y**2):
        raise ValueError("the effects explain every value: there is no error to test against")
    return fit, columns


def _effect_coding(levels: int) -> Array:
    """Code the levels of a factor so that their effects sum to zero, (levels, levels - 1)."""
    return np.vstack([np.eye(levels - 1), -np.ones(levels - 1)])


def _products(first: Array, second: Array) -> Array:
    """Give the columns of an interaction, all products of the columns of two effects."""
    return np.asarray((first[:, :, None] * second[:, None]).reshape(len(first), -1))


def _response(data: pd.DataFrame, response: str, factors: Sequence[str]) -> Array:
    y = data[response].to_numpy(float)
    if not np.isfinite(y).all():
        trial = data.loc[~np.isfinite(y), list(factors)].iloc[0].to_dict()
        raise ValueError(f"{response!r} is missing at {trial}: leave the trial out, and name it")
    return y
