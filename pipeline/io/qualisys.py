"""Text exports of Qualisys Track Manager (.tsv): trajectories, and force plates beside them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.c3d.read import kind_and_side
from pipeline.io.columns import PlateColumns, file_markers, plate_of, recording_of
from pipeline.io.input_file import naming
from pipeline.io.recording import Event, Fact, Plate, Recording
from pipeline.io.stated import Stated
from pipeline.io.text_table import (
    GAPS,
    NUMBER,
    count_facts,
    ending_notes,
    parse_rows,
    read_number,
    read_rate,
    regular_rows,
    table_lines,
    with_last_gaps,
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
"""Key -> what follows it; of the events with their lines' numbers."""
Rows = list[tuple[int, str]]
"""Numbers and lines."""


def _export(path: Path) -> tuple[Header, Rows, list[Fact]]:
    """Give header and rows of numbers, and what was written otherwise than expected."""
    lines, facts = table_lines(path)
    rows = [(k, line) for k, line in enumerate(lines, start=1) if line.strip()]
    firsts = (line.split("\t")[0].strip() for _, line in rows)
    numbers = (k for k, first in enumerate(firsts) if first in GAPS or NUMBER.fullmatch(first))
    start = next(numbers, len(rows))
    if len(rows) < start + 2:
        raise ValueError(f"it holds {len(rows) - start} rows of numbers, expected at least 2")
    header = {}
    for k, line in rows[:start]:
        key, texts = line.split()[0], [text.strip() for text in line.split("\t")]
        named = KEY.fullmatch(key)
        header[f"EVENT {k}" if key == "EVENT" else key if named else TITLES] = texts[bool(named) :]
    return header, rows[start:], facts


def _text(header: Header, key: str) -> str:
    return (header.get(key) or [""])[0]


def _numbers(
    path: Path, header: Header, rows: Rows, columns: Sequence[str], counted: str
) -> tuple[Array, Array, list[Fact]]:
    """Give times [s], of the column TIME or else from 0, and all columns."""
    filled = ((k, with_last_gaps(line, len(columns))) for k, line in rows)
    values = parse_rows(filled, "\t", columns)
    facts = count_facts(path, {counted: (_text(header, counted), len(values))})
    frequency = _text(header, "FREQUENCY")
    timed = [k for k, name in enumerate(columns[:2]) if name.upper() == "TIME"]
    if not timed:
        return np.arange(len(values)) / read_rate(frequency, "FREQUENCY"), values, facts
    # with an external clock only the times show the rate
    rate_hz = None if frequency == "EXT" else read_rate(frequency, "FREQUENCY")
    time, values, more = regular_rows(path.name, [k for k, _ in rows], values, timed[0], rate_hz)
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
    header, rows, facts = _export(path)
    if (included := _text(header, "DATA_INCLUDED")) not in ("3D", ""):
        raise ValueError(f"it holds {short(included)} data, expected 3D; export it again")
    names = [printable(name) for name in header["MARKER_NAMES"] if name]
    width = max(len(line.rstrip().split("\t")) for _, line in rows)
    clock = [title for title in header.get(TITLES, ())[:2] if title.upper() in ("FRAME", "TIME")]
    if TITLES not in header:
        single = "Time" if "." in rows[0][1].split("\t")[0] else "Frame"
        clock = [[], [single], ["Frame", "Time"]][width % 3]
    if width > len(clock) + 3 * len(names):
        raise ValueError(
            f"MARKER_NAMES has {len(names)}, but line {rows[0][0]} holds {width} columns"
        )
    columns = [*clock, *(f"{name} {axis}" for name in names for axis in "XYZ")]
    facts += count_facts(path, {"NO_OF_MARKERS": (_text(header, "NO_OF_MARKERS"), len(names))})
    time, values, more = _numbers(path, header, rows, columns, "NO_OF_FRAMES")
    position = values[:, len(clock) :].reshape(len(values), len(names), 3)
    markers = file_markers(names, "mm", lambda kept: position[:, kept], stated)
    first_frame = int(values[0, 0]) if "Frame" in clock else 1
    frame_s, timed = time[1] - time[0], "Time" in clock
    events = _events(header, time[0] if timed else (first_frame - 1) * frame_s)
    facts += [*more, *(event for event in events if isinstance(event, Fact))]
    plates, notes = list[PlateColumns | Fact](), ending_notes(path)
    files = plate_files(forces or path) or ([] if forces is None else [forces])
    for file in files:
        with naming(file):
            plate, more = _plate(file, time[0] if timed else None)
            notes += ending_notes(file)
        plates.append(plate)
        facts += more
    if files:
        facts.append(Fact("joined", path.name, f"with {listed(file.name for file in files)}"))
    return recording_of(
        path,
        stated,
        markers,
        time - time[0],
        plates,
        on_subject=False,
        facts=facts,
        notes=notes,
        first_frame=first_frame,
        events=tuple(event for event in events if isinstance(event, Event)),
    )


