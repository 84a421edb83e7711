"""ASCII exports of Vicon Nexus: blocks of numbers under groups of columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.columns import PlateColumns, file_markers, recording_of
from pipeline.io.recording import Analog, Fact, Recording
from pipeline.io.stated import Stated
from pipeline.io.text_table import ending_notes, names_in, parse_rows, read_number, table_lines

TITLES: Final = ("devices", "trajectories", "model outputs")
HEADER_LINES: Final = 5
"""Title, rate, groups, components, units."""
MAX_RATE_HZ: Final = 1e6
"""Beyond it the line is no rate."""
MAX_RATE_ERROR: Final = 1e-6
"""Relative."""
Rows = list[tuple[int, str]]
"""Numbers and lines."""


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
    filled = [line for line in lines if _bare(line)][:4]
    return len(filled) > 2 and "".join(filled[2:]).lower().replace(" ", "").find("subframe") >= 0


def _blocks(path: Path) -> tuple[dict[str, Block], list[Note], list[Fact]]:
    """Cut an export into devices, trajectories and model outputs, by their titles."""
    blocks: dict[str, Block] = {}
    skipped = []
    lines, facts = table_lines(path, ",;\t")
    rows = enumerate(lines, start=1)
    for filled, part in groupby(rows, key=lambda row: bool(_bare(row[1]))):
        block = list(part)
        title = _bare(block[0][1])
        if not filled:
            continue
        if title.lower() in blocks:
            raise ValueError(f"line {block[0][0]}: a second block {short(title)}")
        if title.lower() in TITLES:
            try:
                blocks[title.lower()] = _block(block)
            except ValueError as error:
                raise ValueError(f"{title}: {error}") from error
        else:
            skipped.append(short(title))
    return blocks, [Note.of("parts_left_out", parts=skipped)] if skipped else [], facts


def _block(rows: Rows) -> Block:
    first_line = rows[0][0]
    if len(rows) <= HEADER_LINES:
        raise ValueError(
            f"the block at line {first_line} ends after {len(rows)} lines: the file is truncated"
        )
    _, rate, names, components, units = (line for _, line in rows[:HEADER_LINES])
    labels = names_in(components.rstrip(), "\t")
    if [label.lower() for label in labels[:2]] != ["frame", "sub frame"] or len(labels) < 3:
        raise ValueError(
            f"line {first_line + 3} is {short(components)!r}, expected Frame, Sub Frame, components"
        )
    rate_hz = read_number(_bare(rate), f"line {first_line + 1}, rate in Hz")
    if not 0 < rate_hz < MAX_RATE_HZ:
        raise ValueError(f"its rate is {rate_hz:g} Hz")
    values = parse_rows(rows[HEADER_LINES:], "\t", labels)
    frame, sub_frame = values[:, 0], values[:, 1]
    if not (np.isfinite(values[:, :2]).all() and (values[:, :2] % 1 == 0).all()):
        raise ValueError("a row has no frame or sub frame number")
    if (sub_frame == 0).all() and (np.diff(frame) != 1).any():
        raise ValueError("frame numbers do not increase by one")
    titles = names_in(names, "\t")
    if beyond := list(filter(None, titles[len(labels) :])):
        raise ValueError(f"{short(beyond[0])!r} is the name of a column that is not there")
    of_column = [*names_in(units, "\t"), *[""] * len(labels)]
    starts = [k for k, name in enumerate(titles) if name and k >= 2]
    groups = [
        Group(titles[a], tuple(labels[a:b]), tuple(of_column[a:b]), values[:, a:b])
        for a, b in zip(starts, [*starts[1:], len(labels)], strict=True)
    ]
    return Block(rate_hz, frame, sub_frame, groups)


def _bare(line: str) -> str:
    return line.strip(' \t,;"')


def read_nexus(path: Path, stated: Stated) -> Recording:
    """Read an ASCII export of Vicon Nexus (.csv or .txt).

    Parameters
    ----------
    path
        The file, with a Trajectories block and, for plates, a Devices block.
    stated
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`.

    Returns
    -------
    Recording
        SI units, lab axes; times start at 0 at the first frame. Devices with Force and Moment are
        plates with identity rotation and centre at the lab origin, so that their wrench is about
        the lab origin; their corners are unknown (NaN). Other devices are analog channels, Model
        Outputs of three components are model outputs. Prefer C3D: it also knows the plates'
        corners and the events.

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
    blocks, notes, facts = _blocks(path)
    if "trajectories" not in blocks:
        raise ValueError(f"no Trajectories block; blocks: {listed(blocks)}")
    block = blocks["trajectories"]
    groups = [
        group
        for group in block.groups
        if group.components[:3] == ("X", "Y", "Z") and not group.name.startswith("*")
    ]
    if not groups:
        raise ValueError("the Trajectories block names no markers with X, Y and Z")
    unit = groups[0].units[0]
    metre = stated.metre(unit)

    def positions(kept: list[int]) -> Array:
        markers = [groups[k] for k in kept]
        factors = [stated.metre(group.units[0]) / metre for group in markers]
        vectors = zip(markers, factors, strict=True)
        return np.stack([group.values[:, :3] * factor for group, factor in vectors], axis=1)

    markers = file_markers([group.name for group in groups], unit, positions, stated)
    outputs = blocks.get("model outputs")
    if outputs is not None and not np.array_equal(outputs.frame, block.frame):
        raise ValueError("Model Outputs and Trajectories are not of the same frames")
    plates: list[PlateColumns | Fact] = []
    analog = None
    if "devices" in blocks:
        plates, analog = _devices(blocks["devices"], block)
    return recording_of(
        path,
        stated,
        markers,
        (block.frame - block.frame[0]) / block.rate_hz,
        plates,
        on_subject=False,
        facts=facts,
        notes=[*notes, *ending_notes(path)],
        analog=analog,
        first_frame=int(block.frame[0]),
        model_outputs={
            group.name.rpartition(":")[2]: group.values
            for group in (outputs.groups if outputs else ())
            if group.components == ("X", "Y", "Z")
        },
    )


def _devices(block: Block, trajectories: Block) -> tuple[list[PlateColumns | Fact], Analog | None]:
    """Give plates, or why they are left out, and analog channels."""
    per_frame = round(block.rate_hz / trajectories.rate_hz)
    count = (block.frame - trajectories.frame[0]) * per_frame + block.sub_frame
    if abs(block.rate_hz - per_frame * trajectories.rate_hz) > MAX_RATE_ERROR * block.rate_hz:
        raise ValueError(
            f"Devices at {block.rate_hz:g} Hz do not go with Trajectories at "
            f"{trajectories.rate_hz:g} Hz"
        )
    if (np.diff(count) != 1).any() or block.sub_frame.max() >= per_frame:
        raise ValueError("Devices: numbers of frames and sub frames do not increase by one")
    if (last := trajectories.frame[-1]) < block.frame[-1]:
        raise ValueError(
            f"Trajectories end with frame {last:.0f}, Devices with {block.frame[-1]:.0f}: the file "
            "is truncated; copy it from its source again, or export it again"
        )
    time = count / block.rate_hz
    measured: dict[str, dict[str, Group]] = {}
    for group in block.groups:
        stem, _, quantity = group.name.rpartition(" - ")
        if quantity.lower() in ("force", "moment", "cop") and len(group.components) >= 3:
            measured.setdefault(stem, {})[quantity.lower()] = group
    measured = {stem: parts for stem, parts in measured.items() if "force" in parts}
    plates = [
        _plate(number, f"plate {number} ({short(stem)})", time, parts)
        for number, (stem, parts) in enumerate(measured.items(), start=1)
    ]
    used = {id(group) for parts in measured.values() for group in parts.values()}
    rest = [group for group in block.groups if id(group) not in used]
    names = [f"{group.name} {part}".strip() for group in rest for part in group.components]
    units = [unit for group in rest for unit in group.units]
    if not names:
        return plates, None
    values = np.hstack([group.values for group in rest])
    return plates, Analog(time, tuple(names), tuple(units), values)


def _plate(number: int, name: str, time: Array, parts: Mapping[str, Group]) -> PlateColumns | Fact:
    """Give the columns of a plate, or why it is left out."""
    if "moment" not in parts or "cop" not in parts:
        lacks = "CoP" if "moment" in parts else "moments"
        return Fact(
            "left_out",
            name,
            f"it has forces but no {lacks}; export Force, Moment and CoP: only together they give "
            "the wrench in the lab",
        )
    groups = [parts[quantity] for quantity in ("force", "moment", "cop")]
    force, moment, pressure = (group.units[0] for group in groups)
    vectors = (group.values[:, :3] for group in groups)
    return PlateColumns(number, name, time, *vectors, units=(force, moment, pressure))
