"""How many subjects a study needs: the plan that follows from its own variances."""

from collections.abc import Sequence

import pandas as pd

from pipeline.statistics.design import CONFIDENCE, MIN_SUBJECTS, Design
from pipeline.statistics.verdict import MAX_SUBJECTS, POWER, Verdict, level_name


def plan_table(found: Sequence[Verdict], design: Design) -> pd.DataFrame:
    """Tabulate the subjects that each comparison needs.

    Parameters
    ----------
    found
        The verdicts.
    design
        The design that they are of.

    Returns
    -------
    pandas.DataFrame
        axis, unit, condition; reference: its mean residual; difference and sd: mean and standard
        deviation of the differences from it; margin; n; needed and needed_as_observed, empty
        beyond 1000 subjects or where the difference observed exceeds the margin.
    """
    rows = [
        {
            "axis": v.axis,
            "unit": v.unit,
            "condition": v.condition,
            "reference": v.baseline,
            "difference": v.difference,
            "sd": v.sd,
            "margin": design.margin * v.baseline,
            "n": v.n,
            "needed": v.needed,
            "needed_as_observed": v.needed_as_observed,
        }
        for v in found
    ]
    columns = (
        *("axis", "unit", "condition", "reference", "difference", "sd", "margin", "n"),
        *("needed", "needed_as_observed"),
    )
    counts = {"needed": "Int64", "needed_as_observed": "Int64"}
    return pd.DataFrame(rows, columns=columns).astype(counts)


def plan_markdown(found: Sequence[Verdict], design: Design) -> str:
    """Render the plan as Markdown, or say in one line why there is none."""
    most = max((v.n for v in found), default=0)
    if not found:
        return f'No plan: no planned pair is "CONDITION - {design.reference_cell}".\n'
    if most < MIN_SUBJECTS:
        return (
            f"No plan: the variance between subjects needs at least {MIN_SUBJECTS} who have a "
            f"condition and {design.reference_cell}, got {most}.\n"
        )
    conditions = [c for c in design.in_order(v.condition for v in found)]
    cells = {(v.axis, v.condition): _cell(v, design) for v in found}
    lines = [["Residual", *conditions], ["---"] * (1 + len(conditions))]
    lines += [
        [axis, *(cells.get((axis, condition), "–") for condition in conditions)]
        for axis in dict.fromkeys(v.axis for v in found)
    ]
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    pairs = len(design.pairs)
    together = f" over {pairs} planned pairs" * (pairs > 1)
    return (
        f"{body}\n\nSubjects needed to show a residual at {level_name(design)}, at most "
        f"{100 * design.margin:g} % above it, with\n{100 * POWER:g} % power at "
        f"{100 * CONFIDENCE:g} % simultaneous confidence{together}, if the true difference is zero;"
        "\nin brackets, if it is the one observed (–: that one exceeds the margin). From the "
        f"variance between {most}\nsubjects, which is itself uncertain.\n"
    )


def _cell(verdict: Verdict, design: Design) -> str:
    if verdict.n < MIN_SUBJECTS:
        return "–"
    beyond = verdict.difference >= design.margin * verdict.baseline
    observed = "–" if beyond else _count(verdict.needed_as_observed)
    return f"{_count(verdict.needed)} ({observed})"


def _count(subjects: int | None) -> str:
    return f">{MAX_SUBJECTS}" if subjects is None else str(subjects)
