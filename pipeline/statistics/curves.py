"""Where curves over the gait cycle differ: one linear model per instant, tested by sign flips."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, Final

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from hbm.numbers import read_numbers
from hbm.signals.samples import stretches
from hbm.spatial import Array, Mask
from pipeline.statistics.design import ALPHA, CONFIDENCE
from pipeline.statistics.mixed import random_effects

LIMITS: Final = read_numbers("pipeline.statistics", "thresholds.toml", "curves")
ROUNDING: Final = 1e-9
"""Relative; smaller differences are none."""


@dataclass(frozen=True, slots=True)
class CurveDifference:
    """A part of the gait cycle in which two curves differ.

    Attributes
    ----------
    start, stop
        First and last percent of the part.
    p
        Smallest p in it, corrected for all instants.
    """

    start: int
    stop: int
    p: float


@dataclass(frozen=True, slots=True)
class CurveComparison:
    """The difference of two mean curves, and how sure it is.

    Attributes
    ----------
    difference
        First minus second, (101,) in the unit of the curves; NaN where too few are known.
    low, high
        Simultaneous 95 % band, (101,): in 95 % of studies, it holds the difference at all instants.
    p
        Of each instant, corrected for all instants, (101,); 1 where nothing is known.
    in_groups
        Subjects who entered; of groups, those of the first and of the second.
    recordings
        That entered.
    """

    difference: Array
    low: Array
    high: Array
    p: Array
    in_groups: tuple[int, ...]
    recordings: int

    @property
    def subjects(self) -> int:
        """All who entered."""
        return sum(self.in_groups)

    @property
    def parts(self) -> tuple[CurveDifference, ...]:
        """Parts of the gait cycle where p is below 0.05."""
        return tuple(
            CurveDifference(int(start), int(stop) - 1, float(self.p[start:stop].min()))
            for start, stop in stretches(self.p < ALPHA)
        )


ComparedCurves = Mapping[tuple[str, str], CurveComparison]
"""Curve, such as Fx or hip_flexion_moment, and what is compared -> comparison."""


def compare_conditions(
    curves: Array, rows: pd.DataFrame, between: pd.DataFrame | None = None
) -> CurveComparison | None:
    """Compare the mean curves of two conditions over every recording that there is.

    Parameters
    ----------
    curves
        Of each recording and condition, (R, 101); NaN where unknown.
    rows
        Of each curve: subject, recording (equal where one recording is in both conditions, of all
        subjects or of none) and cell, of which there are two. The first to appear is compared with
        the other.
    between
        Index subject; columns are groups (text) and covariates (numbers) by which the subjects'
        means may differ. Where every subject has both conditions they change nothing. A subject of
        whom one is unknown has a mean of its own.

    Returns
    -------
    CurveComparison or None
        None with fewer than six subjects, or fewer than four with both conditions; or where no
        curve varies.

    Notes
    -----
    At every instant, a curve is the mean of its condition, plus effects of group and covariates, an
    error of the subject and one of the curve. Weights are by generalised least squares with one
    working covariance for all instants (subject, condition within it, recording, error, by
    restricted maximum likelihood), so several recordings of a subject count as much as they tell.

    Inference flips the signs of all residuals of a subject together, which keeps whatever
    covariance they have: subjects are the exchangeability blocks (whole-block sign flips, Winkler
    et al. 2014, NeuroImage 92:381). Residuals are of the model without a difference (Freedman and
    Lane 1983). For each flip the model is fitted again, and the difference is studentised by the
    subjects' scores, each divided by one minus its leverage (Bell and McCaffrey 2002), which holds
    where subjects vary differently. p of an instant is the share of the flips whose largest |t|
    over the cycle reaches its |t|. Where each subject has one curve of each condition, this is the
    exact test of paired differences (Nichols and Holmes 2002, Hum Brain Mapp 15:1).

    The band is the difference ± its error times the 95 % quantile of the largest |t| of sign flips
    of the residuals of the model with a difference, divided by the root of one minus the subject's
    leverage, so that they vary as errors do.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> curves = 0.1 * rng.normal(size=(18, 101))
    >>> curves[:9, 40:61] += 1.0  # boots
    >>> rows = pd.DataFrame({"subject": [*"abcdefghi"] * 2, "recording": range(18)})
    >>> rows["cell"] = ["boots"] * 9 + ["barefoot"] * 9
    >>> compared = compare_conditions(curves, rows)
    >>> [(part.start, part.stop, round(part.p, 3)) for part in compared.parts]
    [(40, 60, 0.004)]
    """
    if rows["cell"].nunique() < 2:
        return None
    first = (rows["cell"] == rows["cell"].iloc[0]).to_numpy()
    nuisance = _between(rows["subject"], between)
    # half of the difference to either side of the mean, so that the mean is over both conditions
    sides, everyone = first - 0.5, first | True
    return _compare(curves, rows, sides, nuisance, [everyone], LIMITS.fewest_paired, null=True)


def compare_groups(
    curves: Array, rows: pd.DataFrame, group: "pd.Series[Any]", between: pd.DataFrame | None = None
) -> CurveComparison | None:
    """Compare two groups of subjects: their mean curves, or what two conditions differ by in them.

    Parameters
    ----------
    curves, rows
        As of `compare_conditions`, of one cell or of two.
    group
        Index subject; one of two names, of which the first in the alphabet is subtracted. Subjects
        of neither do not enter.
    between
        Covariates, as of `compare_conditions`. Of one cell, subjects of whom one is unknown do not
        enter.

    Returns
    -------
    CurveComparison or None
        None with fewer than six subjects in a group who have every cell, or where a covariate
        tells the groups apart as well.

    Notes
    -----
    As `compare_conditions`, but p too is by residuals of the model with a difference: it and the
    leverages of subjects allow groups of different size and variance (as Welch's t).
    """
    cells = rows["cell"].unique()
    of_row, complete = rows["subject"].map(group), np.ones(len(rows), bool)
    if len(cells) == 1 and between is not None:
        covariates = between.dropna(axis=1, how="all").reindex(rows["subject"])
        complete = covariates.notna().all(axis=1).to_numpy()
    enters = of_row.notna().to_numpy() & complete
    curves, rows, of_row = curves[enters], rows[enters], of_row[enters]
    second = (of_row == of_row.max()).to_numpy()
    sides, others = second - 0.5, _between(rows["subject"], between)
    if len(cells) == 2:  # the difference between groups of the difference between cells
        cell = (rows["cell"] == cells[0]).to_numpy() - 0.5
        sides, others = sides * cell, np.column_stack([others, sides, cell])
    groups = [second, ~second]
    return _compare(curves, rows, sides, others, groups, LIMITS.fewest_in_group, null=False)


def _between(subjects: "pd.Series[Any]", between: pd.DataFrame | None) -> Array:
    """Give the columns of what differs between subjects, a mean first, (R, Q)."""
    columns = [np.ones(len(subjects))]
    if between is not None and len(between.columns):
        of_rows = between.dropna(axis=1, how="all").reindex(subjects)
        unknown = of_rows.isna().any(axis=1).to_numpy()
        # a subject with a mean of its own tells nothing of groups and covariates
        columns += [(subjects == name).to_numpy(float) for name in subjects[unknown].unique()]
        for _, values in of_rows.items():
            if pd.api.types.is_numeric_dtype(values):  # in any unit
                centred = (values - values.mean()) / (np.ptp(values.dropna()) or 1.0)
                columns.append(centred.fillna(0.0).to_numpy(float))
            else:
                levels = sorted(values.dropna().unique())
                columns += [(values == level).to_numpy(float) for level in levels[1:]]
    return np.column_stack(columns)


def _compare(
    curves: Array,
    rows: pd.DataFrame,
    contrast: Array,
    others: Array,
    groups: Sequence[Mask],
    least: int,
    *,
    null: bool,
) -> CurveComparison | None:
    """Fit and test; in each of the groups, at least so many subjects have every cell."""
    people, subject = np.unique(rows["subject"], return_inverse=True)
    if len(people) < LIMITS.fewest_subjects:
        return None
    cell = np.unique(rows["cell"], return_inverse=True)[1]
    signs, effects = _signs(len(people)), random_effects(rows)
    shape = curves.shape[1]
    difference, error = np.full((2, shape), np.nan)
    largest = np.zeros((2, len(signs)))  # |t| over the cycle, without and with a difference
    is_known, has_entered = np.isfinite(curves), np.zeros(len(rows), bool)
    # instants at which the same curves are known have one model
    for pattern in np.unique(is_known, axis=1).T:
        of = (is_known == pattern[:, None]).all(axis=0)
        shown = curves[np.ix_(pattern, of)]
        counts = np.zeros((len(people), cell.max() + 1), int)
        np.add.at(counts, (subject[pattern], cell[pattern]), 1)
        some, complete = counts.max(axis=1) > 0, counts.min(axis=1) > 0
        with_all = min(complete[np.unique(subject[of_group])].sum() for of_group in groups)
        if some.sum() < LIMITS.fewest_subjects or with_all < least:
            continue
        model = _Model(
            shown,
            np.column_stack([contrast, others])[pattern],
            subject[pattern],
            [effect[pattern] for effect in effects],
            # where all subjects have equally many curves, their weights are equal
            1 if np.ptp(counts[some]) == 0 else 3,
        )
        if not model.separate:
            continue
        has_entered |= pattern
        varies = model.error > ROUNDING * np.abs(shown).max()
        difference[of], error[of] = model.difference, np.where(varies, model.error, np.nan)
        if varies.any():
            # the largest |t| over the cycle corrects for all instants together
            for k, residuals in enumerate((model.without_difference, model.errors)):
                reached = model.largest_t(residuals[:, varies], signs[:, some])
                largest[k] = np.maximum(largest[k], reached)
    if np.isnan(error).all():
        return None
    t, of_band = np.abs(difference) / error, np.sort(largest[1])
    # the observed signs are the first of those without a difference, and reach their own t
    reached = np.sort(largest[0, 1:]) if null else of_band
    beyond = len(reached) - np.searchsorted(reached, np.nan_to_num(t) * (1 - ROUNDING))
    # the observed signs count too, so that p is never zero
    p = np.where(np.isfinite(t), (beyond + 1) / (len(reached) + 1), 1.0)
    half = error * of_band[int(np.ceil(CONFIDENCE * len(of_band))) - 1]
    bands = difference, difference - half, difference + half, p
    in_groups = tuple(len({*subject[has_entered & of_group]}) for of_group in groups)
    return CurveComparison(*bands, in_groups, len({*effects[2][has_entered]}))


class _Model:
    """A linear model of curves, (R, T), whose first column, of (R, P), is the difference."""

    def __init__(
        self,
        curves: Array,
        columns: Array,
        subject: NDArray[Any],
        effects: Iterable[NDArray[Any]],
        rounds: int,
    ) -> None:
        self.curves, self.columns = curves, columns
        blocks = np.unique(subject, return_inverse=True)[1]
        self.of_subject = np.eye(blocks.max() + 1)[:, blocks]
        alike = np.array([of[:, None] == of for of in (*effects, np.arange(len(curves)))], float)
        covariance = np.eye(len(curves))
        for _ in range(rounds):
            # generalised least squares: the coefficients are these weights times the curves
            inverse = np.linalg.inv(covariance)
            self.spread = _inverse(columns.T @ inverse @ columns)
            self.weights = self.spread @ columns.T @ inverse
            self.residuals = curves - columns @ (self.weights @ curves)
            self.covariance = covariance
            # from the residuals the covariance of the next round
            if rounds > 1:
                projection = inverse - inverse @ columns @ self.weights
                covariance = _covariance(inverse @ self.residuals, projection, alike)
        self.difference = self.weights[0] @ curves

    @property
    def separate(self) -> bool:
        """Whether the difference can be told from the effects of the other columns."""
        # weights of an estimable coefficient give its column 1; of two equal columns each takes 0.5
        return abs(float(self.weights[0] @ self.columns[:, 0]) - 1.0) < 1e-6

    def scores_of(self, residuals: Array, k: int = 0) -> Array:
        """Give what each subject adds to a coefficient, (N, T)."""
        return np.asarray(self.of_subject @ (self.weights[k][:, None] * residuals))

    @cached_property
    def scores(self) -> Array:
        """What each subject's residuals would add to the difference, (N, T)."""
        return self.scores_of(self.residuals)

    @cached_property
    def without_difference(self) -> Array:
        """Residuals of the model without its first column, (R, T)."""
        others = self.columns[:, 1:]
        weighted = others.T @ np.linalg.inv(self.covariance)
        fitted = others @ (_inverse(weighted @ others) @ weighted @ self.curves)
        return np.asarray(self.curves - fitted)

    @cached_property
    def inflation(self) -> Array:
        """One by one minus the leverage of each subject, (N,): residuals vary less than errors."""
        # variance of each subject's score by errors, V, and by residuals, V - X (X'V⁻¹X)⁻¹ X'
        weights = self.of_subject * self.weights[0]
        errors = np.einsum("sr,rq,sq->s", weights, self.covariance, weights)
        fitted = self.columns @ self.spread @ self.columns.T
        remaining = errors - np.einsum("sr,rq,sq->s", weights, fitted, weights)
        # a subject who determines a coefficient alone has no residual
        is_alone = remaining <= ROUNDING * errors
        return np.where(is_alone, 0.0, errors / np.where(is_alone, 1.0, remaining))

    @cached_property
    def errors(self) -> Array:
        """Residuals as large as errors, (R, T)."""
        return np.asarray(self.residuals * np.sqrt(self.inflation @ self.of_subject)[:, None])

    @cached_property
    def error(self) -> Array:
        """Standard error of the difference, (T,)."""
        return np.asarray(np.sqrt(self.inflation @ self.scores**2))

    def largest_t(self, residuals: Array, signs: Array) -> Array:
        """Give the largest |t| over all instants of each sign flip, (K,), the model fitted anew."""
        scores, inflation = self.scores_of(residuals), self.inflation[:, None]
        # what a unit of each coefficient adds to each subject's score
        parts = self.of_subject @ (self.weights[0][:, None] * self.columns)
        moving = np.flatnonzero(np.abs(parts).max(axis=0) > ROUNDING * np.abs(parts).max())
        parts = parts[:, moving]
        # coefficients of the columns that move the difference, of each flip: (P, K, T)
        fitted = np.stack([signs @ self.scores_of(residuals, k) for k in moving.tolist()])
        # sum of squares of the scores that remain: signs * scores - parts @ fitted
        squares = np.asarray(self.inflation @ scores**2)
        smallest = ROUNDING * squares
        crossed = np.stack([signs @ (inflation * part[:, None] * scores) for part in parts.T])
        products = np.tensordot(parts.T @ (inflation * parts), fitted, axes=1)
        squares = squares - (fitted * (2 * crossed - products)).sum(axis=0)
        # the difference of a flip is the sum of its scores, its error that of what remains
        t = np.abs(signs @ scores) / np.sqrt(np.maximum(squares, smallest))
        return np.asarray(t.max(axis=1))


def _inverse(products: Array) -> Array:
    """Invert the products of columns, (P, P), of which some may tell the same."""
    # rounding leaves eigenvalues of 1e-14 of the largest, the smallest error of a curve 1e-8
    return np.asarray(np.linalg.pinv(products, 1e-11, hermitian=True))


def _covariance(weighted: Array, projection: Array, alike: Array) -> Array:
    """Give the working covariance of curves by a step of restricted maximum likelihood.

    Of residuals times their inverse covariance, (R, T), scaled to be alike at all instants, and the
    inverse covariance without the fixed effects, (R, R). ``alike`` says of each component which
    curves have it in common: subjects first, each curve by itself last, (K, R, R).
    """
    # by its size at each instant: one working covariance for all
    size = np.sqrt(np.mean(weighted**2, axis=0))
    scaled = weighted[:, size > 0] / size[size > 0]
    if not scaled.size:
        return np.eye(len(projection))
    # expected and observed sums of squares of each component (Patterson and Thompson 1971)
    changed = projection @ alike
    expected = np.einsum("jab,kba->jk", changed, changed)
    observed = np.einsum("rt,krs,st->k", scaled, alike, scaled, optimize=True) / scaled.shape[1]
    # no variance is negative; each curve has an error of its own, else the inverse does not exist
    components = scipy.optimize.nnls(expected, observed)[0]
    components[-1] = max(components[-1], 1e-6 * components.sum())
    return np.asarray(np.tensordot(components, alike, axes=1), float)


def _signs(subjects: int) -> Array:
    """Give sign flips, (K, N), first the observed signs; those of all subjects are as good."""
    # all flips of twelve subjects are 2,048 that differ in |t|; of more, 5,000 are drawn
    if subjects <= 12:
        return np.array([(1.0, *others) for others in product((1.0, -1.0), repeat=subjects - 1)])
    drawn = np.random.default_rng(0).choice((1.0, -1.0), size=(5_000, subjects))
    return np.vstack([np.ones(subjects), drawn[1:]])
