"""Is each residual at the level of its reference? A non-inferiority test, in sentences too."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, isnan, nan
from typing import Final, Literal

import numpy as np
import pandas as pd
import scipy

from hbm.numbers import read_numbers
from hbm.spatial import Array
from hbm.spelling import join_names
from pipeline.statistics.design import CONFIDENCE, EXPERIMENT_3, MIN_SUBJECTS, Design
from pipeline.statistics.measurement import (
    Covariances,
    deviation,
    half_interval,
    mean_covariance,
)
from pipeline.statistics.mixed import (
    DIFFERENCE,
    CellComparison,
    judging_comparison,
    recording_values,
)
from pipeline.statistics.table_3 import number

LIMITS: Final = read_numbers("pipeline.statistics", "thresholds.toml", "plan")
PLANNED_RECORDINGS: Final = (1, 2, 3, 5, 10)
"""Per subject and condition, for which a study is planned."""
Answer = Literal["within margin", "above", "inconclusive", "no interval", "no data"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a residual compares with its reference, "baseline" in experiment 3.

    With compensation, if there is any; the reference is without.

    Attributes
    ----------
    axis, unit, condition
        The residual and the condition.
    answer
        "within margin": the residual is shown to exceed the baseline by at most the margin, or to
        be below it; "above": it is shown to be above the baseline, and not within the margin;
        "inconclusive": neither is shown; "no interval": of a single subject, or of recordings
        that do not vary; "no data": no subject has both cells.
    no_ic
        Mean RMS without compensation; NaN where the model weighs subjects unequally.
    ic, baseline
        Means with compensation, and of the baseline without, by the model that judges; ``ic`` is
        the residual as measured where there is no compensation.
    difference, low, high
        ``ic - baseline`` with its simultaneous 95 % confidence interval over the planned pairs.
    low_percent, high_percent
        The same interval of ``ic / baseline - 1`` [%], by the same model; infinite where the
        baseline is not shown to differ from zero.
    sd
        Standard deviation of the differences between subjects.
    n, paired
        Subjects in the comparison, and those of them who have both cells.
    mixed
        Whether a mixed model of all recordings judges, in place of pairs of single recordings.
    measurement
        The 95 % interval of the difference by errors of measurement of usual size; None where they
        are not known.
    open_margin
        Whether the interval of ``ic - 1.2 baseline`` by them, with the margin of the design,
        contains zero.
    needed, needed_as_observed
        Subjects who would show "within margin" with 80 % power, with as many recordings, if the
        true difference is zero and if it is the one observed; None where it cannot be shown or is
        not known.
    needed_with
        ``needed`` with each of `PLANNED_RECORDINGS` per condition; empty where the study has one.
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
    paired: int = 0
    mixed: bool = False
    measurement: tuple[float, float] | None = None
    open_margin: bool = False
    needed: int | None = None
    needed_as_observed: int | None = None
    needed_with: tuple[int | None, ...] = ()

    def percent(self, value: float) -> float:
        """Give a difference in percent of the baseline."""
        return 100 * value / self.baseline if self.baseline > 0 else nan

    def written_percent(self) -> str:
        """Write the difference in percent of the baseline with the interval that judges it."""
        text = f"{number(self.percent(self.difference), '+z.0f')} %"
        if isnan(self.high_percent):
            return text
        bounds = self.low_percent, self.high_percent
        low, high = (number(bound, "+z.0f") for bound in bounds)
        return f"{text} [{low}, {high}]" if all(map(isfinite, bounds)) else f"{text} [unbounded]"


def verdicts(
    residuals: pd.DataFrame,
    design: Design = EXPERIMENT_3,
    measurement: Covariances | None = None,
    recordings: pd.DataFrame | None = None,
) -> list[Verdict]:
    """Compare every residual in every condition with the reference.

    Parameters
    ----------
    residuals
        Long table of RMS residuals, as `pipeline.statistics.comparison.statistics` takes it.
    design
        What is compared.
    measurement
        Covariances of the residuals by errors of measurement, if they are known.
    recordings
        The same long table with a row per recording: where a subject lacks a cell or has several
        recordings of one, all numbers of its comparison are those of a mixed model. None compares
        the subjects who have both cells.

    Returns
    -------
    list of Verdict
        Residual by residual, for every condition whose comparison with the reference is planned;
        with compensation, for the reference too (does compensation increase it?).

    Notes
    -----
    One model gives all numbers of a comparison (`pipeline.statistics.mixed.judging_comparison`).
    Its interval, at 1 − 0.05/m for m planned pairs, excludes zero exactly where the
    Bonferroni-corrected t-test is significant. That of the ratio is Fieller's (1954) at the same
    level, since the baseline is an estimate too. "within margin" is a test of non-inferiority
    with the design's margin (one side of Schuirmann 1987), by default the 20 % of bioequivalence,
    as a residual below the baseline is no error: the t-test of ``ic - 1.2 baseline`` against zero,
    of a baseline that is shown to differ from zero, as no ratio to others has a bounded interval.
    A difference that is not significant is no evidence for it. No answer depends on the intervals
    of measurement.
    """
    of_recordings = residuals.assign(recording="") if recordings is None else recordings
    judged = []
    for axis, unit in residuals[["axis", "unit"]].drop_duplicates().itertuples(index=False):
        of_axis = residuals[residuals["axis"] == axis]
        rms = of_axis.pivot(index="subject", columns=["compensated", "condition"], values="rms")
        cells = pd.MultiIndex.from_product([[False, True], design.conditions])
        values = recording_values(of_recordings, axis, design)
        for condition in judged_conditions(design):
            pair = (design.compensated, condition), (False, design.reference)
            both = rms.reindex(columns=cells).dropna(subset=[*pair])
            names = design.judged(condition), design.reference_cell
            # without single recordings a mixed model has nothing to add to subjects with both cells
            used = values if recordings is not None else values[values["subject"].isin(both.index)]
            verdict = Verdict(axis, unit, condition, "no data", paired=len(both))
            if both.empty:
                judged.append(verdict)
                continue
            try:
                verdict = _verdict(verdict, judging_comparison(used, *names), design)
                verdict = replace(verdict, no_ic=_without_compensation(used, verdict, design))
            except ValueError:
                no_ic = float(both[False, condition].mean(skipna=False))
                ic, baseline = (float(both[cell].mean()) for cell in pair)
                verdict = replace(
                    verdict,
                    answer="no interval",
                    n=len(both),
                    no_ic=no_ic,
                    ic=ic,
                    baseline=baseline,
                    difference=ic - baseline,
                )
            if measurement is not None:
                of_pair = (condition, design.compensated), (design.reference, False)
                covariance = mean_covariance(measurement[axis], both.index, of_pair)
                # of the difference, and of how far the residual exceeds the margin
                half, of_excess = (
                    half_interval(deviation(covariance, (1.0, -factor)))
                    for factor in (1.0, 1 + design.margin)
                )
                beyond = verdict.difference - design.margin * verdict.baseline
                verdict = replace(
                    verdict,
                    measurement=(verdict.difference - half, verdict.difference + half),
                    open_margin=abs(beyond) < of_excess,
                )
            judged.append(verdict)
    return judged


def _without_compensation(values: pd.DataFrame, verdict: Verdict, design: Design) -> float:
    """Give the mean without compensation that weighs recordings as the mean with it; else NaN."""
    cells = design.judged(verdict.condition), design.cell(verdict.condition, False)
    judged, measured = (values[values["cell"] == cell] for cell in cells)
    with_it, without = (rows.groupby("subject")["value"].mean() for rows in (judged, measured))
    # a mixed model of unequal numbers of recordings, or of missing cells, weighs subjects unequally
    is_alike = len(judged) == len(measured) and np.isclose(with_it.mean(), verdict.ic, rtol=1e-6)
    return float(without.mean()) if is_alike else nan


def _verdict(unjudged: Verdict, compared: CellComparison, design: Design) -> Verdict:
    """Judge a comparison of a residual with its reference."""
    # Bonferroni over the planned pairs
    alpha = (1 - CONFIDENCE) / max(len(design.pairs), 1)
    most = 1 + design.margin
    baseline, difference = float(compared.means[1]), compared.difference
    low, high = compared.interval(alpha)
    low_ratio, high_ratio = compared.ratio_interval(alpha)

    def needed(true_difference: float, recordings: float | None = None) -> int | None:
        """Give the subjects who would show that the residual is within the margin."""
        if compared.subjects < MIN_SUBJECTS:
            return None
        # the test is of ic - (1 + margin) baseline below zero, one side of the interval
        room = design.margin * baseline - true_difference
        return subjects_needed(compared.spread((1.0, -most), recordings), room, alpha / 2)

    return replace(
        unjudged,
        answer=_answer(low, within=high_ratio <= most),
        ic=float(compared.means[0]),
        baseline=baseline,
        difference=difference,
        low=low,
        high=high,
        low_percent=100 * (low_ratio - 1),
        high_percent=100 * (high_ratio - 1),
        sd=compared.spread(DIFFERENCE),
        n=compared.subjects,
        mixed=compared.model is not None,
        needed=needed(0.0),
        needed_as_observed=needed(difference),
        needed_with=tuple(needed(0.0, count) for count in PLANNED_RECORDINGS)
        if compared.repeats > 1
        else (),
    )


def judged_conditions(design: Design) -> list[str]:
    """Give the conditions whose comparison with the reference is planned."""
    return [
        c for c in design.conditions if (design.judged(c), design.reference_cell) in design.pairs
    ]


def _answer(low: float, *, within: bool) -> Answer:
    """Give the answer, by the lower bound of the difference."""
    if isnan(low):
        return "no interval"
    if within:
        return "within margin"
    return "above" if low > 0 else "inconclusive"


def noninferiority_power(n: Array, sd: float, room: float, alpha: float) -> Array:
    """Give the probability that n subjects show a mean difference to be within the margin.

    Parameters
    ----------
    n
        Subjects, at least 2, (N,).
    sd
        Standard deviation of the paired differences between subjects.
    room
        Margin minus true mean difference, in the unit of `sd`.
    alpha
        Level of the one-sided test.

    Returns
    -------
    Array
        (N,) power of the one-sided paired t-test, from the noncentral t distribution.

    Examples
    --------
    >>> print(f"{noninferiority_power(np.array([9]), sd=1.0, room=1.0, alpha=0.025)[0]:.3f}")
    0.748
    """
    # the power is 1 long before a noncentrality of 1,000, from which on SciPy gives NaN
    with np.errstate(divide="ignore", over="ignore"):  # subjects who all agree
        noncentrality = np.minimum(np.divide(room, sd) * np.sqrt(n), 1e3)
    return np.asarray(scipy.stats.nct.sf(scipy.stats.t.isf(alpha, n - 1), n - 1, noncentrality))


def subjects_needed(sd: float, room: float, alpha: float) -> int | None:
    """Give the smallest number of subjects that has 80 % power; None if even 1000 have less.

    Parameters are those of `noninferiority_power`.

    Notes
    -----
    The critical value and the noncentrality both are functions of n (Julious 2010, section 5.3).
    The margin is taken as known, though it is a share of an estimated reference.

    Examples
    --------
    >>> subjects_needed(sd=1.0, room=1.0, alpha=0.025)
    10
    """
    if room <= 0:
        return None
    # power rises with the number of subjects: the first that is enough
    n = np.arange(2.0, LIMITS.most_subjects + 1)
    is_enough = noninferiority_power(n, sd, room, alpha) >= LIMITS.power
    return int(n[is_enough.argmax()]) if is_enough.any() else None


def headlines(verdicts: Sequence[Verdict], design: Design = EXPERIMENT_3) -> tuple[str, ...]:
    """State the verdicts of a study for a paper: a sentence per condition, each with estimates.

    Parameters
    ----------
    verdicts
        Verdicts of all conditions.
    design
        The design that they are of.

    Returns
    -------
    tuple of str
        What is compared; the compared conditions, then the reference; whether subjects are few.
    """
    compared = [v for v in verdicts if v.n >= MIN_SUBJECTS]
    if not compared:
        return ()
    of_what = " with inertia compensation" * design.compensated
    than = " without it" * design.compensated
    pairs = len(design.pairs)
    together = f" simultaneous over {pairs} planned pairs (Bonferroni)" * (pairs > 1)
    sentences = [
        f"Each residual{of_what} was compared with that of {design.reference}{than}: difference in "
        f"percent [95 % CI{together}] and in its unit."
    ]
    for condition in (*design.others, design.reference):
        if of_condition := [v for v in compared if v.condition == condition]:
            sentences.append(_headline(of_condition, design))
    if _are_few(compared, design):
        subjects = max(v.n for v in compared)
        reason = "no exact test of so few can become significant"
        sentences.append(f"{subjects} subjects are a demonstration: {reason}.")
    return tuple(sentences)


def open_questions(verdicts: Sequence[Verdict], design: Design = EXPERIMENT_3) -> tuple[str, ...]:
    """Say what a study leaves open: too few subjects, and errors that could turn a verdict."""
    compared = [v for v in verdicts if v.n >= MIN_SUBJECTS]
    sentences = []
    if count := sum(v.answer == "inconclusive" for v in compared):
        sentences.append(
            f"{count} of {len(compared)} comparisons {'is' if count == 1 else 'are'} "
            "inconclusive; plan.md says how many subjects would decide them."
        )
    open_margins = []
    for condition in (*design.others, design.reference):
        of_condition = [v for v in compared if v.condition == condition]
        if axes := [v.axis for v in of_condition if v.open_margin]:
            names = "all residuals" if 1 < len(axes) == len(of_condition) else join_names(axes)
            open_margins.append(f"{names} in {condition}")
    if open_margins:
        sentences.append(
            f"For {', and '.join(open_margins)}, errors of usual size alone could turn the "
            "verdict: by measurement, the residual may be on either side of the margin of "
            f"{100 * design.margin:g} %."
        )
    return tuple(sentences)


def _are_few(compared: Sequence[Verdict], design: Design) -> bool:
    """Whether no exact test of so few subjects can become significant."""
    # the smallest p of sign flips of n subjects is 2 / 2^n, times the pairs of Bonferroni
    subjects = max((v.n for v in compared), default=0)
    return len(design.pairs) * 2.0 ** (1 - subjects) > 1 - CONFIDENCE


def _headline(verdicts: Sequence[Verdict], design: Design) -> str:
    """State a condition's verdicts in one sentence, which names every residual."""
    condition = verdicts[0].condition
    within, above = within_margin(design), f"above {design.reference}"
    if condition == design.reference:
        margin = f"by more than {100 * design.margin:g} %"
        within, above = f"not increased {margin}", "increased"
        if all(v.answer == "within margin" for v in verdicts):
            return f"In {condition}, compensation increases no residual {margin}."
    answers: dict[Answer, str] = {
        "within margin": within,
        "above": above,
        "inconclusive": "inconclusive",
        "no interval": "without an interval",
    }
    parts = list[str]()
    for answer, words in answers.items():
        if named := [_estimate(v) for v in verdicts if v.answer == answer]:
            parts.append(f"{join_names(named)} {'is' if len(named) == 1 else 'are'} {words}")
    return f"In {condition}, {'; '.join(parts)}."


def _estimate(verdict: Verdict) -> str:
    """Name a residual with its difference from the reference."""
    size = f"{number(verdict.difference, '+z.1f')} {verdict.unit}"
    return f"{verdict.axis} ({verdict.written_percent()}, {size})"


def within_margin(design: Design) -> str:
    """Say what a test of non-inferiority shows.

    Examples
    --------
    >>> within_margin(EXPERIMENT_3)
    'not more than 20 % above baseline'
    """
    return f"not more than {100 * design.margin:g} % above {design.reference}"
