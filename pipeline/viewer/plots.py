"""Curves and states over time, and the last gait cycles of every residual as small plots.

Time-series views of Rerun 0.41 show only the timeline that the cursor moves on, so the last cycles
are drawn line by line, in a picture of `WIDTH` × `HEIGHT`.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr

from hbm.signals.samples import stretches
from hbm.spatial import Array, Mask
from pipeline.figures.style import COLOURS
from pipeline.trial.residuals import AXES, DIRECTIONS, UNITS
from pipeline.viewer.file import Clock, Timelines, printable, rgba, send
from pipeline.viewer.live import FULL_SCALE

LARGEST_COLOURS: Final = ("#E69F00", "#56B4E9", "#009E73", "#F0E442", "#CC79A7")
OTHER_COLOUR: Final = "#4A4F57"

SHOWN_CYCLES: Final = 10
COLUMNS: Final = 3
CELL: Final = np.array([384.0, 188.0])
"""Width and height of a plot with its title."""
SIZE: Final = np.array([360.0, 150.0])
"""Of a plot's frame, whose corner is so far from that of its cell:"""
CORNER: Final = np.array([12.0, 30.0])
CORNERS: Final = np.array([[k % COLUMNS, k // COLUMNS] * CELL + CORNER for k in range(len(AXES))])
"""Upper left corners of the frames, (6, 2)."""
WIDTH: Final = float(COLUMNS * CELL[0])
HEIGHT: Final = float(2 * CELL[1])
FRAME: Final = np.array([[0, 0.5], [0, 0], [1, 0], [1, 1], [0, 1], [0, 0.5], [1, 0.5]]) * SIZE
"""Its outline, and the line at zero."""
TITLE: Final = np.array([SIZE[0] / 2, -26])
"""Middle of a plot's title, from the corner of its frame."""
FRAME_COLOUR: Final = "#5A5F66"
TEXT_COLOUR: Final = "#B4BAC1"
BACKGROUND: Final = "#0D1011"
OLDEST: Final = 0.3
"""Share of a curve's colour in the oldest cycle; the newest has all of it."""
FRAME_PX: Final = 0.5
CURVE_PX: Final = 0.9


def panel_name(k: int) -> str:
    """Name the panel of a residual: axis, direction and unit."""
    return f"{AXES[k]} {'about ' if k > 2 else ''}{DIRECTIONS[k]} ({UNITS[k]})"


def draw_curves(
    stream: rr.RecordingStream,
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


def send_curves(
    stream: rr.RecordingStream, timelines: Timelines, entity: str, curves: Array
) -> None:
    """Send curves, (T, K); NaN breaks one."""
    send(stream, entity, timelines, rr.Scalars, np.ones(curves.shape, bool), scalars=curves)


def draw_residual_curves(stream: rr.RecordingStream, names: Iterable[str]) -> None:
    """Draw what stays of the curves of every axis: one per variant, or per end of an interval."""
    names = list(names)
    colours = [COLOURS.get(name, OTHER_COLOUR) for name in names]
    widths = [1.5 if name in COLOURS else 0.75 for name in names]
    for axis in AXES:
        draw_curves(stream, f"residual/{axis}", names, colours, widths)


def send_residual_curves(
    stream: rr.RecordingStream, timelines: Timelines, residuals: Mapping[str, Array]
) -> None:
    """Send the curves of every axis from residuals in the reported axes, (T, 6) [N, N·m]."""
    for k, axis in enumerate(AXES):
        curves = np.column_stack([value[:, k] for value in residuals.values()])
        send_curves(stream, timelines, f"residual/{axis}", curves)


def log_marker_errors(
    stream: rr.RecordingStream, timelines: Timelines, names: Sequence[str], error_mm: Array
) -> None:
    """Log each marker's distance from the model, (T, K) [mm], the largest first and in colour."""
    order = np.argsort(-np.nansum(error_mm**2, axis=0), kind="stable")
    colours = [*LARGEST_COLOURS, *[OTHER_COLOUR] * len(names)][: len(names)]
    draw_curves(stream, "marker_error_mm", [names[k] for k in order], colours, 1.0)
    send_curves(stream, timelines, "marker_error_mm", error_mm[:, order])


def log_states(
    stream: rr.RecordingStream,
    clock: Clock,
    name: str,
    changes: Sequence[tuple[float, str]],
    colours: Mapping[str, str],
) -> None:
    """Log the states in a row of the phases, each from a time [s] on; "" is none."""
    if not changes:
        return
    times, states = np.array([time for time, _ in changes]), np.array([[s] for _, s in changes])
    entity = f"phases/{name}"
    send(stream, entity, clock(times), rr.StateChange, states != "", state=states)
    names = list(colours)
    shown = rr.StateConfiguration(values=names, labels=names, colors=rgba(*colours.values()))
    stream.log(entity, shown, static=True)


def changes_of(mask: Mask, time: Array, label: str) -> list[tuple[float, str]]:
    """Give the changes of a state that holds where a mask is true."""
    ends = np.append(time, time[-1])
    return [
        change
        for start, stop in stretches(mask)
        for change in ((float(time[start]), label), (float(ends[stop]), ""))
    ]


def draw_cycle_axes(stream: rr.RecordingStream) -> None:
    """Draw what stays of the plots: their frames, and titles with their fixed scales."""
    width, colour = rr.Radius.ui_points(FRAME_PX), rgba(FRAME_COLOUR)
    frames = rr.LineStrips2D([corner + FRAME for corner in CORNERS], radii=width, colors=colour)
    stream.log("cycles/frames", frames, static=True)
    titles = [f"{panel_name(k)}, 0 to 100 %, ± {full:g}" for k, full in enumerate(FULL_SCALE)]
    places, colour = CORNERS + TITLE, rgba(TEXT_COLOUR)
    texts = rr.Points2D(places, radii=0.0, colors=colour, labels=titles, show_labels=True)
    stream.log("cycles/titles", texts, static=True)


def log_cycles(stream: rr.RecordingStream, cycles: Sequence[Mapping[str, Array]]) -> None:
    """Log the curves of gait cycles at the present time of the recording.

    Each has a variant's residuals in the reported axes over 0 to 100 %, (101, 6) [N, N·m]; the
    newest is last, and NaN breaks a curve.
    """
    strips, colours = list[Array](), list[str]()
    for age, cycle in zip(range(len(cycles) - 1, -1, -1), cycles, strict=True):
        for variant, residual in cycle.items():
            own = _curves(residual)
            strips += own
            colours += [_faded(COLOURS[variant], age)] * len(own)
    width = rr.Radius.ui_points(CURVE_PX)
    curves = rr.LineStrips2D(strips, radii=width, colors=rgba(*colours), draw_order=40.0)
    stream.log("cycles/curves", curves)


def _curves(residual: Array) -> list[Array]:
    """Give the points of the six curves, in as many pieces as gaps make of them."""
    pieces, x = list[Array](), np.linspace(0, SIZE[0], len(residual))
    for k, full in enumerate(FULL_SCALE):
        inside = np.clip(residual[:, k] / full, -1, 1)
        points = CORNERS[k] + np.column_stack([x, (1 - inside) * SIZE[1] / 2])
        known = stretches(np.isfinite(residual[:, k]))
        pieces += [points[start:stop] for start, stop in known if stop - start > 1]
    return pieces


def _faded(colour: str, age: int) -> str:
    share = 1 - (1 - OLDEST) * age / (SHOWN_CYCLES - 1)
    mixed = share * rgba(colour)[0, :3] + (1 - share) * rgba(BACKGROUND)[0, :3]
    return f"#{mixed.astype(np.uint8).tobytes().hex()}"
