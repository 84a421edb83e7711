"""Linear mixed models: comparisons that use every recording, also of subjects who lack a cell.

The value of a recording is a mean of its cell, plus what is the same in all recordings of the
subject, in those of one cell of the subject, and in one recording that is in both cells (measured
and compensated), plus an error; all normally distributed. Two cells are compared by a model of
their own: residuals without compensation scatter ten times as much as those with it, and a common
error would be wrong for both.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations, product
from math import inf, nan
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from hbm.spatial import Array
from pipeline.statistics.design import COMPENSATION, CONFIDENCE, MIN_SUBJECTS, Design
from pipeline.statistics.measurement import deviation
from pipeline.statistics.rm_glm import effect_coded

MAX_RATIO: Final = 1e6
"""Of a random effect's variance to that of the error; beyond, rounding hides the error."""
ZERO_RATIO: Final = 1e-7
"""A smaller ratio is a variance of zero."""
MAX_SLOPE: Final = 1e-6
"""Of the criterion at its minimum, by the logarithm of 1 + ratio."""
Weights = tuple[float, float]
"""Of the means of two cells in a sum of both."""
DIFFERENCE: Final = (1.0, -1.0)
"""Weights of the means of two cells in their difference."""


class FTest(NamedTuple):
    """An F test of fixed effects.

    Attributes
    ----------
    f, df1, df2, p
        Statistic, degrees of freedom (of the error by Kenward and Roger), p-value.
    """

    f: float
    df1: int
    df2: float
    p: float


@dataclass(frozen=True, slots=True)
class MixedModel:
    """A linear mixed model, fitted by restricted maximum likelihood (REML).

    Attributes
    ----------
    coefficients, covariance
        Fixed effects, (P,), and their covariance, (P, P).
    variances
        Of the random effects and, last, of the error, (K + 1,). Zero too of an effect that the
        values cannot tell from another.
    adjusted
        Covariance with the correction for few subjects, (P, P).
    sensitivity
        Change of `covariance` with each variance that is not zero, (J, P, P).
    uncertainty
        Covariance of these variances, (J, J).
    """

    coefficients: Array
    covariance: Array
    variances: Array
    adjusted: Array
    sensitivity: Array
    uncertainty: Array

    def df(self, weights: Array) -> float:
        """Give the degrees of freedom of a linear combination of the coefficients, (P,)."""
        # Satterthwaite: 2 V² by the variance of V, which follows the estimated variances
        variance, slopes = weights @ self.covariance @ weights, self.sensitivity @ weights @ weights
        return float(2 * variance**2 / (slopes @ self.uncertainty @ slopes))

    def test(self, contrasts: Array) -> FTest:
        """Test whether linear combinations of the coefficients, (L, P), are all zero.

        Raises
        ------
        ValueError
            If there are too few subjects for several combinations together.

        Notes
        -----
        Kenward and Roger 1997, Biometrics 53:983, equations 4 to 9: the F statistic is scaled, and
        has as many degrees of freedom, that its mean and variance are those of an F distribution.
        """
        count = len(contrasts)
        # A1 and A2 of the paper: how far the estimated variances move the statistic
        inverse = np.linalg.inv(contrasts @ self.covariance @ contrasts.T)
        changes = inverse @ contrasts @ self.sensitivity @ contrasts.T
        traces = np.trace(changes, axis1=1, axis2=2)
        a1 = traces @ self.uncertainty @ traces
        a2 = np.einsum("jk,jab,kba->", self.uncertainty, changes, changes)
        scale, df = 1.0, 2 / a2  # of a single combination
        if count > 1:
            # mean and variance of the F statistic, chosen to be exact where there is an exact test
            b = (a1 + 6 * a2) / (2 * count)
            g = ((count + 1) * a1 - (count + 4) * a2) / ((count + 2) * a2)
            c1, c2, c3 = np.array([g, count - g, count + 2 - g]) / (3 * count + 2 * (1 - g))
            by_mean = 1 - a2 / count
            above, below = (1 + c1 * b) * by_mean**2, (1 - c2 * b) ** 2 * (1 - c3 * b)
            # the F distribution with these moments
            df = 4 + (count + 2) * below / (above - below)
            scale = df * by_mean / (df - 2)
            if not df > 2:
                raise ValueError(f"too few subjects for {count + 1} levels")
        # Wald's statistic with the covariance that allows for few subjects
        estimate = contrasts @ self.coefficients
        adjusted = contrasts @ self.adjusted @ contrasts.T
        f = scale / count * estimate @ np.linalg.solve(adjusted, estimate)
        return FTest(float(f), count, float(df), float(scipy.stats.f.sf(f, count, df)))


