"""Text files of numbers, from programs of all kinds: every fault is named with its place."""

import re
from collections.abc import Iterable, Iterator, Sequence
from io import SEEK_END, StringIO, TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import printable, short
from pipeline.io.input_file import open_file
from pipeline.io.units import MAX_VALUE

DECIMAL_COMMA: Final = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
UTF16_MARKS: Final = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
FIELD_END: Final = re.compile(r"[\t,;]| +")
BATCH_LINES: Final = 500
"""Lines that are parsed together: memory for a file of any length is that of its numbers."""
TAIL_BYTES: Final = 1 << 20
"""Read of a file's end, to compare its last line with those above it."""
LINES_COMPARED: Final = 20
GAPS: Final = [
    "",
    *(f"{sign}{nan}" for sign in ("", "-") for nan in ("nan", "NaN", "NAN", "Nan", "nan(ind)")),
]
"""How programs write a number that is missing; "nan(ind)" is that of C on Windows."""
EMPTY: Final = "the file is empty"
BINARY: Final = "the file holds binary data, expected text"


def lines_of(path: Path) -> Iterator[str]:
    """Go through the lines of a text file with any line ends, as they are read.

    The file is in UTF-8 with or without a byte order mark, or in marked UTF-16; other bytes above
    127 are replaced, since only comments and names hold them. A ValueError where it is empty or
    holds zero bytes, which text never does.
    """
    empty = True
    with open_file(path) as file:
        encoding = "utf-16" if file.read(2) in UTF16_MARKS else "utf-8-sig"
        file.seek(0)
        with TextIOWrapper(file, encoding, errors="replace") as text:
            for line in text:
                if "\0" in line:
                    raise ValueError(BINARY)
                empty = empty and line.isspace()
                yield line.removesuffix("\n")
    if empty:
        raise ValueError(EMPTY)


def decoded(content: bytes) -> str:
    """Decode text as `lines_of` does; a ValueError where it is empty or binary."""
    if not content.strip():
        raise ValueError(EMPTY)
    if content.startswith(tuple(UTF16_MARKS)):
        return content.decode("utf-16", errors="replace")
    if b"\0" in content:
        raise ValueError(BINARY)
    return content.decode("utf-8-sig", errors="replace")


def names_in(line: str, separator: str | None = None) -> list[str]:
    """Give the printable names in a line of a header; without a separator, those between spaces."""
    return [printable(name.strip()) for name in line.split(separator)]


def ending_notes(path: Path) -> list[Note]:
    """Warn where a file ends within a line, so that its last number may have lost digits.

    The note ``cut_short``, unless the last line has as many fields as those above it, and its last
    number as many decimals as theirs.
    """
    with open_file(path) as file:
        encoding = UTF16_MARKS.get(file.read(2), "utf-8")
        size = file.seek(0, SEEK_END)
        file.seek(max(0, size - TAIL_BYTES) // 2 * 2)
        text = file.read().decode(encoding, errors="replace")
    *above, last = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    shapes = {_shape(line) for line in above[1:][-LINES_COMPARED:]}
    fields, decimals = _shape(last)
    if not last.strip() or (decimals and shapes == {(fields, decimals)}):
        return []
    return [Note.of("cut_short", file=path.name, sign="it ends within a line")]


def _shape(line: str) -> tuple[int, int]:
    """Give the number of fields, and of the characters after the last one's point."""
    fields = FIELD_END.split(line)
    return len(fields), len(fields[-1].partition(".")[2])


def parse_rows(rows: Iterable[tuple[int, str]], separator: str, names: Sequence[str]) -> Array:
    """Read rows of numbers, (rows, columns); an empty field is NaN.

    Parameters
    ----------
    rows
        Number of each line in the file, for messages, and the line; separators after the last
        column are allowed.
    separator
        Between fields.
    names
        The columns, for counting and for messages.

    Raises
    ------
    ValueError
        A row has too few or too many fields, or a field is no number, or too large for one.
    """
    rows = iter(rows)
    parts = [np.empty((0, len(names)))]
    while batch := list(islice(rows, BATCH_LINES)):
        parts.append(_parse_batch(batch, separator, names))
    return np.concatenate(parts)


def _parse_batch(rows: Sequence[tuple[int, str]], separator: str, names: Sequence[str]) -> Array:
    count = len(names)
    for number, line in rows:
        fields = line.count(separator) + 1
        extra = line.split(separator)[count:] if fields > count else []
        if fields < count or any(field.strip() for field in extra):
            raise ValueError(
                f"line {number} holds {fields} fields for {count} columns: "
                "the file is truncated or its columns are wrong"
            )
    try:
        values = pd.read_csv(
            StringIO("\n".join(line for _, line in rows)),
            sep=separator,
            header=None,
            usecols=range(count),
            dtype=float,
            skip_blank_lines=False,
            quoting=3,
            keep_default_na=False,
            na_values=GAPS,
            skipinitialspace=True,
        ).to_numpy(float)
    except ValueError as error:
        for number, line in rows:
            for name, field in zip(names, line.split(separator), strict=False):
                read_number(field, f"line {number}, column {short(name)!r}")
        raise ValueError("a row holds something that is no number") from error
    strange = np.argwhere(np.abs(values) > MAX_VALUE)
    if len(strange):
        row, column = strange[0]
        raise ValueError(
            f"line {rows[row][0]}, column {short(names[column])!r}: {values[row, column]:g} cannot "
            "have been measured"
        )
    return np.ascontiguousarray(values)  # row by row: whoever takes columns copies only those


def read_number(text: str, where: str) -> float:
    """Read one number, NaN where it is empty; a ValueError names the place and the text."""
    text = text.strip()
    try:
        return float(text or "nan")
    except ValueError:
        reason = "is no number"
        if DECIMAL_COMMA.fullmatch(text):
            reason = "has a decimal comma; export the file with decimal points"
        raise ValueError(f"{where}: {short(text)!r} {reason}") from None
