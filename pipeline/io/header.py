"""What stands at the head of a file, without words that may name a person.

It is what somebody can show of a recording that cannot be shown: counts, rates, units, labels,
force plates. Of other text, only words that mean something in recordings are printed.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from pipeline.io.c3d.data import KEY
from pipeline.io.c3d.parameters import (
    BLOCK_BYTES,
    BYTE_ORDERS,
    floats,
    integer_type,
    parse_parameters,
)
from pipeline.io.input_file import open_file
from pipeline.io.labels import labels_with, without_prefixes
from pipeline.io.read import file_format
from pipeline.io.read_options import ReadOptions
from pipeline.io.text_table import decoded
from pipeline.io.xdf import MAGIC, read_streams

WORD: Final = re.compile(r"[^\W\d_]{2,}")
DATE: Final = re.compile(r"\b(?:\d{4}([-./])\d\d?\1\d\d?|\d\d?([-./])\d\d?\2(?:\d\d){1,2})\b")


def describe_header(path: Path) -> list[str]:
    """Describe the head of a file, readable or not, line by line.

    Parameters
    ----------
    path
        A recording of any format, or any other file.

    Returns
    -------
    list of str
        Names of people, of files and of places are not in it: prefixes of labels are numbers, other
        text is the number of its letters.

    Raises
    ------
    OSError
        The file cannot be opened.
    """
    with open_file(path) as file:  # blocks of an ASCII export begin within 64 MB
        head = file.read(2**26)
    try:
        kind = file_format(path)
    except ValueError as error:
        kind = str(error).replace(f"{path.name}: ", "", 1)
    lines = [f"{kind}; {path.stat().st_size:,} bytes"]
    is_c3d, is_xdf = head[1:2] == bytes([KEY]), head.startswith(MAGIC)
    describe = _c3d if is_c3d else _xdf if is_xdf else _text
    try:
        lines.extend(islice(describe(head), 300))  # more is no head any more
    except (ValueError, IndexError, struct.error) as error:
        reason = _words(str(error)) if is_xdf else str(error)  # streams have names of their own
        lines += [reason, f"begins with the bytes {head[:16].hex(' ')}"]
    return lines


def _c3d(head: bytes) -> Iterator[str]:
    """Describe the header block and the parameters of a C3D file."""
    section = head[max(head[0] - 1, 0) * BLOCK_BYTES :]
    order = BYTE_ORDERS.get(section[3], "intel")
    words = np.frombuffer(head[:BLOCK_BYTES], integer_type(order, signed=False))
    scale, rate = floats(head[12:16] + head[20:24], order)
    yield (
        f"{order}; points {words[1]}, analog samples {words[2]}, frames {words[3]} to {words[4]}, "
        f"scale {scale:g}, data in block {words[8]}, samples per frame {words[9]}, {rate:g} Hz"
    )
    for group, members in parse_parameters(
        section[4 : BLOCK_BYTES * section[2]], order
    ).groups.items():
        for name, values in members.items():
            shape = "×".join(map(str, values.shape)) or "1"
            every = values.ravel(order="F")  # of lists other than labels, the first 24
            if values.dtype.kind != "U":
                shown = [f"{number:g}" for number in every[:24]]
            elif name.startswith("LABELS") and group in ("POINT", "ANALOG"):
                shown = _labels([*map(str, every)])
            else:
                shown = [*map(_words, every[:24])]
            yield f"{group}:{name} [{shape}] {', '.join(shown)}"


def _xdf(content: bytes) -> Iterator[str]:
    """Describe the streams of an XDF file."""
    for stream in read_streams(content)[0]:
        labels = _labels([label.text or "" for label in stream.info.iter("label")])
        yield (
            f"stream {_words(stream.name)} of type {_words(stream.content_type)}: "
            f"{stream.channels} channels of {stream.format}, {stream.rate_hz:g} Hz, "
            f"{stream.samples} samples: {', '.join(labels)}"
        )


def _text(content: bytes) -> Iterator[str]:
    """Describe the rows of a text file that have words, and two rows of numbers after each."""
    numbers = 0
    for row in decoded(content[: len(content) // 2 * 2]).splitlines():
        numbers = 0 if WORD.search(row) else numbers + 1
        if numbers <= 2:
            yield _row(row[:4000])  # an hour of a .mox file is one row


def _row(row: str) -> str:
    """Describe a row of a text file: labels, of which some are known, or words and numbers."""
    cells = re.split(r"[\t,;]", row)
    named = [cell for cell in cells if WORD.search(cell)]
    meaningful = [cell for cell in named if "letters›" not in _words(cell.rpartition(":")[2])]
    # columns of markers are labels whatever their names; other rows are anybody's text
    labels = len(named) > 3 and 3 * len(meaningful) >= len(named)
    return " | ".join(_labels(cells) if labels else map(_words, cells))


def _labels(labels: Sequence[str]) -> list[str]:
    """Give labels with numbers in place of the prefixes, which name subjects."""
    owners = [label.rpartition(":")[0] for label in labels]
    try:
        bare = without_prefixes(labels, ReadOptions())[0]
    except ValueError:  # several subjects carry the same labels
        bare = {k: label.rpartition(":")[2] for k, label in enumerate(labels)}
    numbers = {owner: k for k, owner in enumerate(dict.fromkeys(filter(None, owners)), start=1)}
    return [f"{numbers[owner]}:{bare[k]}" if owner else bare[k] for k, owner in enumerate(owners)]


def _words(text: str) -> str:
    """Give a text without dates, and the number of letters of words that mean nothing here."""

    def shown(word: re.Match[str]) -> str:
        return word[0] if word[0].casefold() in _known() else f"‹{len(word[0])} letters›"

    return DATE.sub("‹date›", WORD.sub(shown, text))


@cache
def _known() -> frozenset[str]:
    """Give the words of headers and those in the labels of all marker sets, in lower case."""
    words = files("pipeline.io").joinpath("header_words.txt").read_text(encoding="utf-8")
    return frozenset(WORD.findall(" ".join((words, *labels_with(None))).casefold()))
