"""Forces and residuals of one trial over time, and the labels of the panels of residuals."""

import pickle
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from compensation.inertia.sensors import QUANTILE_95
from hbm.spatial import WRENCH_COMPONENTS, Array, Mask
from pipeline.config.schema import Figures
from pipeline.figures.style import (
    BAND_OPACITY,
    COLOURS,
    LINE_INCH,
    LINES,
    PAGE,
    add_title,
    in_style,
    letters_in,
)
from pipeline.trial.gait.events import event_times
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.residuals import AXES, DIRECTIONS, UNITS, reported, worst_cycles
from pipeline.trial.result import TrialResult

if TYPE_CHECKING:
    from pipeline.explain.budget import Bands

SIDE_COLOURS: Final = {"right": "#E69F00", "left": "#56B4E9"}
"""Warm and cool, as in the viewer's scene."""
SHOWN_S: Final = 12.0
"""About ten gait cycles: each can be seen in a figure across a page."""
SIX_PANELS_INCH: Final = (3.2, 2.35)
MARGIN_INCH: Final = (1.0, 0.55, 0.2, 0.6)
"""Left, below, right and above panels whose places are fixed."""
MAX_TICKS: Final = 5
"""Intervals between the ticks of an axis."""


def residual_figure(result: TrialResult, bands: "Bands | None" = None) -> Figure:
    """Draw the forces on both feet over time and, below, the six residuals.

    Parameters
    ----------
    result
        The trial.
    bands
        Of an explained trial: 95 % intervals of measurement are drawn behind its residuals.

    Returns
    -------
    matplotlib.figure.Figure
        Eight panels: vertical and forward force, of the plates closest to the truth; Fx … Mz where
        filters have settled. Vertical lines are foot strikes and, dotted, foot offs; what counts is
        shaded. Of a long trial 12 s around the gait cycle with the largest residual.
    """
    first, last, around = _shown_span(result)
    inside = np.flatnonzero((result.motion.time >= first) & (result.motion.time <= last))
    # more than 800 samples are finer than the figure
    shown = inside[:: -(-len(inside) // 800)]
    time, counts = result.motion.time[shown], result.counts[shown]
    settled = free_of(result.quality, Quality.SETTLING)[shown]
    *_, wrenches = result.ground.values()
    spread, meaning = _spread(result, bands)
    with in_style():
        figure, grid = panel_grid(2 + len(AXES), 1, (9.0, 0.9))
        grid[0, 0].set_xlim(first, last)  # of all, which share it
        for panel, k, direction in zip(grid.flat, (2, 0), ("up", "forward"), strict=False):
            for side, colour in SIDE_COLOURS.items():
                force = wrenches[f"{side}_foot"][shown, k]
                panel.plot(time, force, color=colour, lw=1.0, label=f"{side} foot")
            panel.set_ylabel(f"force (N),\n{direction}", fontsize="small")
        for k, panel in enumerate(grid[2:].flat):
            for variant, dynamics in result.variants.items():
                value = np.where(settled, reported(dynamics.residual)[shown, k], np.nan)
                style = {"lw": 0.9, "ls": LINES[variant] if len(result.variants) > 1 else "-"}
                panel.plot(time, value, color=COLOURS[variant], label=variant, **style)
            if spread is not None:
                low, high = value - spread[shown, k], value + spread[shown, k]
                panel.fill_between(
                    time, low, high, color="black", alpha=BAND_OPACITY, lw=0, label=meaning
                )
            if counts.any():  # plates as measured, and what does not count, may be far larger
                panel.set_ylim(*(1.1 * np.abs(value[counts]).max() * np.array([-1, 1])))
            panel.set_ylabel(axis_label(k), fontsize="small")
        for panel in grid.flat:
            panel.axhline(0, color="black", lw=0.5)
            panel.patch.set_visible(False)  # what is behind all panels shows
            panel.yaxis.set_label_coords(-0.058, 0.5)
        panel.set_xlabel("time (s)")
        legend_below(figure, grid[0, 0], panel)
        _draw_phases(figure, result, time, result.counted[shown])
        add_title(figure, f"{result.source.name}: forces on the feet and pelvis residuals{around}")
    return figure


def _spread(result: TrialResult, bands: "Bands | None") -> tuple[Array | None, str]:
    """Give how uncertain residuals are, (T, 6) [N, N·m], and what of them that is."""
    if bands is None:
        return result.uncertainty, "compensation ± 1σ"
    half = np.full((len(result.motion.time), len(AXES)), np.nan)
    half[np.searchsorted(result.motion.time, bands.time)] = QUANTILE_95 * bands.deviation
    return half, "95 % interval of measurement"


def _shown_span(result: TrialResult) -> tuple[float, float, str]:
    """Give start and stop of what is drawn [s], and in words around what."""
    first, last = result.motion.time[[0, -1]].tolist()
    worst, length = worst_cycles(result), last - first
    if length <= 1.25 * SHOWN_S:
        return first, last, ""
    middle, what = first, "from its beginning"
    if worst:
        middle, what = (worst[0].start_s + worst[0].stop_s) / 2, "around the worst gait cycle"
    elif result.span:
        middle, what = sum(result.span) / 2, "in the middle of what counts"
    start = min(max(middle - SHOWN_S / 2, first), last - SHOWN_S)
    return start, start + SHOWN_S, f", {SHOWN_S:g} of {length:.0f} s {what}"


def _draw_phases(figure: Figure, result: TrialResult, time: Array, used: Mask) -> None:
    """Draw events and shade what counts once behind all panels."""
    top, bottom = figure.axes[0].get_position(), figure.axes[-1].get_position()
    place = (top.x0, bottom.y0, top.width, top.y1 - bottom.y0)
    behind = figure.add_axes(place, sharex=figure.axes[0], zorder=-1)
    behind.set_axis_off()
    behind.set_ylim(0, 1)
    behind.fill_between(time, 0, 1, where=used, color="#EEF1F4", lw=0)
    for side, colour in SIDE_COLOURS.items():
        for label, style in (("foot_strike", "-"), ("foot_off", ":")):
            times = event_times(result.events, label, side)
            inside = times[(times >= time[0]) & (times <= time[-1])]
            behind.vlines(inside, 0, 1, color=colour, lw=0.6, ls=style)


def panel_grid(
    rows: int,
    columns: int,
    panel_inch: tuple[float, float],
    look: Figures = PAGE,
    *,
    turned: bool | None = None,
) -> tuple[Figure, Any]:
    """Give a figure of rows and columns of panels; the lowest ones show the axis of all.

    Turned, by default in one column of a journal, the rows stand beside each other.
    """
    turned = look.of_one_column if turned is None else turned
    shape = (columns, rows) if turned else (rows, columns)
    size = np.multiply(panel_inch, shape[::-1])
    # height of title, legend and labels together
    others = 0.9 if look == PAGE else 1.5
    if look.width_mm is not None:
        mm_per_inch = 25.4
        size *= look.width_mm / mm_per_inch / size[0]
        # a page of a journal, with room for the caption below
        size[1] = min(size[1], 225.0 / mm_per_inch - others)
    size_inch = float(size[0]), float(size[1]) + others
    figure, panels = pickle.loads(_stored_grid(*shape, size_inch, look))
    return figure, panels.T if turned else panels


@cache
def _stored_grid(rows: int, columns: int, size_inch: tuple[float, float], look: Figures) -> bytes:
    """Give such a figure with the ticks that it may need: a copy takes a fifth of the time."""
    # to place more than six panels by their texts would take longer than to draw them
    fixed = look == PAGE and rows * columns > 6
    figure = Figure(figsize=size_inch, layout=None if fixed else "constrained")
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
    room = letters_in(size_inch[0] / columns) // 8  # letters for each interval
    intervals = (MAX_TICKS, MAX_TICKS) if look.width_mm is None else (max(1, room), MAX_TICKS - 1)
    for panel in panels.flat:  # a tick takes as long to draw as a curve
        panel.locator_params("x", nbins=intervals[0])
        panel.locator_params("y", nbins=intervals[1])
        for tick in panel.yaxis.get_major_ticks(MAX_TICKS + 3):
            # how wide a number is moves nothing but the axis label, which the first column has
            tick.label1.set_in_layout(not fixed or panel in panels[:, 0])
    for panel in panels[-1]:
        panel.xaxis.get_major_ticks(MAX_TICKS + 3)
    for panel in panels[:-1].flat:
        panel.xaxis.set_visible(False)
    if fixed:
        left, bottom, right, top = np.divide(MARGIN_INCH, (*size_inch, *size_inch))
        figure.subplots_adjust(left, bottom, 1 - right, 1 - top, wspace=0.3, hspace=0.2)
    return pickle.dumps((figure, panels))


def component_figure(
    components: Sequence[str], draw: Callable[[Axes, int], None], per: str = ""
) -> Figure:
    """Lay out a panel per component of a wrench; `draw` fills it."""
    rows = 1 + (len(components) > 3)
    with in_style():
        figure = Figure(figsize=(9, 2.5 * rows + 0.3), layout="constrained")
        panels = figure.subplots(rows, -(-len(components) // rows), squeeze=False).ravel()
        for k, (panel, component) in enumerate(zip(panels, components, strict=True)):
            draw(panel, k)
            panel.set_title(component, loc="left")
            panel.set_ylabel(f"{UNITS[WRENCH_COMPONENTS.index(component)]}{per}")
        legend_below(figure, panels[0])
    return figure


def legend_below(figure: Figure, *panels: Axes) -> None:
    """Name the curves of panels below all of them, as many in a line as there is room for."""
    of_panels = [panel.get_legend_handles_labels() for panel in panels]
    named = [[*chain(*parts)] for parts in zip(*of_panels, strict=True)]
    longest = max(map(len, named[1]), default=0) + 8  # a line and gaps beside its label
    columns = max(1, min(letters_in(figure.get_figwidth()) // longest, len(named[1])))
    if figure.get_layout_engine() is None:
        lines = -(-len(named[1]) // columns)
        bottom_inch = MARGIN_INCH[1] + LINE_INCH * lines
        figure.subplots_adjust(bottom=bottom_inch / figure.get_figheight())
    figure.legend(*named, loc="outside lower center", ncols=columns, frameon=False)


def mean_part(trials: Iterable[TrialResult]) -> tuple[float, float] | None:
    """Give mean start and stop of the part of the gait cycles that counts [%]; None without."""
    parts = [t.part.percent(t.cycles) for t in trials if t.part is not None]
    ends = np.concatenate([np.empty((0, 2)), *parts])
    ends = ends[np.isfinite(ends).all(axis=1)]
    return (float(ends[:, 0].mean()), float(ends[:, 1].mean())) if len(ends) else None


def axis_label(k: int) -> str:
    """Give a residual's axis in two lines, such as "Mx (N·m)," and "about forward"."""
    return f"{AXES[k]} ({UNITS[k]}),\n{DIRECTIONS[k]}"
