"""The residuals as tables: Table III, means, groups, what they are of, and the plan of a study."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from math import isnan, nan
from typing import Any, Final

import pandas as pd

from hbm.spelling import counted, join_names, mean_sd
from pipeline.config.schema import NOUNS
from pipeline.report.blocks import Table, table_of
from pipeline.statistics.design import CONFIDENCE, EXPERIMENT_3, MIN_SUBJECTS, Design
from pipeline.statistics.table_3 import (
    markdown_table,
    number,
    printed_columns,
    reduction_percent,
    table_3_legend,
)
from pipeline.statistics.verdict import (
    LIMITS,
    PLANNED_RECORDINGS,
    Verdict,
    within_margin,
)
from pipeline.trial.residuals import AXES, TRIAL_COLUMNS, reference_of, rows_of

WINDOWS: Final = {
    "cycle": "whole gait cycles",
    "step": "steps, from one foot's strike to the other's",
    "stance": "stances, from a foot's strike to its foot off",
    "span": "spans of the recordings",
    "motion": "the time from the onset of each perturbation for which the platform moves fast",
}
"""Window -> what counts."""
TABLE_III: Final = "Table III. "
"""Before the caption of the thesis' table."""


def residual_tables(
    residuals: pd.DataFrame, table_3: pd.DataFrame, design: Design, groups: Mapping[str, str]
) -> list[Table]:
    """Give Table III, the means where it does not hold them all, and the means of every group.

    `groups` gives the group of each subject, where the design has groups.
    """
    has_table_3 = bool(table_3["n"].gt(0).any()) and bool(design.factors)
    shown = [_table_3(table_3, design)] if has_table_3 else []
    if not has_table_3 or set(residuals["condition"]) - set(design.conditions):
        shown.append(means(residuals, design))
    group = residuals["subject"].map(groups)
    for name in sorted(set(groups.values())):
        of_group = means(residuals[group == name], design)
        shown.append(replace(of_group, caption=f"{design.group} {name}. {of_group.caption}"))
    return shown


def _table_3(table_3: pd.DataFrame, design: Design) -> Table:
    """Show Table III, intervals below their values."""
    heads, columns = zip(*printed_columns(table_3, design), strict=True)
    in_two_lines = ([cell.replace(" [", "\n[") for cell in column] for column in columns)
    rows = tuple(zip(*in_two_lines, strict=True))
    of_thesis = design.compensated and design.conditions == EXPERIMENT_3.conditions
    caption = TABLE_III * of_thesis + "RMS residuals, mean ± SD over n subjects"
    return Table(caption, heads, rows, "numbers table3", table_3_legend(table_3, design))


def means(residuals: pd.DataFrame, design: Design) -> Table:
    """Give mean and SD of every cell, for conditions of any name.

    Without compensation, with what they are compared with (`reference_of`).
    """
    rows, compensated = [], bool(residuals["compensated"].any())
    title, reference, meaning = reference_of(rows_of(residuals))
    compared = not compensated or title == "Expected"
    heads = ["No IC", "IC", "Reduction"] if compensated else ["RMS"]
    heads += [title] * compared
    for (axis, unit), of_axis in residuals.groupby(["axis", "unit"], sort=False):
        for k, condition in enumerate(design.in_order(of_axis["condition"])):
            cells = of_axis[of_axis["condition"] == condition].groupby("compensated")["rms"]
            mean, sd, count = cells.mean(), cells.std(), cells.count()
            no_ic, ic = mean.get(False, nan), mean.get(True, nan)
            reduction = number(reduction_percent(no_ic, ic), "z.0f", " %")
            of_ic = mean_sd(ic, sd.get(True, nan)), reduction
            row = ["" if k else f"{axis} ({unit})", condition, str(count.max())]
            row += [mean_sd(no_ic, sd.get(False, nan)), *(of_ic if compensated else ())]
            rows.append([*row, f"{reference[str(axis)]:.1f}"] if compared else row)
    what = " without and with inertia compensation (IC)" * compensated
    caption = f"RMS residuals{what}, mean ± SD over n subjects"
    columns = ("Residual", "Condition", "n", *heads)
    return Table(caption, columns, rows, "numbers", meaning * compared)