def _events(header: Header, start_s: float) -> list[Event | Fact]:
    """Give the foot strikes and foot offs, and why others are left out."""
    events: list[Event | Fact] = []
    for name, *_, written in (texts for key, texts in header.items() if key.startswith("EVENT ")):
        of, (kind, side) = f"event {short(name)}", kind_and_side(name)
        if kind and side:
            events.append(Event(read_number(written, of) - float(start_s), kind, side))
        else:
            events.append(Fact("left_out", of, "it is no foot strike or foot off of a side"))
    return events


def _plate(path: Path, start_s: float | None) -> tuple[PlateColumns | Fact, list[Fact]]:
    """Give the plate of a file in the axes of the markers, or why it is left out, and facts.

    Its clock begins with the markers', at ``start_s`` where both files have times.
    """
    header, rows, facts = _export(path)
    of_name = PLATE_FILE.fullmatch(path.stem)
    number = int(of_name["number"] or 1) if of_name else 1
    name = f"plate {number} ({short(_text(header, 'FORCE_PLATE_NAME') or path.name)})"
    columns = [f"{part}{axis}" for part in PARTS for axis in "XYZ"]
    if len(rows[0][1].split("\t")) > len(columns) + 1:
        columns = ["SAMPLE", "TIME", *columns]
    columns = [*header.get(TITLES, columns)]
    time, values, more = _numbers(path, header, rows, columns, "NO_OF_SAMPLES")
    clock = time - (time[0] if start_s is None or "TIME" not in columns else start_s)
    by_name = dict(zip(columns, values.T, strict=True))
    plate = plate_of(number, name, clock, by_name, PARTS, units=UNITS)
    place, axes = _place(header, number), _text(header, "DESCRIPTION").lower()
    local = "local" in axes
    why = "its DESCRIPTION does not say whether its axes are the plate's or the lab's"
    if local and place is None:
        why = "it is in the plate's axes, and states no rectangle of corners"
    elif local or any(word in axes for word in ("lab", "world", "global")):
        why = ""
    if why or isinstance(plate, Fact):
        return (Fact("left_out", name, why) if why else plate), [*facts, *more]
    if local and place is not None and plate.pressure is not None:
        force, moment, pressure = (
            part @ place.rotation.T for part in (plate.force, plate.moment, plate.pressure)
        )
        pressure += 1000 * place.center  # in mm, as the file
        plate = replace(plate, force=force, moment=moment, pressure=pressure)
    return replace(plate, place=place), [*facts, *more]


def _place(header: Header, number: int) -> Plate | None:
    """Give where a plate lies [m]; None where its file states no rectangle."""
    keys = (f"FORCE_PLATE_CORNER_{corner}_{axis}" for corner in CORNERS for axis in "XYZ")
    try:
        corners = np.array([_text(header, key) for key in keys], float).reshape(4, 3) / 1000
        rotation = plate_axes(corners)
    except ValueError:
        return None
    if not np.linalg.norm(corners.T @ [1, -1, 1, -1]) < MAX_CORNER_ERROR_M:
        return None
    empty = np.empty(0)
    return Plate(number, empty, empty.reshape(0, 6), rotation, corners.mean(axis=0), corners)
