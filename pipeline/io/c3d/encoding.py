"""Parameters of a C3D file as bytes."""

import struct
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.byte_order import BLOCK_BYTES, float_bytes, integer_type

Value = str | Sequence[str] | NDArray[np.integer] | NDArray[np.floating]
Groups = dict[str, dict[str, Value]]

MAX_ENTRIES: Final = 255
"""Of a parameter's dimension, which is one byte; longer lists continue in NAME2, NAME3, …"""
MAX_BLOCKS: Final = 255
"""Of the parameter section, whose length is one byte."""
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
