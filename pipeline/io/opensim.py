"""OpenSim's files: TRC with MOT, STO or Cortex's .forces."""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.columns import SI_UNITS, PlateColumns, file_markers, plate_of, recording_of
from pipeline.io.input_file import naming
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Fact, Recording
from pipeline.io.text_table import TextTable, labels_in, read_number, read_rate, read_table

FORCE_COLUMN: Final = re.compile(r"(?P<stem>.*force.*)_(?P<letter>[vf])[xyz]")
OTHER_COLUMNS: Final = (
    re.compile(r"(?P<of>[fpm])(?P<number>\d+)_?(?P<what>[vpm]?)(?P<axis>[xyz123])"),
    re.compile(r"(?P<what>[FM]?)(?P<axis>[XYZ])(?P<number>\d+)(?P<of>)"),
    re.compile(r"(?i:fp|plate)(?P<number>\d+)_(?P<what>[vpm])(?P<axis>[xyz])"),
)
"""Of OpenSim's C3DFileAdapter, such as f1_x, p1_2 or f1_vx, of Cortex, such as FX1, X1, MZ1, and
of others, such as FP1_vx."""
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "times")


@dataclass(frozen=True, slots=True)
class Table:
    """A table over time, as the file holds it.

    Attributes
    ----------
    time
        Times, (N,) [s].
    columns
        Name -> values, (N,), without the times.
    units
        Of forces, moments and points of application.
    text
        The rows as they are written.
    """

    time: Array
    columns: Mapping[str, Array]
    units: tuple[str, str, str]
    text: TextTable


def read_sto(path: str | Path) -> Table:
    """Read a MOT or STO file of any version, or a .forces file of Cortex.

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
        The file has no header or time column, is truncated, holds something that is no number, or
        two different columns of one name.
    OSError
        The file cannot be opened.

    Notes
    -----
    Cortex states its format nowhere in public; this is what a program that reads it says
    (io_cortexmac.py of https://github.com/BMClab/BMC): lines ``[Force Data]``,
    ``NumberOfForcePlates=``, ``SampleRate=``, ``NumberOfSamples=``, then a row of names, ``#Sample
    FX1 FY1 FZ1 X1 Y1 Z1 MZ1 FX2`` and so on: force [N], centre of pressure [mm] and free moment
    [N·mm] of each plate.
    """
    path = Path(path)
    with naming(path):
        table = read_table(path, "\t ")
        lines = table.rows
        firsts = [line.split()[0].lower() for _, line in lines]
        cortex = is_cortex(lines[0][1])
        last_of_header = "#sample" if cortex else "endheader"
        if last_of_header not in firsts and firsts[0] != "time":
            raise ValueError("not a MOT or STO file: it has no line 'endheader'")
        start = firsts.index(last_of_header) + 1 if last_of_header in firsts else 0
        pairs = (line.partition("=") for _, line in lines[:start])
        header = {key.strip(): value.strip() for key, _, value in pairs}
        (_, names_line), *table.rows = lines[start - cortex :] or [(0, "")]
        names = labels_in(names_line, table.width)
        if [name.lower() for name in names[:1]] not in (["time"], ["#sample"]):
            raise ValueError(f"its first column is {listed(names[:1])}, expected 'time'")
        columns = table.distinct(names, table.numbers(names))
        counts = dict.fromkeys(("nRows", "NumberOfSamples"), len(table.rows))
        counts["NumberOfForcePlates"] = sum(name.upper().startswith("FX") for name in names)
        table.check_counts(header, counts | {"nColumns": len(names)})
        time = columns.pop(names[0])
        if not cortex:
            return Table(time, columns, SI_UNITS, table)
        time = (time - 1) / read_rate(header.get("SampleRate", ""), "SampleRate")
        return Table(time, columns, ("N", "Nmm", "mm"), table)


def is_cortex(line: str) -> bool:
    """Whether a file whose first line this is is a .forces file."""
    return line.split()[:2] == ["[Force", "Data]"]


