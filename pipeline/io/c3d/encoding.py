"""Parameters of a C3D file as bytes: a section of one's own, or one that exists and is changed."""

import struct
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.byte_order import BLOCK_BYTES, float_bytes, integer_type
from pipeline.io.c3d.parameters import Record, parameter_records, values_of

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
        end = pointer + _length_from_pointer(records[-1], body)
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
    found = [record for record in records if record.identity in of_group and record.name == name]
    if not found:
        raise ValueError(f"there is no {group}:{name} to change")
    kind, _, where = values_of(body, found[0])
    if kind == 4:
        numbers = encoded_numbers(values.astype(float), byte_order)
    elif kind == 2 and (values > -(2**15)).all() and (values < 2**16 - 1).all():
        numbers = encoded_numbers(np.rint(values).astype(int), byte_order)
    else:
        raise ValueError(f"{group}:{name} cannot hold the numbers that it is to hold")
    if len(numbers) != where.stop - where.start:
        raise ValueError(f"{group}:{name} does not have {values.size} values")
    start = SECTION_START + where.start
    return section[:start] + numbers + section[start + len(numbers) :]


def _length_from_pointer(last: Record, body: bytes) -> int:
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
    label = name.encode("ascii")
    step = np.array([len(content) + 2])
    return (
        struct.pack("<bb", len(label), identity)
        + label
        + encoded_numbers(step, byte_order)
        + content
    )


def _encoded(name: str, value: Value, byte_order: str) -> bytes:
    if isinstance(value, str):
        text = value.encode()
        return struct.pack("<bBB", -1, 1, _dimension(name, len(text))) + text
    if isinstance(value, np.ndarray):
        kind = 4 if value.dtype.kind == "f" else 2
        shape = [_dimension(name, n) for n in value.shape]
        head = struct.pack(f"<bB{len(shape)}B", kind, len(shape), *shape)
        return head + encoded_numbers(value, byte_order)
    texts = [text.encode() for text in value]
    width = max((len(text) for text in texts), default=1) or 1
    head = struct.pack("<bBBB", -1, 2, _dimension(name, width), _dimension(name, len(texts)))
    return head + b"".join(text.ljust(width) for text in texts)


def _dimension(name: str, size: int) -> int:
    if size > MAX_ENTRIES:
        raise ValueError(f"{name} has a dimension of {size}, more than the {MAX_ENTRIES} of C3D")
    return size
