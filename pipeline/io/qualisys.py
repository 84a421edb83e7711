"""Text exports of Qualisys Track Manager (.tsv): trajectories, and force plates beside them."""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.c3d.read import kind_and_side
from pipeline.io.columns import PlateColumns, file_markers, recording_of, vectors
from pipeline.io.input_file import naming
from pipeline.io.recording import Event, Fact, Plate, Recording
from pipeline.io.stated import Stated
from pipeline.io.text_table import (
    GAPS,
    NUMBER,
    Rows,
    count_facts,
    marker_columns,
    parse_rows,
    read_number,
    read_rate,
    regular_rows,
    table_rows,
)

PLATE_FILE: Final = re.compile(r"(?P<trial>.*)_f(?:_(?P<number>\d+))?", re.IGNORECASE)
"""Stem of a file of forces: of the only plate, or of one with its number."""
KEY: Final = re.compile(r"[A-Z]+(_[A-Z]+)+|FREQUENCY|DESCRIPTION|EVENT")
TITLES: Final = "titles"
"""Key for the names of the columns."""
PARTS: Final = ("Force_", "Moment_", "COP_")
UNITS: Final = ("N", "Nm", "mm")
CORNERS: Final = ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY")
"""In the order of the C3D format."""
MAX_CORNER_ERROR_M: Final = 0.02
"""Corners that are measured miss a rectangle by millimetres, those in no order by decimetres."""
Header = Mapping[str, Sequence[str]]
"""Key -> what follows it, an empty text if it is absent; of events with their lines' numbers."""


def _export(path: Path) -> tuple[Header, Rows, list[Note | Fact]]:
    """Give header and rows of numbers, and what was written otherwise than expected."""
    rows, said = table_rows(path)
    firsts = (line.split("\t")[0].strip() for _, line in rows)
    numbers = (k for k, first in enumerate(firsts) if first in GAPS or NUMBER.fullmatch(first))
    start = next(numbers, len(rows))
    if len(rows) < start + 2:
        raise ValueError(f"it holds {len(rows) - start} rows of numbers, expected at least 2")
    header = defaultdict[str, list[str]](lambda: [""])
    for k, line in rows[:start]:
        key, texts = line.split()[0], [text.strip() for text in line.split("\t")]
        if KEY.fullmatch(key):
            header[f"EVENT {k}" if key == "EVENT" else key] = texts[1:] or [""]
        else:
            header[TITLES] = texts
    return header, rows[start:], said


def _timed(
    path: Path, header: Header, rows: Rows, values: Array, timed: int | None, counted: str
) -> tuple[Array, Array, list[Fact]]:
    """Give times [s], of the column ``timed`` or else from 0, and all columns at these times."""
    facts = count_facts(path, {counted: (header[counted][0], len(values))})
    frequency = header["FREQUENCY"][0]
    if timed is None:
        return np.arange(len(values)) / read_rate(frequency, "FREQUENCY"), values, facts
    # with an external clock only the times show the rate
    rate_hz = None if frequency == "EXT" else read_rate(frequency, "FREQUENCY")
    time, values, more = regular_rows(path.name, [k for k, _ in rows], values, timed, rate_hz)
    return time, values, [*facts, *more]


def plate_files(path: Path) -> list[Path]:
    """Give the files of forces of an export, from that of its trajectories or of one plate."""
    match = PLATE_FILE.fullmatch(path.stem)
    export = (match["trial"] if match else path.stem, path.suffix)
    found = [
        file
        for file in path.parent.glob(f"*{path.suffix}")
        if (of := PLATE_FILE.fullmatch(file.stem)) and (of["trial"], file.suffix) == export
    ]
    return sorted(found, key=lambda file: (len(file.stem), file.stem))