@dataclass(frozen=True, slots=True)
class CellComparison:
    """Two cells compared: their means, and how sure weighted sums of both are.

    Attributes
    ----------
    means
        Of the first and of the second cell, (2,).
    covariance
        Of the means, (2, 2); NaN of a single subject.
    between, within
        Covariance of the cells between subjects with infinitely many recordings, and what a single
        recording adds, (2, 2) each.
    subjects, recordings
        How many of them are in one of the cells.
    repeats
        Recordings of a subject in a cell: their harmonic mean.
    model
        The mixed model of all recordings; None of pairs of single recordings, where Student's t of
        the differences is exact.
    """

    means: Array
    covariance: Array
    between: Array
    within: Array
    subjects: int
    recordings: int
    repeats: float = 1.0
    model: MixedModel | None = None

    def df(self, weights: Weights = DIFFERENCE) -> float:
        """Give the degrees of freedom of a weighted sum."""
        return self.subjects - 1 if self.model is None else self.model.df(np.array(weights))

    def bounds(self, weights: Weights, alpha: float) -> tuple[float, float]:
        """Give the confidence interval of a weighted sum, with alpha beyond either end."""
        value = float(self.means @ weights)
        quantile = float(scipy.stats.t.isf(alpha, self.df(weights)))
        half = quantile * deviation(self.covariance, weights)
        return value - half, value + half

    def interval(self, alpha: float = 1 - CONFIDENCE) -> tuple[float, float]:
        """Give the confidence interval of the difference, with alpha beyond both ends together."""
        return self.bounds(DIFFERENCE, alpha / 2)

    def ratio_interval(self, alpha: float = 1 - CONFIDENCE) -> tuple[float, float]:
        """Give the confidence interval of the first mean by the second.

        The ratios r for which ``first - r second`` does not differ from zero (Fieller 1954, J R
        Stat Soc B 16:175); infinite where the second mean may be zero, NaN of a single subject.
        """

        def beyond(ratio: float) -> float:
            """Give how far the weighted sum of a ratio is from its critical value."""
            low, high = self.bounds((1, -ratio), alpha / 2)
            return abs(low + high) / 2 - (high - low) / 2

        low, high = self.bounds((0, 1), alpha / 2)
        if np.isnan(low):
            return nan, nan
        if low <= 0 <= high:
            return -inf, inf
        ratio = float(self.means[0] / self.means[1])
        if beyond(ratio) >= 0:  # nothing varies
            return ratio, ratio
        ends = []
        # at the estimate the sum is zero; each end is bracketed by doubling steps away from it
        for sign in (-1, 1):
            step = 1e-3
            while beyond(ratio + sign * step) < 0:
                step *= 2
            ends.append(scipy.optimize.brentq(beyond, ratio, ratio + sign * step))
        return ends[0], ends[1]

    def spread(self, weights: Weights, repeats: float | None = None) -> float:
        """Give the SD of weighted sums between subjects, with as many recordings, or a number."""
        return deviation(self.between + self.within / (repeats or self.repeats), weights)

    @property
    def difference(self) -> float:
        """The first mean minus the second."""
        return float(self.means[0] - self.means[1])

    @property
    def t(self) -> float:
        """The difference by its error, corrected for few subjects; NaN without an error."""
        error = deviation(self.covariance, DIFFERENCE)
        return self.difference / error if error > 0 else nan

    @property
    def p(self) -> float:
        """The probability of a larger |t| if there is no difference."""
        return float(2 * scipy.stats.t.sf(abs(self.t), self.df()))


