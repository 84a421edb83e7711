"""ASCII exports of Vicon Nexus: blocks of numbers under groups of columns."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.columns import (
    PlateColumns,
    file_markers,
    lab_axes,
    left_out,
    plates_about_origin,
    plates_in_si,
)
from pipeline.io.input_file import naming
from pipeline.io.recording import Analog, Metadata, Plate, Recording
from pipeline.io.stated import Stated, as_stated
from pipeline.io.text_table import ending_notes, lines_of, names_in, parse_rows

TITLES: Final = ("devices", "trajectories", "model outputs")
SEPARATORS: Final = ("\t", ";", ",")
HEADER_LINES: Final = 5
"""Title, rate, groups, components, units."""
MAX_RATE_HZ: Final = 1e6
"""Beyond it the line is no rate."""


@dataclass(frozen=True, slots=True)
class Group:
    """Adjacent columns under one name: ``first`` is the index of the first in `Block.values`."""

    name: str
    first: int
    components: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Block:
    """One block: its rate [Hz], frame and sub frame of each row, (N,), and values, (N, K)."""

    rate_hz: float
    frame: Array
    sub_frame: Array
    groups: tuple[Group, ...]
    values: Array

    def vector(self, group: Group) -> Array:
        """Give the first three columns of a group, (N, 3), in the file's unit."""
        return self.values[:, group.first : group.first + 3]


def is_nexus(lines: Sequence[str]) -> bool:
    """Whether a text begins like a Nexus export: a title, a rate, then "Frame, Sub Frame"."""
    filled = [line for line in lines if _bare(line)][:4]
    return len(filled) > 2 and "".join(filled[2:]).lower().replace(" ", "").find("subframe") >= 0


def read_blocks(lines: Sequence[str]) -> tuple[dict[str, Block], list[Note]]:
    """Cut an export into blocks.

    Parameters
    ----------
    lines
        The text.

    Returns
    -------
    blocks
        Title in small letters -> block; of devices, trajectories and model outputs.
    notes
        ``blocks_left_out`` where there are other blocks.

    Raises
    ------
    ValueError
        A block is truncated, has no such header, or holds something that is no number.
    """
    blocks: dict[str, Block] = {}
    skipped = []
    start = 0
    while start < len(lines):
        if not _bare(lines[start]):
            start += 1
            continue
        stop = start + 1
        while stop < len(lines) and _bare(lines[stop]):
            stop += 1
        title = _bare(lines[start])
        if title.lower() in blocks:
            raise ValueError(f"line {start + 1}: a second block {short(title)}")
        if title.lower() in TITLES:
            try:
                blocks[title.lower()] = _block(lines[start:stop], start + 1)
            except ValueError as error:
                raise ValueError(f"{title}: {error}") from error
        else:
            skipped.append(short(title))
        start = stop
    notes = [Note.of("blocks_left_out", blocks=skipped)] if skipped else []
    return blocks, notes


def _block(lines: Sequence[str], first_line: int) -> Block:
    if len(lines) <= HEADER_LINES:
        raise ValueError(
            f"the block at line {first_line} ends after {len(lines)} lines: the file is truncated"
        )
    _, rate, names, components, units = lines[:HEADER_LINES]
    separator = next((s for s in SEPARATORS if s in components), ",")
    labels = names_in(components.rstrip(f" {separator}"), separator)
    if [label.lower() for label in labels[:2]] != ["frame", "sub frame"] or len(labels) < 3:
        raise ValueError(
            f"line {first_line + 3} is {short(components)!r}, expected Frame, Sub Frame, components"
        )
    rows = enumerate(lines[HEADER_LINES:], start=first_line + HEADER_LINES)
    values = parse_rows(rows, separator, labels)
    frame, sub_frame = values[:, 0], values[:, 1]
    if not (np.isfinite(values[:, :2]).all() and (values[:, :2] % 1 == 0).all()):
        raise ValueError("a row has no frame or sub frame number")
    if (sub_frame == 0).all() and (np.diff(frame) != 1).any():
        raise ValueError("frames do not count upward one by one")
    return Block(
        _rate(_bare(rate)),
        frame,
        sub_frame,
        _groups(names_in(names, separator), labels, names_in(units, separator)),
        values,
    )


def _groups(names: list[str], labels: list[str], units: list[str]) -> tuple[Group, ...]:
    names = [name.strip('"') for name in names]
    starts = [k for k, name in enumerate(names[: len(labels)]) if name and k >= 2]
    if not starts:
        raise ValueError("its third line names no columns")
    if beyond := [name for name in names[len(labels) :] if name]:
        raise ValueError(f"{short(beyond[0])!r} is the name of a column that is not there")
    units = units + [""] * (len(labels) - len(units))
    spans = zip(starts, [*starts[1:], len(labels)], strict=True)
    return tuple(Group(names[a], a, tuple(labels[a:b]), tuple(units[a:b])) for a, b in spans)


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError as error:
        raise ValueError(f"its second line is {short(text)!r}, expected a rate in Hz") from error
    if not 0 < rate < MAX_RATE_HZ:
        raise ValueError(f"its rate is {rate:g} Hz")
    return rate


