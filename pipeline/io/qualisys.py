"""Text exports of Qualisys Track Manager (.tsv): trajectories, and force plates beside them."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.c3d.force_plates import plate_axes, unit_of_corners
from pipeline.io.c3d.read import kind_and_side
from pipeline.io.columns import PlateColumns, file_markers, recording_of, vectors
from pipeline.io.input_file import last_written, naming
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Event, Fact, Plate, Recording
from pipeline.io.text_table import GAPS, NUMBER, TextTable, read_number, read_rate, read_table

PLATE_FILE: Final = re.compile(r"(?P<trial>.*)_f(?:_(?P<number>\d+))?", re.IGNORECASE)
"""Stem of a file of forces: of the only plate, or of one with its number."""
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "plates")
Header = Mapping[str, str]
"""Key -> what follows it, empty if it is absent; of events with their lines' numbers. Without a key
are the names of the columns."""


def _export(path: Path) -> tuple[Header, TextTable]:
    """Give the header, and the table of numbers below it."""
    table = read_table(path)
    firsts = (line.split("\t")[0].strip() for _, line in table.rows)
    numbers = (k for k, first in enumerate(firsts) if first in GAPS or NUMBER.fullmatch(first))
    start = next(numbers, len(table.rows))
    header = defaultdict[str, str](str)
    is_key = re.compile(r"[A-Z]+(_[A-Z]+)+|FREQUENCY|DESCRIPTION|EVENT")
    for k, line in table.rows[:start]:
        key, _, text = line.partition("\t")
        if is_key.fullmatch(key.strip()):
            header[f"EVENT {k}" if key == "EVENT" else key.strip()] = text.strip()
        else:
            header[""] = line
    table.rows = table.rows[start:]
    if len(table.rows) < 2:
        raise ValueError(f"it holds {len(table.rows)} rows of numbers, expected at least 2")
    return header, table


def _rate_hz(header: Header, timed: bool) -> float:
    """Give the rate in a header; 0 with an external clock, whose rate only the times show."""
    external = timed and header["FREQUENCY"] == "EXT"
    return 0.0 if external else read_rate(header["FREQUENCY"], "FREQUENCY")


def plate_files(path: Path) -> list[Path]:
    """Give the files of forces of an export, from that of its trajectories or of one plate.

    A C3D file has none.
    """
    folder, match = path.parent, PLATE_FILE.fullmatch(path.stem)
    if path.suffix.lower() == ".c3d" or not folder.is_dir():
        return []
    files = _force_files(folder, last_written(folder))
    return files.get((match["trial"] if match else path.stem, path.suffix), [])


@lru_cache(maxsize=8)
def _force_files(folder: Path, version: tuple[int, int]) -> dict[tuple[str, str], list[Path]]:
    """Give the files of forces of each trial and suffix; the version changes with the folder.

    A folder of thousands is searched once, not for each of them.
    """
    files = defaultdict[tuple[str, str], list[Path]](list)
    for file in sorted(folder.iterdir(), key=lambda file: (len(file.stem), file.stem)):
        if match := PLATE_FILE.fullmatch(file.stem):
            files[match["trial"], file.suffix].append(file)
    return files


def read_qualisys(path: Path, options: ReadOptions, forces: Path | None = None) -> Recording:
    """Read an export of trajectories in 3D, and the force plates of the same export.

    Parameters
    ----------
    path
        The file, such as walk.tsv.
    options
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
        A file is damaged, truncated, or contradicts its units, axes or itself. One line.
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
    header, table = _export(path)
    names = [printable(n.strip()) for n in header["MARKER_NAMES"].split("\t") if n.strip()]
    # a frame's number, its time, or both, and three columns of each marker
    single = "Time" if "." in table.rows[0][1].split("\t")[0] else "Frame"
    clock = [[], [single], ["Frame", "Time"]][table.width % 3]
    table.check_counts(header, {"NO_OF_MARKERS": len(names), "NO_OF_FRAMES": len(table.rows)})
    first, time, position = table.markers(clock, names, _rate_hz(header, "Time" in clock))
    markers = file_markers(names, "mm", lambda kept: position[:, kept], options)
    plates, start_s = list[PlateColumns | Fact](), time[0] if "Time" in clock else None
    files = plate_files(forces or path) or ([] if forces is None else [forces])
    for file in files:
        with naming(file):
            plates.append(_plate(file, start_s, markers.position, table.remarks))
    if files:
        table.remarks.append(
            Fact("joined", path.name, f"with {listed(file.name for file in files)}")
        )
    return recording_of(
        path,
        options,
        markers,
        time - time[0],
        plates,
        on_subject=False,
        notes=table.remarks,
        first_frame=first,
        events=tuple(_events(header, time[0], table.remarks)),
    )


