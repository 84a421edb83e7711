"""Is each residual at the level of its reference? A non-inferiority test, in sentences too."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan, nan, sqrt
from typing import Final, Literal

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
from pipeline.statistics.mixed import compare_cells, is_incomplete_or_repeated, recording_values

POWER: Final = 0.8
"""By convention (Cohen 1988)."""
PLANNED_RECORDINGS: Final = (1, 2, 3, 5, 10)
"""Per subject and condition, for which a study is planned."""
MAX_SUBJECTS: Final = 1000
"""No gait study has more; beyond, the answer is that it cannot be shown."""
MAX_NONCENTRALITY: Final = 1e3
"""The power is 1 long before; SciPy's noncentral t distribution becomes NaN beyond."""
Answer = Literal["at baseline", "above", "inconclusive", "no interval", "no data"]


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
        Subjects with both cells.
    mixed
        Whether difference, interval and answer are those of mixed models of all recordings.
    measurement
        The 95 % interval of the difference by errors of measurement of usual size; None where they
        are not known.
    open_margin
        Whether the interval of ``ic - 1.2 baseline`` by them, with the margin of the design,
        contains zero.
    needed, needed_as_observed
        Subjects who would show "at baseline" with 80 % power, if the true difference is zero and
        if it is the one observed; None where it cannot be shown or is not known.
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
    mixed: bool = False
    measurement: tuple[float, float] | None = None
    open_margin: bool = False
    needed: int | None = None
    needed_as_observed: int | None = None
    needed_with: tuple[int | None, ...] = ()

    def percent(self, value: float) -> float:
        """Give a difference in percent of the baseline."""
        return 100 * value / self.baseline if self.baseline > 0 else nan


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
        recordings of one, the difference, its interval and the answer are those of mixed models of
        all recordings.

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
    alpha = (1 - CONFIDENCE) / max(len(design.pairs), 1) / 2
    for axis, unit in residuals[["axis", "unit"]].drop_duplicates().itertuples(index=False):
        own = residuals[residuals["axis"] == axis]
        rms = own.pivot(index="subject", columns=["compensated", "condition"], values="rms")
        cells = pd.MultiIndex.from_product([[False, True], design.conditions])
        rms = rms.reindex(columns=cells)
        for condition in judged_conditions(design):
            judged = (design.compensated, condition)
            both = rms.dropna(subset=[judged, reference])
            if both.empty:
                found.append(Verdict(axis, unit, condition, "no data"))
                continue
            baseline = float(both[reference].mean())
            differences = both[judged] - both[reference]
            difference, margin = float(differences.mean()), design.margin * baseline
            excess = both[judged] - (1 + design.margin) * both[reference]
            low, high = _interval(differences, alpha)
            within = _interval(excess, alpha)[1] <= 0
            mixed, spreads = None, tuple[float, ...]()
            if recordings is not None:
                values = recording_values(recordings, axis, design)
                mixed = _by_mixed_model(values, condition, design, alpha)
                complete = values[values["subject"].isin(both.index)]
                spreads = _planned_spreads(complete, condition, design, float(excess.var()))
            if mixed is not None:
                difference, low, high, within = mixed
            relative = ratio_interval(both[judged].to_numpy(), both[reference].to_numpy(), alpha)
            needed = [
                None
                if len(both) < MIN_SUBJECTS
                else subjects_needed(float(excess.std()), margin - true, alpha)
                for true in (0.0, difference)
            ]
            uncertain, open_margin = None, False
            if measurement is not None:
                compared = (condition, design.compensated), (design.reference, False)
                covariance = mean_covariance(measurement[axis], both.index, compared)
                half, of_excess = (
                    half_interval(deviation(covariance, (1.0, -share)))
                    for share in (1.0, 1 + design.margin)
                )
                uncertain = difference - half, difference + half
                open_margin = abs(difference - margin) < of_excess
            found.append(
                Verdict(
                    *(axis, unit, condition),
                    answer=_answer(low, within=within),
                    mixed=mixed is not None,
                    no_ic=float(both[False, condition].mean(skipna=False)),
                    ic=float(both[judged].mean()),
                    baseline=baseline,
                    difference=difference,
                    low=low,
                    high=high,
                    low_percent=100 * (relative[0] - 1),
                    high_percent=100 * (relative[1] - 1),
                    sd=float(differences.std()),
                    n=len(both),
                    measurement=uncertain,
                    open_margin=open_margin,
                    needed=needed[0],
                    needed_as_observed=needed[1],
                    needed_with=tuple(subjects_needed(sd, margin, alpha) for sd in spreads),
                )
            )
    return found