def read_qualisys(path: Path, stated: Stated, forces: Path | None = None) -> Recording:
    """Read an export of trajectories in 3D, and the force plates of the same export.

    Parameters
    ----------
    path
        The file, such as walk.tsv.
    stated
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`. Units are mm, N and N·m.
    forces
        One of its files of forces, walk_f_1.tsv and so on or walk_f.tsv, where they are in another
        folder or have another name; by default those beside it. All of one name are read.

    Returns
    -------
    Recording
        SI units, lab axes; times start at 0 at the first frame. Plates lie where their files state
        the corners.

    Raises
    ------
    ValueError
        A file is damaged, truncated, in 2D, or contradicts its units, axes or itself. One line.
    OSError
        A file cannot be opened.

    Notes
    -----
    Header and rows are those of
    https://docs.qualisys.com/qtm/content/processing_measurement/motion_data_tsv.htm. Forces are the
    actual ones on the plate, in N, N·m and mm, in the plate's own axes with z down or in the lab's
    (https://docs.qualisys.com/qtm/content/qtm_windows/force_data_information.htm); DESCRIPTION says
    which. `recording_of` changes their sign where they pull. The point of the moments is not
    documented: `wrench_about_origin` finds it from the centres of pressure, and takes the centre of
    the plate's surface, as of the program's real-time data, where these fit or are absent.
    """
    header, rows, said = _export(path)
    if (included := header["DATA_INCLUDED"][0]) not in ("3D", ""):
        raise ValueError(f"it holds {short(included)} data, expected 3D; export it again")
    names = [printable(name) for name in header["MARKER_NAMES"] if name]
    # a frame's number, its time, or both, and three columns of each marker
    single = "Time" if "." in rows[0][1].split("\t")[0] else "Frame"
    width = max(len(line.rstrip().split("\t")) for _, line in rows)
    clock = [[], [single], ["Frame", "Time"]][width % 3]
    timed = clock.index("Time") if "Time" in clock else None
    said += count_facts(path, {"NO_OF_MARKERS": (header["NO_OF_MARKERS"][0], len(names))})
    values = marker_columns(rows, clock, names)
    time, values, facts = _timed(path, header, rows, values, timed, "NO_OF_FRAMES")
    position = values[:, len(clock) :].reshape(len(values), len(names), 3)
    markers = file_markers(names, "mm", lambda kept: position[:, kept], stated)
    first_frame = int(values[0, 0]) if "Frame" in clock else 1
    start_s = float((first_frame - 1) * (time[1] - time[0]) if timed is None else time[0])
    events = _events(header, start_s)
    said += [*facts, *(event for event in events if isinstance(event, Fact))]
    plates = list[PlateColumns | Fact]()
    files = plate_files(forces or path) or ([] if forces is None else [forces])
    for file in files:
        with naming(file):
            plate, of_plate = _plate(file, None if timed is None else start_s)
        plates.append(plate)
        said += of_plate
    if files:
        said.append(Fact("joined", path.name, f"with {listed(file.name for file in files)}"))
    return recording_of(
        path,
        stated,
        markers,
        time - time[0],
        plates,
        on_subject=False,
        notes=said,
        first_frame=first_frame,
        events=tuple(event for event in events if isinstance(event, Event)),
    )


def _events(header: Header, start_s: float) -> list[Event | Fact]:
    """Give the foot strikes and foot offs, and why others are left out."""
    events: list[Event | Fact] = []
    for name, *_, written in (texts for key, texts in header.items() if key.startswith("EVENT ")):
        of, (kind, side) = f"event {short(name)}", kind_and_side(name)
        if kind and side:
            events.append(Event(read_number(written, of) - start_s, kind, side))
        else:
            events.append(Fact("left_out", of, "it is no foot strike or foot off of a side"))
    return events


def _plate(path: Path, start_s: float | None) -> tuple[PlateColumns | Fact, list[Note | Fact]]:
    """Give the plate of a file in the axes of the markers, or why it is left out, and facts.

    Its clock begins with the markers', at ``start_s`` where both files have times.
    """
    header, rows, said = _export(path)
    of_name = PLATE_FILE.fullmatch(path.stem)
    number = int(of_name["number"] or 1) if of_name else 1
    name = f"plate {number} ({short(header['FORCE_PLATE_NAME'][0] or path.name)})"
    columns = header[TITLES]
    timed = columns.index("TIME") if "TIME" in columns else None
    values = parse_rows(rows, columns)
    time, values, facts = _timed(path, header, rows, values, timed, "NO_OF_SAMPLES")
    said += facts
    clock = time - (time[0] if start_s is None or timed is None else start_s)
    place, axes = _place(header, number), header["DESCRIPTION"][0].lower()
    try:
        parts = vectors(dict(zip(columns, values.T, strict=True)), PARTS)
        if not any(word in axes for word in ("local", "lab", "world", "global")):
            raise ValueError(
                "its DESCRIPTION does not say whether its axes are the plate's or the lab's"
            )
        if "local" in axes and place is None:
            raise ValueError("it is in the plate's axes, and states no rectangle of corners")
    except ValueError as error:
        return Fact("left_out", name, str(error)), said
    if "local" in axes and place is not None:
        parts = parts @ place.rotation.T
        parts[:, 2] += 1000 * place.center  # in mm, as the file
    vectors_of_plate = parts.transpose(1, 0, 2)
    return PlateColumns(number, name, clock, *vectors_of_plate, units=UNITS, place=place), said


def _place(header: Header, number: int) -> Plate | None:
    """Give where a plate lies [m]; None where its file states no rectangle."""
    keys = (f"FORCE_PLATE_CORNER_{corner}_{axis}" for corner in CORNERS for axis in "XYZ")
    try:
        corners = np.array([header[key][0] for key in keys], float).reshape(4, 3) / 1000
        rotation = plate_axes(corners)
    except ValueError:
        return None
    if not np.linalg.norm(corners.T @ [1, -1, 1, -1]) < MAX_CORNER_ERROR_M:
        return None
    empty = np.empty(0)
    return Plate(number, empty, empty.reshape(0, 6), rotation, corners.mean(axis=0), corners)
