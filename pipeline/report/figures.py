"""Figures of a study: gait cycles over subjects, and marginal means."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, count
from math import nan
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
import scipy
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from hbm.spatial import Array
from hbm.spelling import p_equation
from pipeline.config.schema import Figures
from pipeline.figures.residuals import (
    SIX_PANELS_INCH,
    axis_label,
    legend_below,
    mean_part,
    panel_grid,
)
from pipeline.figures.style import (
    COLOURS,
    LINES,
    PAGE,
    add_title,
    condition_style,
    draw_band,
    draw_differences,
    draw_logarithmic,
    in_style,
    letters_in,
)
from pipeline.report.tables import numbers
from pipeline.run.load import Curves, Results
from pipeline.statistics.comparison import MIXED_ANOVA, RM_ANOVA
from pipeline.statistics.curves import ComparedCurves, CurveComparison, CurveDifference
from pipeline.statistics.design import TAIL, Design, Weigh
from pipeline.statistics.recordings import subject_means
from pipeline.trial.residuals import AXES

DIFFERENCE: Final = COLOURS["compensated"]
"""Colour of differences of curves."""
OFFSET: Final = 0.05
"""Shift of the means of both variants against each other, in steps of conditions."""


class Variant(NamedTuple):
    """How residuals without or with inertia compensation (IC) are drawn."""

    label: str
    colour: str
    line: str
    marker: str
    offset: float


VARIANTS: Final = {
    False: Variant("no IC", COLOURS["measured"], LINES["measured"], "s", -OFFSET),
    True: Variant("IC", COLOURS["compensated"], LINES["compensated"], "o", OFFSET),
}


def study_figures(
    results: Results,
    over_cycles: pd.DataFrame,
    statistics: pd.DataFrame,
    design: Design,
    compared: ComparedCurves,
) -> Iterator[tuple[str, Callable[..., Figure]]]:
    """Give every figure of a study's report, to be drawn in any process.

    Parameters
    ----------
    results
        What `hbm run` left.
    over_cycles
        As `rms_over_cycles` gives them.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for them.
    design
        The design that it was computed for.
    compared
        As `pipeline.report.curves.compared_curves` gives them.

    Yields
    ------
    name, draw
        ``gait_cycle_CONDITION`` where there are gait cycles, ``difference_COMPARED`` of enough
        subjects, and ``marginal_means`` (as the thesis' Figs F.8–F.13).
    """
    for condition in drawn_conditions(over_cycles, design):
        grey = mean_part(t for t in results.trials.values() if t.condition == condition)
        label = f"{design.judged(condition)} - {design.reference_cell}"
        differing = {axis: of.parts for axis in AXES if (of := compared.get((axis, label)))}
        shown = over_cycles[over_cycles["condition"].isin((design.reference, condition))]
        draw = partial(gait_cycle_figure, shown, condition, design, grey=grey, differing=differing)
        yield f"gait_cycle_{condition}", draw
    by_name = by_label(compared, AXES)
    for (label, of_curves), name in zip(by_name.items(), file_names(by_name), strict=True):
        yield f"difference_{name}", partial(difference_figure, of_curves, label)
    yield "marginal_means", partial(marginal_means_figure, results.residuals, statistics, design)


def by_label(
    compared: ComparedCurves, curves: Iterable[str]
) -> dict[str, dict[str, CurveComparison]]:
    """Give some of the curves by what is compared: label -> curve -> comparison."""
    of_labels = dict[str, dict[str, CurveComparison]]()
    for curve, label in compared:
        if curve in curves:
            of_labels.setdefault(label, {})[curve] = compared[curve, label]
    return of_labels


def file_names(labels: Iterable[str]) -> list[str]:
    """Give labels as different parts of files' names, such as sway_IC_-_baseline_no_IC."""
    names = list[str]()
    for label in labels:
        # a file's name has 255 bytes at most, with its number and suffix
        short = re.sub(r"[^\w.+-]+", "_", label).encode()[:200].decode(errors="ignore")
        taken = {name.casefold() for name in names}
        numbered = (f"{short}_{number}" for number in count(2))
        names.append(next(n for n in chain([short], numbered) if n.casefold() not in taken))
    return names


def difference_title(label: str, of_curves: Mapping[str, CurveComparison]) -> str:
    """Say what is compared, what the band is, and who entered, of groups in the label's order."""
    comparisons = list(of_curves.values())
    of_groups = zip(*(of.in_groups for of in comparisons), strict=True)
    people = " and ".join(numbers(pd.Series(counts), "subject") for counts in of_groups)
    recordings = numbers(pd.Series([of.recordings for of in comparisons]), "recording")
    bars = "; black bars: p below .05" * any(of.parts for of in comparisons)
    return f"{label}: difference ± simultaneous 95 % band, {people}, {recordings}{bars}"


def difference_figure(
    of_curves: Mapping[str, CurveComparison], label: str, *, look: Figures = PAGE
) -> Figure:
    """Draw what the residuals of two cells differ by over the gait cycle.

    Parameters
    ----------
    of_curves
        Axis -> comparison.
    label
        What is compared.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels: difference with its simultaneous 95 % band, and bars where p is below 0.05.
    """
    with in_style(look):
        figure, grid = panel_grid(2, 3, SIX_PANELS_INCH, look)
        grid[0, 0].set_xlim(0, 100)
        for k, panel in enumerate(grid.flat):
            of = of_curves.get(AXES[k])
            panel.axhline(0, color="black", lw=0.5)
            panel.set_xlabel("gait cycle (%)")
            panel.set_ylabel(f"RMS {axis_label(k)}")
            if of is not None:
                percent = np.linspace(0, 100, len(of.difference))
                draw_band(panel, percent, of.difference, of.high - of.difference, DIFFERENCE)
                draw_differences(panel, of.parts)
        add_title(figure, f"Pelvis residuals, {difference_title(label, of_curves)}", look)
    return figure


def drawn_conditions(cycles: pd.DataFrame, design: Design) -> list[str]:
    """Give conditions with gait cycles of their own: all but the reference, which is in each."""
    conditions = design.in_order(cycles["condition"].unique())
    return [name for name in conditions if name != design.reference] or conditions


def rms_over_cycles(cycles: Curves, weigh: Weigh, *, within: Sequence[str] = ()) -> pd.DataFrame:
    """Give each subject's RMS over gait cycles at every percent of the cycle.

    Its root mean square over the percent of a window is the subject's RMS in the table of
    residuals. A mean would not be: what changes sign from cycle to cycle cancels in it.

    Parameters
    ----------
    cycles
        Those of ``cycles.parquet``.
    weigh
        Whether each gait cycle or each recording is equal.
    within
        Columns, such as recording, of which each value has its own.

    Returns
    -------
    pandas.DataFrame
        subject, condition, compensated, axis, those within, percent, value [N, N·m]; NaN where none
        counts.
    """
    parts = []
    for axis in AXES:
        curves = cycles.read(axis=axis)
        curves["value"] **= 2
        means = subject_means(curves, ["value"], weigh, within=["axis", *within]).reset_index()
        parts.append(means.assign(value=np.sqrt(means["value"])))
    return pd.concat(parts, ignore_index=True)


def gait_cycle_figure(
    curves: pd.DataFrame,
    condition: str,
    design: Design,
    *,
    grey: tuple[float, float] | None = None,
    differing: Mapping[str, Sequence[CurveDifference]] = MappingProxyType({}),
    look: Figures = PAGE,
) -> Figure:
    """Draw a condition's residuals over the gait cycle with and without compensation.

    Parameters
    ----------
    curves
        As `rms_over_cycles` gives them.
    condition
        The condition; the reference is drawn with it.
    design
        The reference, and the order of the conditions.
    grey
        Start and stop of the part that counts [% of the cycle], drawn as a grey band.
    differing
        Axis -> parts of the cycle in which the condition differs from the reference, drawn as bars.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels: mean over subjects of the RMS over gait cycles at each percent, on logarithmic
        axes, ± SD of the two cells that are compared. Colours and line styles mean compensation
        and thin lines the reference; without compensation, colours and line styles conditions.
    """
    shown = curves[curves["condition"].isin((design.reference, condition))]
    keys = ["condition", "compensated", "axis", "percent"]
    of_subjects = shown.groupby(keys, observed=True)["value"]
    mean, sd = of_subjects.mean().unstack("percent"), of_subjects.std().unstack("percent")
    percent = mean.columns.to_numpy(float)
    order = design.in_order(curves["condition"].cat.categories)
    cells = sorted({key[:2] for key in mean.index}, key=lambda c: (c[1], order.index(c[0])))
    with in_style(look):
        figure, grid = panel_grid(2, 3, SIX_PANELS_INCH, look)
        grid[0, 0].set_xlim(0, 100)  # of all: each curve would find it anew from all panels
        for name, compensated in cells:
            (colour, style), width = condition_style(order.index(name)), 1.0
            if design.compensated:
                colour, style = VARIANTS[compensated].colour, VARIANTS[compensated].line
                width = 0.5 if name != condition else 1.25
            cell = design.cell(name, compensated)
            compared = cell in (design.judged(condition), design.reference_cell)
            width *= mpl.rcParams["lines.linewidth"]
            for axis, panel in zip(AXES, grid.flat, strict=True):
                key = name, compensated, axis
                band = mean.xs(key).to_numpy(), sd.xs(key).to_numpy() * (1 if compared else nan)
                draw_band(panel, percent, *band, colour, label=cell, ls=style, lw=width)
        for k, (axis, panel) in enumerate(zip(AXES, grid.flat, strict=True)):
            if grey is not None:
                panel.axvspan(*grey, color="#BBBBBB", alpha=0.4, lw=0, zorder=0)
            draw_logarithmic(panel, mean.xs(axis, level="axis").to_numpy())
            panel.set_xlabel("gait cycle (%)")
            panel.set_ylabel(f"RMS {axis_label(k)}")
            draw_differences(panel, differing.get(axis, ()))
        legend_below(figure, grid[0, 0])
        counts = shown.groupby("condition", observed=True)["subject"].nunique()
        over = f", mean ± SD over {numbers(counts, 'subject')}"
        over = over if counts.max() > 1 else " of one subject"
        title = f"Pelvis residuals, {condition}: RMS over gait cycles{over}"
        title += "; grey: the part that is used" * (grey is not None)
        pair = f"{design.judged(condition)} differs from {design.reference_cell}"
        add_title(figure, title + f"; black bars: {pair}" * any(differing.values()), look)
    return figure


def marginal_means_figure(
    residuals: pd.DataFrame, statistics: pd.DataFrame, design: Design, *, look: Figures = PAGE
) -> Figure:
    """Draw the mean RMS residual of every cell, to show an interaction with the condition.

    Parameters
    ----------
    residuals
        Long table of RMS residuals.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for it, for the
        p-value of the interaction, or of the condition where there is no compensation.
    design
        The design that it was computed for.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels on logarithmic axes: means and 95 % confidence intervals over the subjects with
        all cells (over all subjects where none has them), each subject as a thin line.
    """
    conditions = design.in_order(residuals["condition"])
    any_cut = False
    with in_style(look):
        figure, grid = panel_grid(2, 3, SIX_PANELS_INCH, look)
        # names of conditions may fill 60 % of a panel and its margin side by side
        room = letters_in(figure.get_figwidth() / grid[0, 0].get_gridspec().ncols) * 0.6
        turned = 30 if len("".join(conditions)) > room else 0
        for k, panel in enumerate(grid.flat):
            rows = residuals[residuals["axis"] == AXES[k]]
            cells = rows.pivot(index="subject", columns=["compensated", "condition"], values="rms")
            compared = [column for column in cells.columns if column[1] in design.conditions]
            if not cells.dropna(subset=compared).empty:
                cells = cells.dropna(subset=compared)
            values = cells.to_numpy().ravel()
            shown, lower = [values], list[tuple[str, Array, Array]]()
            variants = sorted(rows["compensated"].unique())
            for compensated in variants:
                variant, rms = VARIANTS[compensated], cells[compensated].reindex(columns=conditions)
                if len(variants) == 1:
                    variant = variant._replace(line="-", offset=0.0)
                x, low, high = _draw_means(panel, rms, variant)
                lower.append((variant.colour, x, low))
                # an interval that ends far below the least value would hide the others
                shown += [low[low >= 0.5 * np.nanmin(values)], high]
            draw_logarithmic(panel, np.concatenate(shown))
            any_cut |= _draw_cuts(panel, lower)
            panel.set_title(_p_value(statistics, AXES[k], design), loc="right", fontsize="small")
            panel.set_ylabel(f"RMS {axis_label(k)}")
            panel.set_xticks(range(len(conditions)), conditions, rotation=turned)
            panel.set_xlim(-0.3, len(conditions) - 0.7)
        if design.compensated:
            legend_below(figure, grid[0, 0])
        over = f", mean and 95 % CI over {numbers(cells.count(), 'subject')}"
        of_one = len(cells) == 1
        over += "; arrows: intervals that end below the axis" * any_cut
        add_title(figure, f"RMS residuals{' of one subject' if of_one else over}", look)
    return figure


def _draw_cuts(panel: Axes, lower: Sequence[tuple[str, Array, Array]]) -> bool:
    """Draw an arrow where an interval ends below the axis; say whether there is one.

    Of colours, places and lower ends.
    """
    bottom, cuts = panel.get_ylim()[0], 0
    for colour, x, low in lower:
        cut = x[low < bottom]
        cuts += len(cut)
        shape: Any = {"color": colour, "marker": "v", "ls": "none", "ms": 4}
        (arrows,) = panel.plot(cut, np.full(len(cut), bottom), clip_on=False, **shape)
        arrows.set_in_layout(False)
    return cuts > 0


def _draw_means(panel: Axes, rms: pd.DataFrame, variant: Variant) -> tuple[Array, Array, Array]:
    """Draw means with intervals over conditions, and each subject as a thin line.

    Gives places, lower and upper ends. Upper ones fit on a logarithmic axis; lower ones may not.
    """
    n = rms.count()
    quantile = -scipy.special.stdtrit((n - 1).clip(lower=1), TAIL)
    half = quantile * rms.std() / np.sqrt(n)
    x = np.arange(len(rms.columns), dtype=np.float64) + variant.offset
    lines = [np.column_stack([x, of_subject]) for of_subject in rms.to_numpy()]
    panel.add_collection(LineCollection(lines, colors=variant.colour, linewidths=0.7, alpha=0.3))
    drawn: Any = {"color": variant.colour, "marker": variant.marker, "label": variant.label}
    panel.errorbar(x, rms.mean(), half.fillna(0), ls=variant.line, ms=4, capsize=3, **drawn)
    low, high = (np.asarray(rms.mean() + sign * half, np.float64) for sign in (-1, 1))
    return x, low, high


def _p_value(statistics: pd.DataFrame, axis: str, design: Design) -> str:
    """Give the p-value of the effect that the lines show."""
    of_axis = statistics[statistics["axis"] == axis]
    of_effect = of_axis[of_axis["effect"] == ":".join(design.factors)]
    p = of_effect[of_effect["test"].isin((RM_ANOVA, MIXED_ANOVA))]["p_corrected"].dropna()
    if p.empty:
        return ""
    name = "interaction" if len(design.factors) > 1 else "".join(design.factors)
    return f"{name} {p_equation(float(p.iloc[0]))}"
