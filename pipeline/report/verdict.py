"""The verdict on the page of a report: one cell per residual and condition."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import Final

import pandas as pd

from pipeline.report.tables import number
from pipeline.statistics.design import CONDITIONS, in_order
from pipeline.statistics.verdict import BASELINE, MARGIN, Answer, Verdict, headline
from pipeline.trial.residuals import AXES, DIRECTIONS

MARGIN_PERCENT: Final = 100 * MARGIN
MAX_AXIS_PERCENT: Final = 100.0
"""Longest half-axis of the graphs [% of the baseline]; larger differences end at the border."""
HALF_WIDTH_PERCENT: Final = 48
"""Half of a graph's width; the rest is room for the symbol of the mean."""
LABELS: Final[dict[Answer, tuple[str, str, str]]] = {
    "at baseline": ("✔", "at baseline level", "pass"),
    "above": ("✖", "above baseline", "fail"),
    "inconclusive": ("?", "inconclusive", "check"),
    "no interval": ("○", "no interval", "none"),
    "no data": ("–", "no data", "none"),
}
"""Answer -> symbol, label, class in the style sheet."""
BASELINE_LABELS: Final[dict[Answer, tuple[str, str, str]]] = LABELS | {
    "at baseline": ("✔", "not increased", "pass"),
    "above": ("✖", "increased", "fail"),
}
SHOWN_CONDITIONS: Final = (*CONDITIONS[1:], BASELINE)
"""The perturbed conditions first, then the check that compensation leaves the baseline as it is."""


@dataclass(frozen=True, slots=True)
class IntervalGraph:
    """A difference with its interval over the margin: positions from the left, such as "50%"."""

    margin_left: str
    margin_width: str
    low: str
    mean: str
    high: str


@dataclass(frozen=True, slots=True)
class VerdictCell:
    """The verdict on one residual in one condition."""

    symbol: str
    label: str
    css_class: str
    lines: tuple[str, ...] = ()
    interval: IntervalGraph | None = None


@dataclass(frozen=True, slots=True)
class VerdictRow:
    """The verdicts on one residual."""

    axis: str
    direction: str
    cells: tuple[VerdictCell, ...]


@dataclass(frozen=True, slots=True)
class VerdictSection:
    """Whether compensation returns each residual to baseline.

    Attributes
    ----------
    headline
        The answer in sentences.
    questions
        Heads of the columns after the first.
    rows
        One per residual; none where there is nothing to compare.
    subjects
        Most subjects of a comparison.
    margin_percent
        Non-inferiority margin.
    """

    headline: tuple[str, ...]
    questions: tuple[str, ...] = ()
    rows: tuple[VerdictRow, ...] = ()
    subjects: int = 0
    margin_percent: str = f"{MARGIN_PERCENT:g}"


def verdict_section(found: Sequence[Verdict], residuals: pd.DataFrame) -> VerdictSection:
    """Arrange verdicts for the page.

    Parameters
    ----------
    found
        The verdicts.
    residuals
        Long table of RMS residuals, to say why there is no verdict.

    Returns
    -------
    VerdictSection
        Headline and one cell per residual and condition.
    """
    shown = [c for c in SHOWN_CONDITIONS if any(v.condition == c and v.n for v in found)]
    most = max((v.n for v in found), default=0)
    sentences = tuple(f"{headline(found, condition)}." for condition in shown)
    if most < 2:
        sentences = (_why_no_verdict(residuals, most),)
    if not shown:
        return VerdictSection(sentences)
    reach = max([2 * MARGIN_PERCENT, *(abs(v.percent(x)) for v in found for x in (v.low, v.high))])
    reach = min(reach, MAX_AXIS_PERCENT)
    rows = []
    for k, axis in enumerate(AXES):
        own = {v.condition: v for v in found if v.axis == axis}
        if own:
            direction = f"{'' if k < 3 else 'about '}{DIRECTIONS[k]}"
            cells = tuple(_cell(own[condition], reach, most) for condition in shown)
            rows.append(VerdictRow(axis, direction, cells))
    questions = tuple(
        f"{condition}: {'not increased' if condition == BASELINE else 'at baseline level'}?"
        for condition in shown
    )
    return VerdictSection(sentences, questions, tuple(rows), most)


def _why_no_verdict(residuals: pd.DataFrame, subjects: int) -> str:
    if subjects == 1:
        return "With one subject there are means, but no confidence intervals."
    if not residuals["compensated"].any():
        return (
            "There is no compensation to assess: the trials were processed with the plates as "
            "measured only. State treadmill.calibration in study.toml and run the study again."
        )
    return (
        f"No comparison is possible: it needs the conditions {', '.join(CONDITIONS)}, by these "
        "names, in the same subjects; the conditions of this study are "
        f"{', '.join(in_order(residuals['condition']))}. Their means are in the table below."
    )


def _cell(verdict: Verdict, reach: float, most: int) -> VerdictCell:
    labels = BASELINE_LABELS if verdict.condition == BASELINE else LABELS
    label = labels[verdict.answer]
    if not verdict.n:
        return VerdictCell(*label)
    unit = verdict.unit
    change = 100 * (verdict.ic / verdict.no_ic - 1) if verdict.no_ic > 0 else nan
    relative = "" if isnan(change) else f" ({number(change, '+z.0f')} %)"
    difference, low, high = (
        number(value, "+z.1f") for value in (verdict.difference, verdict.low, verdict.high)
    )
    percent = number(verdict.percent(verdict.difference), "+z.0f")
    lines = (
        f"{number(verdict.no_ic, '.1f')} → {verdict.ic:.1f} {unit}{relative}",
        f"from baseline {difference} {unit} ({percent} %)",
    )
    if isnan(verdict.high):
        return VerdictCell(*label, lines)
    count = f", n = {verdict.n}" * (verdict.n < most)
    interval = f"CI {low} to {high} {unit}{count}"
    return VerdictCell(*label, (*lines, interval), _graph(verdict, reach))


def _graph(verdict: Verdict, reach: float) -> IntervalGraph:
    """Draw a difference in percent of the baseline on an axis from -reach to +reach."""

    def at(percent: float) -> str:
        return f"{50 + HALF_WIDTH_PERCENT * max(-1.0, min(1.0, percent / reach)):.2f}%"

    low, mean, high = (verdict.percent(x) for x in (verdict.low, verdict.difference, verdict.high))
    width = f"{2 * HALF_WIDTH_PERCENT * MARGIN_PERCENT / reach:.2f}%"
    return IntervalGraph(at(-MARGIN_PERCENT), width, at(low), at(mean), at(high))