def windows_sentence(residuals: pd.DataFrame) -> str:
    """Say over what the residuals of each condition are summarised, one window per trial.

    Examples
    --------
    >>> table = pd.DataFrame({"condition": ["level", "sway"], "window": ["cycle", "10 to 40 %"]})
    >>> windows_sentence(table)  # doctest: +ELLIPSIS
    'RMS over whole gait cycles (level) and 10 to 40 % of the perturbed gait cycle (sway). ...'
    """
    conditions: dict[str, list[str]] = {}
    pairs = residuals[["window", "condition"]].drop_duplicates()
    for window, condition in pairs.itertuples(index=False):
        conditions.setdefault(window, []).append(condition)
    parts = [
        f"{described(name)} ({', '.join(of_window)})" for name, of_window in conditions.items()
    ]
    if not parts:
        return ""
    unlike = (
        " Conditions differ in the part of the gait cycle that is used, and so may their residuals."
    )
    within = [name for name in conditions if name not in (*NOUNS, "span")]
    return f"RMS over {join_names(parts)}.{unlike * bool(within and len(conditions) > 1)}"


def recordings_sentence(residuals: pd.DataFrame, design: Design) -> str:
    """Say of how many recordings and gait cycles each value is; empty where of one recording each.

    Of the values as `pipeline.statistics.recordings.pool_recordings` gives them.
    """
    if residuals["n_recordings"].max() <= 1:
        return ""
    once = residuals.drop_duplicates(["subject", "condition"]).set_index("condition")
    parts = []
    for condition in design.in_order(once.index):
        of_condition = once.loc[[condition]]
        recordings = numbers(of_condition["n_recordings"], "recording")
        parts.append(
            f"{condition} {recordings} and {numbers(of_condition['n_cycles'], 'gait cycle')}"
        )
    equal = f"each {'gait cycle' if design.weigh == 'cycle' else 'recording'} is equal"
    return f"Per subject: {join_names(parts)}; {equal}."