def _events(header: Header, start_s: float, remarks: list[Note | Fact]) -> Iterator[Event]:
    """Give the foot strikes and foot offs, and say which others are left out."""
    for text in (text for key, text in header.items() if key.startswith("EVENT ")):
        name, *_, written = text.split("\t")
        of, (kind, side) = f"event {short(name)}", kind_and_side(name)
        if kind and side:
            yield Event(read_number(written, of) - start_s, kind, side)
        else:
            remarks.append(Fact("left_out", of, "it is no foot strike or foot off of a side"))


def _plate(
    path: Path, start_s: float | None, position: Array, remarks: list[Note | Fact]
) -> PlateColumns | Fact:
    """Give the plate of a file in the axes of the markers, or why it is left out.

    Its clock begins with the markers', at ``start_s`` where both files have times. Where markers
    are, ``position``, shows corners in another unit.
    """
    header, table = _export(path)
    of_name = PLATE_FILE.fullmatch(path.stem)
    number = int(of_name["number"] or 1) if of_name else 1
    name = f"plate {number} ({short(header['FORCE_PLATE_NAME'] or path.name)})"
    columns = [title.strip() for title in header[""].split("\t")]
    timed = columns.index("TIME") if "TIME" in columns else None
    table.check_counts(header, {"NO_OF_SAMPLES": len(table.rows)})
    rate_hz = _rate_hz(header, timed is not None)
    time, values = table.regular(table.numbers(columns), timed, rate_hz)
    remarks += table.remarks
    clock = time - (time[0] if start_s is None or timed is None else start_s)
    place, axes = _place(header, number, position, remarks), header["DESCRIPTION"].lower()
    try:
        stems = ("Force_", "Moment_", "COP_")
        parts = vectors(dict(zip(columns, values.T, strict=True)), stems)
    except ValueError as error:
        return Fact("left_out", name, str(error), plate=True)
    # from the plate's axes to the file's, and centres of pressure from the file's origin
    if "local" in axes and place is not None:
        parts = parts @ place.rotation.T
        parts[:, 2] += 1000 * place.center  # in mm, as the file
    elif "local" in axes or not any(word in axes for word in ("lab", "world", "global")):
        why = "its header does not say in which axes it is, or states no rectangle of corners"
        return Fact("left_out", name, why, plate=True)
    units = ("N", "Nm", "mm")
    return PlateColumns(number, name, clock, *parts.transpose(1, 0, 2), units=units, place=place)


def _place(
    header: Header, number: int, position: Array, remarks: list[Note | Fact]
) -> Plate | None:
    """Give where a plate lies [m]; None where its file states no rectangle of a plate's size."""
    order = ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY")  # of the C3D format
    keys = (f"FORCE_PLATE_CORNER_{corner}_{axis}" for corner in order for axis in "XYZ")
    try:
        corners = np.array([header[key] for key in keys], float).reshape(4, 3)
        unit, facts = unit_of_corners(number, corners, 1e-3, position)
        place = plate_at(number, corners * unit)
    except ValueError:
        return None
    remarks += facts
    return place


def plate_at(number: int, corners: Array) -> Plate:
    """Give a plate without samples by its corners, (4, 3) [m], in the order of the C3D format.

    A ValueError where they are no rectangle.
    """
    rotation = plate_axes(corners)
    # of a rectangle, both diagonals have one middle
    if not np.linalg.norm(corners.T @ [1, -1, 1, -1]) < LIMITS.largest_disorder:
        raise ValueError("its corners are no rectangle")
    wrench, center = np.empty((0, 6)), corners.mean(axis=0)
    return Plate(number, np.empty(0), wrench, rotation, center, corners)
