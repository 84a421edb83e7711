"""The parameter section of a C3D file: groups of named values, read, made and changed."""

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbm.spelling import printable

BLOCK_BYTES: Final = 512
BYTE_ORDERS: Final = {84: "intel", 85: "dec", 86: "sgi"}
"""Processor type in the parameter section -> order of bytes."""
Values = NDArray[np.floating] | NDArray[np.integer] | NDArray[np.str_]
Value = str | Sequence[str] | NDArray[np.integer] | NDArray[np.floating]
Groups = dict[str, dict[str, Value]]
MAX_ENTRIES: Final = 255
"""Of a parameter's dimension, which is one byte; longer lists continue in NAME2, NAME3, …"""
MAX_BLOCKS: Final = 255
"""Of the parameter section, whose length is one byte."""
MAX_IDENTITY: Final = 127
"""Of a group, whose number is one signed byte."""
SECTION_START: Final = 4
"""Bytes of the parameter section before its first record."""
BLOCK_COUNT: Final = 2
"""Which of them is the number of blocks."""
MAX_RECORD_BYTES: Final = 32767
"""Of one parameter, whose length is a signed 16-bit number."""


def floats(data: bytes, byte_order: str) -> NDArray[np.floating]:
    """Decode 4-byte floating point numbers of any of the three byte orders.

    Notes
    -----
    A DEC (VAX F) number is an IEEE number with its two 16-bit halves exchanged, times four; with an
    exponent of zero it is zero, whatever its other bits.
    """
    with np.errstate(invalid="ignore"):
        if byte_order != "dec":
            return np.frombuffer(data, ">f4" if byte_order == "sgi" else "<f4").astype(np.float32)
        swapped = np.frombuffer(data, "<u2").reshape(-1, 2)[:, ::-1].copy()
        numbers = swapped.view("<f4")[:, 0] / np.float32(4)
        numbers[(swapped[:, 1] & 0x7F80) == 0] = 0
        return numbers


def float_bytes(values: ArrayLike, byte_order: str) -> bytes:
    """Encode 4-byte floating point numbers; `floats` decodes them.

    Raises
    ------
    ValueError
        A number is too large for the format.
    """
    values = np.asarray(values, float).ravel()
    with np.errstate(over="ignore"):
        numbers = (values * 4 if byte_order == "dec" else values).astype("<f4")
    if (np.isinf(numbers) & np.isfinite(values)).any():
        raise ValueError("a number is too large for the 4 bytes that a C3D file has for it")
    if byte_order == "dec":
        numbers[np.abs(numbers) < np.finfo(np.float32).tiny] = 0  # there is no negative zero
        return numbers.view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return numbers.astype(">f4" if byte_order == "sgi" else "<f4").tobytes()


def integer_type(byte_order: str, *, signed: bool = True) -> np.dtype:
    """Give the type of 2-byte integers in a byte order."""
    return np.dtype((">" if byte_order == "sgi" else "<") + ("i2" if signed else "u2"))


@lru_cache(maxsize=1024)  # the files of a study have the same labels
def decoded_text(data: bytes) -> str:
    """Decode a text, which ends at its first zero, printable and without spaces around it."""
    return printable(data.decode("utf-8", "replace").split("\0", 1)[0].strip())


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

    def numbers(self, group: str, name: str) -> NDArray[np.float64]:
        """Give a numeric parameter with its dimensions, joined with NAME2, … along the last."""
        parts = [part for part in self._parts(group, name) if part.dtype.kind in "if"]
        if not parts:
            return np.empty(0)
        with np.errstate(invalid="ignore"):
            return np.concatenate(parts, axis=-1).astype(float)

    def number(self, group: str, name: str, default: float) -> float:
        """Give the first number of a parameter, or the default where it is absent."""
        return next(map(float, self.numbers(group, name).flat), default)

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
        members = self.groups.get(group, {})
        parts = [members[name]] if name in members else []
        while parts and f"{name}{len(parts) + 1}" in members:
            parts.append(members[f"{name}{len(parts) + 1}"])
        if len({part.shape[:-1] for part in parts if part.dtype.kind != "U"}) > 1:
            raise ValueError(f"{group}:{name} and its continuations differ in shape")
        return parts


