"""The verdict on the page of a report: one cell per residual and condition."""

from collections.abc import Iterator, Sequence
from math import isfinite, isnan
from typing import Any, Final

import pandas as pd

from hbm.spelling import join_names
from pipeline.report.blocks import each
from pipeline.report.effects import named, written_test
from pipeline.report.tables import numbers
from pipeline.run.provenance import TrialState
from pipeline.statistics.comparison import MIXED_ANOVA, MIXED_MODEL, RM_ANOVA
from pipeline.statistics.design import EXPERIMENT_3, MIN_SUBJECTS, Design
from pipeline.statistics.table_3 import number
from pipeline.statistics.verdict import (
    LIMITS,
    Answer,
    Verdict,
    headlines,
    judged_conditions,
    open_questions,
    within_margin,
)
from pipeline.trial.residuals import (
    AXES,
    DIRECTIONS,
    HEALTHY,
    HEALTHY_RMS,
    UNITS,
    expectation,
    rows_of,
)

STYLES: Final[dict[Answer, tuple[str, str]]] = {
    "within margin": ("✔", "pass"),
    "above": ("✖", "fail"),
    "inconclusive": ("?", "check"),
    "no interval": ("○", "none"),
    "no data": ("–", "none"),
}
"""Answer -> symbol, class in the style sheet."""
NO_COMPENSATION: Final = (
    "There is no compensation to assess: the trials were processed with the plates as measured "
    "only. State treadmill.calibration in study.toml and run the study again."
)


def question(design: Design) -> str:
    """Give the question that the verdict answers."""
    if not design.factors:
        return "How large are the residuals?"
    compensated = " with compensation" * design.compensated
    return f"Is each residual{compensated} {within_margin(design)}?"


def verdict_values(
    verdicts: Sequence[Verdict],
    residuals: pd.DataFrame,
    tests: pd.DataFrame,
    states: Sequence[TrialState],
    design: Design,
    *,
    planned: bool,
) -> dict[str, Any]:
    """Give what ``verdict.html`` shows: paragraph, basis, heads of the columns, rows of cells.

    `residuals` says why there is no verdict; `planned` whether the study states the design.
    """
    possible = judged_conditions(design)
    order = [c for c in (*design.others, design.reference) if c in possible]
    shown = [c for c in order if any(v.condition == c and v.n for v in verdicts)]
    most = max((v.n for v in verdicts), default=0)
    margin = 100 * design.margin
    bounds = [abs(x) for v in verdicts for x in (v.low_percent, v.high_percent)]
    reach = max([2 * margin, *filter(isfinite, bounds)])
    # a half-axis of 100 % of the reference at most: larger differences end at the border
    reach = min(reach, max(100.0, margin))
    rows = []
    for axis, direction in zip(AXES, DIRECTIONS, strict=True):
        of_axis = {v.condition: v for v in verdicts if v.axis == axis}
        if of_axis and shown:
            cells = [_cell(of_axis[condition], reach, most, design) for condition in shown]
            rows.append((axis, direction, cells))
    no_verdict = most < MIN_SUBJECTS
    open_ones = [_why_none(residuals, design)] if no_verdict else open_questions(verdicts, design)
    return {
        "paragraph": "" if no_verdict else _paragraph(verdicts, tests, states, design),
        "headline": [*_beside_reference(residuals, alone=no_verdict), *open_ones],
        "basis": " ".join(filter(None, ("" if planned else _basis(design), _primary(verdicts)))),
        "heads": [
            c if c in design.others else f"{c}: {label('within margin', c, design)}?" for c in shown
        ],
        "rows": rows,
        "most": most,
    }


def _paragraph(
    verdicts: Sequence[Verdict], tests: pd.DataFrame, states: Sequence[TrialState], design: Design
) -> str:
    """Write the primary analysis as a paper has it: estimates, F tests, subjects, exclusions."""
    sentences = [*headlines(verdicts, design)]
    effect = ":".join(design.factors)
    of_variance = tests["test"].isin((RM_ANOVA, MIXED_ANOVA, MIXED_MODEL))
    of_effect = tests[of_variance & (tests["effect"] == effect)]
    of_effect = of_effect[of_effect["p_corrected"].notna()].drop_duplicates("axis")
    if len(of_effect):
        weakest = max(rows_of(of_effect), key=lambda row: (row.p_corrected, -row.effect_size))
        what = f"{named(effect)} ({weakest.test}), weakest in {weakest.axis}"
        sentences.append(f"Effect of {what}: {written_test(weakest)}.")
    absent = [f"{state.name} ({state.state})" for state in states if not state.in_tables]
    excluded = f"; without {join_names(absent)}" if absent else ", none excluded"
    subjects = numbers(pd.Series([v.n for v in verdicts if v.n]), "subject")
    return " ".join([*sentences, f"{subjects}, {len(states)} trials{excluded}."])


