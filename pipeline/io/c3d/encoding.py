"""Parameters of a C3D file as bytes."""

import struct
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.byte_order import BLOCK_BYTES

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
    records: list[tuple[int, str, bytes]] = []
    for identity, (group, members) in enumerate(groups.items(), start=1):
        records.append((-identity, group, b"\0"))
        records += [
            (identity, name, _encoded(f"{group}:{name}", value) + b"\0")
            for name, value in members.items()
        ]
        if group == "POINT":
            start = _encoded("POINT:DATA_START", np.array([data_block]))
            records.append((identity, "DATA_START", start + b"\0"))
    body = b"".join(_record(*record) for record in records)
    blocks = -(-(len(body) + 6) // BLOCK_BYTES)
    if blocks > MAX_BLOCKS:
        raise ValueError(
            f"labels, units and events need {blocks} blocks, but the parameter section of a C3D "
            f"file has room for {MAX_BLOCKS}: write fewer events or split the trial"
        )
    return struct.pack("<4B", 1, 0x50, blocks, 84) + body + bytes(2)


def _record(identity: int, name: str, content: bytes) -> bytes:
    if len(content) + 2 > MAX_RECORD_BYTES:
        raise ValueError(f"parameter {name} has {len(content)} bytes, more than a C3D file allows")
    label = name.encode("ascii")
    return (
        struct.pack("<bb", len(label), identity)
        + label
        + struct.pack("<h", len(content) + 2)
        + content
    )


def _encoded(name: str, value: Value) -> bytes:
    if isinstance(value, str):
        text = value.encode()
        return struct.pack("<bBB", -1, 1, _dimension(name, len(text))) + text
    if isinstance(value, np.ndarray):
        kind, numbers = (4, "<f4") if value.dtype.kind == "f" else (2, "<u2")
        shape = [_dimension(name, n) for n in value.shape]
        head = struct.pack(f"<bB{len(shape)}B", kind, len(shape), *shape)
        return head + value.astype(numbers).tobytes(order="F")
    texts = [text.encode() for text in value]
    width = max((len(text) for text in texts), default=1) or 1
    head = struct.pack("<bBBB", -1, 2, _dimension(name, width), _dimension(name, len(texts)))
    return head + b"".join(text.ljust(width) for text in texts)


def _dimension(name: str, size: int) -> int:
    if size > MAX_ENTRIES:
        raise ValueError(f"{name} has a dimension of {size}, more than the {MAX_ENTRIES} of C3D")
    return size