def fit_mixed(values: Array, fixed: Array, effects: Sequence[NDArray[Any]]) -> MixedModel:
    """Fit a linear mixed model by restricted maximum likelihood.

    Parameters
    ----------
    values
        What is measured, (N,).
    fixed
        Columns of the fixed effects, (N, P).
    effects
        Which level of each random effect a value has, (N,) each. The first are the subjects;
        levels of the others lie within a subject.

    Returns
    -------
    MixedModel
        Where a variance is zero, the model without its effect.

    Raises
    ------
    ValueError
        If a fixed effect is not determined, nothing is left for the error, or no optimum is found.

    Notes
    -----
    The criterion of Laird and Ware 1982 (Biometrics 38:963), profiled over the fixed effects and
    the variance of the error, is minimised over the ratio of each effect's variance to that of the
    error, from several starts. The ratio may be zero: there, the criterion has to rise. Correction
    for few subjects: Kenward and Roger 1997, Biometrics 53:983, with the expected information; the
    covariance is linear in the variances, so its second derivatives vanish.

    Examples
    --------
    >>> subject = np.array([0, 0, 1, 1, 2, 2])
    >>> model = fit_mixed(np.array([1.0, 2, 4, 6, 8, 9]), np.ones((6, 1)), [subject])
    >>> model.coefficients.round(6).tolist()
    [5.0]
    """
    count, columns = fixed.shape
    if np.linalg.matrix_rank(fixed) < columns:
        raise ValueError("a combination of levels has no value")
    rest = values - fixed @ np.linalg.lstsq(fixed, values, rcond=None)[0]
    # a spread of 1e-12 of the largest value is rounding
    if count <= columns or not np.ptp(rest) > 1e-12 * np.abs(values).max():
        raise ValueError("nothing varies within the cells")
    y, x, alike = _by_subject(values, fixed, [*effects, np.arange(count)])  # the last is the error
    # an effect counts if a level of it repeats, and no effect before it has the same levels
    counting = [
        k
        for k, same in enumerate(alike)
        if same.sum() > count and not any(np.array_equal(same, alike[j]) for j in range(k))
    ]
    ratios = _likeliest(y, x, alike[counting], count)
    # at a variance of zero the model is that without the effect
    above_zero = ratios > ZERO_RATIO
    kept = [*np.array(counting, int)[above_zero], len(effects)]
    model = _corrected(np.append(ratios[above_zero], 1.0), y, x, alike[kept], count)
    variances = np.zeros(len(effects) + 1)
    variances[kept] = model.variances
    return replace(model, variances=variances)


def _by_subject(
    values: Array, fixed: Array, effects: Sequence[NDArray[Any]]
) -> tuple[Array, Array, Array]:
    """Give a block per subject, filled with zeros where a subject has fewer values than others.

    Values (S, M, 1), fixed effects (S, M, P), and for each random effect 1 where two values have
    the same level, else 0, (K, S, M, M).
    """
    # values of different subjects are independent: a covariance matrix for each is enough
    subject = np.unique(effects[0], return_inverse=True)[1]
    order = np.argsort(subject, kind="stable")
    counts = np.bincount(subject)
    block = subject[order]
    row = np.arange(len(values)) - np.repeat(np.cumsum(counts) - counts, counts)
    shape = len(counts), counts.max()
    y, x = np.zeros((*shape, 1)), np.zeros((*shape, fixed.shape[1]))
    y[block, row, 0], x[block, row] = values[order], fixed[order]
    # -1 where a block is filled up: alike to nothing
    level = np.full((len(effects), *shape), -1)
    for k, effect in enumerate(effects):
        level[k, block, row] = np.unique(effect, return_inverse=True)[1][order]
    alike = (level[..., :, None] == level[..., None, :]) & (level[..., None] >= 0)
    return y, x, alike.astype(float)


