"""Residuals of one trial, over the gait cycle or over time, and the labels of the panels."""

import pickle
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any, Final, Literal, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.schema import NOUNS
from pipeline.figures.style import COLOURS, STYLE, draw_band
from pipeline.trial.gait.cycles import mean_and_sd, normalise
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.residuals import AXES, DIRECTIONS, UNITS, counted, cycle_residuals, reported
from pipeline.trial.result import TrialResult

UNCOUNTED: Final = "#BBBBBB"
"""Colour of frames that do not count, and of the part of the gait cycle that does."""
UNCERTAINTY_HATCH: Final = "//////"
"""Of the uncertainty of the compensation, distinct from the spread between gait cycles."""
PART_OPACITY: Final = 0.4
"""Curves and their bands remain visible on it."""
LABEL_INCH: Final = 2.2
"""Width of a label in a legend."""
LINE_INCH: Final = 0.2
"""Height of a line of a legend."""
MARGIN_INCH: Final = (0.7, 0.55, 0.2, 0.6)
"""Left, below, right and above panels whose places are fixed: to find them by their texts takes as
long as to draw them."""
MAX_TICKS: Final = 5
"""Intervals between the ticks of an axis."""


def residual_figure(result: TrialResult) -> Figure:
    """Draw a trial's six residuals over what counts of it.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels; forces above, moments below. Mean ± SD over the right foot's gait cycles, or the
        left foot's where there are none of the right; over time where a span of the recording
        counts, or nothing does.
    """
    if result.span or not any(map(len, result.cycles.values())):
        return _over_time(result)
    return _over_cycle(result)


def _over_time(result: TrialResult) -> Figure:
    """Draw residuals over time where filters have settled, grey where frames do not count."""
    time, counts = result.motion.time, counted(result)
    settled = free_of(result.quality, Quality.SETTLING)[:, None]
    with mpl.rc_context(STYLE):
        figure, panels = six_panels()
        label_panels(panels, (float(time[0]), float(time[-1])), "time (s)")
        for variant, dynamics in result.variants.items():
            values = reported(np.where(settled, dynamics.residual, np.nan))
            for k, panel in enumerate(panels):
                panel.plot(time, values[:, k], color=UNCOUNTED, lw=0.6)
                inside = np.where(counts, values[:, k], np.nan)
                panel.plot(time, inside, color=COLOURS[variant], lw=0.8, label=variant)
                if variant == "compensated" and result.uncertainty is not None:
                    spread = np.where(counts, result.uncertainty[:, k], np.nan)
                    _draw_uncertainty(panel, time, inside, spread)
        for k, panel in enumerate(panels):
            largest = [np.abs(reported(d.residual)[counts, k]) for d in result.variants.values()]
            if counts.any():
                panel.set_ylim(*(1.2 * np.max(largest) * np.array([-1, 1])))
        if len(result.variants) > 1:
            legend_below(figure, panels[0])
        what = "grey: not used" if counts.any() else "no frame is used"
        figure.suptitle(f"{result.source.name}: pelvis residuals, {what}", fontsize=10)
    return figure


def six_panels(
    size_inch: tuple[float, float] = (9, 5), layout: Literal["constrained"] | None = None
) -> tuple[Figure, Sequence[Axes]]:
    """Give a figure of six panels: forces above, moments below."""
    figure, panels = panel_grid(2, 3, size_inch, layout)
    return figure, panels.ravel()


def panel_grid(
    rows: int,
    columns: int,
    size_inch: tuple[float, float],
    layout: Literal["constrained"] | None = None,
) -> tuple[Figure, Any]:
    """Give a figure of rows and columns of panels; the lowest ones show the axis of all."""
    return cast(tuple[Figure, Any], pickle.loads(_stored_grid(rows, columns, size_inch, layout)))


@cache
def _stored_grid(rows: int, columns: int, size_inch: tuple[float, float], layout: Any) -> bytes:
    """Give such a figure with the ticks that it may need: a copy takes a fifth of the time."""
    figure = Figure(figsize=size_inch, layout=layout)
    panels = figure.subplots(rows, columns, sharex=True)
    for panel in panels.flat:
        panel.locator_params(nbins=MAX_TICKS)  # a tick takes as long to draw as a curve
        panel.yaxis.get_major_ticks(MAX_TICKS + 3)
    for panel in panels[:-1].flat:
        panel.xaxis.set_visible(False)
    if layout is None:
        left, bottom, right, top = np.divide(MARGIN_INCH, (*size_inch, *size_inch))
        figure.subplots_adjust(left, bottom, 1 - right, 1 - top, wspace=0.3, hspace=0.2)
    return pickle.dumps((figure, panels))