def read_trc(path: Path, options: ReadOptions, forces: Path | None = None) -> Recording:
    """Read markers from a TRC file and, if given, ground reaction forces from a MOT file.

    Parameters
    ----------
    path
        Marker trajectories.
    options
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
    the moment about a fixed point (`pipeline.io.columns.wrench_of_torque`). Where a force is
    exactly zero its point has no meaning and is not used. MOT files often print times with so few
    digits that the steps look uneven; force times within a twentieth of a step of even ones become
    even.
    """
    table = read_table(path)
    lines = table.rows
    firsts = [line.split()[0].lower() for _, line in lines]
    start = next((k for k, first in enumerate(firsts) if first in ("frame#", "frame")), 0)
    if not firsts[0].startswith("pathfiletype") or start < 3:
        raise ValueError("not a TRC file: it does not begin with 'PathFileType', keys and 'Frame#'")
    keys, written = (line.split("\t" if "\t" in line.strip() else None) for _, line in lines[1:3])
    header = {key.strip(): text.strip() for key, text in zip(keys, written, strict=False)}
    if missing := [key for key in ("DataRate", "Units") if not header.get(key)]:
        raise ValueError(f"its header does not say {listed(missing)}")
    # the line of X1, Y1, … has no numbers
    body = lines[start + 1 :] or [(0, "X")]
    table.rows = body[any(letter in body[0][1].upper() for letter in "XYZ") :]
    # labels of "Frame#", "Time" and three columns each
    names = labels_in(lines[start][1], 2 + table.width // 3)[2:]
    if not table.rows or not names:
        raise ValueError("it holds no frames or names no markers")
    table.check_counts(header, {"NumMarkers": len(names), "NumFrames": len(table.rows)})
    rate_hz = read_number(header["DataRate"], "DataRate in the header")
    first, time, position = table.markers(("Frame", "Time"), names, rate_hz)
    markers = file_markers(names, header["Units"], lambda kept: position[:, kept], options)
    plates, of_sto = list[PlateColumns | Fact](), True
    if forces is not None:
        with naming(forces):
            loads = read_sto(forces)
            held = np.column_stack([loads.time, *loads.columns.values()])
            if np.ptp(held[:, 0]) > LIMITS.least_span_in_ms * np.ptp(time):
                held[:, 0] /= 1000
                in_ms = (
                    "its times are read as ms: in s they would last much longer than the markers"
                )
                table.remarks.append(Fact("corrected", forces.name, in_ms))
            clock, held = loads.text.regular(held, 0)
            of_sto, lasts_s, last_s = loads.units == SI_UNITS, np.ptp(clock), np.ptp(time)
            if not of_sto and abs(lasts_s - last_s) < 2 * (time[1] - time[0]):
                clock = clock - clock[0] + time[0]
            elif not of_sto:
                doubt = f"it lasts {lasts_s:.2f} s by its SampleRate, the markers {last_s:.2f} s"
                table.remarks.append(Fact("in_doubt", forces.name, doubt))
            if clock[-1] < time[0] or clock[0] > time[-1]:
                times = f"{clock[0]:.2f}–{clock[-1]:.2f} s do not overlap the {time[0]:.2f}"
                raise ValueError(f"its times {times}–{time[-1]:.2f} s of {path.name}; same clock?")
            columns = dict(zip(loads.columns, held.T[1:], strict=True))
            plates = list(_forces(columns, clock - time[0], loads.units))
            table.remarks += loads.text.remarks
    return recording_of(
        path,
        options,
        markers,
        time - time[0],
        plates,
        on_subject=of_sto,
        torques=True,
        notes=table.remarks,
        first_frame=first,
        forces_beside=forces_beside(path) if forces is None else None,
    )


def forces_beside(path: Path) -> Path | None:
    """Give the file beside a TRC file that holds forces of its trial by its name, if it is one."""
    # words that say what a file holds, not which trial it is of
    of_content = {"markers", "marker", "trc", "grf", "grfs", "forces", "force", "mot"}
    of_forces = []
    for file in path.parent.glob("*"):
        words, others = (
            {*re.findall(r"[^\W_]+", f.stem.lower())} - of_content for f in (file, path)
        )
        alike = words <= others or others <= words
        if alike and file.suffix.lower() in (".mot", ".sto", ".forces"):
            with suppress(OSError, ValueError):
                if any(map(FORCE_COLUMN.fullmatch, map(_usual_name, read_sto(file).columns))):
                    of_forces.append(file)
    return of_forces[0] if len(of_forces) == 1 else None


def _usual_name(name: str) -> str:
    """Give the usual name of a column of Cortex or of OpenSim's C3DFileAdapter."""
    for match in filter(None, (pattern.fullmatch(name) for pattern in OTHER_COLUMNS)):
        what = {"f": "v", "": "p"}.get(letter := (match["what"] or match["of"]).lower(), letter)
        axis = "xyz"["xyz123".index(match["axis"].lower()) % 3]
        return f"ground_force_{match['number']}_{what}{axis}"
    return name


def _forces(
    columns: Mapping[str, Array], time: Array, units: tuple[str, str, str]
) -> Iterator[PlateColumns | Fact]:
    """Give each force of a table with its point and torque, or why it is left out."""
    columns = {_usual_name(name): values for name, values in columns.items()}
    if units != SI_UNITS:  # a free moment is vertical
        stems_of_free = [name.removesuffix("z") for name in columns if name.endswith("_mz")]
        columns |= {f"{stem}{axis}": np.zeros(len(time)) for stem in stems_of_free for axis in "xy"}
    matches = filter(None, map(FORCE_COLUMN.fullmatch, columns))
    stems = dict.fromkeys((match["stem"], match["letter"]) for match in matches)
    if not stems:
        raise ValueError(f"no forces such as ground_force_vx; columns: {listed(columns)}")
    # torques of ground_force_vx are ground_torque_x, ground_moment_x, ground_force_mx and the like
    of_torques = [*product(("torque", "moment", "force"), ("_", "_m"))]
    for k, (stem, letter) in enumerate(stems, start=1):
        name = f"plate {k} ({short(stem)})"
        torques = [stem.replace("force", word) + before for word, before in of_torques]
        there = [torque for torque in torques if f"{torque}x" in columns]
        if len(there) > 1:
            raise ValueError(f"the torques of {name} are there twice: {listed(there)}; remove one")
        quantities = [f"{stem}_{letter}", (there or torques)[0], f"{stem}_p"]
        yield plate_of(k, name, time, columns, quantities, axes="xyz", units=units)
