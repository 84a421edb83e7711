"""Is each residual at the level of its reference? A non-inferiority test with intervals."""

from dataclasses import dataclass
from math import isnan, nan
from typing import Final, Literal

import pandas as pd
from scipy import stats

from pipeline.statistics.design import EXPERIMENT_3, MIN_SUBJECTS, Design
from pipeline.statistics.sample_size import subjects_needed

CONFIDENCE: Final = 0.95

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
        "at baseline": the interval's upper bound is at most the margin above the baseline;
        "above": the interval is above the baseline and reaches beyond the margin; "inconclusive":
        neither is shown; "no interval": a single subject; "no data": no subject has both cells.
    no_ic, ic, baseline
        Mean RMS without and with compensation, and of the baseline without, over the `n` subjects
        who have both cells of the comparison; ``no_ic`` is NaN where one of them lacks it, and
        ``ic`` is the residual as measured where there is no compensation.
    difference, low, high
        ``ic - baseline`` with its simultaneous 95 % confidence interval over the planned pairs.
    sd
        Standard deviation of the differences between subjects.
    n
        Subjects.
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
    sd: float = nan
    n: int = 0
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
    residuals: pd.DataFrame, statistics: pd.DataFrame, design: Design = EXPERIMENT_3
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

    Returns
    -------
    list of Verdict
        Residual by residual, for every condition whose comparison with the reference is planned;
        with compensation, for the reference too (does compensation increase it?).

    Notes
    -----
    The interval is Student's t of the paired differences, at 1 − 0.05/m for m planned pairs: it
    excludes zero exactly where the Bonferroni-corrected paired t-test is significant. "at
    baseline" is a test of non-inferiority with the design's margin (one side of Schuirmann 1987),
    by default the 20 % of bioequivalence, as a residual below the baseline is no error. A
    difference that is not significant is no evidence for it.
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
            sd, alpha = float(differences.std()), (1 - CONFIDENCE) / len(design.pairs) / 2
            needed = [
                None if len(both) < MIN_SUBJECTS else subjects_needed(sd, margin - true, alpha)
                for true in (0.0, difference)
            ]
            found.append(
                Verdict(
                    *(axis, unit, condition),
                    answer=_answer(low, high, margin),
                    no_ic=float(both[False, condition].mean(skipna=False)),
                    ic=float(both[judged].mean()),
                    baseline=baseline,
                    difference=difference,
                    low=low,
                    high=high,
                    sd=sd,
                    n=len(both),
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


def _answer(low: float, high: float, margin: float) -> Answer:
    if isnan(high):
        return "no interval"
    if high <= margin:
        return "at baseline"
    return "above" if low > 0 else "inconclusive"
