"""Factorial analysis of variance between trials, as experiments 1 and 2 need it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
from scipy import stats

from hbm.spatial import Array


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
    values of an experiment before the groups are looked at, as the thesis did.
    """
    values = np.asarray(values, float)
    if not (np.isfinite(values).all() and (values > 0).all()):
        raise ValueError("a Box–Cox transform needs positive values, none missing")
    if np.ptp(values) == 0:
        raise ValueError("a Box–Cox transform needs values that differ")
    transformed, exponent, (low, high) = stats.boxcox(values, alpha=0.05)
    return BoxCox(transformed, float(exponent), float(low), float(high))


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
    (Yates 1934), so it does not depend on the order of the factors.
    """
    blocks = _effects(data, factors, interactions)
    y = _response(data, response, factors)
    design = np.hstack(list(blocks.values()))
    _, ss_error, df_error = _fit(design, y)
    ms_error = ss_error / df_error
    rows = []
    for effect in [name for name in blocks if name]:
        rest = np.hstack([block for name, block in blocks.items() if name != effect])
        ss, df = _fit(rest, y)[1] - ss_error, blocks[effect].shape[1]
        f = ss / df / ms_error
        p = float(stats.f.sf(f, df, df_error))
        rows.append((effect, ss, df, ss / df, f, p, ss / (ss + ss_error)))
    rows.append(("residual", ss_error, df_error, ms_error, np.nan, np.nan, np.nan))
    columns = ["effect", "ss", "df", "ms", "f", "p", "partial_eta_squared"]
    return pd.DataFrame(rows, columns=columns)


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
    blocks = _effects(data, factors, interactions)
    y = _response(data, response, factors)
    design = np.hstack(list(blocks.values()))
    coefficients, ss_error, df = _fit(design, y)
    covariance = ss_error / df * np.linalg.inv(design.T @ design)

    levels = np.unique(data[factor].to_numpy())
    columns = {effect: np.zeros((len(levels), block.shape[1])) for effect, block in blocks.items()}
    columns[""][:] = 1
    columns[factor] = _sum_coding(len(levels))
    margins = np.hstack(list(columns.values()))  # all other effects sum to zero over their levels
    means = margins @ coefficients

    pairs = list(combinations(range(len(levels)), 2))
    rows = []
    for first, second in pairs:
        contrast = margins[first] - margins[second]
        difference = means[first] - means[second]
        standard_error = np.sqrt(contrast @ covariance @ contrast)
        t = difference / standard_error
        p = float(2 * stats.t.sf(abs(t), df))
        half = stats.t.isf(0.025 / len(pairs), df) * standard_error
        rows.append(
            {
                "first": levels[first],
                "second": levels[second],
                "mean_first": means[first],
                "mean_second": means[second],
                "difference": difference,
                "standard_error": standard_error,
                "t": t,
                "df": df,
                "p_uncorrected": p,
                "p_bonferroni": min(1.0, len(pairs) * p),
                "ci_low": difference - half,
                "ci_high": difference + half,
            }
        )
    return pd.DataFrame(rows)


def _sum_coding(levels: int) -> Array:
    return np.vstack([np.eye(levels - 1), -np.ones(levels - 1)])


def _effects(data: pd.DataFrame, factors: Sequence[str], interactions: bool) -> dict[str, Array]:
    """Give the effect-coded columns of each effect; the intercept's name is empty."""
    main = {}
    for factor in factors:
        if data[factor].isna().any():
            raise ValueError(f"factor {factor!r}: a level is missing")
        levels, index = np.unique(data[factor].to_numpy(), return_inverse=True)
        if len(levels) < 2:
            raise ValueError(f"factor {factor!r} has one level only, {levels}")
        main[factor] = _sum_coding(len(levels))[index]
    blocks = {"": np.ones((len(data), 1))}
    for size in range(1, len(factors) + 1 if interactions else 2):
        for names in combinations(factors, size):
            block = blocks[""]
            for name in names:
                block = (block[:, :, None] * main[name][:, None, :]).reshape(len(data), -1)
            blocks[":".join(names)] = block
    return blocks


def _response(data: pd.DataFrame, response: str, factors: Sequence[str]) -> Array:
    y = data[response].to_numpy(float)
    if not np.isfinite(y).all():
        trial = data.loc[~np.isfinite(y), list(factors)].iloc[0].to_dict()
        raise ValueError(f"{response!r} is missing at {trial}: leave the trial out, and name it")
    return y


def _fit(design: Array, y: Array) -> tuple[Array, float, int]:
    """Give coefficients, error sum of squares and error degrees of freedom."""
    coefficients, _, rank, _ = np.linalg.lstsq(design, y)
    if rank < design.shape[1]:
        raise ValueError(
            "an effect cannot be estimated: a combination of levels was never measured; "
            "fit main effects only, or leave a factor out"
        )
    df = len(y) - rank
    if df < 1:
        raise ValueError(f"{len(y)} trials are too few for {design.shape[1]} coefficients")
    ss_error = float(np.sum((y - design @ coefficients) ** 2))
    if ss_error <= 1e-24 * np.sum(y**2):
        raise ValueError("the effects explain every value: there is no error to test against")
    return np.asarray(coefficients, float), ss_error, int(df)
