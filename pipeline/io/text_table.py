"""Text files of numbers, from programs of all kinds: every fault is named with its place."""

import re
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from hbm.spelling import short

DECIMAL_COMMA: Final = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
UTF16_MARKS: Final = (b"\xff\xfe", b"\xfe\xff")
MAX_VALUE: Final = 1e9
"""In any unit; beyond it the number is damaged."""


def read_lines(path: Path) -> list[str]:
    """Read a text file with any line ends, with or without a byte order mark.

    Parameters
    ----------
    path
        The file, in UTF-8 or marked UTF-16; other bytes above 127 are replaced, since only
        comments and names hold them.

    Returns
    -------
    list[str]
        Lines without their ends.

    Raises
    ------
    ValueError
        The file is empty or holds zero bytes, which text never does.
    OSError
        The file cannot be opened.
    """
    return decoded(path.read_bytes()).splitlines()


def decoded(content: bytes) -> str:
    """Decode text in UTF-8 or marked UTF-16; a ValueError where it is empty or binary."""
    if not content.strip():
        raise ValueError("the file is empty")
    if content.startswith(UTF16_MARKS):
        return content.decode("utf-16", errors="replace")
    if b"\0" in content:
        raise ValueError("the file holds binary data, expected text")
    return content.decode("utf-8-sig", errors="replace")


def parse_rows(
    lines: Sequence[str], separator: str, names: Sequence[str], numbers: Sequence[int]
) -> Array:
    """Read rows of numbers.

    Parameters
    ----------
    lines
        One row each; separators after the last column are allowed.
    separator
        Between fields.
    names
        The columns, for counting and for messages.
    numbers
        The rows' line numbers in the file, for messages.

    Returns
    -------
    Array
        (rows, columns); an empty field is NaN.

    Raises
    ------
    ValueError
        A row has too few or too many fields, or a field is no number, or too large for one.
    """
    count = len(names)
    for line, number in zip(lines, numbers, strict=True):
        fields = line.count(separator) + 1
        extra = line.split(separator)[count:] if fields > count else []
        if fields < count or any(field.strip() for field in extra):
            raise ValueError(
                f"line {number} holds {fields} fields for {count} columns: "
                "the file is truncated or its columns are wrong"
            )
    if not lines:
        return np.empty((0, count))
    try:
        values = pd.read_csv(
            StringIO("\n".join(lines)),
            sep=separator,
            header=None,
            usecols=range(count),
            dtype=float,
            skip_blank_lines=False,
            quoting=3,
            keep_default_na=False,
            na_values=["", "NaN", "nan", "-nan"],
            skipinitialspace=True,
        ).to_numpy(float)
    except ValueError as error:
        raise ValueError(_first_fault(lines, separator, names, numbers)) from error
    strange = np.argwhere(np.abs(values) > MAX_VALUE)
    if len(strange):
        row, column = strange[0]
        raise ValueError(
            f"line {numbers[row]}, column {short(names[column])!r}: {values[row, column]:g} cannot "
            "have been measured"
        )
    return values


def read_number(text: str, where: str) -> float:
    """Read one number, NaN where it is empty; a ValueError names the place and the text."""
    text = text.strip()
    try:
        return float(text or "nan")
    except ValueError:
        reason = "is no number"
        if DECIMAL_COMMA.fullmatch(text):
            reason = "has a decimal comma; export the file with decimal points"
        raise ValueError(f"{where}: {text[:40]!r} {reason}") from None


def _first_fault(
    lines: Sequence[str], separator: str, names: Sequence[str], numbers: Sequence[int]
) -> str:
    for line, number in zip(lines, numbers, strict=True):
        for name, field in zip(names, line.split(separator), strict=False):
            try:
                read_number(field, f"line {number}, column {short(name)!r}")
            except ValueError as error:
                return str(error)
    return "a row holds something that is no number"