def _by_mixed_model(
    values: pd.DataFrame, condition: str, design: Design, alpha: float
) -> tuple[float, float, float, bool] | None:
    """Give difference, interval and whether it is within the margin; None where pairs tell it."""
    cells = design.judged(condition), design.reference_cell
    own = values[values["cell"].isin(cells)]
    if not is_incomplete_or_repeated(own, cells):
        return None
    found = compare_cells(own, *cells)
    margin = own["value"].where(own["cell"] == cells[0], (1 + design.margin) * own["value"])
    excess = compare_cells(own.assign(value=margin), *cells)
    if found is None or excess is None:
        return None
    return found.difference, *found.interval(2 * alpha), excess.interval(2 * alpha)[1] <= 0


def _planned_spreads(
    values: pd.DataFrame, condition: str, design: Design, variance: float
) -> tuple[float, ...]:
    """Give the SD between subjects of ``ic - 1.2 baseline`` with other numbers of recordings.

    With each of `PLANNED_RECORDINGS` per condition, from its variance between subjects with the
    recordings that there are; empty where no recording is repeated. A mean of k recordings has the
    variance within subjects by k.
    """
    cells, factors = (design.judged(condition), design.reference_cell), (1, 1 + design.margin)
    own = values[values["cell"].isin(cells)]
    each = own.pivot(index=["subject", "recording"], columns="cell", values="value")
    parts = [factor * each[cell].dropna() for cell, factor in zip(cells, factors, strict=True)]
    if len(parts[0]) == len(parts[1]) == len(each):  # of the same recordings
        parts = [parts[0] - parts[1]]
    within = of_means = 0.0
    for part in parts:
        of_subject = part.groupby("subject")
        count = of_subject.size()
        if count.max() < 2:
            return ()
        own_variance = np.average(of_subject.var()[count > 1], weights=count[count > 1] - 1)
        within += own_variance
        of_means += own_variance * float((1 / count).mean())
    between = max(variance - of_means, 0.0)
    return tuple(float(np.sqrt(between + within / count)) for count in PLANNED_RECORDINGS)


def judged_conditions(design: Design) -> list[str]:
    """Give the conditions whose comparison with the reference is planned."""
    return [
        c for c in design.conditions if (design.judged(c), design.reference_cell) in design.pairs
    ]


def _interval(values: pd.Series, alpha: float) -> tuple[float, float]:
    """Give Student's interval of a mean, with alpha beyond either bound; NaN for one value."""
    n = len(values)
    if n < MIN_SUBJECTS:
        return nan, nan
    mean, half = values.mean(), stats.t.isf(alpha, n - 1) * values.std() / sqrt(n)
    return float(mean - half), float(mean + half)


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


def _answer(low: float, *, within: bool) -> Answer:
    """Give the answer, by the lower bound of the difference."""
    if isnan(low):
        return "no interval"
    if within:
        return "at baseline"
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
    with np.errstate(divide="ignore", over="ignore"):  # subjects who all agree
        noncentrality = np.minimum(np.divide(room, sd) * np.sqrt(n), MAX_NONCENTRALITY)
    return np.asarray(stats.nct.sf(stats.t.isf(alpha, n - 1), n - 1, noncentrality))


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
    n = np.arange(2.0, MAX_SUBJECTS + 1)
    enough = noninferiority_power(n, sd, room, alpha) >= POWER
    return int(n[enough.argmax()]) if enough.any() else None


