"""Text files of D-Flow's record module: signals at uneven times, and events between the rows."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array, read_only
from hbm.spelling import listed, short
from pipeline.io.input_file import naming
from pipeline.io.recording import Analog
from pipeline.io.text_table import ending_notes, lines_of, names_in, parse_rows

EVENT: Final = re.compile(r"#\s*EVENT\s+(\S+)\s*-\s*COUNT\s+(\d+)", re.IGNORECASE)
TOTAL: Final = re.compile(r"#\s*EVENT\s+(\S+)\s+occur+ed\s+(\d+)\s+times?", re.IGNORECASE)

MIN_COVERED: Final = 0.9
"""Share of the frames' time: both modules are started and stopped by hand, some frames apart."""


@dataclass(frozen=True, slots=True)
class Record:
    """What a record file holds, on D-Flow's clock.

    Attributes
    ----------
    time
        Times of the rows, (N,) [s].
    names
        Signals, without the time.
    values
        (N, K), as the file has them.
    events
        Letter -> times [s], in the middle between the rows around the event.
    notes
        On how the file ends: ``last_line_unended``, and ``record_unended`` where the counts of
        events are missing that D-Flow writes last.
    """

    time: Array
    names: tuple[str, ...]
    values: Array
    events: dict[str, tuple[float, ...]]
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", read_only(self.time))
        object.__setattr__(self, "values", read_only(self.values))


def read_record(path: str | Path) -> Record:
    """Read a file of D-Flow's record module.

    Parameters
    ----------
    path
        The file (.txt).

    Returns
    -------
    Record
        Signals and events.

    Raises
    ------
    ValueError
        The file is damaged, its times do not increase, or it holds fewer events than it counts.
    OSError
        The file cannot be opened.
    """
    path = Path(path)
    with naming(path):
        return _parse(lines_of(path), ending_notes(path))


def _parse(lines: Iterator[str], notes: tuple[Note, ...]) -> Record:
    names = names_in(next(lines, "").rstrip(), "\t")
    if names[0] != "Time":
        raise ValueError(f"not a D-Flow record file: its first column is {short(names[0])!r}")
    rows: list[tuple[int, str]] = []
    marks: list[tuple[str, int]] = []
    totals: dict[str, int] = {}
    for number, line in enumerate(lines, start=2):
        if event := EVENT.match(line.strip()):
            marks.append((event[1], len(rows)))
        elif total := TOTAL.match(line.strip()):
            totals[total[1]] = int(total[2])
        elif line.strip() and not line.lstrip().startswith("#"):
            rows.append((number, line))
    values = parse_rows(rows, "\t", names)
    if len(values) < 2:
        raise ValueError(f"it holds {len(values)} rows, expected at least 2")
    time = values[:, 0]
    if not (np.diff(time) >= 0).all():
        raise ValueError("its times do not increase")
    counts = Counter(name for name, _ in marks)
    for name, stated in totals.items():
        if counts[name] != stated:
            raise ValueError(f"it counts {stated} events {name} but holds {counts[name]}")
    if uncounted := sorted(set(counts) - set(totals)):
        notes = (*notes, Note.of("record_unended", events=uncounted))
    events: dict[str, tuple[float, ...]] = {}
    for name, row in marks:
        around = time[max(row - 1, 0) : row + 1]
        events[name] = (*events.get(name, ()), float(around.mean()))
    return Record(time, tuple(names[1:]), values[:, 1:], events, notes)


def on_clock(
    record: Record, name: str, stamps: Array, time: Array, analog: Analog | None
) -> tuple[Analog, dict[str, tuple[float, ...]], tuple[Note, ...]]:
    """Bring a record onto the cameras' clock.

    Parameters
    ----------
    record
        The record.
    name
        Its file's name, for the note.
    stamps
        D-Flow's time stamp of each camera frame, (T,) [s]; NaN where the frame was dropped.
    time
        The frames' times on the recording's clock, (T,) [s].
    analog
        Channels that are already on that clock, which the record's follow.

    Returns
    -------
    analog
        All channels; NaN outside the record.
    events
        Letter -> times [s] on the recording's clock.
    notes
        ``record_interpolated``; ``record_short`` where the record covers less than nine tenths of
        the frames.

    Raises
    ------
    ValueError
        The two do not overlap in time, or a signal has the name of a channel.

    Notes
    -----
    Time stamps scatter and bunch up when D-Flow lags, so the clocks are related by a straight line
    through all of them, not frame by frame.
    """
    seen = np.isfinite(stamps)
    rate, start = np.polyfit(time[seen] - time[seen].mean(), stamps[seen], 1)
    start = float(np.median(stamps[seen] - rate * time[seen]))
    clock = (record.time - start) / rate
    if clock[-1] < time[0] or clock[0] > time[-1]:
        raise ValueError(
            f"its times {record.time[0]:.2f}–{record.time[-1]:.2f} s do not overlap the "
            f"markers' {start:.2f}–{start + rate * time[-1]:.2f} s; is it of the same trial?"
        )
    names = analog.names if analog else ()
    if twice := sorted(set(names) & set(record.names)):
        raise ValueError(f"signals named like the mocap file's: {listed(twice)}")
    signals = [
        np.interp(time, clock, record.values[:, k], np.nan, np.nan)
        for k in range(len(record.names))
    ]
    known = [analog.values] if analog else []
    both = Analog(
        time,
        (*names, *record.names),
        (*(analog.units if analog else ()), *[""] * len(record.names)),
        np.column_stack([*known, *signals]) if known or signals else np.empty((len(time), 0)),
    )
    events = {
        letter: tuple((at - start) / float(rate) for at in times)
        for letter, times in record.events.items()
    }
    counted = [f"{letter} ×{len(times)}" for letter, times in events.items()] or ["none"]
    note = Note.of("record_interpolated", signals=len(record.names), file=name, events=counted)
    covered = np.clip(clock[[0, -1]], time[0], time[-1])
    if np.ptp(covered) >= MIN_COVERED * np.ptp(time):
        return both, events, (note,)
    short_note = Note.of("record_short", file=name, first_s=covered[0], last_s=covered[1])
    return both, events, (note, short_note)
