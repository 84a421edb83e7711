"""ASCII exports of Vicon Nexus: blocks of numbers under groups of columns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.columns import PlateColumns, file_markers, plate_of, recording_of
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Analog, Fact, Recording
from pipeline.io.text_table import TextTable, read_rate, read_table

HEADER_LINES: Final = 5
"""Title, rate, groups, components, units."""


@dataclass(frozen=True, slots=True)
class Group:
    """Adjacent columns under one name: components, units, and values, (N, components)."""

    name: str
    components: tuple[str, ...]
    units: tuple[str, ...]
    values: Array


@dataclass(frozen=True, slots=True)
class Block:
    """One block: its rate [Hz], frame and sub frame of each row, (N,), and groups of columns."""

    rate_hz: float
    frame: Array
    sub_frame: Array
    groups: list[Group]


def is_nexus(lines: Sequence[str]) -> bool:
    """Whether a text begins like a Nexus export: a title, a rate, then "Frame, Sub Frame"."""
    filled = [line for line in lines if line.strip(' \t,;"')][2:4]
    return "subframe" in "".join(filled).lower().replace(" ", "")


def _blocks(path: Path) -> tuple[dict[str, Block], list[Note | Fact]]:
    """Cut an export into devices and trajectories, by their titles."""
    blocks: dict[str, Block] = {}
    table = read_table(path, ",;\t")
    # an empty line, which is not among the rows, ends a block
    for _, part in groupby(enumerate(table.rows), key=lambda place: place[1][0] - place[0]):
        block = [row for _, row in part]
        title = block[0][1].strip()
        if title.lower() in ("devices", "trajectories") and title.lower() not in blocks:
            blocks[title.lower()] = _block(replace(table, rows=block))
        else:
            table.remarks.append(Note.of("parts_left_out", parts=[short(title)]))
    return blocks, table.remarks


def _block(table: TextTable) -> Block:
    rows, first_line = table.rows, table.rows[0][0]
    if len(rows) <= HEADER_LINES:
        raise ValueError(f"line {first_line}: its block ends after {len(rows)} lines, truncated")
    _, rate, *header = (line.rstrip() for _, line in rows[:HEADER_LINES])
    names, labels, units = ([printable(f.strip()) for f in line.split("\t")] for line in header)
    clock = [label.lower() for label in labels[:2]]
    if clock != ["frame", "sub frame"] or len(labels) < 3 or any(names[len(labels) :]):
        raise ValueError(
            f"line {first_line + 3} is {short(header[1])!r}, expected Frame, Sub Frame, and "
            "components of each name above them"
        )
    values = replace(table, rows=rows[HEADER_LINES:]).numbers(labels)
    units += [""] * len(labels)
    # a name stands above the first of its components, after the two columns of the clock
    starts = [k for k, name in enumerate(names) if name and k >= 2]
    groups = [
        Group(names[a], tuple(labels[a:b]), tuple(units[a:b]), values[:, a:b])
        for a, b in zip(starts, [*starts[1:], len(labels)], strict=True)
    ]
    return Block(read_rate(rate, "rate"), values[:, 0], values[:, 1], groups)


def _time(title: str, block: Block, trajectories: Block) -> Array:
    """Give the times of a block's rows from the first frame of the trajectories, (N,) [s]."""
    # whole frames of the cameras, and within one the samples of the device
    time: Array = (block.frame - trajectories.frame[0]) / trajectories.rate_hz
    time = time + block.sub_frame / block.rate_hz
    # in samples, as rates are rounded
    if not (np.abs(np.diff(time) * block.rate_hz - 1) < 1e-3).all():
        raise ValueError(
            f"{title}: numbers of frames and sub frames do not increase by one at "
            f"{block.rate_hz:g} Hz, with frames at {trajectories.rate_hz:g} Hz"
        )
    return time


def read_nexus(path: Path, options: ReadOptions) -> Recording:
    """Read an ASCII export of Vicon Nexus (.csv or .txt).

    Parameters
    ----------
    path
        The file, with a Trajectories block and, for plates, a Devices block.
    options
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`.

    Returns
    -------
    Recording
        SI units, lab axes; times start at 0 at the first frame. Devices with Force and Moment are
        plates with identity rotation and centre at the lab origin, so that their wrench is about
        the lab origin; their corners are unknown (NaN). Other devices are analog channels. Prefer
        C3D: it also knows the plates' corners, the events and model outputs.

    Raises
    ------
    ValueError
        The file is damaged, truncated, or contradicts its units, axes or itself. One line.
    OSError
        The file cannot be opened.

    Notes
    -----
    Nexus exports forces in the lab's axes, by its settings as acting on the plate or on the
    subject. Forces that pull down on average are those on the plate, for nobody hangs from one, and
    change sign. Its moments are about the plate's centre, which the file does not state:
    `wrench_about_origin` finds it from the centres of pressure.
    """
    blocks, remarks = _blocks(path)
    if "trajectories" not in blocks:
        raise ValueError(f"no Trajectories block; blocks: {listed(blocks)}")
    block = blocks["trajectories"]
    labelled = (group for group in block.groups if not group.name.startswith("*"))
    groups = [group for group in labelled if group.components[:3] == ("X", "Y", "Z")]
    units = list(dict.fromkeys(group.units[0] for group in groups))
    if len(units) != 1:
        raise ValueError(
            f"Trajectories: {len(groups)} markers with X, Y, Z in units {listed(units)}, not one"
        )
    markers = file_markers(
        [group.name for group in groups],
        units[0],
        lambda kept: np.stack([groups[k].values[:, :3] for k in kept], axis=1),
        options,
    )
    plates, analog = _devices(blocks["devices"], block) if "devices" in blocks else ([], None)
    return recording_of(
        path,
        options,
        markers,
        _time("Trajectories", block, block),
        plates,
        on_subject=False,
        notes=remarks,
        analog=analog,
        first_frame=int(block.frame[0]),
    )


def _devices(block: Block, trajectories: Block) -> tuple[list[PlateColumns | Fact], Analog | None]:
    """Give plates, or why they are left out, and analog channels."""
    time = _time("Devices", block, trajectories)
    if (last := trajectories.frame[-1]) < block.frame[-1]:
        raise ValueError(
            f"Trajectories end with frame {last:.0f}, Devices with {block.frame[-1]:.0f}: the file "
            "is truncated; copy it from its source again, or export it again"
        )
    by_name = {group.name: group for group in block.groups}
    columns = {
        f"{name} {axis}": column
        for name, group in by_name.items()
        for axis, column in zip("XYZ", group.values.T, strict=False)
    }
    forces = [n for n, g in by_name.items() if n.endswith(" - Force") and len(g.components) >= 3]
    plates, used = list[PlateColumns | Fact](), set[str]()
    for number, name in enumerate(forces, start=1):
        device = name.removesuffix(" - Force")
        stems = [f"{device} - {part}" for part in ("Force", "Moment", "CoP")]
        used.update(stems)
        force, moment, pressure = (by_name[s].units[0] if s in by_name else "" for s in stems)
        plate = f"plate {number} ({short(device)})"
        vectors, units = [f"{stem} " for stem in stems], (force, moment, pressure)
        plates.append(plate_of(number, plate, time, columns, vectors, units=units))
    rest = [group for group in block.groups if group.name not in used]
    if not rest:
        return plates, None
    labels = [f"{group.name} {part}".strip() for group in rest for part in group.components]
    of_labels = [unit for group in rest for unit in group.units]
    values = np.hstack([group.values for group in rest])
    return plates, Analog(time, tuple(labels), tuple(of_labels), values)
