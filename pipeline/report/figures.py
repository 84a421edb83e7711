"""Figures of a study: gait cycles over subjects, marginal means, one subject's raw residuals."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from pipeline.figures.residuals import axis_name, name_panels
from pipeline.figures.style import COLOURS, STYLE, draw_band
from pipeline.run.load import Results
from pipeline.statistics.design import CONDITIONS, in_order
from pipeline.statistics.table_3 import format_p
from pipeline.trial.residuals import AXES, UNITS

BASELINE: Final = CONDITIONS[0]
LATERAL: Final = ("Fy", "Mx", "Mz")
"""Residuals that change sign in a mirror image in the sagittal plane."""
VARIANTS: Final = {False: ("no IC", "measured", "--"), True: ("IC", "compensated", "-")}
"""Compensated -> name, its colour, line style."""


def study_figures(results: Results, statistics: pd.DataFrame) -> Iterator[tuple[str, Figure]]:
    """Draw every figure of a study's report.

    Parameters
    ----------
    results
        What `hbm run` left.
    statistics
        What `pipeline.statistics.comparison.statistics` made of it.

    Yields
    ------
    name, figure
        ``gait_cycle_CONDITION`` (as the thesis' Figs 6 and 7), ``marginal_means`` (F.8–F.13) and
        ``raw_AXIS`` (F.14–F.19).
    """
    for condition in drawn_conditions(results.residuals):
        yield f"gait_cycle_{condition}", gait_cycle_figure(results.cycles, condition)
    yield "marginal_means", marginal_means_figure(results.residuals, statistics)
    subject = example_subject(results.residuals)
    spans = {c: trial.cycles for (s, c), trial in results.summaries.items() if s == subject}
    own = results.cycles[results.cycles["subject"] == subject]
    for axis in AXES:
        yield f"raw_{axis}", raw_figure(own, spans, axis)


def drawn_conditions(residuals: pd.DataFrame) -> list[str]:
    """Give the conditions that have a figure of their own: all but the baseline they show too."""
    conditions = in_order(residuals["condition"])
    return [name for name in conditions if name != BASELINE] or conditions


def example_subject(residuals: pd.DataFrame) -> str:
    """Give the subject with most cells, the first of equals, whose raw residuals are drawn."""
    return str(residuals.groupby("subject", sort=True).size().idxmax())


def gait_cycle_figure(cycles: pd.DataFrame, condition: str) -> Figure:
    """Draw a condition's residuals over the gait cycle with and without compensation.

    Parameters
    ----------
    cycles
        As `pipeline.run.load.Results.cycles`.
    condition
        Which condition; the baseline is drawn beside it.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels: mean ± SD over subjects of each subject's mean cycle; of a single subject, over
        the cycles. Cycles of the left foot are mirrored, or lateral residuals would cancel.
    """
    shown = cycles[cycles["condition"].isin((BASELINE, condition))]
    mirrored = (shown["side"] == "left") & shown["axis"].isin(LATERAL)
    shown = shown.assign(value=shown["value"].where(~mirrored, -shown["value"]))
    counts = shown.groupby("condition")["subject"].nunique()
    one = counts.max() == 1
    unit = ["subject", "side", "cycle"] if one else ["subject"]
    keys = ["condition", "compensated", "axis", "percent"]
    values = shown.groupby([*keys, *unit], sort=False)["value"].mean().groupby(keys)
    mean, sd = values.mean(), values.std()
    percent = np.arange(101.0)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 5.6), layout="constrained")
        panels = figure.subplots(2, 3, sharex=True).ravel()
        drawn = [(name, compensated) for name in in_order(counts.index) for compensated in VARIANTS]
        for name, compensated in drawn:
            if (name, compensated) not in mean.index:
                continue
            said, variant, style = VARIANTS[compensated]
            colour = COLOURS[variant if name == condition else "baseline"]
            line: dict[str, Any] = {"label": f"{name}, {said}", "ls": style}
            if name != condition and compensated:
                line |= {"lw": 1, "ls": ":"}
            for k, panel in enumerate(panels):
                at = (name, compensated, AXES[k])
                middle, spread = np.asarray(mean[at]), np.asarray(sd[at])
                draw_band(panel, percent, middle, spread, colour, **line)
        name_panels(panels)
        figure.legend(*panels[0].get_legend_handles_labels(), **_BELOW)
        over = "gait cycles of one subject" if one else f"{counts[condition]} subjects"
        figure.suptitle(f"Pelvis residuals, {condition}: mean ± SD over {over}", fontsize=11)
    return figure


_BELOW: Final[Any] = {"loc": "outside lower center", "ncols": 4, "frameon": False}


def marginal_means_figure(residuals: pd.DataFrame, statistics: pd.DataFrame) -> Figure:
    """Draw the mean RMS residual of every cell, to see whether compensation acts by condition.

    Parameters
    ----------
    residuals
        Long table of RMS residuals.
    statistics
        What `pipeline.statistics.comparison.statistics` made of it, for the interaction's p-value.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels: means and 95 % confidence intervals over the subjects who have all cells (over
        all, where nobody has), each subject as a thin line.
    """
    conditions = in_order(residuals["condition"])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 5.6), layout="constrained")
        panels = figure.subplots(2, 3, sharex=True).ravel()
        for k, panel in enumerate(panels):
            own = residuals[residuals["axis"] == AXES[k]]
            cells = own.pivot(index="subject", columns=["compensated", "condition"], values="rms")
            if not cells.dropna().empty:
                cells = cells.dropna()
            for compensated in sorted(own["compensated"].unique()):
                rms = cells[compensated].reindex(columns=conditions)
                _draw_means(panel, rms, VARIANTS[compensated])
            panel.set_title(axis_name(k), loc="left")
            panel.set_title(_interaction(statistics, AXES[k]), loc="right", fontsize=8)
            panel.set_ylabel(f"RMS ({UNITS[k]})")
            panel.set_ylim(bottom=0)
            panel.set_xticks(range(len(conditions)), conditions)
            panel.set_xlim(-0.3, len(conditions) - 0.7)
        figure.legend(*panels[0].get_legend_handles_labels(), **_BELOW)
        title = f"RMS residuals, mean and 95 % CI over {len(cells)} subjects"
        figure.suptitle(title, fontsize=11)
    return figure


def _draw_means(panel: Axes, rms: pd.DataFrame, variant: tuple[str, str, str]) -> None:
    name, colour, style = variant[0], COLOURS[variant[1]], variant[2]
    n = rms.count()
    half = stats.t.isf(0.025, (n - 1).clip(lower=1)) * rms.std() / np.sqrt(n)
    x = np.arange(len(rms.columns)) + (0.05 if style == "-" else -0.05)
    panel.plot(x, rms.to_numpy().T, color=colour, lw=0.6, alpha=0.3)
    panel.errorbar(
        *(x, rms.mean()),
        yerr=half.fillna(0),
        color=colour,
        ls=style,
        marker="o" if style == "-" else "s",
        ms=4,
        capsize=3,
        label=name,
    )


def _interaction(statistics: pd.DataFrame, axis: str) -> str:
    row = statistics[
        (statistics["test"] == "RM-ANOVA")
        & (statistics["effect"] == "IC:condition")
        & (statistics["axis"] == axis)
    ]
    p = row["p_corrected"].dropna()
    if p.empty:
        return ""
    written = format_p(float(p.iloc[0]))
    return f"interaction p {written if written.startswith('<') else f'= {written}'}"


def raw_figure(
    cycles: pd.DataFrame, spans: Mapping[str, Mapping[str, Sequence[Sequence[float]]]], axis: str
) -> Figure:
    """Draw one residual of one subject, cycle after cycle, for every condition.

    Parameters
    ----------
    cycles
        One subject's gait cycles, as `pipeline.run.load.Results.cycles`.
    spans
        Condition -> side -> start and stop of each cycle [s], which put both sides in order.
    axis
        Which residual.

    Returns
    -------
    matplotlib.figure.Figure
        One panel per condition, with and without compensation, as recorded (nothing mirrored).
    """
    own = cycles[cycles["axis"] == axis]
    conditions = in_order(own["condition"])
    k = AXES.index(axis)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 1.2 + 1.4 * len(conditions)), layout="constrained")
        panels = figure.subplots(len(conditions), 1, squeeze=False)[:, 0]
        for condition, panel in zip(conditions, panels, strict=True):
            for compensated, trial in own[own["condition"] == condition].groupby("compensated"):
                name, variant, _ = VARIANTS[bool(compensated)]
                keys = [(s, c) for s, at in spans[condition].items() for c in range(len(at))]
                keys.sort(key=lambda key: spans[condition][key[0]][key[1]][0])
                curves = trial.pivot(index=["side", "cycle"], columns="percent", values="value")
                values = curves.loc[keys].to_numpy()
                x = np.arange(len(values))[:, None] + curves.columns.to_numpy() / 100
                panel.plot(
                    x.ravel(), values.ravel(), color=COLOURS[variant], lw=0.7, label=name, zorder=2
                )
            panel.axhline(0, color="black", lw=0.5)
            panel.set_title(condition, loc="left")
            panel.set_ylabel(UNITS[k])
            panel.margins(x=0)
        panels[-1].set_xlabel("gait cycles that count, one after another")
        figure.legend(*panels[0].get_legend_handles_labels(), **_BELOW)
        who = own["subject"].iloc[0]
        figure.suptitle(f"Residual {axis_name(k)} of {who}, every cycle", fontsize=11)
    return figure
