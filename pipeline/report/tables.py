"""Tables of residuals for the page of a report."""

from collections.abc import Hashable, Mapping
from math import isnan
from typing import Any
from xml.etree.ElementTree import Element

import pandas as pd

from pipeline.report.markup import element, table
from pipeline.statistics.design import CONDITIONS, in_order
from pipeline.statistics.table_3 import format_p, reduction_percent


def table_3_table(rows: pd.DataFrame) -> Element:
    """Lay out `pipeline.statistics.table_3.table_3` as in the thesis.

    Parameters
    ----------
    rows
        Table III.

    Returns
    -------
    xml.etree.ElementTree.Element
        Tables and notes.
    """
    heads = (
        *("Residual", "Condition", "n", "No IC", "IC", "IC − base (no IC)", "IC − base (IC)"),
        *("Reduction", "t: IC − no IC", "t: IC − base", "W: IC − no IC", "W: IC − base"),
    )
    records = rows.to_dict("records")
    body = [_row(row) for row in records]
    without = {f"{row['condition']} without {row['without']}" for row in records if row["without"]}
    note = (
        "IC: with inertia compensation. Differences are from the baseline without and with IC; "
        "reduction is 100 · (1 − IC / no IC). t, W: p-values of paired t-test and exact Wilcoxon "
        "signed-rank test, Bonferroni-corrected for five planned pairs, base without IC; "
        f"* p < 0.05. {'. '.join(sorted(without))}{'.' * bool(without)}"
    )
    caption = "Table III. RMS residuals, mean ± SD over n subjects"
    shown = table(heads, body, caption=caption, class_="numbers table3")
    return element("div", shown, element("p", note, class_="small soft"))


def _row(row: Mapping[Hashable, Any]) -> list[str]:
    return [
        f"{row['axis']} ({row['unit']})" if row["condition"] == CONDITIONS[0] else "",
        row["condition"],
        str(row["n"]),
        mean_sd(row["mean_no_ic"], row["sd_no_ic"]),
        mean_sd(row["mean_ic"], row["sd_ic"]),
        number(row["ic_minus_baseline_no_ic"], "+z.1f"),
        number(row["ic_minus_baseline_ic"], "+z.1f"),
        number(row["reduction_percent"], "z.0f", " %"),
        *(format_p(row[p]) for p in ("p_t", "p_t_baseline", "p_wilcoxon", "p_wilcoxon_baseline")),
    ]


def means_table(residuals: pd.DataFrame) -> Element:
    """Give mean and SD of every cell there is, whatever the conditions are called.

    Parameters
    ----------
    residuals
        Long table of RMS residuals.

    Returns
    -------
    xml.etree.ElementTree.Element
        The table.
    """
    rows = []
    for (axis, unit), own in residuals.groupby(["axis", "unit"], sort=False):
        for k, condition in enumerate(in_order(own["condition"])):
            cells = own[own["condition"] == condition].groupby("compensated")["rms"]
            mean, sd, count = cells.mean(), cells.std(), cells.count()
            no_ic, ic = mean.get(False, float("nan")), mean.get(True, float("nan"))
            rows.append(
                [
                    "" if k else f"{axis} ({unit})",
                    condition,
                    str(count.max()),
                    mean_sd(no_ic, sd.get(False, float("nan"))),
                    mean_sd(ic, sd.get(True, float("nan"))),
                    number(reduction_percent(no_ic, ic), "z.0f", " %"),
                ]
            )
    heads = ("Residual", "Condition", "n", "No IC", "IC", "Reduction")
    caption = "RMS residuals without and with inertia compensation (IC), mean ± SD over n subjects"
    return table(heads, rows, caption=caption, class_="numbers")


def mean_sd(mean: float, sd: float) -> str:
    """Write "mean ± SD", a dash where there is no mean, no SD where there is but one value."""
    return number(mean, ".1f") + ("" if isnan(sd) else f" ± {sd:.1f}")


def number(value: float, form: str, unit: str = "") -> str:
    """Write a number with a true minus sign; a dash for NaN."""
    return "–" if isnan(value) else f"{value:{form}}{unit}".replace("-", "−")
