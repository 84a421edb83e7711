"""The header and parameter sections of a C3D file, which describe its data section.

All counts and offsets are checked as they are read: a damaged file gives one line of error.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

BLOCK_BYTES: Final = 512
KEY: Final = 0x50
"""Second byte of every C3D file."""
BYTE_ORDERS: Final = {84: "intel", 85: "dec", 86: "sgi"}
"""Processor type in the parameter section -> order of bytes."""
EVENTS_KEY: Final = 12345
"""Of header events with labels of four characters."""
MAX_HEADER_EVENTS: Final = 18

Values = NDArray[np.floating] | NDArray[np.integer] | NDArray[np.str_]


@dataclass(frozen=True, slots=True)
class Header:
    """The first block of a C3D file.

    Attributes
    ----------
    byte_order
        "intel", "dec" or "sgi": how numbers lie in the rest of the file.
    parameter_block, data_block
        First blocks of the parameter and data sections, from 1.
    n_points, n_analog
        Points per frame; analog samples per frame, all channels together.
    analog_per_frame
        Samples of one analog channel per frame.
    first_frame, last_frame
        Frame numbers as stored, in 16 bits: too small for long recordings.
    scale
        Units per integer step; negative where the data are floating point.
    rate_hz
        Frame rate [Hz].
    events
        Old-style events: label and time in the file's clock [s].
    """

    byte_order: str
    parameter_block: int
    data_block: int
    n_points: int
    n_analog: int
    analog_per_frame: int
    first_frame: int
    last_frame: int
    scale: float
    rate_hz: float
    events: tuple[tuple[str, float], ...]


class Parameters:
    """Parameters by group and name, upper case; absent ones are empty.

    Parameters
    ----------
    groups
        Group name -> parameter name -> values; numbers in the order of the file's dimensions
        (first index fastest), text as one string per entry.
    """

    def __init__(self, groups: Mapping[str, Mapping[str, Values]]) -> None:
        self.groups = groups

    def has(self, group: str, name: str) -> bool:
        """Whether a parameter exists and is not empty."""
        return self.groups.get(group, {}).get(name, np.empty(0)).size > 0

    def numbers(self, group: str, name: str) -> NDArray[np.float64]:
        """Give a numeric parameter with its dimensions, joined with NAME2, … along the last."""
        parts = [part for part in self._parts(group, name) if part.dtype.kind in "if"]
        if not parts:
            return np.empty(0)
        with np.errstate(invalid="ignore"):
            return np.concatenate(parts, axis=-1).astype(float)

    def integers(self, group: str, name: str) -> NDArray[np.int64]:
        """Give a parameter of counts or indices: 16 bits without sign, whole numbers."""
        values = self.numbers(group, name)
        if not (np.abs(values) < 2**31).all():
            raise ValueError(f"{group}:{name} is not a whole number")
        return np.where(values < 0, values + 65536, values).astype(int)

    def integer(self, group: str, name: str, default: int) -> int:
        """Give the first value of a count, or the default where it is absent."""
        values = self.integers(group, name)
        return int(values.flat[0]) if values.size else default

    def texts(self, group: str, name: str) -> list[str]:
        """Give a text parameter, joined with NAME2, … (more than 255 entries)."""
        parts = [part for part in self._parts(group, name) if part.dtype.kind == "U"]
        return [str(text) for part in parts for text in part.ravel(order="F")]

    def text(self, group: str, name: str) -> str:
        """Give the first entry of a text parameter, or an empty string."""
        return next(iter(self.texts(group, name)), "")

    def _parts(self, group: str, name: str) -> list[Values]:
        found = self.groups.get(group, {})
        parts = [found[name]] if name in found else []
        while parts and f"{name}{len(parts) + 1}" in found:
            parts.append(found[f"{name}{len(parts) + 1}"])
        if len({part.shape[:-1] for part in parts if part.dtype.kind != "U"}) > 1:
            raise ValueError(f"{group}:{name} and its continuations differ in shape")
        return parts


def read_header(path: Path) -> tuple[Header, Parameters]:
    """Read the header and parameter sections.

    Parameters
    ----------
    path
        A C3D file of any byte order.

    Returns
    -------
    Header, Parameters
        The header block, and all parameters.

    Raises
    ------
    ValueError
        The file is empty, not a C3D file, or its parameter section is broken.
    OSError
        The file cannot be opened.
    """
    with path.open("rb") as file:
        first = file.read(BLOCK_BYTES)
        if not first:
            raise ValueError("the file is empty")
        if len(first) < BLOCK_BYTES or first[1] != KEY or first[0] == 0:
            raise ValueError("not a C3D file: it does not begin with a C3D header block")
        file.seek((first[0] - 1) * BLOCK_BYTES)
        start = file.read(4)
        if len(start) < 4 or start[3] not in BYTE_ORDERS:
            raise ValueError("not a C3D file, or its parameter section is missing")
        byte_order = BYTE_ORDERS[start[3]]
        header = _parse_header(first, byte_order)
        if header.data_block > header.parameter_block:
            section = file.read((header.data_block - header.parameter_block) * BLOCK_BYTES - 4)
        else:
            section = file.read(start[2] * BLOCK_BYTES - 4 if start[2] else 0)
    return header, Parameters(_parse_parameters(section, byte_order))


def floats(data: bytes, byte_order: str) -> NDArray[np.floating]:
    """Decode 4-byte floating point numbers of any of the three byte orders.

    Notes
    -----
    A DEC (VAX F) number is an IEEE number with its two 16-bit halves exchanged, times four.
    """
    with np.errstate(invalid="ignore"):
        if byte_order != "dec":
            return np.frombuffer(data, ">f4" if byte_order == "sgi" else "<f4").astype(np.float32)
        swapped = np.frombuffer(data, "<u2").reshape(-1, 2)[:, ::-1].copy()
        return swapped.view("<f4")[:, 0] / np.float32(4)


def integer_type(byte_order: str, *, signed: bool = True) -> np.dtype:
    """Give the type of 2-byte integers in a byte order."""
    return np.dtype((">" if byte_order == "sgi" else "<") + ("i2" if signed else "u2"))


def _parse_header(block: bytes, byte_order: str) -> Header:
    words = np.frombuffer(block, integer_type(byte_order, signed=False)).astype(int)
    scale, rate = (float(floats(block[k : k + 4], byte_order)[0]) for k in (12, 20))
    if not (np.isfinite(scale) and np.isfinite(rate)):
        raise ValueError("the header's scale or frame rate is not a number")
    events = []
    if words[149] == EVENTS_KEY:
        times = floats(block[304:376], byte_order)
        for k in range(min(int(words[150]), MAX_HEADER_EVENTS)):
            label = _text(block[396 + 4 * k : 400 + 4 * k])
            events.append((label, float(times[k])))
    return Header(
        byte_order=byte_order,
        parameter_block=block[0],
        data_block=int(words[8]),
        n_points=int(words[1]),
        n_analog=int(words[2]),
        analog_per_frame=int(words[9]),
        first_frame=int(words[3]),
        last_frame=int(words[4]),
        scale=scale,
        rate_hz=rate,
        events=tuple(events),
    )


def _parse_parameters(section: bytes, byte_order: str) -> dict[str, dict[str, Values]]:
    names: dict[int, str] = {}
    members: list[tuple[int, str, Values]] = []
    offset_format = ">h" if byte_order == "sgi" else "<h"
    position = 0
    while position + 2 <= len(section):
        name_length, identity = struct.unpack_from("bb", section, position)
        if name_length == 0:
            break
        pointer = position + 2 + abs(name_length)
        try:
            (step,) = struct.unpack_from(offset_format, section, pointer)
            name = _text(section[position + 2 : pointer]).upper()
            if identity < 0:
                names[-identity] = name
            elif identity > 0:
                members.append((identity, name, _parse_values(section, pointer + 2, byte_order)))
        except (struct.error, IndexError, ValueError) as error:
            raise ValueError(
                f"the parameter section is broken {position + 4} bytes after its start: {error}"
            ) from error
        if step == 0:
            break
        if step < 0:
            raise ValueError(
                f"the parameter section is broken {position + 4} bytes after its start: "
                "it points backwards"
            )
        position = pointer + step
    groups: dict[str, dict[str, Values]] = {name: {} for name in names.values()}
    for identity, name, values in members:
        if identity in names:
            groups[names[identity]].setdefault(name, values)
    return groups


def _parse_values(section: bytes, position: int, byte_order: str) -> Values:
    kind, n_dimensions = struct.unpack_from("bB", section, position)
    if kind not in (-1, 1, 2, 4) or n_dimensions > 7:
        raise ValueError(f"a parameter of unknown type {kind} with {n_dimensions} dimensions")
    shape = list(section[position + 2 : position + 2 + n_dimensions])
    count = int(np.prod(shape, dtype=object)) if shape else 1
    start = position + 2 + n_dimensions
    data = section[start : start + count * abs(kind)]
    if len(shape) < n_dimensions or len(data) < count * abs(kind):
        raise ValueError("a parameter reaches beyond the end of the section")
    if kind == -1:
        width, *rows = shape or [1]
        n_texts = int(np.prod(rows, dtype=object))
        if n_texts > len(section):
            raise ValueError(f"a parameter of {n_texts} texts")
        texts = [_text(data[k * width : (k + 1) * width]) for k in range(n_texts)]
        return np.array(texts, dtype=str).reshape(rows or 1, order="F")
    if kind == 4:
        values: Values = floats(data, byte_order)
    else:
        values = np.frombuffer(data, np.int8 if kind == 1 else integer_type(byte_order))
    return values.reshape(shape, order="F") if shape else values


def _text(data: bytes) -> str:
    return data.decode("utf-8", "replace").split("\0", 1)[0].strip()