def _inverse(ratios: Array, alike: Array) -> Array:
    """Give the inverse covariance of the values by the error's variance, (S, M, M)."""
    covariance = np.eye(alike.shape[2]) + np.tensordot(ratios, alike, axes=1)
    return np.asarray(np.linalg.inv(covariance), float)


def _criterion(logs: Array, y: Array, x: Array, alike: Array, count: int) -> tuple[float, Array]:
    """Give -2 log of the restricted likelihood but for a constant, and its slopes, (K,).

    By the logarithms of 1 + ratio, (K,), by which it is curved alike near zero and far from it.
    """
    # generalised least squares of the fixed effects with these ratios
    weight = _inverse(np.expm1(logs), alike)
    weighted_x = weight @ x
    precision = np.einsum("smp,smq->pq", x, weighted_x)
    rest = y - x @ np.linalg.solve(precision, np.einsum("smp,smo->po", weighted_x, y))
    weighted = weight @ rest
    # (n - p) log of the squares, log |X'WX| and log |V| = -log |W|
    squares, freedom = float(np.sum(rest * weighted)), count - x.shape[2]
    value = freedom * np.log(squares) + np.linalg.slogdet(precision)[1]
    value -= np.linalg.slogdet(weight)[1].sum()

    # derivatives by the ratios: of the squares, of the determinants of fixed effects and values
    of_squares = np.sum(weighted * (alike @ weighted), axis=(1, 2, 3))
    of_fixed = np.einsum("smp,ksmq->kpq", weighted_x, alike @ weighted_x)
    slopes = np.sum(weight * alike, axis=(1, 2, 3)) - freedom / squares * of_squares
    slopes -= np.trace(np.linalg.solve(precision, of_fixed), axis1=1, axis2=2)
    return float(value), slopes * np.exp(logs)  # by the logarithms


def _likeliest(y: Array, x: Array, alike: Array, count: int) -> Array:
    """Find the ratios at the minimum of the criterion, which may be zero, (K,)."""

    def criterion(logs: Array) -> tuple[float, Array]:
        """Give the criterion and its slopes."""
        return _criterion(logs, y, x, alike, count)

    most = np.log1p(10 * MAX_RATIO)
    # the criterion can have several minima: the best three starts of a coarse grid
    starts = [np.log1p(r) for r in product((0.0, 0.5, 5.0, 200.0), repeat=len(alike))]
    starts.sort(key=lambda logs: criterion(logs)[0])
    ends = [
        scipy.optimize.minimize(
            criterion,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(0, most)] * len(alike),
            options={"ftol": 0.0, "gtol": MAX_SLOPE / 10},
        )
        for start in starts[:3]
    ]
    best = np.asarray(min(ends, key=lambda end: end.fun).x)
    # the search ends where rounding hides a fall of the criterion; its slopes are more exact
    inside = best > ZERO_RATIO

    def with_inside(logs: Array) -> Array:
        """Give the logarithms, with others of the variances that are not zero."""
        result = best.copy()
        result[inside] = np.clip(logs, 0, most)
        return result

    def slopes_inside(logs: Array) -> Array:
        """Give the slopes by them."""
        return criterion(with_inside(logs))[1][inside]

    if inside.any():
        best = with_inside(scipy.optimize.root(slopes_inside, best[inside]).x)
    if np.any(best > np.log1p(MAX_RATIO)):
        raise ValueError("the recordings of subjects hardly vary within the cells")
    slopes = criterion(best)[1]
    # inside its bounds the criterion is level; at a variance of zero it may rise
    if np.any(np.where(best > ZERO_RATIO, np.abs(slopes), -slopes) > MAX_SLOPE):
        raise ValueError("the likeliest variances were not found")
    return np.expm1(best)