def parse_parameters(section: bytes, byte_order: str) -> Parameters:
    """Parse a parameter section; section, byte order and errors are those of `parameter_records`.

    A ValueError also where a parameter's values cannot be understood.
    """
    records = list(parameter_records(section, byte_order))
    names = {-record.identity: record.name for record in records if record.identity < 0}
    groups: dict[str, dict[str, Values]] = {name: {} for name in names.values()}
    for record in records:
        if record.identity > 0:
            try:
                values = _parse_values(section, record, byte_order)
            except (struct.error, IndexError, ValueError) as error:
                raise ValueError(_broken(record.start, str(error))) from error
            groups.get(names.get(record.identity, ""), {}).setdefault(record.name, values)
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
    start += 2 + n_dimensions
    stop = start + prod(shape) * abs(kind)
    if len(shape) < n_dimensions or stop > len(section):
        raise ValueError("a parameter reaches beyond the end of the section")
    return kind, shape, slice(start, stop)


def _parse_values(section: bytes, record: Record, byte_order: str) -> Values:
    kind, shape, where = values_of(section, record)
    data = section[where]
    if kind == -1:
        width, *rows = shape or [1]
        if prod(rows) > len(section):
            raise ValueError(f"a parameter of {prod(rows)} texts")
        texts = [decoded_text(data[k * width : (k + 1) * width]) for k in range(prod(rows))]
        return np.array(texts, dtype=str).reshape(rows or 1, order="F")
    whole = np.dtype(np.int8) if kind == 1 else integer_type(byte_order)
    values: Values = floats(data, byte_order) if kind == 4 else np.frombuffer(data, whole)
    return values.reshape(shape or -1, order="F")


