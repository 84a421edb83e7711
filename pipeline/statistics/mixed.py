"""Linear mixed models: comparisons that use every recording, also of subjects who lack a cell.

The value of a recording is a mean of its cell, plus what is the same in all recordings of the
subject, in those of one cell of the subject, and in one recording that is in both cells (measured
and compensated), plus an error; all normally distributed. Two cells are compared by a model of
their own: residuals without compensation scatter ten times as much as those with it, and a common
error would be wrong for both.
"""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import nan
from typing import Any, Final

import numpy as np
import pandas as pd
from scipy import stats

from hbm.spatial import Array
from pipeline.statistics.design import COMPENSATION, CONFIDENCE, MIN_SUBJECTS, Design

DRAWS: Final = 2000
"""Of the parametric bootstrap: the 99 % quantile of an interval for five pairs is known to 3 %."""
RATIOS: Final = {1: 16, 2: 8, 3: 5}
"""Number of random effects -> how many variances of each by that of the error, from 0.01 to 1000
and 0, among which each draw takes the likeliest."""


@dataclass(frozen=True, slots=True)
class MixedComparison:
    """The difference of two cells by a mixed model.

    Attributes
    ----------
    difference, error
        Estimate and standard error.
    scatter
        |t| of each draw of the parametric bootstrap if there is no difference, (`DRAWS`,).
    subjects, recordings
        How many of them are in one of the cells.
    """

    difference: float
    error: float
    scatter: Array
    subjects: int
    recordings: int

    def interval(self, alpha: float = 1 - CONFIDENCE) -> tuple[float, float]:
        """Give the confidence interval, with alpha beyond its ends."""
        student = stats.t.isf(alpha / 2, self.subjects - 1)
        half = max(float(np.quantile(self.scatter, 1 - alpha)), student) * self.error
        return self.difference - half, self.difference + half

    @property
    def t(self) -> float:
        """The difference by its standard error."""
        return self.difference / self.error if self.error > 0 else nan

    @property
    def p(self) -> float:
        """The probability of a larger |t| if there is no difference."""
        beyond = np.count_nonzero(self.scatter >= abs(self.t))
        student = 2 * stats.t.sf(abs(self.t), self.subjects - 1)
        return float(max((1 + beyond) / (1 + len(self.scatter)), student))


def fit_mixed(
    formula: str,
    table: pd.DataFrame,
    groups: str,
    random_slopes: str = "1",
    variance_components: Mapping[str, str] | None = None,
) -> Any:
    """Fit a linear mixed model by restricted maximum likelihood.

    Parameters
    ----------
    formula
        Of the fixed effects, such as "Reaction ~ Days".
    table
        A row per value.
    groups
        Column of the subjects.
    random_slopes
        Formula of effects that vary between subjects, with any correlation; the intercept alone by
        default.
    variance_components
        Name -> formula of independent effects within subjects.

    Returns
    -------
    statsmodels.regression.mixed_linear_model.MixedLMResults
        Of statsmodels (Lindstrom and Bates 1988, J Am Stat Assoc 83:1014).
    """
    from statsmodels.regression.mixed_linear_model import MixedLM

    model = MixedLM.from_formula(
        formula, table, groups=groups, re_formula=random_slopes, vc_formula=variance_components
    )
    with warnings.catch_warnings():  # a variance of zero is no fault
        warnings.simplefilter("ignore")
        return model.fit(reml=True)


def compare_cells(values: pd.DataFrame, first: str, second: str) -> MixedComparison | None:
    """Compare two cells by all recordings that there are.

    Parameters
    ----------
    values
        A row per recording and cell: subject, recording (equal where one recording is in both
        cells), cell, value.
    first, second
        The cells.

    Returns
    -------
    MixedComparison or None
        ``first - second``; None where fewer than two subjects are in a cell, or the values do not
        vary.

    Notes
    -----
    The interval is that of a parametric bootstrap of t: values are drawn from the fitted model, and
    the variances are estimated anew in each draw (Davison and Hinkley 1997, Bootstrap Methods,
    section 5.2). As variances of few subjects are uncertain, it is never narrower than by Student's
    t with as many degrees of freedom as subjects but one: where no cell is missing and nothing is
    repeated, it is that of the paired t-test. Equal data give equal numbers.
    """
    own = values[values["cell"].isin((first, second)) & np.isfinite(values["value"])]
    own = own.assign(first=np.where(own["cell"] == first, 0.5, -0.5)).reset_index(drop=True)
    people = own.groupby("cell")["subject"].nunique()
    if len(people) < 2 or people.min() < MIN_SUBJECTS:
        return None
    size = float(own["value"].std())
    if not size > 0:
        return None
    components = _components(own)
    formulas = {name: f"0 + C({name})" for name in components}
    own["scaled"] = own["value"] / size
    fitted = fit_mixed("scaled ~ first", own, "subject", variance_components=formulas or None)
    variances = [float(fitted.cov_re.iloc[0, 0]), *map(float, fitted.vcomp)]
    alike = [_alike(own[name]) for name in ("subject", *components)]
    covariance = float(fitted.scale) * np.eye(len(own))
    covariance += sum(v * same for v, same in zip(variances, alike, strict=True))
    fixed = np.column_stack([np.ones(len(own)), own["first"]])
    error = float(np.sqrt(np.linalg.inv(fixed.T @ np.linalg.solve(covariance, fixed))[1, 1]))
    scatter = _drawn_t(fixed, alike, covariance)
    subjects, recordings = own["subject"].nunique(), own["of_recording"].nunique()
    difference = float(fitted.fe_params["first"])
    return MixedComparison(size * difference, size * error, scatter, subjects, recordings)


