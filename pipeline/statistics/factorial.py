"""Factorial analysis of variance between trials, as experiments 1 and 2 need it.

The only module that uses statsmodels, which is imported when something is tested.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.statistics.design import CONFIDENCE

if TYPE_CHECKING:
    from statsmodels.regression.linear_model import RegressionResults


def anova(data: pd.DataFrame, response: str, factors: Sequence[str]) -> pd.DataFrame:
    """Give the analysis of variance of a factorial design: main effects, type III.

    Parameters
    ----------
    data
        One row per trial; the levels of a factor are its distinct values, numbers included.
        Groups may be of unequal size.
    response
        Column to explain.
    factors
        Columns with the factors.

    Returns
    -------
    pandas.DataFrame
        One row per effect and a last one, "residual": effect, ss, df, ms, f, p,
        partial_eta_squared.

    Raises
    ------
    ValueError
        If a value is missing, a factor has one level only, two factors always change
        together, or nothing is left for the error.

    Notes
    -----
    Main effects only, as MATLAB's anovan by default. Effect-coded factors; an effect's sum of
    squares is what the fit loses without its columns
    (Yates 1934), so it does not depend on the order of the factors. Equal to R's ``car::Anova``.
    """
    from statsmodels.stats.anova import anova_lm

    table = anova_lm(_fit(data, response, factors), typ=3).drop("Intercept")
    ss, df = table["sum_sq"].to_numpy(), table["df"].to_numpy().round().astype(int)
    # partial: of an effect and the error alone; the error, last, has none
    eta_squared = np.append(ss[:-1] / (ss[:-1] + ss[-1]), np.nan)
    return pd.DataFrame(
        {
            "effect": [*factors, "residual"],
            "ss": ss,
            "df": df,
            "ms": ss / df,
            "f": table["F"].to_numpy(),
            "p": table["PR(>F)"].to_numpy(),
            "partial_eta_squared": eta_squared,
        }
    )


def compare_levels(
    data: pd.DataFrame, response: str, factors: Sequence[str], factor: str
) -> pd.DataFrame:
    """Compare the marginal means of all pairs of levels of one factor, Bonferroni-corrected.

    Parameters
    ----------
    data, response, factors
        As in `anova`, whose model and error are used.
    factor
        The factor whose levels are compared, one of `factors`.

    Returns
    -------
    pandas.DataFrame
        One row per pair: first, second, mean_first, mean_second, difference (first − second),
        standard_error, t, df, p_uncorrected, p_bonferroni, ci_low, ci_high. The intervals hold
        together at 95 %.

    Raises
    ------
    ValueError
        As in `anova`.

    Notes
    -----
    Marginal means give every cell of the other factors the same weight however often it was
    measured (Searle, Speed & Milliken 1980), as MATLAB's multcompare and R's emmeans do.
    """
    fit = _fit(data, response, factors)
    levels = np.unique(data[factor].to_numpy())
    margins = np.zeros((len(levels), len(fit.params)))
    margins[:, 0] = 1  # all other effects sum to zero over their levels
    # effect coding: the last level is minus the sum of the others
    of_factor = fit.params.index.str.startswith(_coded(factors.index(factor)))
    margins[:, of_factor] = np.vstack([np.eye(len(levels) - 1), -np.ones(len(levels) - 1)])
    means = margins @ fit.params.to_numpy()

    first, second = np.array(list(combinations(range(len(levels)), 2))).T
    test = fit.t_test(margins[first] - margins[second])
    # Bonferroni: the error of all pairs together is that of one interval
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
    """Give what the main effects of `anova` do not explain, (n,): what has to be normal."""
    return np.asarray(_fit(data, response, factors).resid)


def _coded(number: int) -> str:
    """Name the effect-coded factor of a number in the model."""
    return f"C(x{number}, Sum)"


def _fit(data: pd.DataFrame, response: str, factors: Sequence[str]) -> "RegressionResults":
    """Fit the linear model with effect-coded factors, or say why it cannot be tested."""
    from statsmodels.formula.api import ols

    y = data[response].to_numpy(float)
    if not np.isfinite(y).all():
        trial = data.loc[~np.isfinite(y), list(factors)].iloc[0].to_dict()
        raise ValueError(f"{response!r} is missing at {trial}: leave the trial out, and name it")
    for factor in factors:
        if data[factor].isna().any():
            raise ValueError(f"factor {factor!r}: a level is missing")
        if data[factor].nunique() < 2:
            raise ValueError(f"factor {factor!r} has one level only, {data[factor].unique()}")
    columns = {f"x{k}": data[factor].to_numpy() for k, factor in enumerate(factors)}
    effects = " + ".join(map(_coded, range(len(factors))))
    model = ols(f"y ~ {effects}", pd.DataFrame({"y": y, **columns}))
    trials, coefficients = model.exog.shape
    if np.linalg.matrix_rank(model.exog) < coefficients:
        raise ValueError(
            "an effect cannot be estimated: a combination of levels was never measured; "
            "leave a factor out"
        )
    if trials <= coefficients:
        raise ValueError(f"{trials} trials are too few for {coefficients} coefficients")
    fit = model.fit()
    # errors of 1e-12 of the values are rounding
    if fit.ssr <= 1e-24 * np.sum(y**2):
        raise ValueError("the effects explain every value: there is no error to test against")
    return fit
