"""The verdict on the page of a report: one cell per residual and condition."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, isnan, nan
from typing import Final

import pandas as pd

from pipeline.statistics.design import EXPERIMENT_3, Design
from pipeline.statistics.table_3 import number
from pipeline.statistics.verdict import (
    MAX_SUBJECTS,
    Answer,
    Verdict,
    headlines,
    judged_conditions,
    level_name,
)
from pipeline.trial.residuals import AXES, DIRECTIONS

MAX_AXIS_PERCENT: Final = 100.0
"""Longest half-axis of the graphs [% of the reference]; larger differences end at the border."""
HALF_WIDTH_PERCENT: Final = 48
"""Half of a graph's width; the rest is room for the symbol of the mean."""
STYLES: Final[dict[Answer, tuple[str, str]]] = {
    "at baseline": ("✔", "pass"),
    "above": ("✖", "fail"),
    "inconclusive": ("?", "check"),
    "no interval": ("○", "none"),
    "no data": ("–", "none"),
}
"""Answer -> symbol, class in the style sheet."""


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
    """Whether each residual is at the level of the reference.

    Attributes
    ----------
    headline
        The answer in sentences.
    basis
        What is compared, where no study states it; empty otherwise.
    caption
        Of the table.
    questions
        Heads of the columns after the first.
    rows
        One per residual; none where there is nothing to compare.
    subjects, pairs
        Most subjects of a comparison, and number of planned pairs.
    margin_percent
        Non-inferiority margin.
    """

    headline: tuple[str, ...]
    basis: str = ""
    caption: str = ""
    questions: tuple[str, ...] = ()
    rows: tuple[VerdictRow, ...] = ()
    subjects: int = 0
    pairs: int = 0
    margin_percent: str = ""


def question(design: Design) -> str:
    """Give the question that the section answers."""
    if design.compensated:
        return f"Does compensation return each residual to {level_name(design)}?"
    return f"Is each residual at {level_name(design)}?"


def verdict_section(
    found: Sequence[Verdict], residuals: pd.DataFrame, design: Design, *, stated: bool
) -> VerdictSection:
    """Arrange verdicts for the page.

    Parameters
    ----------
    found
        The verdicts.
    residuals
        Long table of RMS residuals, to say why there is no verdict.
    design
        The design that they are of.
    stated
        Whether the study states it.

    Returns
    -------
    VerdictSection
        Headline and one cell per residual and condition.
    """
    basis = "" if stated else _basis(design)
    possible = judged_conditions(design)
    order = [c for c in (*design.others, design.reference) if c in possible]
    shown = [c for c in order if any(v.condition == c and v.n for v in found)]
    most = max((v.n for v in found), default=0)
    sentences = headlines(found, design)
    if most < 2:
        sentences = (_why_no_verdict(residuals, most, design),)
    if not shown:
        return VerdictSection(sentences, basis)
    margin_percent = 100 * design.margin
    bounds = [abs(x) for v in found for x in (v.low_percent, v.high_percent)]
    reach = max([2 * margin_percent, *filter(isfinite, bounds)])
    reach = min(reach, max(MAX_AXIS_PERCENT, margin_percent))
    rows = []
    for k, axis in enumerate(AXES):
        own = {v.condition: v for v in found if v.axis == axis}
        if own:
            direction = f"{'' if k < 3 else 'about '}{DIRECTIONS[k]}"
            cells = tuple(_cell(own[condition], reach, most, design) for condition in shown)
            rows.append(VerdictRow(axis, direction, cells))
    caption = f"RMS, and its difference from {design.reference}"
    if design.compensated:
        caption = (
            "RMS without → with inertia compensation (IC), and its difference from "
            f"{design.reference} without IC"
        )
    return VerdictSection(
        headline=sentences,
        basis=basis,
        caption=caption,
        questions=tuple(f"{c}: {_label('at baseline', c, design)}?" for c in shown),
        rows=tuple(rows),
        subjects=most,
        pairs=len(design.pairs),
        margin_percent=f"{margin_percent:g}",
    )


def _basis(design: Design) -> str:
    """Say what is compared where no study states it and it is not experiment 3."""
    if design == EXPERIMENT_3 or not design.pairs:
        return ""
    if design.conditions == EXPERIMENT_3.conditions:
        return (
            "There is no compensation to assess: the trials were processed with the plates as "
            "measured only. State treadmill.calibration in study.toml and run the study again."
        )
    order = ", ".join(design.conditions)
    return (
        f"No [comparison] is stated, so the conditions are compared in the order {order}, with "
        f"{design.reference} as reference."
    ) * (len(design.conditions) > 1)


