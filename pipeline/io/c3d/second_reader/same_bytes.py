"""Bytes of a rewritten C3D file against those of its original."""

import struct
from collections import defaultdict
from collections.abc import Collection
from functools import partial
from math import prod
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.byte_order import BLOCK_BYTES, floats, integer_type
from pipeline.io.c3d.header import DATA_STARTS, Header, read_header
from pipeline.io.c3d.parameters import Parameters, Record, parameter_records
from pipeline.io.c3d.second_reader.disagreement import (
    Disagreement,
    parameters_that_differ,
    samples_that_differ,
    shown,
)
from pipeline.io.c3d.second_reader.reading import Parameter, numbered

DATA_BLOCK_BYTES: Final = slice(16, 18)
"""Of the header: where the data section begins."""
POINT_WORDS: Final = ("x", "y", "z", "residual")


def bytes_that_differ(
    original: Path, written: Path, changed: Collection[int], allowed: set[str], group: str | None
) -> list[Disagreement]:
    """Compare header, parameters and data section byte by byte.

    Parameters
    ----------
    original, written
        Both files.
    changed
        Indices of the analog channels whose samples may differ.
    allowed
        Parameters that may differ, ``GROUP:NAME``.
    group
        Parameter group that may be there or not.

    Returns
    -------
    list[Disagreement]
        What else differs: names, values, dimensions, descriptions and locks of parameters, words
        of the data section, and all that follows it. The end of the parameter section is free.

    Raises
    ------
    ValueError
        A file is damaged.
    OSError
        A file cannot be opened.
    """
    (header, parameters), (header_again, parameters_again) = map(read_header, (original, written))
    first, second = (np.memmap(path, np.uint8, "r") for path in (original, written))
    found = _header_bytes(
        *(side[: (header.parameter_block - 1) * BLOCK_BYTES].copy() for side in (first, second))
    )
    found += parameters_that_differ(
        _values(parameters, allowed, group), _values(parameters_again, allowed, group)
    ) or _records_that_differ(
        _records(first, header, allowed, group), _records(second, header_again, allowed, group)
    )
    moved = header_again.data_block - header.data_block
    found += _starts_that_differ(parameters, parameters_again, moved)
    data, data_again = (
        side[own.data_start :] for side, own in ((first, header), (second, header_again))
    )
    if len(data) != len(data_again):
        sizes = f"{len(data)} bytes", f"{len(data_again)} bytes"
        return [*found, Disagreement("bytes", "of the data section", *sizes)]
    return found + _words_that_differ(data, data_again, header, parameters, changed)


def _header_bytes(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> list[Disagreement]:
    for side in (first, second):
        side[DATA_BLOCK_BYTES] = 0
    return [
        Disagreement("header", f"byte {k + 1}", str(first[k]), str(second[k]))
        for k in np.flatnonzero(first != second)[:1]
    ]


def _records(
    content: NDArray[np.uint8], header: Header, allowed: set[str], group: str | None
) -> dict[str, list[bytes]]:
    """Give the bytes of each record but those that may differ, without the way to the next one."""
    start, stop = ((k - 1) * BLOCK_BYTES for k in (header.parameter_block, header.data_block))
    section = content[start + 4 : stop].tobytes()
    listed = list(parameter_records(section, header.byte_order))
    groups = {-record.identity: record.name for record in listed if record.identity < 0}
    records: dict[str, list[bytes]] = defaultdict(list)
    for record in listed:
        owner = groups.get(abs(record.identity), "")
        name = owner if record.identity < 0 else f"{owner}:{record.name}"
        if owner != group and name not in allowed:
            end = record.pointer + record.step
            if not record.step or end > len(section):
                end = _end(section, record)
            head, rest = section[record.start : record.pointer], section[record.pointer + 2 : end]
            records[name].append(head + rest.rstrip(b"\0"))
    return records


def _end(section: bytes, record: Record) -> int:
    """Give the end of a last record that does not say rightly where the next one would begin."""
    start = record.pointer + 2
    if record.identity > 0:
        kind, dimensions = struct.unpack_from("bB", section, start)
        sizes = section[start + 2 : start + 2 + dimensions]
        start += 2 + dimensions + prod(sizes) * abs(kind)
    return start + 1 + section[start] if start < len(section) else len(section)


def _records_that_differ(
    first: dict[str, list[bytes]], second: dict[str, list[bytes]]
) -> list[Disagreement]:
    return [
        Disagreement("parameter", name, "these bytes", "others")
        for name in sorted({*first, *second})
        if first.get(name) != second.get(name)
    ]


def _starts_that_differ(first: Parameters, second: Parameters, moved: int) -> list[Disagreement]:
    """Find starts of data that have not moved by so many blocks, as the header's has."""
    found = []
    for group, name in DATA_STARTS:
        start, again = (side.integer(group, name, 0) for side in (first, second))
        expected = start + moved if start else 0
        if again != expected:
            key = f"{group}:{name}"
            found.append(Disagreement("parameter", key, f"{expected} after the move", str(again)))
    return found


def _values(parameters: Parameters, allowed: set[str], group: str | None) -> dict[str, Parameter]:
    """Give all parameters but those that may differ."""
    flat: dict[str, Parameter] = {}
    for name, members in parameters.groups.items():
        for member, values in members.items():
            if name != group and f"{name}:{member}" not in allowed:
                flat[f"{name}:{member}"] = tuple(
                    text if isinstance(text, str) else float(text)
                    for text in values.ravel(order="F").tolist()
                )
    return flat


def _words_that_differ(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    header: Header,
    parameters: Parameters,
    changed: Collection[int],
) -> list[Disagreement]:
    end, words, channels = header.frames * header.frame.bytes, 4 * header.n_points, header.channels
    kept = [k for k in range(channels) if k not in changed]
    points = numbered(parameters.texts("POINT", "LABELS"), header.n_points)
    labels = numbered(parameters.texts("ANALOG", "LABELS"), channels)
    one, other = (
        side[:end].view("u4" if header.scale < 0 else "u2").reshape(header.frames, -1)
        for side in (first, second)
    )
    found = samples_that_differ(
        "marker",
        [f"{point} {word}" for point in points for word in POINT_WORDS],
        one[:, :words],
        other[:, :words],
        np.not_equal,
        first_frame=header.first_frame,
        show=partial(_shown_word, header),
    )
    if kept:
        found += samples_that_differ(
            "channel",
            [labels[k] for k in kept],
            one[:, words:].reshape(-1, channels)[:, kept],
            other[:, words:].reshape(-1, channels)[:, kept],
            np.not_equal,
            first_frame=header.first_frame,
            per_frame=header.analog_per_frame,
            show=partial(_shown_word, header),
        )
    rest = np.flatnonzero(first[end:] != second[end:])
    if rest.size:
        at = end + int(rest[0])
        values = str(first[at]), str(second[at])
        found.append(Disagreement("bytes", f"{at + 1} of the data section", *values))
    return found


def _shown_word(header: Header, word: np.generic) -> str:
    data = word.tobytes()
    if header.scale < 0:
        return shown(floats(data, header.byte_order)[0])
    return shown(np.frombuffer(data, integer_type(header.byte_order))[0])
