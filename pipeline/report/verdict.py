"""The verdict on the page of a report: one cell per residual and condition."""

from collections.abc import Sequence
from math import isnan, nan
from typing import Final
from xml.etree.ElementTree import Element

import pandas as pd

from pipeline.report.markup import element, table
from pipeline.report.tables import number
from pipeline.statistics.design import CONDITIONS, in_order
from pipeline.statistics.verdict import BASELINE, MARGIN, Verdict, headline
from pipeline.trial.residuals import AXES, DIRECTIONS

WORDS: Final = {
    "at baseline": ("✔", "at baseline level"),
    "above": ("✖", "above baseline"),
    "inconclusive": ("?", "inconclusive"),
    "no interval": ("○", "no interval"),
    "no data": ("–", "no data"),
}
WORDS_BASELINE: Final = WORDS | {
    "at baseline": ("✔", "unchanged"),
    "above": ("✖", "increased"),
}
CSS_CLASSES: Final = {"at baseline": "yes", "above": "no", "inconclusive": "open"}
JUDGED: Final = (*CONDITIONS[1:], BASELINE)
"""The question first, then the check on the baseline."""


def verdict_section(
    found: Sequence[Verdict], residuals: pd.DataFrame, reservations: Sequence[Element]
) -> list[Element]:
    """Say whether compensation brings each residual back to baseline.

    Parameters
    ----------
    found
        The verdicts.
    residuals
        Long table of RMS residuals, to say why there is no verdict.
    reservations
        What stands right below the headline.

    Returns
    -------
    list of Element
        Headline, reservations, one cell per residual and condition, what the signs mean.
    """
    shown = [c for c in JUDGED if any(v.condition == c and v.n for v in found)]
    most = max((v.n for v in found), default=0)
    said = [f"{headline(found, condition)}." for condition in shown]
    if most < 2:
        said = [_why_not(residuals, most)]
    lead = element("div", *(element("p", text) for text in said), class_="headline")
    if not shown:
        return [lead, *reservations]
    reach = max([2 * MARGIN * 100, *(abs(v.percent(x)) for v in found for x in (v.low, v.high))])
    rows = []
    for k, axis in enumerate(AXES):
        own = {v.condition: v for v in found if v.axis == axis}
        if own:
            about = "" if k < 3 else "about "
            name = element(
                "span", f"{axis} ", element("span", f"{about}{DIRECTIONS[k]}", class_="soft")
            )
            rows.append([name, *(_cell(own[c], min(reach, 100.0), most) for c in shown)])
    heads = ["Residual", *(f"{c}: {_question(c)}?" for c in shown)]
    caption = (
        "RMS without → with compensation (IC), and its difference from the baseline without IC; "
        f"n = {most} unless stated"
    )
    shown_table = table(heads, rows, caption=caption, class_="verdicts")
    return [lead, *reservations, shown_table, *([_legend()] if most > 1 else [])]


def _question(condition: str) -> str:
    return "unchanged" if condition == BASELINE else "at baseline level"


def _why_not(residuals: pd.DataFrame, most: int) -> str:
    """Say what stands in the way of a verdict."""
    if most == 1:
        return "One subject shows sizes, but not how certain they are."
    if not residuals["compensated"].any():
        return (
            "There is no compensation to judge: the trials were processed with the plates as "
            "measured only. State treadmill.calibration in study.toml and run again."
        )
    return (
        f"This cannot be told: the comparison needs the conditions {', '.join(CONDITIONS)}, by "
        "these names, in the same subjects; here are "
        f"{', '.join(in_order(residuals['condition']))}. The table of means stands for itself."
    )


def _cell(verdict: Verdict, reach: float, most: int) -> Element:
    words = WORDS_BASELINE if verdict.condition == BASELINE else WORDS
    symbol, said = words[verdict.answer]
    kind = CSS_CLASSES.get(verdict.answer, "none")
    mark = element("span", f"{symbol} {said}", class_="mark")
    if not verdict.n:
        return element("div", mark, class_=kind)
    unit = verdict.unit
    change = 100 * (verdict.ic / verdict.no_ic - 1) if verdict.no_ic > 0 else nan
    relative = "" if isnan(change) else f" ({number(change, '+z.0f')} %)"
    sizes = f"{number(verdict.no_ic, '.1f')} → {verdict.ic:.1f} {unit}{relative}"
    difference, low, high = (
        number(value, "+z.1f") for value in (verdict.difference, verdict.low, verdict.high)
    )
    percent = number(verdict.percent(verdict.difference), "+z.0f")
    count = f", n = {verdict.n}" * (verdict.n < most)
    against = f"from baseline {difference} {unit} ({percent} %)"
    parts = [mark, element("p", sizes), element("p", against)]
    if not isnan(verdict.high):
        parts += [
            element("p", f"CI {low} to {high} {unit}{count}"),
            _interval_picture(verdict, reach),
        ]
    return element("div", *parts, class_=kind)


def _interval_picture(verdict: Verdict, reach: float) -> Element:
    """Draw a difference's interval in percent of the baseline over the margin, as the text says."""

    def at(percent: float) -> str:
        return f"{50 + 48 * max(-1.0, min(1.0, percent / reach)):.2f}%"

    margin = 100 * MARGIN
    low, mean, high = (verdict.percent(x) for x in (verdict.low, verdict.difference, verdict.high))
    width = f"{2 * 48 * margin / reach:.2f}%"
    return element(
        "svg",
        element("rect", x=at(-margin), y="0", width=width, height="100%", fill="#fff"),
        element(
            "line", x1=at(0), x2=at(0), y1="0", y2="100%", stroke="#56616b", stroke_dasharray="2"
        ),
        element(
            "line", x1=at(low), x2=at(high), y1="50%", y2="50%", stroke="#1b2126", stroke_width="2"
        ),
        element("circle", cx=at(mean), cy="50%", r="4", fill="#1b2126"),
        aria_hidden="true",
    )


def _legend() -> Element:
    percent = f"{100 * MARGIN:g} %"
    return element(
        "div",
        element(
            "p",
            f"✔ the whole interval lies below {percent} above the baseline: back at baseline (or "
            "below it). ✖ the interval lies above zero and is not within the margin: the residual "
            "is larger than at baseline. ? neither is shown; no significant difference does not "
            f"mean no difference. The {percent} is a convention; the intervals let you apply your "
            "own.",
        ),
        element(
            "p",
            "CI: simultaneous 95 % confidence interval over the five planned pairs (Bonferroni). "
            "Pictures: the difference in percent of the baseline, with its interval; white is the "
            "margin, the dashed line no difference.",
        ),
        class_="small soft",
    )