def _label(answer: Answer, condition: str, design: Design) -> str:
    if condition == design.reference:
        words = {"at baseline": f"within {100 * design.margin:g} %", "above": "increased"}
    else:
        words = {"at baseline": f"at {level_name(design)}", "above": f"above {design.reference}"}
    return words.get(answer, answer)


def _why_no_verdict(residuals: pd.DataFrame, subjects: int, design: Design) -> str:
    if subjects == 1:
        return "With one subject there are means, but no confidence intervals."
    if design.compensated and not residuals["compensated"].any():
        return (
            "There is no compensation to assess: the trials were processed with the plates as "
            "measured only. State treadmill.calibration in study.toml and run the study again."
        )
    if not design.factors:
        return "There is one condition and no compensation, so there is nothing to compare."
    if not judged_conditions(design):
        return (
            f'No verdict: no planned pair is "CONDITION - {design.reference_cell}", which compares '
            "a condition with the reference."
        )
    present = ", ".join(design.in_order(residuals["condition"]))
    return (
        f"No comparison is possible: it needs the conditions {', '.join(design.conditions)} in the "
        f"same subjects; there are {present}. Their means are in the table below."
    )


def _cell(verdict: Verdict, reach: float, most: int, design: Design) -> VerdictCell:
    symbol, css_class = STYLES[verdict.answer]
    label = _label(verdict.answer, verdict.condition, design)
    if not verdict.n:
        return VerdictCell(symbol, label, css_class)
    unit = verdict.unit
    difference, low, high = (
        number(value, "+z.1f") for value in (verdict.difference, verdict.low, verdict.high)
    )
    first = f"{verdict.ic:.1f} {unit}"
    if design.compensated:
        change = 100 * (verdict.ic / verdict.no_ic - 1) if verdict.no_ic > 0 else nan
        relative = "" if isnan(change) else f" ({number(change, '+z.0f')} %)"
        first = f"{number(verdict.no_ic, '.1f')} → {first}{relative}"
    percent = number(verdict.percent(verdict.difference), "+z.0f")
    lines = [first, f"from {design.reference} {difference} {unit} ({percent} %)"]
    if not isnan(verdict.high):
        lines.append(f"CI {low} to {high} {unit}{_relative(verdict)}")
    if own := verdict.measurement:
        low, high = (number(value, "+z.1f") for value in (own.low, own.high))
        lines.append(f"measurement {low} to {high} {unit}")
    if isnan(verdict.high):
        return VerdictCell(symbol, label, css_class, tuple(lines))
    lines += [f"n = {verdict.n}"] * (verdict.n < most)
    if verdict.answer == "inconclusive":
        lines.append(_needed(verdict))
    graph = _graph(verdict, reach, 100 * design.margin)
    return VerdictCell(symbol, label, css_class, tuple(lines), graph)


def _relative(verdict: Verdict) -> str:
    """Give the interval in percent of the reference, where it has an end."""
    bounds = verdict.low_percent, verdict.high_percent
    if not all(map(isfinite, bounds)):
        return ""
    low, high = (number(value, "+z.0f") for value in bounds)
    return f" ({low} to {high} %)"


def _needed(verdict: Verdict) -> str:
    """Say how many subjects would decide a comparison that is inconclusive."""
    if verdict.needed is None:
        return f"more than {MAX_SUBJECTS} subjects needed"
    if verdict.lacks_subjects:
        return f"{verdict.needed} subjects needed"
    return f"{verdict.needed} would do if the difference were zero"


def _graph(verdict: Verdict, reach: float, margin_percent: float) -> IntervalGraph:
    """Draw a difference in percent of the reference on an axis from -reach to +reach."""

    def at(percent: float) -> str:
        return f"{50 + HALF_WIDTH_PERCENT * max(-1.0, min(1.0, percent / reach)):.2f}%"

    low, high = verdict.low_percent, verdict.high_percent
    mean = verdict.percent(verdict.difference)
    width = f"{2 * HALF_WIDTH_PERCENT * margin_percent / reach:.2f}%"
    return IntervalGraph(at(-margin_percent), width, at(low), at(mean), at(high))
