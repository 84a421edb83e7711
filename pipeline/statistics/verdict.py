"""Does compensation bring each residual back to baseline? Answers, with their uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import Final, Literal

import pandas as pd
from scipy import stats

from pipeline.statistics.design import CONDITIONS, PAIRS

BASELINE: Final = CONDITIONS[0]
MARGIN: Final = 0.2
"""Share of the baseline's residual that counts as back at baseline: the 20 % of bioequivalence."""
CONFIDENCE: Final = 0.95

Answer = Literal["yes", "no", "open", "size only", "no data"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a condition's residual with compensation stands to the baseline without.

    Attributes
    ----------
    axis, unit, condition
        Which residual, where.
    answer
        "yes": at most 20 % above the baseline, as far as the interval tells; "no": above the
        baseline, and not shown to be within 20 %; "open": neither is shown; "size only": one
        subject; "no data": nobody has both cells.
    no_ic, ic, baseline
        Mean RMS without and with compensation, and of the baseline without, over the `n` subjects
        who have what is compared; ``no_ic`` is NaN where one of them lacks it.
    difference, low, high
        ``ic - baseline`` with its interval: simultaneous 95 % for the five planned pairs.
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
    """Judge every residual in every condition of the design.

    Parameters
    ----------
    residuals
        Long table of RMS residuals, as `pipeline.statistics.comparison.statistics` takes it.
    statistics
        What `pipeline.statistics.comparison.statistics` made of it.

    Returns
    -------
    list of Verdict
        Residual by residual: baseline (does compensation leave it alone?), sway, pitch.

    Notes
    -----
    The interval is Student's t of the paired differences, at 1 − 0.05/5: it excludes zero exactly
    where the Bonferroni-corrected paired t-test is significant. "yes" is a test of non-inferiority
    with a margin of 20 % of the baseline (one side of Schuirmann 1987): a residual below the
    baseline is no fault. No significant difference alone never makes a "yes".
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
            low, high = _interval(tests, f"{condition} IC - {BASELINE} no IC")
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


def _interval(tests: pd.DataFrame, effect: str) -> tuple[float, float]:
    """Widen a mean difference's interval so that all planned pairs hold at once."""
    of_mean = (tests["effect"] == effect) & (tests["effect_size_name"] == "mean difference")
    row = tests[of_mean]
    if row.empty:
        return nan, nan
    mean, low, n = (float(row[name].iloc[0]) for name in ("effect_size", "ci_low", "n"))
    alpha = 1 - CONFIDENCE
    wider = stats.t.isf(alpha / len(PAIRS) / 2, n - 1) / stats.t.isf(alpha / 2, n - 1)
    half = float(wider * (mean - low))
    return mean - half, mean + half


def _answer(low: float, high: float, margin: float) -> Answer:
    if isnan(high):
        return "size only"
    if high <= margin:
        return "yes"
    return "no" if low > 0 else "open"


def headline(found: Sequence[Verdict], condition: str) -> str:
    """Say a condition's verdicts in one sentence.

    Parameters
    ----------
    found
        Verdicts of all conditions.
    condition
        Which.

    Returns
    -------
    str
        How many residuals are at baseline with compensation, and the names of those that are not.
    """
    own = [v for v in found if v.condition == condition]
    named = {a: [v.axis for v in own if v.answer == a] for a in ("yes", "no", "open")}
    if not any(named.values()):
        return f"In {condition}, there are too few subjects to tell"
    back, above = (
        ("left alone", "raised") if condition == BASELINE else ("back at baseline", "above")
    )
    parts = [f"{len(named['yes'])} of {len(own)} residuals are {back} with compensation"]
    if named["no"]:
        parts.append(f"{listed(named['no'])} {'is' if len(named['no']) == 1 else 'are'} {above}")
    if named["open"]:
        subjects = max(v.n for v in own)
        parts.append(f"for {listed(named['open'])}, {subjects} subjects are too few to tell")
    return f"In {condition}, " + "; ".join(parts)


def listed(names: Sequence[str]) -> str:
    """Say names as in a sentence, the last after "and"."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
