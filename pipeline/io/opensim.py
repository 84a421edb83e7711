"""OpenSim's files: TRC, MOT and STO."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.columns import (
    FileMarkers,
    PlateColumns,
    file_markers,
    plate_of,
    recording_of,
    wrench_of_torque,
)
from pipeline.io.input_file import naming
from pipeline.io.recording import Fact, Recording
from pipeline.io.stated import Stated
from pipeline.io.text_table import ending_notes, lines_of, names_in, parse_rows, read_number

MIN_RATE_HZ, MAX_RATE_HZ = 1.0, 100_000.0
"""Of cameras."""
MAX_TIME_ERROR: Final = 0.1
"""In frames: files round their times, but not by more than this beyond half of their last digit."""
ROUNDED: Final = 1e-6
"""Of a digit: closer to a whole one, a number has no further digits."""
Trajectories = tuple[FileMarkers, Array, dict[str, Any]]
"""Markers, times on the file's clock, (T,) [s], and further attributes of the recording."""
MAX_ROUNDING: Final = 0.05
"""In steps: times printed with few digits differ from even ones by less."""
FORCE_COLUMN: Final = re.compile(r"(?P<stem>.*force.*)_(?P<letter>[vf])[xyz]")
TORQUE_COLUMNS: Final = (
    ("torque", "_"),
    ("moment", "_"),
    ("torque", "_m"),
    ("moment", "_m"),
    ("force", "_m"),
)
"""How programs call the torques of ``ground_force_vx``: ``ground_torque_x``, `` ground_force_mx``:
word in the place of "force", and what stands before the axis."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table over time, as the file holds it.

    Attributes
    ----------
    time
        Times, (N,) [s].
    columns
        Name -> values, (N,); of columns with the same name the first. Without ``time``.
    notes
        On how the file ends.
    """

    time: Array
    columns: Mapping[str, Array]
    notes: Sequence[Note]


def read_sto(path: str | Path) -> Table:
    """Read a MOT or STO file of any version.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Table
        Its columns; nothing is converted.

    Raises
    ------
    ValueError
        The file has no header or time column, is truncated, or holds something that is no number.
    OSError
        The file cannot be opened.
    """
    path = Path(path)
    with naming(path):
        return _table(path)


def _table(path: Path) -> Table:
    lines = list(lines_of(path))
    ends = [k for k, line in enumerate(lines) if line.strip().lower() == "endheader"]
    if not ends:
        raise ValueError("not a MOT or STO file: it has no line 'endheader'")
    pairs = (line.partition("=") for line in lines[: ends[0]] if "=" in line)
    header = {key.strip().lower(): value.strip().lower() for key, _, value in pairs}
    body = [(k, line) for k, line in enumerate(lines, start=1) if k > ends[0] + 1 and line.strip()]
    names = names_in(body[0][1]) if body else []
    if not names or names[0].lower() != "time":
        raise ValueError(f"its first column is {listed(names[:1])}, expected 'time'")
    values = parse_rows(((k, "\t".join(line.split())) for k, line in body[1:]), "\t", names)
    for key, count in (("nrows", values.shape[0]), ("ncolumns", values.shape[1])):
        if key in header and header[key] != str(count):
            raise ValueError(f"its header says {key}={short(header[key])} but it holds {count}")
    columns = dict(reversed([*zip(names[1:], values.T[1:], strict=True)]))  # the first of each
    ordered = {name: columns[name] for name in names[1:]}
    return Table(values[:, 0], ordered, ending_notes(path))


def read_trc(path: Path, stated: Stated, forces: Path | None = None) -> Recording:
    """Read markers from a TRC file and, if given, ground reaction forces from a MOT file.

    Parameters
    ----------
    path
        Marker trajectories.
    stated
        What is stated about the files.
    forces
        Forces, points of application and torques in OpenSim's naming, on the same clock and in the
        same axes as the markers; N, m and N·m, if no other units are stated.

    Returns
    -------
    Recording
        Times start at 0 at the first frame of the TRC file. Each force is a plate with identity
        rotation and centre at the lab origin, so that its wrench in the plate is the wrench about
        the lab origin; its corners are unknown (NaN).

    Raises
    ------
    ValueError
        A file is damaged or truncated, a unit is unknown or contradicts the markers' extent, the
        axes cannot be inferred, or the table names no forces.
    OSError
        A file cannot be opened.

    Notes
    -----
    Moment about the origin of force f at point p with torque t: p × f + t, unless t turns out to be
    the moment about a fixed point (`wrench_of_torque`). Where a force is exactly zero its point has
    no meaning and is not used. MOT files often print times with so few digits that the steps look
    uneven; force times within a twentieth of a step of even ones become even.
    """
    markers, time, attributes = _trajectories(path, stated)
    plates: list[PlateColumns | Fact] = []
    if forces is not None:
        table = read_sto(forces)
        with naming(forces):
            plates = list(_forces(table, _evened(table.time) - time[0]))
        attributes["notes"] += table.notes
    return recording_of(
        path, stated, markers, time - time[0], plates, locate=wrench_of_torque, **attributes
    )