def headlines(found: Sequence[Verdict], design: Design = EXPERIMENT_3) -> tuple[str, ...]:
    """Summarise the verdicts of a study: a sentence per condition, and what is not decided.

    Parameters
    ----------
    found
        Verdicts of all conditions.
    design
        The design that they are of.

    Returns
    -------
    tuple of str
        The compared conditions first, then the reference; at the end, where verdicts are
        inconclusive, how many subjects would decide them. So few subjects that no exact test can
        become significant are called a demonstration there, and only there. Last, where intervals
        of measurement are known, where they leave open on which side of the margin a residual is.
    """
    compared = [v for v in found if v.n >= MIN_SUBJECTS]
    subjects = max((v.n for v in compared), default=0)
    undecided = [v for v in compared if v.answer == "inconclusive"]
    few = len(design.pairs) * 2.0 ** (1 - subjects) > 1 - CONFIDENCE
    sentences, open_margins = [], []
    for condition in (*design.others, design.reference):
        own = [v for v in compared if v.condition == condition]
        if own and not (few and all(v in undecided for v in own)):
            sentences.append(_headline(own, design, name_undecided=not few))
        if named := [v.axis for v in own if v.open_margin]:
            every = "all residuals" if 1 < len(named) == len(own) else join_names(named)
            open_margins.append(f"{every} in {condition}")
    if undecided:
        start = f"{subjects} subjects are a demonstration: " * few
        verb = "is" if len(undecided) == 1 else "are"
        sentences.append(
            f"{start}{len(undecided)} of {len(compared)} comparisons {verb} inconclusive. "
            f"With the variance between subjects, {_needed(undecided)}."
        )
    if open_margins:
        sentences.append(
            f"For {', and '.join(open_margins)}, errors of usual size alone could turn the "
            "verdict: by measurement, the residual may be on either side of the margin of "
            f"{100 * design.margin:g} %."
        )
    return tuple(sentences)


def _needed(undecided: Sequence[Verdict]) -> str:
    """Say how many subjects would decide the comparisons that are inconclusive."""
    enough = [v for v in undecided if v.needed is not None and v.needed <= v.n]
    needed = [v.needed for v in undecided if v.needed is not None and v not in enough]
    parts = []
    if needed:
        parts.append(
            f"about {max(needed)} subjects are needed for {len(needed)} of them "
            f"({100 * POWER:g} % power, no true difference)"
        )
    if never := sum(v.needed is None for v in undecided):
        parts.append(f"{MAX_SUBJECTS} subjects are too few for {never} of them")
    if enough:
        parts.append(
            f"enough were measured for {len(enough)} of them if there is no true difference: there "
            "may be one"
        )
    return "; ".join(parts)


def _headline(own: Sequence[Verdict], design: Design, *, name_undecided: bool) -> str:
    """Summarise a condition's verdicts in one sentence: how many are at baseline, and the others.

    Residuals whose verdict is inconclusive are named if wanted.
    """
    condition = own[0].condition
    back, above = f"at {level_name(design)}", "above it"
    if condition == design.reference:
        back, above = f"increased by no more than {100 * design.margin:g} %", "increased"
    named = {a: [v.axis for v in own if v.answer == a] for a in ("above", "inconclusive")}
    count = sum(v.answer == "at baseline" for v in own)
    compensated = " with compensation" * design.compensated
    parts = [f"{count} of {len(own)} residuals {'is' if count == 1 else 'are'} {back}{compensated}"]
    if named["above"]:
        verb = "is" if len(named["above"]) == 1 else "are"
        parts.append(f"{join_names(named['above'])} {verb} {above}")
    if named["inconclusive"] and name_undecided:
        result = f"result is inconclusive with {max(v.n for v in own)} subjects"
        parts.append(f"for {join_names(named['inconclusive'])}, the {result}")
    return f"In {condition}, {'; '.join(parts)}."


def level_name(design: Design) -> str:
    """Name the reference's level in a sentence: "baseline level", or "the level of barefoot"."""
    return (
        "baseline level" if design.reference == "baseline" else f"the level of {design.reference}"
    )


def join_names(names: Sequence[str]) -> str:
    """Join names as in a sentence, with "and" before the last."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