def _corrected(ratios: Array, y: Array, x: Array, alike: Array, count: int) -> MixedModel:
    """Give the model with given variances by that of the error, the last, and its correction."""
    # generalised least squares, with the error's variance from what it leaves
    weight = _inverse(ratios[:-1], alike[:-1])
    precision = np.einsum("smp,smq->pq", x, weight @ x)
    coefficients = np.linalg.solve(precision, np.einsum("smp,smo->p", weight @ x, y))
    rest = y - (x @ coefficients)[..., None]
    error = float(np.sum(rest * (weight @ rest))) / (count - x.shape[2])
    covariance = error * np.asarray(np.linalg.inv(precision), float)

    # how the precision of the fixed effects changes with each variance, to first and second order
    variances, weight = error * ratios, weight / error
    weighted_x = weight @ x
    changed_x = alike @ weighted_x
    first = np.einsum("smp,ksmq->kpq", weighted_x, changed_x)
    second = np.einsum("jsmp,ksmq->jkpq", changed_x, weight @ changed_x)
    # expected information of the variances: of all values, minus that of the fixed effects
    changed, products = alike @ weight, covariance @ first
    information = np.einsum("jsmn,ksnm->jk", changed, changed) / 2
    information += np.einsum("jpq,kqp->jk", products, products) / 2
    information -= np.trace(covariance @ second, axis1=2, axis2=3)
    both = np.outer(variances, variances)  # without it, large ones would hide the small ones
    uncertainty = both * np.linalg.pinv(information * both)

    # the fixed effects vary more than by their covariance, as the variances are estimates
    excess = second - first[:, None] @ covariance @ first
    correction = covariance @ np.einsum("jk,jkpq->pq", uncertainty, excess) @ covariance
    return MixedModel(
        coefficients=coefficients,
        covariance=covariance,
        variances=variances,
        adjusted=covariance + 2 * correction,
        sensitivity=covariance @ first @ covariance,
        uncertainty=uncertainty,
    )


def compare_cells(values: pd.DataFrame, first: str, second: str) -> CellComparison:
    """Compare two cells by a mixed model of all recordings that there are.

    Parameters
    ----------
    values
        A row per recording and cell: subject, recording (equal where one recording is in both
        cells), cell, value.
    first, second
        The cells.

    Returns
    -------
    CellComparison
        ``first - second``.

    Raises
    ------
    ValueError
        If fewer than two subjects are in a cell, or the recordings of a cell do not vary.

    Notes
    -----
    Estimate and error are by restricted maximum likelihood, interval and p by Kenward and Roger
    (`fit_mixed`). Where no cell is missing and nothing is repeated, they are those of the paired
    t-test, unless subjects vary less than their differences.
    """
    cells = values[values["cell"].isin((first, second)) & np.isfinite(values["value"])]
    people = cells.groupby("cell")["subject"].nunique()
    if len(people) < 2 or people.min() < MIN_SUBJECTS:
        raise ValueError(f"needs at least {MIN_SUBJECTS} subjects in each of both cells")
    effects = random_effects(cells)
    means = np.column_stack([cells["cell"] == name for name in (first, second)]).astype(float)
    model = fit_mixed(cells["value"].to_numpy(float), means, effects)
    # what cells have in common between recordings and within one, and what each has alone
    of_subject, of_cell, of_recording, error = model.variances
    both, apart = np.ones((2, 2)), np.eye(2)  # what is in both cells, and what is in one
    counts = cells.groupby(["subject", "cell"]).size()
    return CellComparison(
        means=model.coefficients,
        covariance=model.adjusted,
        between=of_subject * both + of_cell * apart,
        within=of_recording * both + error * apart,
        subjects=len(np.unique(effects[0])),
        recordings=len(np.unique(effects[2])),
        repeats=float(1 / (1 / counts).mean()),  # harmonic: errors of means go with 1 / count
        model=model,
    )


