"""The thesis' Table III: residuals without and with compensation, and the planned pairs."""

from collections.abc import Hashable, Mapping, Sequence
from math import inf, isnan, nan
from textwrap import fill
from typing import Any, Final

import pandas as pd

from hbm.spelling import format_p, mean_sd
from pipeline.statistics.design import EXPERIMENT_3, Design
from pipeline.statistics.measurement import (
    Covariances,
    deviation,
    half_interval,
    mean_covariance,
)

DIFFERENCES: Final = (
    ("no_ic_minus_baseline_no_ic", False, False),
    ("ic_minus_baseline_no_ic", True, False),
    ("ic_minus_baseline_ic", True, True),
)
"""Name of the column; whether the condition is compensated, and the reference."""
MEASUREMENT: Final = "measurement_sd_"


def reduction_percent(uncompensated: float, compensated: float) -> float:
    """Give the reduction of a residual by compensation, 100 · (1 − IC / no IC) [%].

    Negative where the residual increases; NaN where it is zero without compensation.
    """
    return 100 * (1 - compensated / uncompensated) if uncompensated > 0 else nan


def table_3(
    residuals: pd.DataFrame,
    statistics: pd.DataFrame,
    design: Design = EXPERIMENT_3,
    measurement: Covariances | None = None,
) -> pd.DataFrame:
    """Arrange the residuals and the planned comparisons as the thesis' Table III.

    Parameters
    ----------
    residuals
        Long table of RMS residuals, as `pipeline.statistics.comparison.statistics` takes it.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for it.
    design
        The design that it was computed for.
    measurement
        Covariances of the residuals by errors of measurement, if they are known.

    Returns
    -------
    pandas.DataFrame
        One row per residual and condition, where "baseline" is the design's reference and NaN
        what the design has not:

        - `axis`, `unit`, `condition`, `n` subjects, and those `without` one of the row's cells;
        - `mean_no_ic`, `sd_no_ic`, `mean_ic`, `sd_ic` over subjects;
        - `no_ic_minus_baseline_no_ic`, `ic_minus_baseline_no_ic` and `ic_minus_baseline_ic`, mean
          differences;
        - `reduction_percent`, of the means;
        - p-values with the design's correction, paired t and exact Wilcoxon, of IC against no IC
          (`p_t`, `p_wilcoxon`) and against the baseline without IC (`p_t_baseline`,
          `p_wilcoxon_baseline`; without compensation, of the condition against the baseline);
        - with `measurement`, one standard deviation of each mean and difference by errors of
          measurement: its name with `measurement_sd_` before it.

    Notes
    -----
    Means are over the subjects who have all cells of a row, n of them; a difference from the
    baseline is over those who have both of its cells.

    Deviations from the original: the thesis' column "IC − Base no IC" holds differences from the
    baseline *with* compensation; both are here. Its non-parametric p-values are asymptotic.
    """
    rows: list[dict[str, object]] = []
    for (axis, unit), group in residuals.groupby(["axis", "unit"], sort=False):
        rms = group.pivot(index="subject", columns=["compensated", "condition"], values="rms")
        rms = rms.reindex(columns=pd.MultiIndex.from_product([[False, True], design.conditions]))
        tests = statistics[statistics["axis"] == axis]
        corrected = tests["correction"].astype(str).str.lower().str.startswith(design.correction)
        for condition in design.conditions:
            complete = rms[[(variant, condition) for variant in design.variants]].dropna().index
            no_ic, ic = rms[False, condition][complete], rms[True, condition][complete]
            row = {
                "axis": axis,
                "unit": unit,
                "condition": condition,
                "n": len(complete),
                "without": ", ".join(map(str, rms.index.difference(complete))),
                "mean_no_ic": no_ic.mean(),
                "sd_no_ic": no_ic.std(),
                "mean_ic": ic.mean(),
                "sd_ic": ic.std(),
            }
            for name, first, second in DIFFERENCES:
                difference = rms[first, condition] - rms[second, design.reference]
                row[name] = nan if condition == design.reference else difference.mean()
            row["reduction_percent"] = reduction_percent(no_ic.mean(), ic.mean())
            no_ic_cell, judged = design.cell(condition, False), design.judged(condition)
            pairs = {"": f"{judged} - {no_ic_cell}", "_baseline": ""}
            if condition != design.reference:
                pairs["_baseline"] = f"{judged} - {design.reference_cell}"
            for test, name in (("paired t", "p_t"), ("Wilcoxon exact", "p_wilcoxon")):
                p = tests[(tests["test"] == test) & corrected].set_index("effect")["p_corrected"]
                for suffix, pair in pairs.items():
                    row[name + suffix] = p.get(pair, nan)
            if measurement is not None:
                row |= _measurement_sds(measurement[str(axis)], rms, complete, condition, design)
            rows.append(row)
    return pd.DataFrame(rows)


