"""The general linear model for repeated measures: within factors, groups and covariates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import nan

import numpy as np
from scipy import stats

from hbm.spatial import Array
from pipeline.statistics.f_test import observed_power

ROUNDING = 1e-12
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
    epsilon_hf
        Huynh–Feldt epsilon, at most 1; NaN with too few subjects.
    mauchly_w, mauchly_p
        Mauchly's test of sphericity; NaN with one contrast or too few subjects.
    partial_eta_squared
        ss / (ss + ss_error).
    power, power_gg
        Observed power as in SPSS, with sphericity assumed and with Greenhouse–Geisser.
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
    epsilon_hf: float
    mauchly_w: float
    mauchly_p: float
    partial_eta_squared: float
    power: float
    power_gg: float


def repeated_measures_glm(
    values: Array,
    factors: Sequence[str],
    between: Mapping[str, Array] | None = None,
    *,
    centre: bool = True,
    alpha: float = 0.05,
) -> tuple[GlmTerm, ...]:
    """Fit a univariate repeated-measures model and test every term with type III sums of squares.

    Parameters
    ----------
    values
        One value per subject and cell, (n, levels of factor 1, levels of factor 2, …).
    factors
        Names of the within-subject factors, in the order of the axes of `values`.
    between
        One value per subject, (n,): texts make a group (effect-coded), numbers a covariate.
    centre
        Centre the covariates, so that the within effects are tested for the average subject.
        False leaves them as given, as SPSS does: the within effects are then those at zero (a
        body height of 0 m); terms that hold a covariate are the same either way.
    alpha
        Level of significance for the observed power.

    Returns
    -------
    tuple of GlmTerm
        Between terms first, then each within effect followed by its interactions.

    Raises
    ------
    ValueError
        If a value is missing, between variables are constant or linearly dependent, or too few
        subjects are left for an error term.

    Notes
    -----
    Orthonormal contrasts of each within effect turn the cells into a small multivariate
    regression on the between variables; its hypothesis and error matrices give F by their
    traces, epsilon by Greenhouse & Geisser (1959) and by Huynh & Feldt (1976) in the form of
    Lecoutre (1991), and sphericity by Mauchly (1940).

    Deviations from the original: Mauchly's p uses the dimension of the contrasts throughout,
    as Anderson (2003), section 10.7.4; R and pingouin put the number of cells into one term of
    the small-sample correction. Without more than two contrasts the two are identical.
    """
    values = np.asarray(values, float)
    n, *levels = values.shape
    if len(levels) != len(factors):
        raise ValueError(f"values need one axis per factor {tuple(factors)}, got {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError("a cell is missing: leave incomplete subjects out")
    blocks = _design(n, between or {}, centre)
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
            coefficients = inverse @ design.T @ contrasts
            residuals = contrasts - design @ coefficients
            error = residuals.T @ residuals
            if np.trace(error) < rounding:
                error[:] = 0
            for name, own in columns.items():
                if within or name:
                    beta = coefficients[own]
                    ss = np.trace(beta.T @ np.linalg.solve(inverse[own, own], beta))
                    terms.append(_term(within, name, ss, error, len(beta), df_error, alpha))
    return tuple(terms)


def _design(n: int, between: Mapping[str, Array], centre: bool) -> dict[str, Array]:
    blocks = {"": np.ones((n, 1))}
    for name, given in between.items():
        column = np.asarray(given)
        if column.shape != (n,):
            raise ValueError(f"{name}: expected one value for each of {n} subjects")
        if np.issubdtype(column.dtype, np.number):
            column = column.astype(float)
            blocks[name] = (column - column.mean() * centre)[:, None]
        else:
            group = (column[:, None] == np.unique(column)).astype(float)
            blocks[name] = group[:, :-1] - group[:, -1:]
        if not np.isfinite(blocks[name]).all():
            raise ValueError(f"{name}: missing for a subject")
        if blocks[name].size == 0 or np.ptp(blocks[name]) == 0:
            raise ValueError(f"{name}: the same for all subjects, so its effect cannot be tested")
    return blocks


def orthonormal_contrasts(levels: Sequence[int], tested: Sequence[bool]) -> Array:
    """Give orthonormal contrasts of one within effect, (cells, contrasts).

    Parameters
    ----------
    levels
        Levels of each within factor; the last factor runs fastest over the cells.
    tested
        For each factor, whether it takes part in the effect; the others are averaged over.
    """
    matrix = np.ones((1, 1))
    for level, is_tested in zip(levels, tested, strict=True):
        basis, _ = np.linalg.qr(np.hstack([np.ones((level, 1)), np.eye(level)[:, 1:]]))
        matrix = np.kron(matrix, basis[:, 1:] if is_tested else basis[:, :1])
    return matrix


def _term(
    within: tuple[str, ...],
    name: str,
    ss: float,
    error: Array,
    rank: int,
    df_error: int,
    alpha: float,
) -> GlmTerm:
    d = len(error)
    ss_error = np.trace(error)
    df1, df2 = rank * d, df_error * d
    f = (ss / df1) / (ss_error / df2) if ss_error > 0 else nan
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
        p=float(stats.f.sf(f, df1, df2)),
        epsilon=float(epsilon),
        p_gg=float(stats.f.sf(f, df1 * epsilon, df2 * epsilon)),
        epsilon_hf=_huynh_feldt(float(epsilon), d, df_error),
        mauchly_w=w,
        mauchly_p=p_sphericity,
        partial_eta_squared=float(ss / (ss + ss_error)) if ss + ss_error > 0 else nan,
        power=observed_power(f, df1, df2, alpha),
        power_gg=observed_power(f, df1 * epsilon, df2 * epsilon, alpha),
    )


def _huynh_feldt(epsilon: float, d: int, df: int) -> float:
    if d == 1:
        return 1.0
    below = d * (df - d * epsilon)
    return min(1.0, ((df + 1) * d * epsilon - 2) / below) if below > ROUNDING else nan


def _mauchly(error: Array, df: int) -> tuple[float, float]:
    d = len(error)
    if d < 2 or df < d or np.trace(error) <= 0:
        return nan, nan
    w = float(np.linalg.det(error / (np.trace(error) / d)))
    if w <= ROUNDING:  # a contrast does not vary at all
        return 0.0, 0.0
    rho = 1 - (2 * d**2 + d + 2) / (6 * d * df)
    second = (
        (d + 2)
        * (d - 1)
        * (d - 2)
        * (2 * d**3 + 6 * d**2 + 3 * d + 2)
        / (288 * (d * df * rho) ** 2)
    )
    chi2, df_chi2 = -df * rho * np.log(w), d * (d + 1) / 2 - 1
    first, next_term = stats.chi2.sf(chi2, df_chi2), stats.chi2.sf(chi2, df_chi2 + 4)
    return w, float(first + second * (next_term - first))
