"""Figures of a study: gait cycles over subjects, marginal means, every cycle of one subject."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from pipeline.figures.residuals import (
    axis_label,
    draw_part,
    label_panels,
    legend_below,
    mean_part,
    six_panels,
)
from pipeline.figures.style import (
    COLOURS,
    LINE_WIDTH_PT,
    STYLE,
    draw_band,
    draw_differences,
)
from pipeline.run.load import Results
from pipeline.statistics.comparison import MIXED_ANOVA, RM_ANOVA
from pipeline.statistics.curves import CurveDifference, parts_of
from pipeline.statistics.design import CONFIDENCE, Design
from pipeline.statistics.table_3 import format_p
from pipeline.trial.residuals import AXES, UNITS

LATERAL: Final = ("Fy", "Mx", "Mz")
"""Residuals that change sign when mirrored in the sagittal plane."""
SIX_PANELS_INCH: Final = (9.5, 5.6)
PANEL_HEIGHT_INCH: Final = 1.4
MARGIN_HEIGHT_INCH: Final = 1.2
TITLE_PT: Final = 11
THIN_LINE_PT: Final = 0.7
OFFSET: Final = 0.05
"""Shift of the means of both variants against each other, in steps of conditions."""


Spans = Mapping[str, Any]
"""Side -> start and stop of each gait cycle [s]."""


@dataclass(frozen=True, slots=True)
class Variant:
    """How residuals without or with inertia compensation (IC) are drawn."""

    label: str
    colour: str
    linestyle: str
    marker: str
    offset: float


VARIANTS: Final = {
    False: Variant("no IC", COLOURS["measured"], "--", "s", -OFFSET),
    True: Variant("IC", COLOURS["compensated"], "-", "o", OFFSET),
}


def study_figures(
    results: Results, statistics: pd.DataFrame, design: Design, curves: pd.DataFrame
) -> Iterator[tuple[str, Figure]]:
    """Draw every figure of a study's report.

    Parameters
    ----------
    results
        What `hbm run` left.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for them.
    design
        The design that it was computed for.
    curves
        As `pipeline.report.curves.differing_curves`.

    Yields
    ------
    name, figure
        ``gait_cycle_CONDITION`` (as the thesis' Figs 6 and 7), ``marginal_means`` (F.8–F.13) and
        ``raw_AXIS`` (F.14–F.19), the latter where there are gait cycles.
    """
    for condition in drawn_conditions(results.cycles, design):
        grey = mean_part(t for t in results.trials.values() if t.condition == condition)
        compared = f"{design.judged(condition)} - {design.reference_cell}"
        differing = {axis: parts_of(curves, axis, compared) for axis in AXES}
        figure = gait_cycle_figure(
            results.cycles, condition, design, grey=grey, differing=differing
        )
        yield f"gait_cycle_{condition}", figure
    yield "marginal_means", marginal_means_figure(results.residuals, statistics, design)
    subject = example_subject(results.cycles)
    if subject is None:
        return
    spans = {n[1:]: trial.cycles for n, trial in results.trials.items() if n.subject == subject}
    own = results.cycles[results.cycles["subject"] == subject]
    for axis in AXES:
        yield f"raw_{axis}", raw_figure(own, spans, axis, design)


def drawn_conditions(cycles: pd.DataFrame, design: Design) -> list[str]:
    """Give conditions with gait cycles of their own: all but the reference, which is in each."""
    conditions = design.in_order(cycles["condition"].unique())
    return [name for name in conditions if name != design.reference] or conditions


def example_subject(cycles: pd.DataFrame) -> str | None:
    """Give the subject with cycles in most cells, the first of several; None without cycles."""
    cells = cycles[["subject", "condition", "compensated"]].drop_duplicates()
    return None if cells.empty else str(cells.groupby("subject", sort=True).size().idxmax())


def mirrored(cycles: pd.DataFrame) -> pd.DataFrame:
    """Mirror the cycles of the left foot in the sagittal plane."""
    left = (cycles["side"] == "left") & cycles["axis"].isin(LATERAL)
    return cycles.assign(value=cycles["value"].where(~left, -cycles["value"]))


def gait_cycle_figure(
    cycles: pd.DataFrame,
    condition: str,
    design: Design,
    *,
    grey: tuple[float, float] | None = None,
    differing: Mapping[str, Sequence[CurveDifference]] = MappingProxyType({}),
) -> Figure:
    """Draw a condition's residuals over the gait cycle with and without compensation.

    Parameters
    ----------
    cycles
        As `pipeline.run.load.Results.cycles`.
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
        Six panels: mean ± SD over the subjects' mean cycles; for a single subject, over its cycles.
        Cycles of the left foot are mirrored, as lateral residuals would cancel otherwise.
    """
    shown = mirrored(cycles[cycles["condition"].isin((design.reference, condition))])
    counts = shown.groupby("condition")["subject"].nunique()
    single = counts.max() == 1
    unit = ["recording", "side", "cycle"] if single else ["subject"]
    keys = ["condition", "compensated", "axis", "percent"]
    values = shown.groupby([*keys, *unit], sort=False)["value"].mean().groupby(keys)
    mean, sd = values.mean().unstack("percent"), values.std().unstack("percent")
    with mpl.rc_context(STYLE):
        figure, panels = six_panels(SIX_PANELS_INCH)
        drawn = [
            (name, compensated)
            for name in design.in_order(counts.index)
            for compensated in VARIANTS
        ]
        for name, compensated in drawn:
            if (name, compensated) not in mean.index:
                continue
            variant = VARIANTS[compensated]
            dotted = name != condition and compensated
            for k, panel in enumerate(panels):
                key = (name, compensated, AXES[k])
                draw_band(
                    panel,
                    mean.columns.to_numpy(float),
                    mean.xs(key).to_numpy(),
                    sd.xs(key).to_numpy(),
                    variant.colour if name == condition else COLOURS["baseline"],
                    label=f"{name}, {variant.label}",
                    linestyle=":" if dotted else variant.linestyle,
                    linewidth=1.0 if dotted else LINE_WIDTH_PT,
                )
        label_panels(panels)
        draw_part(panels, grey)
        for axis, panel in zip(AXES, panels, strict=True):
            draw_differences(panel, differing.get(axis, ()))
        legend_below(figure, panels[0])
        over = "gait cycles of one subject" if single else f"{counts[condition]} subjects"
        title = f"Pelvis residuals, {condition}: mean ± SD over {over}"
        title += "; grey: the part that is used" * (grey is not None)
        title += f"; bars: differs from {design.reference}" * any(differing.values())
        figure.suptitle(title, fontsize=TITLE_PT)
    return figure


def marginal_means_figure(
    residuals: pd.DataFrame, statistics: pd.DataFrame, design: Design
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
        Six panels: means and 95 % confidence intervals over the subjects with all cells (over all
        subjects where none has them), each subject as a thin line.
    """
    conditions = design.in_order(residuals["condition"])
    with mpl.rc_context(STYLE):
        figure, panels = six_panels(SIX_PANELS_INCH)
        for k, panel in enumerate(panels):
            own = residuals[residuals["axis"] == AXES[k]]
            cells = own.pivot(index="subject", columns=["compensated", "condition"], values="rms")
            compared = [column for column in cells.columns if column[1] in design.conditions]
            if not cells.dropna(subset=compared).empty:
                cells = cells.dropna(subset=compared)
            for compensated in sorted(own["compensated"].unique()):
                rms = cells[compensated].reindex(columns=conditions)
                _draw_means(panel, rms, VARIANTS[compensated])
            panel.set_title(axis_label(k), loc="left")
            panel.set_title(_p_value(statistics, AXES[k], design), loc="right", fontsize=8)
            panel.set_ylabel(f"RMS ({UNITS[k]})")
            panel.set_ylim(bottom=0)
            panel.set_xticks(range(len(conditions)), conditions)
            panel.set_xlim(-0.3, len(conditions) - 0.7)
        legend_below(figure, panels[0])
        title = f"RMS residuals, mean and 95 % CI over {len(cells)} subjects"
        figure.suptitle(title, fontsize=TITLE_PT)
    return figure


def _draw_means(panel: Axes, rms: pd.DataFrame, variant: Variant) -> None:
    """Draw means with intervals over conditions, and each subject as a thin line."""
    n = rms.count()
    half = stats.t.isf((1 - CONFIDENCE) / 2, (n - 1).clip(lower=1)) * rms.std() / np.sqrt(n)
    x = np.arange(len(rms.columns)) + variant.offset
    panel.plot(x, rms.to_numpy().T, color=variant.colour, lw=THIN_LINE_PT, alpha=0.3)
    panel.errorbar(
        *(x, rms.mean()),
        yerr=half.fillna(0),
        color=variant.colour,
        ls=variant.linestyle,
        marker=variant.marker,
        ms=4,
        capsize=3,
        label=variant.label,
    )


def _p_value(statistics: pd.DataFrame, axis: str, design: Design) -> str:
    """Give the p-value of the effect that the lines show."""
    row = statistics[
        statistics["test"].isin((RM_ANOVA, MIXED_ANOVA))
        & (statistics["effect"] == ":".join(design.factors))
        & (statistics["axis"] == axis)
    ]
    p = row["p_corrected"].dropna()
    if p.empty:
        return ""
    written, name = format_p(float(p.iloc[0])), "".join(design.factors[:1])
    name = "interaction" if len(design.factors) > 1 else name
    return f"{name} p {written if written.startswith('<') else f'= {written}'}"


def raw_figure(
    cycles: pd.DataFrame, spans: Mapping[tuple[str, str], Spans], axis: str, design: Design
) -> Figure:
    """Draw one residual of one subject in every gait cycle of every condition.

    Parameters
    ----------
    cycles
        One subject's gait cycles, as `pipeline.run.load.Results.cycles`.
    spans
        Condition and recording -> side -> start and stop of each cycle [s], by which the cycles
        are ordered.
    axis
        The residual, such as "Fx".
    design
        The order of the conditions.

    Returns
    -------
    matplotlib.figure.Figure
        One panel per condition, without and with compensation, as recorded (not mirrored).
    """
    own = cycles[cycles["axis"] == axis]
    conditions = design.in_order(own["condition"])
    k = AXES.index(axis)
    height = MARGIN_HEIGHT_INCH + PANEL_HEIGHT_INCH * len(conditions)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(SIX_PANELS_INCH[0], height), layout="constrained")
        panels = figure.subplots(len(conditions), 1, squeeze=False)[:, 0]
        for condition, panel in zip(conditions, panels, strict=True):
            for compensated, trial in own[own["condition"] == condition].groupby("compensated"):
                variant = VARIANTS[bool(compensated)]
                keys = [
                    (recording, *key)
                    for (of, recording), own_spans in sorted(spans.items())
                    if of == condition
                    for key in _in_time(own_spans)
                ]
                curves = trial.pivot(
                    index=["recording", "side", "cycle"], columns="percent", values="value"
                )
                values = curves.loc[keys].to_numpy()
                x = np.arange(len(values))[:, None] + curves.columns.to_numpy() / 100
                panel.plot(
                    *(x.ravel(), values.ravel()),
                    color=variant.colour,
                    lw=THIN_LINE_PT,
                    label=variant.label,
                    zorder=2,
                )
            panel.axhline(0, color="black", lw=0.5)
            panel.set_title(condition, loc="left")
            panel.set_ylabel(UNITS[k])
            panel.margins(x=0)
        panels[-1].set_xlabel("analysed gait cycles, one after another")
        legend_below(figure, panels[0])
        subject = own["subject"].iloc[0]
        figure.suptitle(f"Residual {axis_label(k)} of {subject}, every cycle", fontsize=TITLE_PT)
    return figure


def _in_time(spans: Spans) -> list[tuple[str, int]]:
    """Give side and number of a trial's gait cycles in order of their starts."""
    keys = [(side, number) for side, own in spans.items() for number in range(1, len(own) + 1)]
    return sorted(keys, key=lambda key: spans[key[0]][key[1] - 1][0])