def _measurement_sds(
    covariance: pd.DataFrame, rms: pd.DataFrame, complete: pd.Index, condition: str, design: Design
) -> dict[str, float]:
    """Give the standard deviations by errors of measurement of a row's means and differences."""

    def sd(table: pd.DataFrame, *cells: tuple[str, bool]) -> float:
        subjects = table[[(ic, name) for name, ic in cells]].dropna().index
        if not len(subjects):
            return nan
        return deviation(mean_covariance(covariance, subjects, cells), (1.0, -1.0)[: len(cells)])

    variants = {"mean_no_ic": False, "mean_ic": True}
    sds = {name: sd(rms.loc[complete], (condition, ic)) for name, ic in variants.items()}
    for name, first, second in DIFFERENCES:
        of_two = sd(rms, (condition, first), (design.reference, second))
        sds[name] = nan if condition == design.reference else of_two
    return {f"{MEASUREMENT}{name}": value for name, value in sds.items()}


Column = tuple[str, list[str]]
"""A column of Table III as it is printed: its head and its text in every row."""


def printed_columns(table: pd.DataFrame, design: Design) -> list[Column]:
    """Give the columns of `table_3` that a design has, as text.

    The first names the residual, in the row of its first condition only.
    """
    reference, rows = design.reference, table.to_dict("records")
    first = design.conditions[0]
    no_ic, minus = ("No IC", "IC − ") if design.compensated else ("RMS", "− ")
    unless = f"{reference} (no IC)" if design.compensated else reference
    heads = {
        "mean_no_ic": no_ic,
        "mean_ic": "IC",
        "no_ic_minus_baseline_no_ic": f"− {reference}",
        "ic_minus_baseline_no_ic": f"IC − {reference} (no IC)",
        "ic_minus_baseline_ic": f"IC − {reference} (IC)",
        "reduction_percent": "Reduction",
        "p_t": "t: IC − no IC",
        "p_t_baseline": f"t: {minus}{unless}",
        "p_wilcoxon": "Wilcoxon: IC − no IC",
        "p_wilcoxon_baseline": f"Wilcoxon: {minus}{unless}",
    }
    # columns of the other kind of study: as measured alone, or with compensation
    left_out = {
        *("mean_ic", "ic_minus_baseline_no_ic", "ic_minus_baseline_ic", "reduction_percent"),
        *("p_t", "p_wilcoxon"),
    }
    if design.compensated:
        left_out = {"no_ic_minus_baseline_no_ic"}
    names = [f"{r['axis']} ({r['unit']})" if r["condition"] == first else "" for r in rows]
    return [
        ("Residual", names),
        (design.factor.capitalize(), [row["condition"] for row in rows]),
        ("n", [str(row["n"]) for row in rows]),
        *(
            (head, [_printed(row, name) for row in rows])
            for name, head in heads.items()
            if name not in left_out
        ),
    ]


def _printed(row: Mapping[Hashable, Any], name: str) -> str:
    """Write a number of Table III, with its 95 % interval of measurement where that is known."""
    if name.startswith("p_"):
        return format_p(row[name])
    if name == "reduction_percent":
        return number(row[name], "z.0f", " %")
    is_mean = name.startswith("mean_")
    form, lowest = (".1f", 0.0) if is_mean else ("+z.1f", -inf)
    text = mean_sd(row[name], row[f"sd_{name[5:]}"]) if is_mean else number(row[name], form)
    # an RMS is not negative, however uncertain; a difference may be
    half = half_interval(row.get(f"{MEASUREMENT}{name}", nan))

    if isnan(half):
        return text
    low, high = max(row[name] - half, lowest), row[name] + half
    return f"{text} [{number(low, form)}, {number(high, form)}]"


def table_3_legend(table: pd.DataFrame, design: Design) -> str:
    """Explain the columns of Table III, and name subjects without a cell."""
    incomplete = {
        f"{row['condition']} without {row['without']}."
        for row in table.to_dict("records")
        if row["without"]
    }
    parts = ["Root mean square residuals, mean ± standard deviation over n subjects"]
    if design.compensated:
        parts[0] += (
            ", without and with inertia compensation (IC). Differences are from "
            f"{design.reference} without and with compensation, as labelled; reduction is "
            "100 · (1 − IC / no IC)"
        )
    if any(str(name).startswith(MEASUREMENT) for name in table):
        parts.append(
            "In brackets the 95 % interval of measurement: what errors of usual size change the "
            "value by, those shared by trials included"
        )
    corrected = ""
    if len(design.pairs) > 1:
        correction = design.correction.capitalize()
        corrected = f", {correction}-corrected for {len(design.pairs)} planned pairs"
    tests = "paired t-test and exact Wilcoxon signed-rank test"
    parts.append(f"p-values: {tests}{corrected}; * p < .05")
    return " ".join([*(f"{part}." for part in parts), *sorted(incomplete)])


def table_3_markdown(table: pd.DataFrame, design: Design = EXPERIMENT_3) -> str:
    """Render `table_3` as Markdown, with a legend below."""
    heads, cells = zip(*printed_columns(table, design), strict=True)
    lines = markdown_table(heads, list(zip(*cells, strict=True)))
    return f"{lines}\n\n{fill(table_3_legend(table, design), 100)}\n"


def markdown_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Render texts as a table in Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in (heads, ["---"] * len(heads), *rows))


def number(value: float, form: str, unit: str = "") -> str:
    """Format a number with a true minus sign; a dash for NaN."""
    return "–" if isnan(value) else f"{value:{form}}{unit}".replace("-", "−")
