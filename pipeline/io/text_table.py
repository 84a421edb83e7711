"""Text files of numbers, from programs of all kinds: every fault is named with its place."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import SEEK_END, StringIO, TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.notes import Note
from hbm.spatial import Array, Indices
from hbm.spelling import printable, short
from pipeline.io.input_file import open_file
from pipeline.io.recording import Fact, FactKind
from pipeline.io.units import MAX_VALUE

DECIMAL_COMMA: Final = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
COMMA_IN_NUMBER: Final = re.compile(r"(?<=\d),(?=\d)")
NUMBER: Final = re.compile(r"[-+]?(\d+(\.\d*|,\d+)?|\.\d+)([eE][-+]?\d+)?|[-+]?nan", re.IGNORECASE)
SEPARATORS: Final = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}
BETWEEN_LABELS: Final = (r"\t", r"\t|  +", r"\s")
"""The first that gives as many labels as there are columns."""
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
    *("NULL", "null", "NA", "N/A", "#N/A"),
]
"""How programs write a number that is missing; "nan(ind)" is that of C on Windows."""
MIN_RATE_HZ, MAX_RATE_HZ = 1.0, 100_000.0
MAX_TIME_ERROR: Final = 0.1
"""In steps: files round their times, but not by more than this beyond half of their last digit."""
MAX_ROUNDING: Final = 1.2
"""Of half of the last digit: how far rounded times may be from those of a fitted rate."""
ROUNDED: Final = 1e-6
"""Of a digit: closer to a whole one, a number has no further digits."""
MIN_SHARE_USUAL: Final = 0.95
"""Of steps like most of them: rounding alone makes more that are not."""
MAX_FILLED_RATIO: Final = 2
"""Rows spanned per row held: with more missing, this is not one recording."""
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


def table_lines(path: Path, separators: str = "\t") -> tuple[list[str], list[Fact]]:
    """Give the lines of a table with tabs between its fields, and what was written otherwise.

    The longest of the last rows shows what separates fields: tabs, semicolons, commas or spaces;
    others than the ``separators`` of the format are a fact. Commas in numbers are decimal ones
    where they separate no fields and no number has a point. Quotes are removed.
    """
    lines, facts = [line.replace('"', "") for line in lines_of(path)], list[Fact]()
    rows = list(islice(filter(str.strip, reversed(lines)), LINES_COMPARED))
    longest = max(rows, key=len)
    words = longest.split()
    separator = next((s for s in SEPARATORS if s in longest), " ")
    # more numbers between spaces than fields between tabs
    if all(map(NUMBER.fullmatch, words)) and len(words) > len(longest.strip().split("\t")):
        separator = " "
    fields = [field.strip() for row in rows for field in row.split(separator)]
    if separator != "\t":
        lines = ["\t".join(line.split(separator.strip() or None)) for line in lines]
    if separator not in separators:
        what = f"its columns are separated by {SEPARATORS[separator]}, expected tabs"
        facts.append(Fact("corrected", path.name, what))
    commas = separator != "," and any(map(DECIMAL_COMMA.fullmatch, fields))
    if commas and not any("." in field for field in fields):
        lines = [COMMA_IN_NUMBER.sub(".", line) for line in lines]
        facts.append(Fact("corrected", path.name, "its decimal commas are read as points"))
    return lines, facts


def labels_in(line: str, count: int) -> list[str]:
    """Give the labels in a line of a header, ``count`` of them where it can be read so.

    They are between tabs, else between tabs or several spaces, else between any spaces.
    """
    ways = [[label for label in re.split(way, line) if label.strip()] for way in BETWEEN_LABELS]
    labels = next((labels for labels in ways if len(labels) == count), ways[0])
    return [printable(label.strip()) for label in labels]


def with_last_gaps(line: str, count: int) -> str:
    """Add the tabs that some programs leave out where a row's last markers are missing."""
    missing = count - line.count("\t") - 1
    return line + "\t" * missing if missing > 0 and missing % 3 == 0 else line


def count_facts(path: Path, counts: Mapping[str, tuple[str, int]]) -> list[Fact]:
    """Say which counts of a header, key -> (as written, in the file), are not those of the file."""
    facts = []
    for key, (written, held) in counts.items():
        if written.strip() not in ("", str(held)):
            # a file that holds less may have been cut short
            kind: FactKind = "in_doubt" if read_number(written, key) > held else "corrected"
            what = f"its header says {key} {short(written)}, but it holds {held}"
            facts.append(Fact(kind, path.name, what))
    return facts


def read_rate(text: str, key: str) -> float:
    """Read a rate in a header [Hz]; a ValueError where it is none."""
    rate_hz = read_number(text, f"{key} in the header")
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise ValueError(
            f"its header says {key} {short(text)!r}, expected {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
        )
    return rate_hz


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