def judging_comparison(values: pd.DataFrame, first: str, second: str) -> CellComparison:
    """Compare two cells as their difference is judged.

    By pairs where every subject has one recording of each cell, else by a mixed model.
    Parameters and errors are those of `compare_cells`; pairs are given of a single subject too.
    """
    cells = values[values["cell"].isin((first, second)) & np.isfinite(values["value"])]
    if cells.empty or is_incomplete_or_repeated(cells, (first, second)):
        return compare_cells(cells, first, second)
    # pairs of single recordings: the covariance over subjects holds all that varies
    table = cells.pivot(index="subject", columns="cell", values="value")
    pairs = table[[first, second]].to_numpy(float)
    spread = np.full((2, 2), nan) if len(pairs) < MIN_SUBJECTS else np.cov(pairs.T)
    return CellComparison(
        means=pairs.mean(axis=0),
        covariance=spread / len(pairs),
        between=spread,
        within=np.zeros((2, 2)),
        subjects=len(pairs),
        recordings=len(np.unique(random_effects(cells)[2])),
    )


def recording_values(recordings: pd.DataFrame, axis: str, design: Design) -> pd.DataFrame:
    """Give the values of one residual as `compare_cells` takes them.

    Of a long table with a row per recording, compensation and axis: subject, condition, recording,
    compensated, axis, rms.
    """
    rows = recordings[
        (recordings["axis"] == axis)
        & recordings["condition"].isin(design.conditions)
        & recordings["compensated"].isin(design.variants)
    ]
    return rows.assign(
        recording=rows["condition"] + " " + rows["recording"].astype(str),
        cell=design.cells_of(rows),
        value=rows["rms"].astype(float),
    )


def is_incomplete_or_repeated(values: pd.DataFrame, cells: Sequence[str]) -> bool:
    """Whether a subject lacks one of some cells, or has several recordings of it.

    Otherwise a mixed model of two cells is the paired t-test.
    """
    counts = values.groupby(["subject", "cell"]).size().unstack(fill_value=0)
    counts = counts.reindex(columns=[*cells], fill_value=0)
    return bool((counts != 1).any(axis=None))


def effects_of_factors(values: pd.DataFrame, design: Design) -> Iterator[tuple[str, FTest]]:
    """Test the factors and their interactions by all recordings, in one model of all cells.

    Of the design's groups where the values have a column ``group``.

    Yields
    ------
    effect, FTest
        Type III, by Kenward and Roger.

    Raises
    ------
    ValueError
        If a combination of levels has no value, or the values do not vary.
    """
    levels = {COMPENSATION: "compensated", design.factor: "condition"}
    factors = {name: levels[name] for name in design.factors}
    rows = values[np.isfinite(values["value"])]
    # subjects of no stated group do not enter
    if design.group is not None and "group" in values:
        factors[design.group] = "group"
        rows = rows.dropna(subset="group")
    # effect coding: each term is tested for the mean over the levels of the others
    columns = {name: effect_coded(name, rows[c].to_numpy(str)) for name, c in factors.items()}
    terms = [t for size in range(len(factors) + 1) for t in combinations(factors, size)]
    blocks = [
        reduce(_products, [columns[name] for name in term], np.ones((len(rows), 1)))
        for term in terms
    ]
    model = fit_mixed(rows["value"].to_numpy(float), np.hstack(blocks), random_effects(rows))
    # each term is tested by its own columns of coefficients, the intercept first
    ends = np.cumsum([block.shape[1] for block in blocks])
    for term, start, end in zip(terms[1:], ends, ends[1:], strict=False):
        yield ":".join(term), model.test(np.eye(ends[-1])[start:end])


def _products(block: Array, factor: Array) -> Array:
    """Multiply each column of a block by each of a factor, (N, columns)."""
    return (block[:, :, None] * factor[:, None, :]).reshape(len(block), -1)


def random_effects(values: pd.DataFrame) -> list[NDArray[Any]]:
    """Give the subject, the subject's cell and the subject's recording of each value."""
    subject = values["subject"].to_numpy(str)
    within = (np.char.add(subject, "\0" + values[n].to_numpy(str)) for n in ("cell", "recording"))
    return [subject, *within]
