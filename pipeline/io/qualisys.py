"""Text exports of Qualisys Track Manager (.tsv): trajectories, and force plates beside them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.c3d.read import kind_and_side
from pipeline.io.columns import (
    Located,
    PlateColumns,
    file_markers,
    plate_of,
    recording_of,
    wrench_about_origin,
)
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
    regular_rows,
    table_lines,
    with_last_gaps,
)

PLATE_FILE: Final = re.compile(r"(?P<trial>.*)_f(?:_(?P<number>\d+))?", re.IGNORECASE)
"""Stem of a file of forces: of the only plate, or of one with its number."""
KEY: Final = re.compile(r"[A-Z]+(_[A-Z]+)+|FREQUENCY|DESCRIPTION|EVENT")
PARTS: Final = ("Force_", "Moment_", "COP_")
UNITS: Final = ("N", "Nm", "mm")
CORNERS: Final = ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY")
"""In the order of the C3D format."""
MAX_CORNER_ERROR_M: Final = 0.02
"""Corners that are measured miss a rectangle by millimetres, those in no order by decimetres."""


@dataclass(frozen=True, slots=True)
class Export:
    """A file as the program writes it.

    Attributes
    ----------
    header
        Key -> what follows it in its line.
    events
        Name, frame and time of each, as written.
    titles
        Names of the columns; empty where the file has none.
    rows
        Number and text of each line of numbers.
    facts, notes
        What was written otherwise than expected, and how the file ends.
    """

    header: dict[str, list[str]]
    events: list[list[str]]
    titles: list[str]
    rows: list[tuple[int, str]]
    facts: list[Fact]
    notes: list[Note]

    def text(self, key: str) -> str:
        """Give the first text of a line of the header; empty where it is absent."""
        return (self.header.get(key) or [""])[0]

    def table(self, path: Path, columns: list[str], counted: str) -> tuple[Array, Array, bool]:
        """Give times [s] and rows, and whether the times are those of a column."""
        filled = ((k, with_last_gaps(line, len(columns))) for k, line in self.rows)
        values = parse_rows(filled, "\t", columns)
        self.facts.extend(count_facts(path, {counted: (self.text(counted), len(values))}))
        rate_hz = read_number(self.text("FREQUENCY"), "FREQUENCY in the header")
        timed = [k for k, name in enumerate(columns[:2]) if name.lower() == "time"]
        if not timed:
            return np.arange(len(values)) / rate_hz, values, False
        numbers = [k for k, _ in self.rows]
        time, values, facts = regular_rows(path.name, numbers, values, timed[0], rate_hz)
        self.facts.extend(facts)
        return time, values, True


def _export(path: Path) -> Export:
    lines, facts = table_lines(path)
    rows = [(k, line) for k, line in enumerate(lines, start=1) if line.strip()]
    firsts = (line.split("\t")[0].strip() for _, line in rows)
    numbers = (k for k, first in enumerate(firsts) if first in GAPS or NUMBER.fullmatch(first))
    start = next(numbers, len(rows))
    export = Export({}, [], [], rows[start:], facts, ending_notes(path))
    for _, line in rows[:start]:
        key, texts = line.split()[0], [text.strip() for text in line.split("\t")]
        if key == "EVENT":
            export.events.append(texts[1:])
        elif KEY.fullmatch(key):
            export.header[key] = texts[1:]
        else:
            export.titles[:] = texts
    if len(export.rows) < 2:
        raise ValueError(f"it holds {len(export.rows)} rows of numbers, expected at least 2")
    return export


def plate_files(path: Path) -> list[Path]:
    """Give the files of forces of an export, from that of its trajectories or of one plate."""
    match = PLATE_FILE.fullmatch(path.stem)
    trial = match["trial"] if match else path.stem
    beside = [
        file
        for file in path.parent.iterdir()
        if (of := PLATE_FILE.fullmatch(file.stem))
        and (of["trial"], file.suffix.lower()) == (trial, path.suffix.lower())
    ]
    return sorted(beside, key=lambda file: (len(file.stem), file.stem))


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
    actual ones on the plate, in N, N·m and mm, in its own axes with z down or in those of the lab
    (https://docs.qualisys.com/qtm/content/qtm_windows/force_data_information.htm); ``DESCRIPTION``
    says which. Where they pull nevertheless, they are taken as they are: `recording_of` changes the
    sign of forces that act on the plate. Moments in the plate's axes are about the centre of its
    surface, as in the program's real-time data; the point of others is not documented, so that
    `wrench_about_origin` finds it from the centres of pressure.
    """
    export = _export(path)
    if export.text("DATA_INCLUDED") not in ("3D", ""):
        raise ValueError(
            f"it holds {short(export.text('DATA_INCLUDED'))} data, expected 3D; export it again"
        )
    names = [name for name in export.header["MARKER_NAMES"] if name]
    width = max(len(line.rstrip().split("\t")) for _, line in export.rows)
    others = [title for title in export.titles[:2] if title.lower() in ("frame", "time")]
    if not export.titles:  # a single column before the markers counts frames or has the time
        first = [float(line.split("\t")[0] or "nan") for _, line in export.rows[:2]]
        single = ["Frame" if first[1] - first[0] == 1 else "Time"]
        others = [[], single, ["Frame", "Time"]][width % 3]
    if width > len(others) + 3 * len(names):
        raise ValueError(
            f"MARKER_NAMES are {len(names)}, but line {export.rows[0][0]} has {width} columns"
        )
    columns = [*others, *(f"{name} {axis}" for name in names for axis in "XYZ")]
    export.facts.extend(
        count_facts(path, {"NO_OF_MARKERS": (export.text("NO_OF_MARKERS"), len(names))})
    )
    time, values, timed = export.table(path, columns, "NO_OF_FRAMES")
    position = values[:, len(others) :].reshape(len(values), len(names), 3)
    markers = file_markers(names, "mm", lambda kept: position[:, kept], stated)
    first_frame = int(values[0, others.index("Frame")]) if "Frame" in others else 1
    start_s = time[0] if timed else (first_frame - 1) / read_number(export.text("FREQUENCY"), "")
    plates, local = list[PlateColumns | Fact](), set[int]()
    for file in (files := plate_files(forces or path) or ([forces] if forces else [])):
        with naming(file):
            plate = _plate(file, export, time[0] if timed else None, local)
        plates.append(plate)
    if files:
        beside = f"with the plates of {listed(file.name for file in files)}"
        export.facts.append(Fact("joined", path.name, beside))

    def located(plate: PlateColumns, up: Array) -> Located:
        if plate.place is not None and plate.number in local:
            if plate.place.rotation[:, 2] @ up > 0:
                raise ValueError(
                    f"{plate.name}: its corners are in another order than the plate's axes: z is up"
                )
            about = plate.moment + np.cross(plate.place.center, plate.force)
            plate = replace(plate, moment=about)
        return wrench_about_origin(plate, up)

    return recording_of(
        path,
        stated,
        markers,
        time - time[0],
        plates,
        on_subject=False,
        locate=located,
        facts=export.facts,
        notes=export.notes,
        first_frame=first_frame,
        events=tuple(_events(export, start_s)),
    )