def regular_rows(
    file: str, numbers: Sequence[int], values: Array, column: int, rate_hz: float | None = None
) -> tuple[Array, Array, list[Fact]]:
    """Bring rows to regular times.

    Parameters
    ----------
    file, numbers
        Name of the file and number of each row's line in it, for messages.
    values
        Rows of numbers, (N, columns).
    column
        That of their times [s].
    rate_hz
        As a header states it; used where the times agree but for their rounding.

    Returns
    -------
    time
        Regular times, (T,) [s].
    values
        Rows at these times, (T, columns); NaN where the file lacks them.
    facts
        Another rate than the stated one, a repeated row left out, rows that are missing.

    Raises
    ------
    ValueError
        A row has no time or one that occurs twice, or the times are those of no rate.
    """
    time, facts = values[:, column], list[Fact]()
    if len(time) < 2:
        raise ValueError(f"it holds {len(time)} rows of numbers, expected at least 2")
    if not np.isfinite(time).all():
        raise ValueError(f"line {numbers[int(np.isfinite(time).argmin())]}: it has no time")
    grid = _grid(time, rate_hz)
    if grid is None:  # rows written twice: the same again, or the last one
        kept = np.append(True, np.diff(time) != 0)
        for k in np.flatnonzero(~kept).tolist():
            where, what = f"line {numbers[k]}", f"time {time[k]:.9g} occurs twice"
            if k < len(time) - 1 and not np.array_equal(values[k], values[k - 1], equal_nan=True):
                raise ValueError(f"{where}: {what}; delete one of the rows, or export it again")
            facts.append(Fact("left_out", f"{file}, {where}", what))
        numbers = [numbers[k] for k in np.flatnonzero(kept).tolist()]
        values, time = values[kept], time[kept]
        grid = _grid(time, rate_hz)
    if len(time) < 2:
        raise ValueError("all its rows have the same time")
    if grid is None:
        step = 1 / rate_hz if rate_hz else float(np.median(np.diff(time)))
        k = 1 + int(np.argmax(np.abs(np.diff(time) - step) > MAX_TIME_ERROR * step))
        raise ValueError(
            f"line {numbers[k]}: time {time[k]:.9g} s, expected {time[k - 1] + step:.9g} s in "
            f"steps of {step:.6g} s; correct its times or rate, or export it again"
        )
    start_s, rate, index = grid
    if rate_hz is not None and rate != rate_hz:
        what = f"its header says {rate_hz:g} Hz, but its times are those of {rate:.6g} Hz"
        facts.append(Fact("corrected", file, what))
    if rounding := _rounding(time, rate):
        what = f"its times, rounded to {2 * rounding:g} s, are taken as those of {rate:.6g} Hz"
        facts.append(Fact("corrected", file, what))
    filled = np.full((index[-1] + 1, values.shape[1]), np.nan)
    filled[index] = values
    if missing := len(filled) - len(values):
        after = numbers[int(np.argmax(np.diff(index) > 1))]
        what = f"{missing} rows are not there, the first after line {after}"
        facts.append(Fact("missing", file, what))
    return start_s + np.arange(len(filled)) / rate, filled, facts


def _grid(time: Array, stated_hz: float | None) -> tuple[float, float, Indices] | None:
    """Give start [s], rate [Hz] and numbers of rows whose times are regular but for rounding."""
    steps, count = np.diff(time), np.arange(len(time))
    if not time[-1] > time[0]:
        return None
    usual_s, slope_s = float(np.median(steps)), float(np.polyfit(count, time, 1)[0])
    # single steps that are lost or doubled would turn a line through all times or their ends
    lost = MIN_SHARE_USUAL < np.mean(np.abs(steps - usual_s) < usual_s / 2) < 1
    ends_hz = (len(time) - 1) / float(time[-1] - time[0])
    # equal steps need no rounding to be explained; else the stated rate is tried with it first
    measured = [(0.0, ends_hz)] if np.ptp(steps) < MAX_TIME_ERROR * usual_s else []
    tries = [
        (0.0, stated_hz),
        *measured,
        (MAX_ROUNDING, stated_hz),
        (0.0, 1 / usual_s if lost else ends_hz),
    ]
    tries += [] if lost else [(MAX_ROUNDING, round(1 / slope_s)), (MAX_ROUNDING, 1 / slope_s)]
    for share, rate_hz in tries:
        if rate_hz and MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
            index = np.rint((time - time[0]) * rate_hz).astype(int) if lost and not share else count
            rounding = _rounding(time, rate_hz)
            start_s = float(np.mean(time - index / rate_hz) if rounding else time[0])
            error_s = np.abs(time - start_s - index / rate_hz).max()
            increases = (np.diff(index) > 0).all() and index[-1] < MAX_FILLED_RATIO * len(time)
            if increases and error_s < MAX_TIME_ERROR / rate_hz + share * rounding:
                return start_s, rate_hz, index
    return None


def _rounding(time: Array, rate_hz: float) -> float:
    """Give half of the last digit of rounded times [s]; 0 where the steps have no more digits."""
    for unit in (0.01, 0.001, 1e-4, 1e-5):
        if np.abs(time / unit - np.round(time / unit)).max() < ROUNDED:
            step = 1 / rate_hz / unit
            whole = abs(step - round(step)) < ROUNDED
            fine = unit < 0.001 and unit * rate_hz < MAX_TIME_ERROR
            return 0.0 if whole or fine else unit / 2
    return 0.0


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
