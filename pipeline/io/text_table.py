"""Text files of numbers, from programs of all kinds: every fault is named with its place."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import compress, islice
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.spatial import Array, Indices
from hbm.spelling import listed, printable, short
from pipeline.io.input_file import open_file
from pipeline.io.recording import Fact, FactKind
from pipeline.io.units import MAX_VALUE

Rows = list[tuple[int, str]]
"""Numbers and lines."""
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "times")
NUMBER: Final = re.compile(r"[-+]?(\d+(\.\d*|,\d+)?|\.\d+)([eE][-+]?\d+)?|[-+]?nan", re.IGNORECASE)
SEPARATORS: Final = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}
ROWS_COMPARED: Final = 20
"""Last ones of a file, which show how it is written."""
GAPS: Final = [
    "",
    *(f"{sign}{nan}" for sign in ("", "-") for nan in ("nan", "NaN", "NAN", "Nan", "nan(ind)")),
    *("NULL", "null", "NA", "N/A", "#N/A"),
]
"""How programs write a number that is missing; "nan(ind)" is that of C on Windows."""
MIN_RATE_HZ, MAX_RATE_HZ = 1.0, 100_000.0
ROUNDED: Final = 1e-6
"""Of a digit: closer to a whole one, a number has no further digits."""
MIN_STEP_S: Final = 0.5 / MAX_RATE_HZ
"""Shorter than that of any rate."""
EMPTY: Final = "the file is empty"


def decoded(content: bytes) -> str:
    """Decode text in UTF-8 with or without a byte order mark, or in marked UTF-16.

    Other bytes above 127 are replaced, since only comments and names hold them. A ValueError where
    it is empty or holds zero bytes, which text never does.
    """
    if not content.strip():
        raise ValueError(EMPTY)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if b"\0" in content:
        raise ValueError("the file holds binary data, expected text")
    return content.decode("utf-8-sig", errors="replace")


def read_table(path: Path, separators: str = "\t") -> "TextTable":
    """Read the lines of a table, with tabs between their fields.

    The longest of the last rows shows what separates fields: most of them are numbers. Others than
    the ``separators`` of the format are a fact. Commas in numbers are decimal ones where they
    separate no fields and no number has a point. Quotes are removed. The note ``cut_short`` says
    that the file ends within a line, so that its last number may have lost digits; not where this
    line has as many fields as those above it, and its last number as many decimals as theirs.
    """
    with open_file(path) as file:
        text = decoded(file.read()).replace("\r\n", "\n").replace("\r", "\n")
    lines, remarks = text.replace('"', "").split("\n"), list[Note | Fact]()
    of_numbers = (line for line in reversed(lines) if NUMBER.match(line.lstrip()))
    last_rows = list(islice(of_numbers, ROWS_COMPARED))
    fields = {s: [f.strip() for row in last_rows for f in row.split(s)] for s in SEPARATORS}
    separator = max(fields, key=lambda s: sum(map(bool, map(NUMBER.fullmatch, fields[s]))))
    if separator != "\t":
        lines = ["\t".join(line.split(separator.strip() or None)) for line in lines]
    if separator not in separators:
        what = f"its columns are separated by {SEPARATORS[separator]}, expected tabs"
        remarks.append(Fact("corrected", path.name, what))
    decimal_comma = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
    commas = separator != "," and any(map(decimal_comma.fullmatch, fields[separator]))
    if commas and not any("." in field for field in fields[separator]):
        lines = [re.sub(r"(?<=\d),(?=\d)", ".", line) for line in lines]
        remarks.append(Fact("corrected", path.name, "its decimal commas are read as points"))
    *above, shape = (
        (line.count("\t"), len(line.rpartition("\t")[2].partition(".")[2]))
        for line in lines[1:][-1 - ROWS_COMPARED :]
    )
    if lines[-1].strip() and (not shape[1] or {*above} != {shape}):
        remarks.append(Note.of("cut_short", file=path.name, sign="it ends within a line"))
    rows = [(k, line) for k, line in enumerate(lines, start=1) if line.strip()]
    return TextTable(path, rows, remarks)


def labels_in(line: str, count: int) -> list[str]:
    """Give the labels in a line of a header; between any spaces where these give ``count``."""
    ways = [list(filter(str.strip, line.split(way))) for way in ("\t", None)]
    labels = next((labels for labels in ways if len(labels) == count), ways[0])
    return [printable(label.strip()) for label in labels]


def read_rate(text: str, key: str) -> float:
    """Read a rate in a header [Hz]; a ValueError where it is none."""
    rate_hz = read_number(text, f"{key} in the header")
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise ValueError(
            f"its header says {key} {short(text)!r}, expected {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
        )
    return rate_hz


@dataclass(slots=True)
class TextTable:
    """A table in a text file.

    Attributes
    ----------
    path
        The file.
    rows
        Its lines that are not empty, with their numbers in the file and tabs between fields; from
        `labels_in` on those of numbers.
    remarks
        How the file ends, and what was corrected, left out or is in doubt.
    """

    path: Path
    rows: Rows
    remarks: list[Note | Fact]

    @property
    def width(self) -> int:
        """Number of columns up to the last one that is filled in any row."""
        return max((line.rstrip().count("\t") + 1 for _, line in self.rows), default=0)

    def check_counts(self, header: Mapping[str, str], counts: Mapping[str, int]) -> None:
        """Say which counts of a header are not those of the file."""
        for key, held in counts.items():
            if (written := header.get(key, "").strip()) not in ("", str(held)):
                # a file that holds less may have been cut short
                kind: FactKind = "in_doubt" if read_number(written, key) > held else "corrected"
                what = f"its header says {key} {short(written)}, but it holds {held}"
                self.remarks.append(Fact(kind, self.path.name, what))

    def numbers(self, names: Sequence[str]) -> Array:
        """Read rows of numbers, (rows, columns) by their names; an empty field is NaN.

        A ValueError where a row has too few or too many fields, tabs at its end excepted, or a
        field is no number, or too large for one.
        """
        # 500 rows at once, so that parsing takes little memory
        batches = (self.rows[k : k + 500] for k in range(0, len(self.rows), 500))
        parts = [_parse_batch(batch, names) for batch in batches]
        return np.concatenate([np.empty((0, len(names))), *parts])

    def distinct(self, names: Sequence[str], values: Array) -> dict[str, Array]:
        """Give columns by their names; the same one again is left out, another one refused."""
        by_name: dict[str, Array] = {}
        for k, (name, column) in enumerate(zip(names, values.T, strict=True), start=1):
            first = names.index(name) + 1
            if not np.array_equal(by_name.setdefault(name, column), column, equal_nan=True):
                raise ValueError(
                    f"columns {first} and {k} are both named {short(name)}, but differ; rename one"
                )
            if first < k:
                of, what = f"{self.path.name}, column {k}", f"it is the same as column {first}"
                self.remarks.append(Fact("left_out", of, what))
        return by_name

    def regular(
        self, values: Array, column: int | None, rate_hz: float = 0.0, of: str = "time"
    ) -> tuple[Array, Array]:
        """Bring rows to regular times.

        Parameters
        ----------
        values
            Rows of numbers, (N, columns).
        column
            That of their times [s]; None if these begin at 0.
        rate_hz
            As a header states it, used where the times agree but for their rounding; else 0.
        of
            What messages call the times.

        Returns
        -------
        time
            Regular times, (T,) [s].
        values
            Rows at these times, (T, columns); NaN where the file lacks them.

        Raises
        ------
        ValueError
            A row has no time, or that of another with other values, or the times have no rate.
        """
        if column is None:
            return np.arange(len(values)) / rate_hz, values
        time, file, lines = values[:, column], self.path.name, [k for k, _ in self.rows]
        if len(time) < 2:
            raise ValueError(f"it holds {len(time)} rows of numbers, expected at least 2")
        if not np.isfinite(time).all():
            raise ValueError(f"line {lines[int(np.isfinite(time).argmin())]}: it has no {of}")
        grid, (_, first, place) = _grid(time, rate_hz), np.unique(time, True, True)
        new = first[place] == np.arange(len(time))
        if grid is None and not new.all():  # rows written twice: the same again, or the last one
            for k in np.flatnonzero(~new).tolist():
                last, before = k == len(time) - 1, values[first[place[k]]]
                if not (last or np.array_equal(values[k], before, equal_nan=True)):
                    what = f"{of} {time[k]:.9g} occurs twice with other values"
                    raise ValueError(f"line {lines[k]}: {what}; delete one row, or export it again")
            where = f"{file}, line {listed(compress(lines, ~new), 3)}"
            self.remarks.append(Fact("left_out", where, f"{of} occurs twice"))
            self.rows = [*compress(self.rows, new)]
            return self.regular(values[new], column, rate_hz, of)
        if grid is None:
            step = 1 / rate_hz if rate_hz else float(np.median(np.diff(time)))
            k = 1 + int(np.argmax(np.abs(np.diff(time) - step) > LIMITS.largest_error * step))
            raise ValueError(
                f"line {lines[k]}: {of} {time[k]:.9g}, expected {time[k - 1] + step:.9g} in "
                f"steps of {step:.6g}; correct the file, or export it again"
            )
        start_s, rate, index, rounding = grid
        if rate_hz and rate != rate_hz:
            what = f"its header says {rate_hz:g} Hz, but its times are those of {rate:.6g} Hz"
            self.remarks.append(Fact("corrected", file, what))
        if rounding:
            what = f"its times, rounded to {2 * rounding:g} s, are taken as those of {rate:.6g} Hz"
            self.remarks.append(Fact("corrected", file, what))
        filled = np.full((index[-1] + 1, values.shape[1]), np.nan)
        filled[index] = values
        if missing := len(filled) - len(values):
            after = lines[int(np.argmax(np.diff(index) > 1))]
            what = f"{missing} rows are not there, the first after line {after}"
            self.remarks.append(Fact("missing", file, what))
        return start_s + np.arange(len(filled)) / rate, filled

    def markers(
        self, clock: Sequence[str], names: Sequence[str], rate_hz: float
    ) -> tuple[int, Array, Array]:
        """Read rows of a frame's number, a time, or both, and three columns of each marker.

        Some programs end a row after its last marker that is seen. Given are the number of the
        first frame, times [s], and positions, (T, M, 3).
        """
        columns = [*clock, *(f"{name} {axis}" for name in names for axis in "XYZ")]
        if self.width > len(columns):
            raise ValueError(
                f"its header names {len(names)} markers, but line {self.rows[0][0]} has columns "
                f"for {(self.width - len(clock)) / 3:.3g}"
            )
        missing = [len(columns) - line.count("\t") - 1 for _, line in self.rows]
        gaps = ["\t" * count * (count % 3 == 0) for count in missing]
        self.rows = [(k, line + gap) for (k, line), gap in zip(self.rows, gaps, strict=True)]
        timed = clock.index("Time") if "Time" in clock else None
        time, values = self.regular(self.numbers(columns), timed, rate_hz)
        first = int(values[0, 0]) if "Frame" in clock and np.isfinite(values[0, 0]) else 1
        if timed is None:
            time += (first - 1) / rate_hz
        return first, time, values[:, len(clock) :].reshape(len(values), len(names), 3)


def _grid(time: Array, stated_hz: float) -> tuple[float, float, Indices, float] | None:
    """Give start [s], rate [Hz], numbers of rows and rounding [s] of times that are regular."""
    count, steps = np.arange(len(time)), np.diff(time)
    # without steps over rows that are missing
    median = np.quantile(steps, 0.5, method="lower")
    usual_s = max(float(np.mean(steps[np.isclose(steps, median, rtol=0.5, atol=0)])), MIN_STEP_S)
    slope_s = max(float(np.polyfit(count, time, 1)[0]), MIN_STEP_S)
    # the last digit to which times are written
    digits = (0.01, 0.001, 1e-4, 1e-5)
    digit = next((d for d in digits if np.abs(time / d - np.rint(time / d)).max() < ROUNDED), 1e-6)
    # equal steps need no rounding to be explained
    uneven = LIMITS.largest_rounding * bool(np.ptp(steps) > LIMITS.largest_error * usual_s)
    # all rows and rounded times, or some rows missing and times as they are
    tries = (
        (stated_hz, True),
        (stated_hz, False),
        (1 / usual_s, False),
        (round(1 / slope_s), True),
        (1 / slope_s, True),
    )
    for rate_hz, complete in tries:
        if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
            continue
        index = count if complete else np.rint((time - time[0]) * rate_hz).astype(int)
        # a step of whole digits, or of many fine ones, needs no rounding to be explained
        in_digits = 1 / rate_hz / digit
        whole = abs(in_digits - round(in_digits)) < ROUNDED
        fine = digit < 0.001 and in_digits > 1 / LIMITS.largest_error
        rounding = 0.0 if whole or fine else digit / 2
        start_s = float(np.mean(time - index / rate_hz) if rounding else time[0])
        error_s = np.abs(time - start_s - index / rate_hz).max()
        # with more than half of the rows missing, this is not one recording
        increases = np.diff(index).min() == 1 and index[-1] < 2 * len(time)
        if increases and error_s < LIMITS.largest_error / rate_hz + uneven * rounding * complete:
            return start_s, rate_hz, index, rounding
    return None


def _parse_batch(rows: Rows, names: Sequence[str]) -> Array:
    import pandas as pd  # takes longer to load than a C3D file to read

    for number, line in rows:
        fields, filled = line.count("\t") + 1, line.rstrip().count("\t") + 1
        if not filled <= len(names) <= fields:
            raise ValueError(
                f"line {number} holds {fields} fields for {len(names)} columns; truncated or wrong"
            )
    try:
        values = pd.read_csv(
            StringIO("\n".join(line for _, line in rows)),
            sep="\t",
            header=None,
            usecols=range(len(names)),
            dtype=float,
            quoting=3,
            keep_default_na=False,
            na_values=GAPS,
            skipinitialspace=True,
        ).to_numpy(float)
    except ValueError:
        values = None
    if values is None or (np.abs(values) > MAX_VALUE).any():
        for number, line in rows:
            for name, field in zip(names, line.split("\t"), strict=False):
                read_number(field, f"line {number}, column {short(name)!r}")
        raise ValueError(f"a row from line {rows[0][0]} on holds something that is no number")
    return np.ascontiguousarray(values)  # row by row: whoever takes columns copies only those


def read_number(text: str, where: str) -> float:
    """Read one number, NaN where it is missing; a ValueError names the place and the text."""
    try:
        number = float("nan" if text.strip() in GAPS else text)
    except ValueError:
        number = np.inf
    if abs(number) > MAX_VALUE:
        raise ValueError(f"{where}: {short(text.strip())!r}, expected a number such as 1.5")
    return number
