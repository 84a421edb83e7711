"""Tables for the page of a report: what they show, as text."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import nan
from types import MappingProxyType

import pandas as pd

from pipeline.statistics.design import Design
from pipeline.statistics.table_3 import (
    mean_sd,
    number,
    printed_columns,
    reduction_percent,
    table_3_legend,
)


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


def residual_tables(
    residuals: pd.DataFrame,
    table_3: pd.DataFrame,
    design: Design,
    groups: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Table, ...]:
    """Give the tables of residuals: Table III, means where it does not hold them all, and groups.

    Parameters
    ----------
    residuals
        Long table of RMS residuals.
    table_3
        The table that `pipeline.statistics.table_3.table_3` made of it.
    design
        The design that it was made for.
    groups
        Subject -> group, where the design has groups.

    Returns
    -------
    tuple of Table
        Table III, the means, or both, and the means of every group.
    """
    has_table_3 = bool(table_3["n"].gt(0).any())
    shown = [_table_3(table_3, design)] if has_table_3 else []
    if not has_table_3 or set(residuals["condition"]) - set(design.conditions):
        shown.append(_means(residuals, design))
    group = residuals["subject"].map(groups)
    for name in sorted(set(groups.values())):
        of_group = _means(residuals[group == name], design)
        shown.append(replace(of_group, caption=f"{design.group} {name}. {of_group.caption}"))
    return tuple(shown)


def _table_3(table_3: pd.DataFrame, design: Design) -> Table:
    heads, columns = zip(*printed_columns(table_3, design), strict=True)
    in_two_lines = ([cell.replace(" [", "\n[") for cell in own] for own in columns)
    rows = tuple(zip(*in_two_lines, strict=True))
    caption = "Table III. RMS residuals, mean ± SD over n subjects"
    return Table(caption, heads, rows, "numbers table3", table_3_legend(table_3, design))


def _means(residuals: pd.DataFrame, design: Design) -> Table:
    """Give mean and SD of every cell, for conditions of any name."""
    rows = []
    for (axis, unit), own in residuals.groupby(["axis", "unit"], sort=False):
        for k, condition in enumerate(design.in_order(own["condition"])):
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
