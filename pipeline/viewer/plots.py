"""Curves and states over time."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr

from hbm.signals.samples import stretches
from hbm.spatial import Array, Mask
from pipeline.figures.style import COLOURS
from pipeline.trial.residuals import AXES, DIRECTIONS, UNITS
from pipeline.viewer.file import Clock, Stream, Timelines, printable, rgba, send

LARGEST_COLOURS: Final = ("#E69F00", "#56B4E9", "#009E73", "#F0E442", "#CC79A7")
OTHER_COLOUR: Final = "#4A4F57"


def panel_name(k: int) -> str:
    """Name the panel of a residual as the axes of figures: narrow panels cut the end off."""
    return f"{AXES[k]} ({UNITS[k]}), {DIRECTIONS[k]}"


def draw_curves(
    stream: Stream,
    entity: str,
    names: Sequence[str],
    colours: Sequence[str],
    width: float | Sequence[float] = 1.5,
) -> None:
    """Draw what stays of an entity's curves; their extremes stay visible when zoomed out."""
    lines = rr.SeriesLines(
        names=[printable(name) for name in names],
        colors=rgba(*colours),
        widths=width,
        aggregation_policy="minmax",
    )
    stream.log(entity, lines, static=True)


def send_curves(stream: Stream, timelines: Timelines, entity: str, curves: Array) -> None:
    """Send curves, (T, K); NaN breaks one."""
    send(stream, entity, timelines, rr.Scalars, np.ones(curves.shape, bool), scalars=curves)


def draw_residual_curves(stream: Stream, names: Iterable[str]) -> None:
    """Draw what stays of the curves of every axis: one per variant, or per end of an interval."""
    names = list(names)
    colours = [COLOURS.get(name, OTHER_COLOUR) for name in names]
    widths = [1.5 if name in COLOURS else 0.75 for name in names]
    for axis in AXES:
        draw_curves(stream, f"residual/{axis}", names, colours, widths)


def send_residual_curves(
    stream: Stream, timelines: Timelines, residuals: Mapping[str, Array]
) -> None:
    """Send the curves of every axis from residuals in the reported axes, (T, 6) [N, N·m]."""
    for k, axis in enumerate(AXES):
        curves = np.column_stack([value[:, k] for value in residuals.values()])
        send_curves(stream, timelines, f"residual/{axis}", curves)


def log_marker_errors(
    stream: Stream, timelines: Timelines, names: Sequence[str], error_mm: Array
) -> None:
    """Log each marker's distance from the model, (T, K) [mm], the largest first and in colour."""
    order = np.argsort(-np.nansum(error_mm**2, axis=0), kind="stable")
    colours = [*LARGEST_COLOURS, *[OTHER_COLOUR] * len(names)][: len(names)]
    draw_curves(stream, "marker_error_mm", [names[k] for k in order], colours, 1.0)
    send_curves(stream, timelines, "marker_error_mm", error_mm[:, order])


def log_states(
    stream: Stream,
    clock: Clock,
    name: str,
    changes: Sequence[tuple[float, str]],
    colours: Mapping[str, str],
) -> None:
    """Log the states in a row, each from a time [s] on; "" is none."""
    if not changes:
        return
    times, states = np.array([time for time, _ in changes]), np.array([[s] for _, s in changes])
    send(stream, name, clock(times), rr.StateChange, states != "", state=states)
    names = list(colours)
    shown = rr.StateConfiguration(values=names, labels=names, colors=rgba(*colours.values()))
    stream.log(name, shown, static=True)


def changes_of(mask: Mask, time: Array, label: str) -> list[tuple[float, str]]:
    """Give the changes of a state that holds where a mask is true."""
    ends = np.append(time, time[-1])
    return [
        change
        for start, stop in stretches(mask)
        for change in ((float(time[start]), label), (float(ends[stop]), ""))
    ]