def repeated_values(residuals: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Give the values whose repeatability is reported, as `reliability` takes them.

    RMS residuals, and the peaks of joints as means of both sides.
    """
    names = [*TRIAL_COLUMNS, "compensated"]
    of_residuals = residuals.rename(columns={"axis": "name", "rms": "value"})
    peaks = joints[joints["percent"].notna()]
    quantity = peaks["joint"] + " " + peaks["direction"] + ", " + peaks["quantity"]
    keys = [*names, "name", "unit"]
    peaks = peaks.assign(name=quantity).groupby(keys, sort=False)["value"].mean().reset_index()
    present = [values for values in (of_residuals[[*keys, "value"]], peaks) if len(values)]
    return pd.concat(present, ignore_index=True)


def reliability_tables(reliability: pd.DataFrame, design: Design) -> list[Table]:
    """Show how well the residuals repeat, a table per condition; joints are in the file."""
    best = reliability[
        (reliability["compensated"] == reliability["compensated"].any())
        & reliability["name"].isin(AXES)
    ]
    columns: dict[str, Callable[[Any], str]] = {
        "": lambda row: f"{row.what} ({row.unit})",
        "mean": lambda row: number(row.mean, ".2f"),
        "SD within subjects": lambda row: number(row.sd_within, ".2f"),
        "ICC [95 % CI]": lambda row: (
            "–" if isnan(row.icc) else f"{row.icc:.2f} [{row.icc_low:.2f}, {row.icc_high:.2f}]"
        ),
        "SEM": lambda row: number(row.sem, ".2f"),
        "smallest detectable": lambda row: number(row.smallest_detectable_change, ".2f"),
    }
    tables = []
    for condition in design.in_order(best["condition"].unique()):
        rows = rows_of(best[best["condition"] == condition].rename(columns={"name": "what"}))
        first = rows[0]
        repeats = f"{first.n_repeats} {first.repeated}s of {first.n_subjects} subjects"
        title = f"Repeatability, {condition}: {repeats}; peaks of joints are in reliability.csv"
        tables.append(table_of(title, columns, rows))
    return tables


def numbers(counts: pd.Series, noun: str) -> str:
    """Write the range of counts with their noun, such as "3 to 5 recordings"."""
    low, high = int(counts.min()), int(counts.max())
    return counted(low, noun) if low == high else f"{low} to {high} {noun}s"


def described(window: str) -> str:
    """Say what a window is."""
    of_cycle = window.endswith("%")
    after = "of the perturbed gait cycle" if of_cycle else "after the onset of each perturbation"
    return WINDOWS.get(window, f"{window} {after}")


def plan_table(verdicts: Sequence[Verdict], design: Design) -> pd.DataFrame:
    """Tabulate the subjects that each comparison needs.

    Returns
    -------
    pandas.DataFrame
        axis, unit, condition; reference: its mean residual; difference and sd: mean and standard
        deviation of the differences from it; margin; n; needed and needed_as_observed, with as
        many recordings, empty beyond 1000 subjects or where the difference observed exceeds the
        margin; where recordings are repeated, needed_with_1 to needed_with_10 per condition.
    """
    table = pd.DataFrame(verdicts, columns=[field.name for field in fields(Verdict)])
    table = table.rename(columns={"baseline": "reference"})
    columns = ["axis", "unit", "condition", "reference", "difference", "sd", "margin", "n"]
    counts = ["needed", "needed_as_observed"]
    if any(verdict.needed_with for verdict in verdicts):
        for k, recordings in enumerate(PLANNED_RECORDINGS):
            counts.append(f"needed_with_{recordings}")
            table[counts[-1]] = [v.needed_with[k] if v.needed_with else None for v in verdicts]
    table = table.assign(margin=design.margin * table["reference"])
    return table[[*columns, *counts]].astype(dict.fromkeys(counts, "Int64"))


def plan_markdown(verdicts: Sequence[Verdict], design: Design) -> str:
    """Render the plan as Markdown, or say in one line why there is none.

    By conditions; where recordings are repeated, by recordings per condition.
    """
    most = max((v.n for v in verdicts), default=0)
    if not verdicts:
        return f'No plan: no planned pair is "CONDITION - {design.reference_cell}".\n'
    if most < MIN_SUBJECTS:
        return (
            f"No plan: the variance between subjects needs at least {MIN_SUBJECTS} who have a "
            f"condition and {design.reference_cell}, got {most}.\n"
        )
    if any(v.needed_with for v in verdicts):
        heads = ["Residual", "as recorded", *map(str, PLANNED_RECORDINGS)]
        rows = [
            [f"{v.axis}, {v.condition}", _planned(v, design)]
            + [_count(n) for n in v.needed_with]
            + ["–"] * (len(PLANNED_RECORDINGS) - len(v.needed_with))
            for v in verdicts
        ]
        by = ", by recordings per condition"
    else:
        conditions = design.in_order(v.condition for v in verdicts)
        cells = {(v.axis, v.condition): _planned(v, design) for v in verdicts}
        heads, by = ["Residual", *conditions], ""
        rows = [
            [axis, *(cells.get((axis, condition), "–") for condition in conditions)]
            for axis in dict.fromkeys(v.axis for v in verdicts)
        ]
    pairs = len(design.pairs)
    together = f" over {pairs} planned pairs" * (pairs > 1)
    return (
        f"{markdown_table(heads, rows)}\n\n"
        f"Subjects needed to show that a residual is {within_margin(design)}{by}, with\n"
        f"{100 * LIMITS.power:g} % power at {100 * CONFIDENCE:g} % simultaneous confidence"
        f"{together}, if the true difference is zero;\nin brackets, if it is the one observed (–: "
        f"that one exceeds the margin). From the variance between {most}\nsubjects, which is "
        "itself uncertain.\n"
    )


def _planned(verdict: Verdict, design: Design) -> str:
    """Give the subjects that a comparison needs, and in brackets with the difference observed."""
    if verdict.n < MIN_SUBJECTS:
        return "–"
    beyond = verdict.difference >= design.margin * verdict.baseline
    second = "–" if beyond else _count(verdict.needed_as_observed)
    return f"{_count(verdict.needed)} ({second})"


def _count(subjects: int | None) -> str:
    return f">{LIMITS.most_subjects}" if subjects is None else str(subjects)