def _primary(verdicts: Sequence[Verdict]) -> str:
    """Say which analysis is the primary one, and by what model."""
    if not any(verdict.n >= MIN_SUBJECTS for verdict in verdicts):
        return ""
    mixed = [verdict for verdict in verdicts if verdict.mixed]
    if not mixed:
        return "Primary analysis: this table. All other tests on this page are secondary."
    cells = "" if len(mixed) == len(verdicts) else f" ({each(v.condition for v in mixed)})"
    return (
        f"Primary analysis: this table, by mixed models of all recordings{cells}, since subjects "
        "lack a condition or have several recordings of one. All other tests on this page are "
        "secondary; those of pairs and Table III use complete subjects alone."
    )


def _basis(design: Design) -> str:
    """Say what is compared where no study states it and it is not experiment 3."""
    if design == EXPERIMENT_3 or not design.pairs:
        return ""
    if design.conditions == EXPERIMENT_3.conditions:
        return NO_COMPENSATION
    order = ", ".join(design.conditions)
    return (
        f"No [comparison] in study.toml: conditions are compared in the order {order}, with "
        f"{design.reference} as reference."
    ) * (len(design.conditions) > 1)


def label(answer: Answer, condition: str, design: Design) -> str:
    """Name an answer; the reference is asked whether compensation increased it."""
    if condition == design.reference:
        within = f"not increased by more than {100 * design.margin:g} %"
        words = {"within margin": within, "above": "increased"}
    else:
        words = {"within margin": within_margin(design), "above": f"above {design.reference}"}
    return words.get(answer, answer)


def _beside_reference(residuals: pd.DataFrame, *, alone: bool) -> Iterator[str]:
    """Compare residuals with what is expected where markers do not show all segments.

    Else, where there is no verdict, the mean RMS of each with that of healthy walking.
    """
    best = residuals[residuals["compensated"] == residuals["compensated"].any()]
    if unseen := expectation([*best.itertuples()]):
        yield unseen
        return
    mean = best.groupby("axis")["rms"].mean()
    above = [
        f"{axis} ({mean[axis]:.1f}, healthy {healthy:.1f} {unit})"
        for axis, unit, healthy in zip(AXES, UNITS, HEALTHY_RMS, strict=True)
        if mean.get(axis, 0.0) > healthy
    ]
    limit = f"above the RMS of {HEALTHY}"
    if alone and len(mean):
        yield f"{', '.join(above)}: {limit}." if above else f"No residual is {limit}."


def _why_none(residuals: pd.DataFrame, design: Design) -> str:
    """Say why there is no verdict."""
    if residuals["subject"].nunique() == 1:
        return "With one subject there are means, but no confidence intervals."
    if design.compensated and not residuals["compensated"].any():
        return NO_COMPENSATION
    if not design.factors:
        return "There is one condition and no compensation, so there is nothing to compare."
    if not judged_conditions(design):
        return (
            f'No verdict: no planned pair is "CONDITION - {design.reference_cell}", which compares '
            "a condition with the reference."
        )
    present = ", ".join(design.in_order(residuals["condition"]))
    return (
        f"No confidence intervals: they need two subjects who have {design.reference} and another "
        f"condition; there are {present}. Their means are in the table below."
    )


def _cell(v: Verdict, reach: float, most: int, design: Design) -> dict[str, Any]:
    """Give symbol, label, class, lines and graph of a verdict."""
    symbol, css_class = STYLES[v.answer]
    words = {"within margin": "yes", "above": "no"}
    cell = {"symbol": symbol, "label": words.get(v.answer, v.answer), "class": css_class}
    lines = []
    if v.n:
        lines = [f"{v.ic:.1f} {v.unit}"]
        if not isnan(v.no_ic) and design.compensated:
            lines = [f"{number(v.no_ic, '.1f')} → {lines[0]}"]
        lines[0] += f", {v.written_percent()}"
    has_interval = v.n and not isnan(v.high)
    if v.measurement:
        lines.append(f"measurement {interval(*v.measurement)} {v.unit}")
    if has_interval:
        lines += [f"n = {v.n}"] * (v.n < most)
        lines += [f"{v.paired} of {v.n} subjects in both"] * (v.paired < v.n)
    if has_interval and v.answer == "inconclusive":
        cell["label"] += f": {_needed(v)}"
    return cell | {"lines": lines, "graph": _graph(v, reach, design) if has_interval else None}


def interval(low: float, high: float, form: str = "+z.1f") -> str:
    """Write an interval."""
    return f"{number(low, form)} to {number(high, form)}"


def _needed(verdict: Verdict) -> str:
    """Say how many subjects would decide a comparison that is inconclusive."""
    if verdict.needed is None:
        return f"needs over {LIMITS.most_subjects} subjects"
    return f"needs {verdict.needed} subjects" + " if equal" * (verdict.needed <= verdict.n)


def _graph(v: Verdict, reach: float, design: Design) -> dict[str, str]:
    """Place a difference, its interval and the margin on an axis from -reach to +reach [%]."""
    places = {
        "margin": -100 * design.margin,
        "low": v.low_percent,
        "mean": v.percent(v.difference),
        "high": v.high_percent,
    }
    half = 48  # of the width in percent; the rest is room for the symbol of the mean
    graph = {
        name: f"{50 + half * max(-1.0, min(1.0, percent / reach)):.2f}%"
        for name, percent in places.items()
    }
    return graph | {"width": f"{2 * half * 100 * design.margin / reach:.2f}%"}