def component_figure(
    components: Sequence[str], draw: Callable[[Axes, int], None], per: str = ""
) -> Figure:
    """Lay out a panel per component of a wrench; `draw` fills it."""
    rows = 1 + (len(components) > 3)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 2.5 * rows + 0.3), layout="constrained")
        panels = figure.subplots(rows, -(-len(components) // rows), squeeze=False).ravel()
        for k, (panel, component) in enumerate(zip(panels, components, strict=True)):
            draw(panel, k)
            panel.set_title(component, loc="left")
            panel.set_ylabel(f"{UNITS[WRENCH_COMPONENTS.index(component)]}{per}")
        legend_below(figure, panels[0])
    return figure


def _over_cycle(result: TrialResult) -> Figure:
    """Draw mean ± SD over the gait cycles of one side."""
    with mpl.rc_context(STYLE):
        figure, panels = six_panels()
        label_panels(panels, label=f"{NOUNS[result.unit]} (%)")
        side = "right" if len(result.cycles.get("right", ())) else "left"
        for variant in result.variants:
            curves, spans = cycle_residuals(result, variant)[side], result.cycles[side]
            mean, sd = mean_and_sd(curves)
            percent = np.linspace(0, 100, len(mean))
            for k, panel in enumerate(panels):
                draw_band(panel, percent, mean[:, k], sd[:, k], COLOURS[variant], label=variant)
                if variant == "compensated" and result.uncertainty is not None:
                    own = normalise(result.motion.time, result.uncertainty[:, [k]], spans)
                    spread = np.sqrt(np.nanmean(own[..., 0] ** 2, axis=0))
                    _draw_uncertainty(panel, percent, mean[:, k], spread)
        draw_part(panels, mean_part([result]))
        if len(result.variants) > 1:
            legend_below(figure, panels[0])
        count, noun = len(result.cycles[side]), NOUNS[result.unit]
        figure.suptitle(
            f"{result.source.name}: pelvis residuals, mean ± SD of {count} {side} {noun}s",
            fontsize=10,
        )
    return figure


def legend_below(figure: Figure, panel: Axes) -> None:
    """Name the curves of a panel below all of them, as many in a line as there is room for."""
    named = panel.get_legend_handles_labels()
    columns = max(1, min(int(figure.get_figwidth() / LABEL_INCH), len(named[1])))
    if figure.get_layout_engine() is None:
        lines = -(-len(named[1]) // columns)
        bottom_inch = MARGIN_INCH[1] + LINE_INCH * lines
        figure.subplots_adjust(bottom=bottom_inch / figure.get_figheight())
    figure.legend(*named, loc="outside lower center", ncols=columns, frameon=False)


def _draw_uncertainty(panel: Axes, x: Array, middle: Array, spread: Array) -> None:
    """Draw the band of one standard deviation that the compensation adds about a curve."""
    panel.fill_between(
        *(x, middle - spread, middle + spread),
        facecolor="none",
        edgecolor=COLOURS["compensated"],
        hatch=UNCERTAINTY_HATCH,
        lw=0,
        label="compensation ± 1σ",
    )


def mean_part(trials: Iterable[TrialResult]) -> tuple[float, float] | None:
    """Give mean start and stop of the part of the gait cycles that counts [%]; None without."""
    parts = [t.part.percent(t.cycles) for t in trials if t.part is not None]
    known = np.concatenate([np.empty((0, 2)), *parts])
    known = known[np.isfinite(known).all(axis=1)]
    return (float(known[:, 0].mean()), float(known[:, 1].mean())) if len(known) else None


def draw_part(panels: Sequence[Axes], percent: tuple[float, float] | None) -> None:
    """Mark the part of the gait cycle that counts [%] by a grey band; nothing where it is None."""
    start, stop = percent or (0.0, 0.0)
    for panel in panels if percent else ():
        panel.axvspan(start, stop, color=UNCOUNTED, alpha=PART_OPACITY, lw=0, zorder=0)


def axis_label(k: int) -> str:
    """Give a residual's axis with its direction, such as "Mx (about forward)"."""
    return f"{AXES[k]} ({DIRECTIONS[k]})"


def label_panels(
    panels: Sequence[Axes], limits: tuple[float, float] = (0, 100), label: str = "gait cycle (%)"
) -> None:
    """Label six panels of residuals, two rows of three, by default over the gait cycle.

    Before anything is drawn: each curve would find the limits anew from all panels.
    """
    panels[0].set_xlim(*limits)  # of all, which share it
    for k, panel in enumerate(panels):
        panel.set_title(axis_label(k), loc="left")
        panel.set_ylabel(UNITS[k])
        panel.axhline(0, color="black", lw=0.5)
    for panel in panels[3:]:
        panel.set_xlabel(label)
