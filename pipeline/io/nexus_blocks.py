"""The blocks of a Vicon Nexus ASCII export: tables of numbers under groups of columns."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import short
from pipeline.io.text_table import names_in, parse_rows

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
