"""The last gait cycles of every residual over 0 to 100 %, as small plots side by side.

Time-series views of Rerun 0.41 show only the timeline that the cursor moves on, so these plots are
drawn line by line, in a picture of `WIDTH` × `HEIGHT`.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr

from hbm.signals.samples import stretches
from hbm.spatial import Array
from pipeline.figures.style import COLOURS
from pipeline.trial.residuals import AXES, DIRECTIONS, UNITS
from pipeline.viewer.file import Timelines, rgba, send

SHOWN_CYCLES: Final = 10
COLUMNS: Final = 3
CELL: Final = np.array([384.0, 188.0])
"""Width and height of a plot with its labels."""
CORNER: Final = np.array([46.0, 30.0])
SIZE: Final = np.array([318.0, 128.0])
"""Of a plot's frame; its corner is that far from the corner of its cell."""
WIDTH: Final = float(COLUMNS * CELL[0])
HEIGHT: Final = float(2 * CELL[1])
RANGE_LABELS: Final = np.array([[-24.0, -10.0], [-24.0, SIZE[1] - 16]])
"""Places of the labels of the vertical range, from the corner of the frame."""
FRAME_COLOUR: Final = "#5A5F66"
TEXT_COLOUR: Final = "#B4BAC1"
LINE_COLOUR: Final = "#32363B"
BACKGROUND: Final = "#0D1011"
OLDEST: Final = 0.3
"""Share of a curve's colour in the oldest cycle; the newest has all of it."""
FRAME_PX: Final = 0.5
CURVE_PX: Final = 0.9
LEADING: Final = np.array([1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0])
SMALLEST: Final = {"N": 10.0, "N·m": 2.0}
"""Of the vertical range, so that noise does not fill a plot."""


def draw_cycle_axes(stream: rr.RecordingStream) -> None:
    """Draw what stays of the plots: frames, lines at 0 and at each quarter of the gait cycle."""
    grid, frames, places, names = [], [], [], []
    for k, axis in enumerate(AXES):
        left, top = _corner(k)
        right, bottom = _corner(k) + SIZE
        frames.append([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
        grid.append([[left, (top + bottom) / 2], [right, (top + bottom) / 2]])
        for percent in (25, 50, 75):
            x = left + SIZE[0] * percent / 100
            grid.append([[x, top], [x, bottom]])
        about = "about " if k >= COLUMNS else ""
        places += [[(left + right) / 2, top - 26]]
        names += [f"{axis} {about}{DIRECTIONS[k]} ({UNITS[k]})"]
        for percent in (0, 50, 100):
            places.append([left + SIZE[0] * percent / 100, bottom + 2])
            names.append(f"{percent} %")
    stream.log(
        "cycles/grid",
        rr.LineStrips2D(grid, radii=rr.Radius.ui_points(FRAME_PX), colors=rgba(LINE_COLOUR)),
        static=True,
    )
    stream.log(
        "cycles/frames",
        rr.LineStrips2D(frames, radii=rr.Radius.ui_points(FRAME_PX), colors=rgba(FRAME_COLOUR)),
        static=True,
    )
    _log_labels(stream, "cycles/names", places, names)
    stream.log(
        "cycles/curves",
        rr.LineStrips2D.from_fields(radii=rr.Radius.ui_points(CURVE_PX), draw_order=40.0),
        static=True,
    )
    stream.log(
        "cycles/ranges",
        rr.Points2D.from_fields(radii=0.0, colors=rgba(TEXT_COLOUR), show_labels=True),
        static=True,
    )


def send_cycles(
    stream: rr.RecordingStream, timelines: Timelines, cycles: Sequence[Mapping[str, Array]]
) -> None:
    """Send the curves of gait cycles.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of one row.
    cycles
        Variant -> residuals in the reported axes over 0 to 100 %, (101, 6) [N, N·m], the newest
        last; NaN breaks a curve.
    """
    limits = cycle_limits(cycles)
    strips, colours = list[Array](), list[str]()
    for age, cycle in zip(range(len(cycles) - 1, -1, -1), cycles, strict=True):
        for variant, residual in cycle.items():
            own = _curves(residual, limits)
            strips += own
            colours += [_faded(COLOURS[variant], age)] * len(own)
    stream.send_columns(
        "cycles/curves",
        [rr.TimeColumn("time", duration=timelines["time"])],
        rr.LineStrips2D.columns(strips=strips, colors=rgba(*colours)).partition([len(strips)]),
        strict=True,
    )
    places = np.array([_corner(k) + end for k in range(len(AXES)) for end in RANGE_LABELS])
    labels = np.array([f"{sign}{limit:g}" for limit in limits for sign in ("+", "−")])
    send(
        stream,
        "cycles/ranges",
        timelines,
        rr.Points2D,
        np.ones((1, len(labels)), bool),
        positions=places[None],
        labels=labels[None],
    )


def cycle_limits(cycles: Sequence[Mapping[str, Array]]) -> Array:
    """Give the ends of the vertical ranges, round numbers, (6,) [N, N·m].

    Parameters
    ----------
    cycles
        As of `send_cycles`.

    Examples
    --------
    >>> cycle_limits([{"measured": np.full((101, 6), -21.0)}])
    array([30., 30., 30., 30., 30., 30.])
    """
    every = [np.abs(residual) for cycle in cycles for residual in cycle.values()]
    smallest = np.array([SMALLEST[unit] for unit in UNITS])
    largest = np.fmax.reduce([smallest, *(np.fmax.reduce(each, axis=0) for each in every)])
    power = 10.0 ** np.floor(np.log10(largest))
    steps = np.append(LEADING, 10)[:, None] * power
    return np.asarray(np.where(steps >= largest * (1 - 1e-9), steps, np.inf).min(axis=0))


def _corner(k: int) -> Array:
    """Give the upper left corner of a plot's frame."""
    return np.asarray([k % COLUMNS, k // COLUMNS] * CELL + CORNER)


def _curves(residual: Array, limits: Array) -> list[Array]:
    """Give the points of the six curves, in as many pieces as gaps make of them."""
    pieces = []
    x = np.linspace(0, SIZE[0], len(residual))
    for k, limit in enumerate(limits):
        y = (1 - residual[:, k] / limit) * SIZE[1] / 2
        points = _corner(k) + np.column_stack([x, y])
        known = np.isfinite(residual[:, k])
        pieces += [points[start:stop] for start, stop in stretches(known) if stop - start > 1]
    return pieces


def _faded(colour: str, age: int) -> str:
    share = 1 - (1 - OLDEST) * age / (SHOWN_CYCLES - 1)
    mixed = share * rgba(colour)[0, :3] + (1 - share) * rgba(BACKGROUND)[0, :3]
    return f"#{mixed.astype(np.uint8).tobytes().hex()}"


def _log_labels(
    stream: rr.RecordingStream, entity: str, places: list[list[float]], labels: list[str]
) -> None:
    stream.log(
        entity,
        rr.Points2D(places, radii=0.0, colors=rgba(TEXT_COLOUR), labels=labels, show_labels=True),
        static=True,
    )
