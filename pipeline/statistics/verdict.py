"""Is each residual at the level of its reference? A non-inferiority test with intervals."""

from dataclasses import dataclass
from math import inf, isnan, nan
from typing import Literal

import numpy as np
import pandas as pd
from scipy import stats

from hbm.spatial import Array
from pipeline.statistics.design import CONFIDENCE, EXPERIMENT_3, MIN_SUBJECTS, Design
from pipeline.statistics.measurement import (
    Covariances,
    deviation,
    half_interval,
    mean_covariance,
)
from pipeline.statistics.sample_size import subjects_needed

Answer = Literal["at baseline", "above", "inconclusive", "no interval", "no data"]


@dataclass(frozen=True, slots=True)
class MeasurementInterval:
    """What errors of measurement of usual size make of a difference from the reference.

    Attributes
    ----------
    low, high
        The 95 % interval of ``ic - baseline`` by them.
    contains_margin
        Whether that of ``ic - 1.2 baseline``, with the margin of the design, contains zero.
    """

    low: float
    high: float
    contains_margin: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a residual compares with its reference, "baseline" in experiment 3.

    With compensation, if there is any; the reference is without.

    Attributes
    ----------
    axis, unit, condition
        The residual and the condition.
    answer
        "at baseline": the residual is shown to exceed the baseline by at most the margin; "above":
        it is shown to be above the baseline, and not within the margin; "inconclusive": neither is
        shown; "no interval": a single subject; "no data": no subject has both cells.
    no_ic, ic, baseline
        Mean RMS without and with compensation, and of the baseline without, over the `n` subjects
        who have both cells of the comparison; ``no_ic`` is NaN where one of them lacks it, and
        ``ic`` is the residual as measured where there is no compensation.
    difference, low, high
        ``ic - baseline`` with its simultaneous 95 % confidence interval over the planned pairs.
    low_percent, high_percent
        The same interval of ``ic / baseline - 1`` [%]; infinite where the baseline is not shown to
        differ from zero.
    sd
        Standard deviation of the differences between subjects.
    n
        Subjects.
    measurement
        How sure the difference is of the measurement itself; None where that is not known.
    needed, needed_as_observed
        Subjects who would show "at baseline" with 80 % power, if the true difference is zero and
        if it is the one observed; None where it cannot be shown or is not known.
    """

    axis: str
    unit: str
    condition: str
    answer: Answer
    no_ic: float = nan
    ic: float = nan
    baseline: float = nan
    difference: float = nan
    low: float = nan
    high: float = nan
    low_percent: float = nan
    high_percent: float = nan
    sd: float = nan
    n: int = 0
    measurement: MeasurementInterval | None = None
    needed: int | None = None
    needed_as_observed: int | None = None

    @property
    def lacks_subjects(self) -> bool:
        """Whether more subjects are needed than there were, if the true difference is zero."""
        return self.needed is None or self.needed > self.n

    def percent(self, value: float) -> float:
        """Give a difference in percent of the baseline."""
        return 100 * value / self.baseline if self.baseline > 0 else nan


def verdicts(
    residuals: pd.DataFrame,
    statistics: pd.DataFrame,
    design: Design = EXPERIMENT_3,
    measurement: Covariances | None = None,
) -> list[Verdict]:
    """Compare every residual in every condition with the reference.

    Parameters
    ----------
    residuals
        Long table of RMS residuals, as `pipeline.statistics.comparison.statistics` takes it.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for it.
    design
        The design that it was computed for.
    measurement
        Covariances of the residuals by errors of measurement, if they are known.

    Returns
    -------
    list of Verdict
        Residual by residual, for every condition whose comparison with the reference is planned;
        with compensation, for the reference too (does compensation increase it?).

    Notes
    -----
    The interval is Student's t of the paired differences, at 1 − 0.05/m for m planned pairs: it
    excludes zero exactly where the Bonferroni-corrected paired t-test is significant. That of the
    ratio is Fieller's (1954) at the same level, since the baseline is an estimate too. "at
    baseline" is a test of non-inferiority with the design's margin (one side of Schuirmann 1987),
    by default the 20 % of bioequivalence, as a residual below the baseline is no error: the paired
    t-test of ``ic - 1.2 baseline`` against zero. A difference that is not significant is no
    evidence for it. No answer depends on the intervals of measurement.
    """
    found = []
    reference = (False, design.reference)
    for axis, unit in residuals[["axis", "unit"]].drop_duplicates().itertuples(index=False):
        own = residuals[residuals["axis"] == axis]
        rms = own.pivot(index="subject", columns=["compensated", "condition"], values="rms")
        cells = pd.MultiIndex.from_product([[False, True], design.conditions])
        rms = rms.reindex(columns=cells)
        tests = statistics[statistics["axis"] == axis]
        for condition in judged_conditions(design):
            judged = (design.compensated, condition)
            both = rms.dropna(subset=[judged, reference])
            if both.empty:
                found.append(Verdict(axis, unit, condition, "no data"))
                continue
            baseline = float(both[reference].mean())
            differences = both[judged] - both[reference]
            effect = f"{design.judged(condition)} - {design.reference_cell}"
            low, high = _simultaneous_interval(tests, effect, len(design.pairs))
            margin, difference = design.margin * baseline, float(differences.mean())
            alpha = (1 - CONFIDENCE) / len(design.pairs) / 2
            excess = both[judged] - (1 + design.margin) * both[reference]
            within = _upper_bound(excess.to_numpy(), alpha) <= 0
            needed = [
                None
                if len(both) < MIN_SUBJECTS
                else subjects_needed(float(excess.std()), margin - true, alpha)
                for true in (0.0, difference)
            ]
            relative = ratio_interval(both[judged].to_numpy(), both[reference].to_numpy(), alpha)
            low_percent, high_percent = (100 * (bound - 1) for bound in relative)
            uncertain = None
            if measurement is not None:
                compared = (condition, design.compensated), (design.reference, False)
                covariance = mean_covariance(measurement[axis], both.index, compared)
                half, of_excess = (
                    half_interval(deviation(covariance, (1.0, -share)))
                    for share in (1.0, 1 + design.margin)
                )
                uncertain = MeasurementInterval(
                    difference - half, difference + half, abs(difference - margin) < of_excess
                )
            found.append(
                Verdict(
                    *(axis, unit, condition),
                    answer=_answer(low, within=within),
                    no_ic=float(both[False, condition].mean(skipna=False)),
                    ic=float(both[judged].mean()),
                    baseline=baseline,
                    difference=difference,
                    low=low,
                    high=high,
                    low_percent=low_percent,
                    high_percent=high_percent,
                    sd=float(differences.std()),
                    n=len(both),
                    measurement=uncertain,
                    needed=needed[0],
                    needed_as_observed=needed[1],
                )
            )
    return found


def judged_conditions(design: Design) -> list[str]:
    """Give the conditions whose comparison with the reference is planned."""
    return [
        c for c in design.conditions if (design.judged(c), design.reference_cell) in design.pairs
    ]


def _simultaneous_interval(tests: pd.DataFrame, effect: str, pairs: int) -> tuple[float, float]:
    """Widen the interval of a mean difference to hold for all planned pairs simultaneously."""
    of_mean = (tests["effect"] == effect) & (tests["effect_size_name"] == "mean difference")
    row = tests[of_mean]
    if row.empty:
        return nan, nan
    mean, low, n = (float(row[name].iloc[0]) for name in ("effect_size", "ci_low", "n"))
    alpha = 1 - CONFIDENCE
    corrected = stats.t.isf(alpha / pairs / 2, n - 1)
    half = float(corrected / stats.t.isf(alpha / 2, n - 1) * (mean - low))
    return mean - half, mean + half


def ratio_interval(first: Array, second: Array, alpha: float) -> tuple[float, float]:
    """Give Fieller's confidence interval of the ratio of two paired means.

    Parameters
    ----------
    first, second
        Values of the same subjects, (N,).
    alpha
        Probability beyond either bound.

    Returns
    -------
    tuple of float
        Lower and upper bound: the ratios r for which a paired t-test of ``first - r second`` is
        not significant at ``alpha``, one-sided. Infinite where ``second`` is not shown to differ
        from zero, NaN for a single subject.

    Notes
    -----
    Fieller 1954, J R Stat Soc B 16:175.

    Examples
    --------
    >>> low, high = ratio_interval(np.array([11.0, 12, 13]), np.array([10.0, 11, 12]), 0.025)
    >>> print(f"{low:.3f} {high:.3f}")
    1.074 1.117
    """
    if len(first) < MIN_SUBJECTS:
        return nan, nan
    mean = np.array([first.mean(), second.mean()])
    error = stats.t.isf(alpha, len(first) - 1) ** 2 * np.cov(first, second) / len(first)
    squared, half, constant = (
        mean[1] ** 2 - error[1, 1],
        mean[0] * mean[1] - error[0, 1],
        mean[0] ** 2 - error[0, 0],
    )
    if squared <= 0:
        return -inf, inf
    root = np.sqrt(max(half**2 - squared * constant, 0.0))
    return float((half - root) / squared), float((half + root) / squared)


def _upper_bound(values: Array, alpha: float) -> float:
    """Give the one-sided upper confidence bound of a mean; NaN for a single value."""
    n = len(values)
    if n < MIN_SUBJECTS:
        return nan
    return float(values.mean() + stats.t.isf(alpha, n - 1) * values.std(ddof=1) / np.sqrt(n))


def _answer(low: float, *, within: bool) -> Answer:
    if isnan(low):
        return "no interval"
    if within:
        return "at baseline"
    return "above" if low > 0 else "inconclusive"
