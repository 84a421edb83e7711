"""The parameter section of a C3D file: groups of named values, which describe its data section."""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.byte_order import decoded_text, floats, integer_type

Values = NDArray[np.floating] | NDArray[np.integer] | NDArray[np.str_]


@dataclass(frozen=True, slots=True)
class Record:
    """A group or parameter as it lies in the parameter section.

    Attributes
    ----------
    identity
        Of a group, negative; of a parameter, that of its group, positive.
    name
        In upper case.
    start, pointer
        Where the record begins, and where its distance to the next one is; bytes from the end of
        the section's first four bytes.
    step
        From the pointer to the next record [bytes]; 0 in the last one of some files.
    """

    identity: int
    name: str
    start: int
    pointer: int
    step: int


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


def parse_parameters(section: bytes, byte_order: str) -> Parameters:
    """Parse a parameter section; section, byte order and errors are those of `parameter_records`.

    A ValueError also where a parameter's values cannot be understood.
    """
    names: dict[int, str] = {}
    members: list[tuple[int, str, Values]] = []
    for record in parameter_records(section, byte_order):
        if record.identity < 0:
            names[-record.identity] = record.name
        elif record.identity > 0:
            try:
                values = _parse_values(section, record, byte_order)
            except (struct.error, IndexError, ValueError) as error:
                raise ValueError(_broken(record.start, str(error))) from error
            members.append((record.identity, record.name, values))
    groups: dict[str, dict[str, Values]] = {name: {} for name in names.values()}
    for identity, name, values in members:
        if identity in names:
            groups[names[identity]].setdefault(name, values)
    return Parameters(groups)


def parameter_records(section: bytes, byte_order: str) -> Iterator[Record]:
    """Go through the groups and parameters of a parameter section.

    Parameters
    ----------
    section
        The section without its first four bytes.
    byte_order
        "intel", "dec" or "sgi".

    Yields
    ------
    Record
        In the file's order.

    Raises
    ------
    ValueError
        A record reaches beyond the section or points backwards.
    """
    offset_format = ">h" if byte_order == "sgi" else "<h"
    start = 0
    while start + 2 <= len(section):
        name_length, identity = struct.unpack_from("bb", section, start)
        if name_length == 0:
            break
        pointer = start + 2 + abs(name_length)
        try:
            (step,) = struct.unpack_from(offset_format, section, pointer)
        except struct.error as error:
            raise ValueError(_broken(start, str(error))) from error
        name = decoded_text(section[start + 2 : pointer]).upper()
        yield Record(identity, name, start, pointer, step)
        if step == 0:
            break
        if step < 0:
            raise ValueError(_broken(start, "it points backwards"))
        start = pointer + step


def _broken(start: int, reason: str) -> str:
    return (
        f"the parameter section is broken {start + 4} bytes after its start: {reason}; export the "
        "file again"
    )


def values_of(section: bytes, record: Record) -> tuple[int, list[int], slice]:
    """Find the values of a parameter.

    Parameters
    ----------
    section
        The section without its first four bytes.
    record
        The parameter.

    Returns
    -------
    kind
        -1 for text, otherwise the bytes of a number: 4 of a real one, 1 or 2 of a whole one.
    shape
        The dimensions; of text, the first one is the number of characters.
    values
        Where they are in the section.

    Raises
    ------
    ValueError
        They reach beyond the section, or are of a type that the format does not have.
    """
    start = record.pointer + 2
    kind, n_dimensions = struct.unpack_from("bB", section, start)
    if kind not in (-1, 1, 2, 4) or n_dimensions > 7:
        raise ValueError(f"a parameter of unknown type {kind} with {n_dimensions} dimensions")
    shape = list(section[start + 2 : start + 2 + n_dimensions])
    count = int(np.prod(shape, dtype=object)) if shape else 1
    start += 2 + n_dimensions
    stop = start + count * abs(kind)
    if len(shape) < n_dimensions or stop > len(section):
        raise ValueError("a parameter reaches beyond the end of the section")
    return kind, shape, slice(start, stop)


def _parse_values(section: bytes, record: Record, byte_order: str) -> Values:
    kind, shape, where = values_of(section, record)
    data = section[where]
    if kind == -1:
        width, *rows = shape or [1]
        n_texts = int(np.prod(rows, dtype=object))
        if n_texts > len(section):
            raise ValueError(f"a parameter of {n_texts} texts")
        texts = [decoded_text(data[k * width : (k + 1) * width]) for k in range(n_texts)]
        return np.array(texts, dtype=str).reshape(rows or 1, order="F")
    if kind == 4:
        values: Values = floats(data, byte_order)
    else:
        values = np.frombuffer(data, np.int8 if kind == 1 else integer_type(byte_order))
    return values.reshape(shape, order="F") if shape else values