def _bare(line: str) -> str:
    return line.strip(' \t,;"')


def read_nexus(path: str | Path, stated: Stated | str | None = None) -> Recording:
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
    path = Path(path)
    with naming(path):
        return _read(path, as_stated(stated))


def _read(path: Path, stated: Stated) -> Recording:
    blocks, skipped = read_blocks(list(lines_of(path)))
    if "trajectories" not in blocks:
        raise ValueError(f"no Trajectories block; blocks: {listed(blocks)}")
    block = blocks["trajectories"]
    groups = [group for group in block.groups if group.components[:3] == ("X", "Y", "Z")]
    groups = [group for group in groups if group.name and not group.name.startswith("*")]
    if not groups:
        raise ValueError("the Trajectories block names no markers with X, Y and Z")
    unit = groups[0].units[0]
    metre, _ = stated.marker_unit(unit)

    def positions(kept: list[int]) -> Array:
        metres = [stated.marker_unit(groups[k].units[0])[0] / metre for k in kept]
        vectors = zip((groups[k] for k in kept), metres, strict=True)
        return np.stack([block.vector(group) * factor for group, factor in vectors], axis=1)

    markers = file_markers([group.name for group in groups], unit, positions, stated)
    to_lab, axes_notes = lab_axes(markers, (), stated)
    notes = [*axes_notes, *skipped, *ending_notes(path), *markers.notes]
    plates: tuple[Plate, ...] = ()
    analog = None
    if "devices" in blocks:
        plates, analog, device_notes = _devices(blocks["devices"], block, to_lab, stated)
        notes += device_notes
    return Recording(
        source=path,
        markers=markers.in_lab((block.frame - block.frame[0]) / block.rate_hz, to_lab),
        plates=plates,
        analog=analog,
        first_frame=int(block.frame[0]),
        metadata=Metadata(software="Vicon Nexus", subject=markers.subject),
        model_outputs=_outputs(blocks.get("model outputs"), block),
        stated=stated,
        notes=tuple(notes),
    )


def _devices(
    block: Block, trajectories: Block, to_lab: Array, stated: Stated
) -> tuple[tuple[Plate, ...], Analog | None, list[Note]]:
    """Give plates and analog channels in lab axes."""
    first, rate_hz = trajectories.frame[0], trajectories.rate_hz
    per_frame = block.rate_hz / rate_hz
    if abs(per_frame - round(per_frame)) > 1e-6 or block.sub_frame.max() >= round(per_frame):
        raise ValueError(
            f"Devices at {block.rate_hz:g} Hz do not go with Trajectories at {rate_hz:g} Hz "
            f"and sub frames up to {block.sub_frame.max():g}"
        )
    count = (block.frame - first) * round(per_frame) + block.sub_frame
    if (np.diff(count) != 1).any():
        raise ValueError("Devices: frames and sub frames do not count upward one by one")
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
    columns, notes = plates_in_si(_plates(block, measured, time), stated)
    push = sum(float(np.nan_to_num(plate.force @ to_lab[2]).mean()) for plate in columns)
    if push < 0:
        columns = [replace(plate, force=-plate.force, moment=-plate.moment) for plate in columns]
        notes.append(Note.of("forces_reversed"))
    plates, moment_notes = plates_about_origin(columns, to_lab)
    used = {group.first for parts in measured.values() for group in parts.values()}
    analog = _analog(block, [g for g in block.groups if g.first not in used], time)
    return plates, analog, [*notes, *moment_notes]


def _plates(
    block: Block, measured: Mapping[str, Mapping[str, Group]], time: Array
) -> Iterator[PlateColumns | Note]:
    """Give the columns of each plate, or why it is left out."""
    for number, (stem, parts) in enumerate(measured.items(), start=1):
        name = f"plate {number} ({short(stem)})"
        if "moment" not in parts or "cop" not in parts:
            lacks = "CoP" if "moment" in parts else "moments"
            yield left_out(
                name,
                f"it has forces but no {lacks}; export Force, Moment and CoP: only together they "
                "give the wrench in the lab",
            )
            continue
        groups = [parts[quantity] for quantity in ("force", "moment", "cop")]
        force, moment, pressure = (group.units[0] for group in groups)
        vectors = (block.vector(group) for group in groups)
        yield PlateColumns(number, name, time, (force, moment, pressure), *vectors)


def _analog(block: Block, groups: list[Group], time: Array) -> Analog | None:
    channels = [
        (f"{group.name} {component}".strip(), unit, group.first + k)
        for group in groups
        for k, (component, unit) in enumerate(zip(group.components, group.units, strict=True))
    ]
    if not channels:
        return None
    names, units, columns = zip(*channels, strict=True)
    return Analog(time, names, units, block.values[:, list(columns)])


def _outputs(block: Block | None, trajectories: Block) -> dict[str, Array]:
    if block is None:
        return {}
    if not np.array_equal(block.frame, trajectories.frame):
        raise ValueError("Model Outputs and Trajectories are not of the same frames")
    return {
        group.name.rpartition(":")[2]: block.vector(group)
        for group in block.groups
        if group.name and group.components == ("X", "Y", "Z")
    }
