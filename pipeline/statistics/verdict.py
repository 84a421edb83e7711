"""Does compensation return each residual to its baseline? A non-inferiority test with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import Final, Literal

import pandas as pd
from scipy import stats

from pipeline.statistics.design import CONDITIONS, PLANNED_PAIRS

BASELINE: Final = CONDITIONS[0]
MARGIN: Final = 0.2
"""Non-inferiority margin, as a fraction of the baseline residual: the 20 % of bioequivalence."""
CONFIDENCE: Final = 0.95

Answer = Literal["at baseline", "above", "inconclusive", "no interval", "no data"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a residual with compensation compares with the baseline without compensation.

    Attributes
    ----------
    axis, unit, condition
        The residual and the condition.
    answer
        "at baseline": the interval's upper bound is at most 20 % above the baseline; "above": the
        interval is above the baseline and reaches beyond the margin; "inconclusive": neither is
        shown; "no interval": a single subject; "no data": no subject has both cells.
    no_ic, ic, baseline
        Mean RMS without and with compensation, and of the baseline without, over the `n` subjects
        who have both cells of the comparison; ``no_ic`` is NaN where one of them lacks it.
    difference, low, high
        ``ic - baseline`` with its simultaneous 95 % confidence interval over the planned pairs.
    n
        Subjects.
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
    n: int = 0

    def percent(self, value: float) -> float:
        """Give a difference in percent of the baseline."""
        return 100 * value / self.baseline if self.baseline > 0 else nan


def verdicts(residuals: pd.DataFrame, statistics: pd.DataFrame) -> list[Verdict]:
    """Compare every residual in every condition with the baseline.

    Parameters
    ----------
    residuals
        Long table of RMS residuals, as `pipeline.statistics.comparison.statistics` takes it.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for it.

    Returns
    -------
    list of Verdict
        Residual by residual: baseline (does compensation increase it?), sway, pitch.

    Notes
    -----
    The interval is Student's t of the paired differences, at 1 − 0.05/5: it excludes zero exactly
    where the Bonferroni-corrected paired t-test is significant. "at baseline" is a test of
    non-inferiority with a margin of 20 % of the baseline (one side of Schuirmann 1987), as a
    residual below the baseline is no error. A difference that is not significant is no evidence
    for it.
    """
    found = []
    for axis, unit in residuals[["axis", "unit"]].drop_duplicates().itertuples(index=False):
        own = residuals[residuals["axis"] == axis]
        rms = own.pivot(index="subject", columns=["compensated", "condition"], values="rms")
        cells = pd.MultiIndex.from_product([[False, True], CONDITIONS])
        rms = rms.reindex(columns=cells)
        tests = statistics[statistics["axis"] == axis]
        for condition in CONDITIONS:
            both = rms.dropna(subset=[(True, condition), (False, BASELINE)])
            if both.empty:
                found.append(Verdict(axis, unit, condition, "no data"))
                continue
            baseline = float(both[False, BASELINE].mean())
            difference = float((both[True, condition] - both[False, BASELINE]).mean())
            low, high = _simultaneous_interval(tests, f"{condition} IC - {BASELINE} no IC")
            found.append(
                Verdict(
                    *(axis, unit, condition),
                    answer=_answer(low, high, MARGIN * baseline),
                    no_ic=float(both[False, condition].mean(skipna=False)),
                    ic=float(both[True, condition].mean()),
                    baseline=baseline,
                    difference=difference,
                    low=low,
                    high=high,
                    n=len(both),
                )
            )
    return found


def _simultaneous_interval(tests: pd.DataFrame, effect: str) -> tuple[float, float]:
    """Widen the interval of a mean difference to hold for all planned pairs simultaneously."""
    of_mean = (tests["effect"] == effect) & (tests["effect_size_name"] == "mean difference")
    row = tests[of_mean]
    if row.empty:
        return nan, nan
    mean, low, n = (float(row[name].iloc[0]) for name in ("effect_size", "ci_low", "n"))
    alpha = 1 - CONFIDENCE
    corrected = stats.t.isf(alpha / len(PLANNED_PAIRS) / 2, n - 1)
    half = float(corrected / stats.t.isf(alpha / 2, n - 1) * (mean - low))
    return mean - half, mean + half


def _answer(low: float, high: float, margin: float) -> Answer:
    if isnan(high):
        return "no interval"
    if high <= margin:
        return "at baseline"
    return "above" if low > 0 else "inconclusive"


def headline(found: Sequence[Verdict], condition: str) -> str:
    """Summarise a condition's verdicts in one sentence.

    Parameters
    ----------
    found
        Verdicts of all conditions.
    condition
        The condition to summarise.

    Returns
    -------
    str
        How many residuals are at baseline with compensation, and the names of the others.
    """
    own = [v for v in found if v.condition == condition]
    named = {a: [v.axis for v in own if v.answer == a] for a in ("above", "inconclusive")}
    at_baseline = sum(v.answer == "at baseline" for v in own)
    if not at_baseline and not any(named.values()):
        return f"In {condition}, there are too few subjects for a comparison"
    back, above = "at baseline level", "above it"
    if condition == BASELINE:
        back, above = "not increased", "increased"
    parts = [f"{at_baseline} of {len(own)} residuals are {back} with compensation"]
    if named["above"]:
        verb = "is" if len(named["above"]) == 1 else "are"
        parts.append(f"{join_names(named['above'])} {verb} {above}")
    if named["inconclusive"]:
        subjects = max(v.n for v in own)
        result = f"result is inconclusive with {subjects} subjects"
        parts.append(f"for {join_names(named['inconclusive'])}, the {result}")
    return f"In {condition}, " + "; ".join(parts)


def join_names(names: Sequence[str]) -> str:
    """Join names as in a sentence, with "and" before the last."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
