"""Tables for the page of a report: what they show, as text."""

from dataclasses import dataclass
from math import isnan, nan

import pandas as pd

from pipeline.statistics.design import CONDITIONS, in_order
from pipeline.statistics.table_3 import format_p, reduction_percent

P_VALUES = ("p_t", "p_t_baseline", "p_wilcoxon", "p_wilcoxon_baseline")


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts.

    Attributes
    ----------
    caption
        What it shows.
    heads
        Heads of the columns; the first column names the rows.
    rows
        Cells, one per head.
    css_class
        Classes in the style sheet.
    legend
        Explanation below the table.
    """

    caption: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    css_class: str = ""
    legend: str = ""


def residual_tables(residuals: pd.DataFrame, table_3: pd.DataFrame) -> tuple[Table, ...]:
    """Give the tables of residuals: Table III, and the means where it does not hold them all.

    Parameters
    ----------
    residuals
        Long table of RMS residuals.
    table_3
        The table that `pipeline.statistics.table_3.table_3` made of it.

    Returns
    -------
    tuple of Table
        One or two tables.
    """
    has_table_3 = bool(table_3["n"].gt(0).any())
    shown = [_table_3(table_3)] if has_table_3 else []
    if not has_table_3 or set(residuals["condition"]) - set(CONDITIONS):
        shown.append(_means(residuals))
    return tuple(shown)


def _table_3(table_3: pd.DataFrame) -> Table:
    heads = (
        *("Residual", "Condition", "n", "No IC", "IC", "IC − base (no IC)", "IC − base (IC)"),
        *("Reduction", "t: IC − no IC", "t: IC − base", "W: IC − no IC", "W: IC − base"),
    )
    records = table_3.to_dict("records")
    rows = tuple(
        (
            f"{row['axis']} ({row['unit']})" if row["condition"] == CONDITIONS[0] else "",
            row["condition"],
            str(row["n"]),
            mean_sd(row["mean_no_ic"], row["sd_no_ic"]),
            mean_sd(row["mean_ic"], row["sd_ic"]),
            number(row["ic_minus_baseline_no_ic"], "+z.1f"),
            number(row["ic_minus_baseline_ic"], "+z.1f"),
            number(row["reduction_percent"], "z.0f", " %"),
            *(format_p(row[name]) for name in P_VALUES),
        )
        for row in records
    )
    incomplete = {
        f"{row['condition']} without {row['without']}." for row in records if row["without"]
    }
    legend = (
        "IC: with inertia compensation. Differences are from the baseline without and with IC; "
        "reduction is 100 · (1 − IC / no IC). t, W: p-values of the paired t-test and the exact "
        "Wilcoxon signed-rank test, Bonferroni-corrected for five planned pairs; base: without IC; "
        f"* p < 0.05. {' '.join(sorted(incomplete))}"
    )
    caption = "Table III. RMS residuals, mean ± SD over n subjects"
    return Table(caption, heads, rows, "numbers table3", legend)


def _means(residuals: pd.DataFrame) -> Table:
    """Give mean and SD of every cell, for conditions of any name."""
    rows = []
    for (axis, unit), own in residuals.groupby(["axis", "unit"], sort=False):
        for k, condition in enumerate(in_order(own["condition"])):
            cells = own[own["condition"] == condition].groupby("compensated")["rms"]
            mean, sd, count = cells.mean(), cells.std(), cells.count()
            no_ic, ic = mean.get(False, nan), mean.get(True, nan)
            rows.append(
                (
                    "" if k else f"{axis} ({unit})",
                    condition,
                    str(count.max()),
                    mean_sd(no_ic, sd.get(False, nan)),
                    mean_sd(ic, sd.get(True, nan)),
                    number(reduction_percent(no_ic, ic), "z.0f", " %"),
                )
            )
    heads = ("Residual", "Condition", "n", "No IC", "IC", "Reduction")
    caption = "RMS residuals without and with inertia compensation (IC), mean ± SD over n subjects"
    return Table(caption, heads, tuple(rows), "numbers")


def mean_sd(mean: float, sd: float) -> str:
    """Format "mean ± SD": a dash without a mean, no SD of a single value."""
    return number(mean, ".1f") + ("" if isnan(sd) else f" ± {sd:.1f}")


def number(value: float, form: str, unit: str = "") -> str:
    """Format a number with a true minus sign; a dash for NaN."""
    return "–" if isnan(value) else f"{value:{form}}{unit}".replace("-", "−")
