"""Curves and states over time: residuals, marker errors, gait phases, perturbations."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr

from hbm.signals.samples import stretches
from hbm.spatial import Array, Mask
from pipeline.figures.style import COLOURS
from pipeline.io.recording import Event
from pipeline.trial.residuals import AXES
from pipeline.viewer.file import Clock, Timelines, printable, rgba, send

Interval = tuple[float, float, str]
"""Start and stop [s], and a label."""

PHASES: Final = {"foot_strike": "stance", "foot_off": "swing"}
PHASE_COLOURS: Final = {"stance": "#009E73", "swing": "#3A4A45"}
PERTURBATION_COLOUR: Final = "#E69F00"
UNCERTAIN_COLOUR: Final = "#CC79A7"
UNCOUNTED_COLOUR: Final = "#D55E00"
LARGEST_COLOURS: Final = ("#E69F00", "#56B4E9", "#009E73", "#F0E442", "#CC79A7")
OTHER_COLOUR: Final = "#4A4F57"


def log_curves(
    stream: rr.RecordingStream,
    timelines: Timelines,
    entity: str,
    curves: Array,
    names: Sequence[str],
    colours: Sequence[str],
    width: float | Sequence[float] = 1.5,
) -> None:
    """Log several curves as one entity; their extremes stay visible when zoomed out.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    entity
        Path of the entity.
    curves
        (T, K); NaN breaks a curve.
    names, colours
        One per curve.
    width
        Of the lines, for all or one each.
    """
    _send_curves(stream, timelines, entity, curves)
    _draw_curves(stream, entity, names, colours, width)


def draw_residual_curves(stream: rr.RecordingStream, names: Sequence[str]) -> None:
    """Log what stays of the curves of every axis: names, colours and widths.

    Parameters
    ----------
    stream
        Recording to write to.
    names
        Variants, or ends of an interval.
    """
    colours = [COLOURS.get(name, OTHER_COLOUR) for name in names]
    widths = [1.5 if name in COLOURS else 0.75 for name in names]
    for axis in AXES:
        _draw_curves(stream, f"residual/{axis}", names, colours, widths)


def send_residual_curves(
    stream: rr.RecordingStream, timelines: Timelines, residuals: Mapping[str, Array]
) -> None:
    """Send one entity per axis, one curve per variant.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    residuals
        Variant, or end of an interval -> residuals in the reported axes, (T, 6) [N, N·m].
    """
    for k, axis in enumerate(AXES):
        curves = np.column_stack([value[:, k] for value in residuals.values()])
        _send_curves(stream, timelines, f"residual/{axis}", curves)


def log_marker_errors(
    stream: rr.RecordingStream, timelines: Timelines, names: Sequence[str], error_mm: Array
) -> None:
    """Log each marker's distance from the model, the largest first and in colour.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    names
        Names of the markers.
    error_mm
        (T, K) [mm]; NaN where a marker is missing.
    """
    order = np.argsort(-np.nansum(error_mm**2, axis=0), kind="stable")
    colours = [*LARGEST_COLOURS, *[OTHER_COLOUR] * len(names)][: len(names)]
    log_curves(
        stream,
        timelines,
        "marker_error_mm",
        error_mm[:, order],
        [names[k] for k in order],
        colours,
        1.0,
    )


def log_phases(stream: rr.RecordingStream, clock: Clock, events: Iterable[Event]) -> None:
    """Log stance and swing of each foot, from its first event on."""
    events = list(events)
    for side in ("left", "right"):
        own = [event for event in events if event.side == side]
        changes = [(event.time, PHASES[event.label]) for event in own]
        _log_states(stream, clock, f"phases/foot_{side}", changes, PHASE_COLOURS)


def log_intervals(
    stream: rr.RecordingStream,
    clock: Clock,
    name: str,
    intervals: Iterable[Interval],
    colour: str,
) -> None:
    """Log intervals as states in a row of the timeline view; the row is empty in between.

    Parameters
    ----------
    stream, clock
        Recording to write to, and what gives the timelines of any instants.
    name
        Name of the row.
    intervals
        Without overlap.
    colour
        Colour of all intervals.
    """
    changes: list[tuple[float, str | None]] = []
    for start, stop, label in sorted(intervals):
        if changes and changes[-1][0] == start:
            changes.pop()
        changes += [(start, printable(label)), (stop, None)]
    colours = {label: colour for _, label in changes if label is not None}
    _log_states(stream, clock, f"phases/{name}", changes, colours)


def _log_states(
    stream: rr.RecordingStream,
    clock: Clock,
    entity: str,
    changes: Sequence[tuple[float, str | None]],
    colours: Mapping[str, str],
) -> None:
    if not changes:
        return
    times = np.array([time for time, _ in changes])
    known = np.array([[state is not None] for _, state in changes])
    states = np.array([[state or ""] for _, state in changes])
    send(stream, entity, clock(times), rr.StateChange, known, state=states)
    stream.log(
        entity,
        rr.StateConfiguration(
            values=list(colours), labels=list(colours), colors=rgba(*colours.values())
        ),
        static=True,
    )


def _draw_curves(
    stream: rr.RecordingStream,
    entity: str,
    names: Sequence[str],
    colours: Sequence[str],
    width: float | Sequence[float],
) -> None:
    stream.log(
        entity,
        rr.SeriesLines(
            names=[printable(name) for name in names],
            colors=rgba(*colours),
            widths=width,
            aggregation_policy="minmax",
        ),
        static=True,
    )


def _send_curves(
    stream: rr.RecordingStream, timelines: Timelines, entity: str, curves: Array
) -> None:
    send(stream, entity, timelines, rr.Scalars, np.ones(curves.shape, bool), scalars=curves)


def intervals_of(mask: Mask, time: Array, label: str) -> list[Interval]:
    """Give the intervals of time in which a mask is true."""
    last = len(time) - 1
    return [(float(time[a]), float(time[min(b, last)]), label) for a, b in stretches(mask)]