def recording_values(recordings: pd.DataFrame, axis: str, design: Design) -> pd.DataFrame:
    """Give the values of one residual as `compare_cells` takes them.

    Of a long table with a row per recording, compensation and axis: subject, condition, recording,
    compensated, axis, rms.
    """
    own = recordings[
        (recordings["axis"] == axis)
        & recordings["condition"].isin(design.conditions)
        & recordings["compensated"].isin(design.variants)
    ]
    cells = [design.cell(*key) for key in zip(own["condition"], own["compensated"], strict=True)]
    return pd.DataFrame(
        {
            "subject": own["subject"].to_numpy(),
            "recording": (own["condition"] + " " + own["recording"].astype(str)).to_numpy(),
            "condition": own["condition"].to_numpy(),
            "compensated": own["compensated"].to_numpy(),
            "cell": cells,
            "value": own["rms"].to_numpy(float),
        }
    )


def is_incomplete_or_repeated(values: pd.DataFrame, cells: Sequence[str]) -> bool:
    """Whether a subject lacks one of some cells, or has several recordings of it.

    Otherwise a mixed model of two cells is the paired t-test.
    """
    counts = values.groupby(["subject", "cell"]).size().unstack(fill_value=0)
    counts = counts.reindex(columns=[*cells], fill_value=0)
    return bool((counts != 1).any(axis=None))


def effects_of_factors(
    values: pd.DataFrame, design: Design
) -> Iterator[tuple[str, float, int, float]]:
    """Test the factors and their interactions by all recordings.

    Of the design's groups where the values have a column ``group``.

    Yields
    ------
    effect, chi2, degrees of freedom, p
        Wald's test in one model of all cells, with a common error.
    """
    terms = {COMPENSATION: "C(compensated, Sum)", design.factor: "C(condition, Sum)"}
    named = [terms[factor] for factor in design.factors]
    own = values.assign(scaled=values["value"] / values["value"].std())
    if design.group is not None and "group" in values:
        terms[design.group] = "C(group, Sum)"
        own, named = own.dropna(subset="group"), [*named, terms[design.group]]
    components = _components(own)
    formulas = {name: f"0 + C({name})" for name in components}
    formula = f"scaled ~ {' * '.join(named)}"
    fitted = fit_mixed(formula, own, "subject", variance_components=formulas or None)
    tests = fitted.wald_test_terms(scalar=True).table
    names = {term: factor for factor, term in terms.items()}
    for term, row in tests.iterrows():
        if term != "Intercept":
            effect = ":".join(names[part] for part in str(term).split(":"))
            yield effect, float(row["statistic"]), int(row["df_constraint"]), float(row["pvalue"])


def _components(own: pd.DataFrame) -> list[str]:
    """Add the random effects within subjects that recordings of two cells can tell, as columns."""
    own["of_cell"] = own["subject"] + " " + own["cell"]
    own["of_recording"] = own["subject"] + " " + own["recording"]
    found = []
    for name in ("of_cell", "of_recording"):
        repeated = own[name].duplicated().any()
        if repeated and own[name].nunique() > own["subject"].nunique():
            found.append(name)
    return found


def _alike(names: pd.Series) -> Array:
    """Give 1 where two rows have the same name, else 0, (N, N)."""
    column = names.to_numpy(str)
    return np.asarray(column[:, None] == column, float)


def _drawn_t(fixed: Array, alike: list[Array], covariance: Array) -> Array:
    """Give |t| of values that are drawn from a model without a difference, (`DRAWS`,)."""
    count = len(fixed)
    rng = np.random.default_rng(0)
    drawn = np.linalg.cholesky(covariance) @ rng.standard_normal((count, DRAWS))
    best, found = np.full(DRAWS, np.inf), np.zeros(DRAWS)
    each = np.array([0.0, *np.geomspace(0.01, 1000, RATIOS[len(alike)])])
    for ratios in product(each, repeat=len(alike)):
        mixed = np.eye(count) + sum(r * same for r, same in zip(ratios, alike, strict=True))
        weight = np.linalg.inv(mixed)
        normal = fixed.T @ weight @ fixed
        back = np.linalg.solve(normal, fixed.T @ weight)
        estimate = back @ drawn
        left = drawn - fixed @ estimate
        square = np.sum(left * (weight @ left), axis=0) / (count - 2)
        shape = np.linalg.slogdet(mixed)[1] + np.linalg.slogdet(normal)[1]
        criterion = (count - 2) * np.log(square) + shape
        t = np.abs(estimate[1]) / np.sqrt(square * np.linalg.inv(normal)[1, 1])
        better = criterion < best
        best[better], found[better] = criterion[better], t[better]
    return found