def _events(export: Export, start_s: float) -> Iterator[Event]:
    """Give the foot strikes and foot offs; others are a fact."""
    for name, *_, written in export.events:
        kind, side = kind_and_side(name)
        if kind and side:
            yield Event(read_number(written, f"event {short(name)}") - start_s, kind, side)
        else:
            what = "it is no foot strike or foot off of either side"
            export.facts.append(Fact("left_out", f"event {short(name)}", what))


def _plate(
    path: Path, of_markers: Export, start_s: float | None, local: set[int]
) -> PlateColumns | Fact:
    """Give the plate of a file in the axes of the markers, or why it is left out.

    The number of one whose columns are in its own axes is added to ``local``. Its clock begins with
    the markers' unless both files have times.
    """
    export = _export(path)
    of_name = PLATE_FILE.fullmatch(path.stem)
    number = int(of_name["number"] or 1) if of_name else 1
    name = f"plate {number} ({short(export.text('FORCE_PLATE_NAME') or path.name)})"
    titles = [f"{part}{axis}" for part in PARTS for axis in "XYZ"]
    if len(export.rows[0][1].rstrip().split("\t")) > len(titles):
        titles = ["SAMPLE", "TIME", *titles]
    time, values, timed = export.table(path, export.titles or titles, "NO_OF_SAMPLES")
    of_markers.facts.extend(export.facts)
    of_markers.notes.extend(export.notes)
    columns = dict(zip(export.titles or titles, values.T, strict=True))
    clock = time - (start_s if timed and start_s is not None else time[0])
    plate = plate_of(number, name, clock, columns, PARTS, units=UNITS)
    place, axes = _place(export, number), export.text("DESCRIPTION").lower()
    if isinstance(plate, Fact):
        return plate
    if "local" not in axes:
        known = any(word in axes for word in ("lab", "world", "global"))
        what = "its DESCRIPTION does not say whether its axes are the plate's or the lab's"
        return replace(plate, place=place) if known else Fact("left_out", name, what)
    if place is None:
        what = "its columns are in its own axes, and its corners are no rectangle"
        return Fact("left_out", name, what)
    local.add(number)
    turned = (part @ place.rotation.T for part in (plate.force, plate.moment, plate.pressure))
    force, moment, pressure = turned
    return replace(
        plate, force=force, moment=moment, pressure=pressure + 1000 * place.center, place=place
    )


def _place(export: Export, number: int) -> Plate | None:
    """Give where a plate lies [m]; None where its file states no rectangle."""
    keys = (f"FORCE_PLATE_CORNER_{corner}_{axis}" for corner in CORNERS for axis in "XYZ")
    try:
        corners = np.array([export.text(key) for key in keys], float).reshape(4, 3) / 1000
        rotation = plate_axes(corners)
    except ValueError:
        return None
    if not np.linalg.norm(corners.T @ [1, -1, 1, -1]) < MAX_CORNER_ERROR_M:
        return None
    empty = np.empty(0)
    return Plate(number, empty, empty.reshape(0, 6), rotation, corners.mean(axis=0), corners)