def _trajectories(path: Path, stated: Stated) -> Trajectories:
    """Read a TRC file in its own axes; empty fields and points at exactly zero are gaps.

    Times are regular from the first one at the file's rate, since files round them.
    """
    lines, notes = list(lines_of(path)), ending_notes(path)
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise ValueError("not a TRC file: it does not begin with 'PathFileType'")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    if missing := {"DataRate", "NumFrames", "NumMarkers", "Units"} - set(header):
        raise ValueError(f"its header does not say {listed(sorted(missing))}")
    names = tuple(filter(None, names_in(lines[3], "\t")[2:]))
    columns = ["Frame#", "Time", *(f"{name} {axis}" for name in names for axis in "XYZ")]
    rows = [(k, line) for k, line in enumerate(lines[5:], start=6) if line.strip()]
    rate_hz, frames, count = (
        read_number(header[key], f"{key} in the header")
        for key in ("DataRate", "NumFrames", "NumMarkers")
    )
    if count != len(names):
        raise ValueError(f"its header says NumMarkers {count:g}, but it holds {len(names)}")
    if not rows or not names:
        raise ValueError("it holds no frames")
    if frames != len(rows):
        if notes and rows[-1][1].count("\t") + 1 < len(columns):  # it ends within a line
            raise ValueError(
                f"its header says NumFrames {frames:g}, but it is cut off in {len(rows)}"
            )
        notes.append(Note.of("frame_count_differs", header=f"{frames:g}", found=len(rows)))
    filled = ((k, _with_last_gaps(line, len(columns))) for k, line in rows)
    values = parse_rows(filled, "\t", columns)
    if not np.isfinite(values[:, :2]).all():
        raise ValueError("a frame has no number or no time")
    position = values[:, 2:].reshape(len(rows), len(names), 3)
    time, time_notes = _regular(values[:, 1], rate_hz)
    markers = file_markers(names, header["Units"], lambda kept: position[:, kept], stated)
    attributes = {"first_frame": int(values[0, 0]), "notes": [*notes, *time_notes]}
    return markers, time, attributes


def _regular(stated: Array, rate_hz: float) -> tuple[Array, list[Note]]:
    """Give regular times [s] at a rate, as the stated ones are but for their rounding."""
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise ValueError(
            f"its header says {rate_hz:g} Hz, expected {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
        )
    after = np.arange(len(stated)) / rate_hz
    rounding = _rounding(stated, rate_hz)
    time: Array = (float(np.mean(stated - after)) if rounding else stated[0]) + after
    wrong = np.flatnonzero(~(np.abs(stated - time) < MAX_TIME_ERROR / rate_hz + 2 * rounding))
    if len(wrong):
        k = wrong[0]
        raise ValueError(
            f"its times are not the regular times of its rate of {rate_hz:g} Hz: frame {k + 1} of "
            f"{len(time)} is at {stated[k]:.6g} s, expected {time[k]:.6g} s; correct DataRate, or "
            "export the file again"
        )
    if not rounding:
        return time, []
    scatter_s = np.ptp(stated - time)
    return time, [Note.of("sample_clock", of="frames", rate_hz=rate_hz, scatter_s=scatter_s)]


def _rounding(stated: Array, rate_hz: float) -> float:
    """Give half of the last digit of rounded times [s]; 0 where the steps have no more digits."""
    for unit in (0.01, 0.001):
        if np.abs(stated / unit - np.round(stated / unit)).max() < ROUNDED:
            step = 1 / rate_hz / unit
            return 0.0 if abs(step - round(step)) < ROUNDED else unit / 2
    return 0.0


def _with_last_gaps(line: str, count: int) -> str:
    """Add the tabs that some programs leave out where a frame's last markers are missing."""
    missing = count - line.count("\t") - 1
    return line + "\t" * missing if missing > 0 and missing % 3 == 0 else line


def _evened(time: Array) -> Array:
    """Give even times where the printed ones are those but for their rounding."""
    even = np.linspace(time[0], time[-1], len(time))
    step = even[1] - even[0] if len(time) > 1 else 0.0
    return even if np.abs(time - even).max() <= MAX_ROUNDING * step else time


def _forces(table: Table, time: Array) -> Iterator[PlateColumns | Fact]:
    """Give each force of a table with its point and torque, or why it is left out."""
    columns = table.columns
    found = [match for name in columns if (match := FORCE_COLUMN.fullmatch(name))]
    stems = dict.fromkeys((match["stem"], match["letter"]) for match in found)
    if not stems:
        raise ValueError(f"no forces such as ground_force_vx; columns: {listed(columns)}")
    for k, (stem, letter) in enumerate(stems, start=1):
        name = short(stem)
        torques = dict.fromkeys(
            stem.replace("force", word) + before for word, before in TORQUE_COLUMNS
        )
        there = [torque for torque in torques if f"{torque}x" in columns]
        if len(there) > 1:
            raise ValueError(
                f"the torques of {name} are there twice, as {short(there[0])}x and "
                f"{short(there[1])}x; remove those that are not free torques"
            )
        quantities = [f"{stem}_{letter}", (there or [*torques])[0], f"{stem}_p"]
        plate = plate_of(k, f"plate {k} ({name})", time, columns, quantities, axes="xyz")
        if isinstance(plate, PlateColumns) and plate.pressure is not None:
            plate.pressure[~plate.force.any(axis=1)] = 0  # it has no meaning there
        yield plate