def parameter_section(groups: Groups, data_block: int) -> bytes:
    """Encode the parameter section of an Intel file.

    Parameters
    ----------
    groups
        Group -> parameter -> value: a text, texts, whole numbers, or real numbers whose first
        index runs fastest in the file.
    data_block
        First block of the data section; becomes POINT:DATA_START.

    Returns
    -------
    bytes
        The section, not yet padded to whole blocks.

    Raises
    ------
    ValueError
        A text, a list or the whole section is longer than the format allows.
    """
    members = {
        group: values | ({"DATA_START": np.array([data_block])} if group == "POINT" else {})
        for group, values in groups.items()
    }
    body = b"".join(
        encoded_group(identity, group, values)
        for identity, (group, values) in enumerate(members.items(), start=1)
    )
    blocks = -(-(len(body) + 6) // BLOCK_BYTES)
    if blocks > MAX_BLOCKS:
        raise ValueError(
            f"labels, units and events need {blocks} blocks, but the parameter section of a C3D "
            f"file has room for {MAX_BLOCKS}: write fewer events or split the trial"
        )
    return struct.pack("<4B", 1, 0x50, blocks, 84) + body + bytes(2)


def encoded_group(
    identity: int, group: str, members: Mapping[str, Value], byte_order: str = "intel"
) -> bytes:
    """Encode a group and its parameters.

    Parameters
    ----------
    identity
        Number of the group, from 1.
    group
        Its name.
    members
        Parameter -> value.
    byte_order
        "intel", "dec" or "sgi".

    Returns
    -------
    bytes
        Records that other records may follow.

    Raises
    ------
    ValueError
        A text or a list is longer than the format allows.
    """
    records = [_record(-identity, group, b"\0", byte_order)]
    for name, value in members.items():
        content = _encoded(f"{group}:{name}", value, byte_order) + b"\0"
        records.append(_record(identity, name, content, byte_order))
    return b"".join(records)


def with_group(section: bytes, byte_order: str, group: str, members: Mapping[str, Value]) -> bytes:
    """Add a group to the parameter section of a file.

    Parameters
    ----------
    section
        From the section's first block to the data section.
    byte_order
        "intel", "dec" or "sgi".
    group, members
        The group, which the section does not have, and its parameters.

    Returns
    -------
    bytes
        The section with the group after all others, longer by whole blocks where it has to be.

    Raises
    ------
    ValueError
        The section would be longer than the format allows, has no number left for a group, or is
        broken.
    """
    body = section[SECTION_START:]
    records = list(parameter_records(body, byte_order))
    taken = {abs(record.identity) for record in records}
    identity = next((k for k in range(1, MAX_IDENTITY + 1) if k not in taken), None)
    if identity is None:
        raise ValueError(f"all {MAX_IDENTITY} numbers of parameter groups are taken")
    changed, end = bytearray(section), SECTION_START
    if records:
        pointer = SECTION_START + records[-1].pointer
        end = pointer + length_from_pointer(records[-1], body)
        changed[pointer : pointer + 2] = encoded_numbers(np.array([end - pointer]), byte_order)
    added = encoded_group(identity, group, members, byte_order) + bytes(2)
    changed[end : end + len(added)] = added
    blocks = max(section[BLOCK_COUNT], -(-(end + len(added)) // BLOCK_BYTES))
    if blocks > MAX_BLOCKS:
        raise ValueError(
            f"group {group} does not fit: the parameter section would have {blocks} blocks, but a "
            f"C3D file has room for {MAX_BLOCKS}; remove parameters that are not needed"
        )
    changed[BLOCK_COUNT] = blocks
    return bytes(changed).ljust(blocks * BLOCK_BYTES, b"\0")


def with_values(
    section: bytes, byte_order: str, group: str, name: str, values: NDArray[np.number]
) -> bytes:
    """Give a parameter of a section other numbers.

    Parameters
    ----------
    section, byte_order
        As for `with_group`.
    group, name
        The parameter.
    values
        As many as it has, in its dimensions; rounded where it holds whole numbers.

    Returns
    -------
    bytes
        The section, of the same length.

    Raises
    ------
    ValueError
        There is no such parameter, it holds no such numbers, or not as many.
    """
    body = section[SECTION_START:]
    records = list(parameter_records(body, byte_order))
    of_group = {-record.identity for record in records if record.name == group}
    for record in records:
        if record.identity in of_group and record.name == name:
            kind, _, where = values_of(body, record)
            whole = kind == 2 and (values > -(2**15)).all() and (values < 2**16 - 1).all()
            written = np.rint(values).astype(int) if whole else values.astype(float)
            numbers = encoded_numbers(written, byte_order)
            if (whole or kind == 4) and len(numbers) == where.stop - where.start:
                start = SECTION_START + where.start
                return section[:start] + numbers + section[start + len(numbers) :]
    raise ValueError(f"there is no {group}:{name} that can hold {values.size} numbers as they are")


def length_from_pointer(last: Record, body: bytes) -> int:
    """Give the length of the last record, which programs state as 0 or wrongly."""
    if last.step and last.pointer + last.step <= len(body):
        return last.step
    description = last.pointer + 2 if last.identity < 0 else values_of(body, last)[2].stop
    if description >= len(body):
        raise ValueError("the parameter section ends within its last parameter")
    return description + 1 + body[description] - last.pointer


def encoded_numbers(values: NDArray[np.number], byte_order: str) -> bytes:
    """Encode numbers, 4-byte real or 2-byte whole; the first index runs fastest."""
    if values.dtype.kind == "f":
        return float_bytes(values.ravel(order="F"), byte_order)
    return values.astype(integer_type(byte_order, signed=False)).tobytes(order="F")


def _record(identity: int, name: str, content: bytes, byte_order: str) -> bytes:
    if len(content) + 2 > MAX_RECORD_BYTES:
        raise ValueError(f"parameter {name} has {len(content)} bytes, more than a C3D file allows")
    label = struct.pack("<bb", len(name), identity) + name.encode("ascii")
    return label + encoded_numbers(np.array([len(content) + 2]), byte_order) + content


def _encoded(name: str, value: Value, byte_order: str) -> bytes:
    if isinstance(value, np.ndarray):
        kind, shape = 4 if value.dtype.kind == "f" else 2, list(value.shape)
        data = encoded_numbers(value, byte_order)
    else:
        rows = [value] if isinstance(value, str) else value
        texts = [text.encode(errors="replace") for text in rows]  # what is no UTF-8
        kind, width = -1, max((len(text) for text in texts), default=1) or 1
        shape = [width] if isinstance(value, str) else [width, len(texts)]
        data = b"".join(text.ljust(width) for text in texts)
    if max(shape, default=0) > MAX_ENTRIES:
        raise ValueError(f"{name} has a dimension of {max(shape)}, C3D allows {MAX_ENTRIES}")
    return struct.pack(f"<bB{len(shape)}B", kind, len(shape), *shape) + data
