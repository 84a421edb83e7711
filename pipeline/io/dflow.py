"""Text files of Motek D-Flow's mocap module, with or without one of its record module."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.columns import (
    SI_UNITS,
    PlateColumns,
    file_markers,
    lab_axes,
    left_out,
    plates_about_origin,
    plates_in_si,
)
from pipeline.io.input_file import naming
from pipeline.io.recording import Analog, Metadata, Recording
from pipeline.io.stated import Stated, as_stated
from pipeline.io.text_table import ending_notes, lines_of, names_in, parse_rows

EVENT: Final = re.compile(r"#\s*EVENT\s+(\S+)\s*-\s*COUNT\s+(\d+)", re.IGNORECASE)
TOTAL: Final = re.compile(r"#\s*EVENT\s+(\S+)\s+occur+ed\s+(\d+)\s+times?", re.IGNORECASE)

MIN_COVERED: Final = 0.9
"""Share of the frames' time: both modules are started and stopped by hand, some frames apart."""
AXES: Final = "right,up,back"
"""D-Flow's own, of x, y and z."""
CUSTOMARY_RATES_HZ: Final = np.array(
    [30, 50, 60, 100, 120, 125, 128, 150, 200, 240, 250, 256, 300, 400, 500, 1000], float
)
MAX_RATE_DIFFERENCE: Final = 0.02
"""Relative: the slope of time stamps that lag is a customary rate to 2 %."""
MIN_FRAME_S: Final = 1e-4
MAX_FRAME_S: Final = 1.0
"""Time per frame of a camera system; beyond it the stamps are not in seconds."""
MAX_DROPPED_RATIO: Final = 2
"""Frames spanned per frame held: with more dropped, this is not one recording."""
SEGMENTS: Final = {
    *("pelvis", "thorax", "spine", "pelvislegs", "toes", "head"),
    *(f"{side}{name}" for side in "lr" for name in ("femur", "tibia", "foot", "toes")),
    *(f"{side}{name}" for side in "lr" for name in ("humerus", "forearm", "hand", "clavicle")),
}
"""Columns of D-Flow's body model that are named as markers are."""
UNITS: Final = {".Anlg": "V", ".Ang": "deg", ".Mom": "N·m", ".Pow": "W"}
PLATE: Final = re.compile(r"FP(\d+)\.For[XYZ]")
MARKER: Final = re.compile(r"(.+)\.Pos[XYZ]")


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
        return _record(lines_of(path), ending_notes(path))


def _record(lines: Iterator[str], notes: tuple[Note, ...]) -> Record:
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
) -> tuple[Analog, dict[str, tuple[float, ...]], list[Note]]:
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
    known = analog or Analog(time, (), (), np.empty((len(time), 0)))
    if twice := sorted({*known.names} & {*record.names}):
        raise ValueError(f"signals named like the mocap file's: {listed(twice)}")
    signals = [np.interp(time, clock, values, np.nan, np.nan) for values in record.values.T]
    both = Analog(
        time,
        known.names + record.names,
        known.units + ("",) * len(record.names),
        np.column_stack([known.values, *signals]),
    )
    events = {
        letter: tuple((at - start) / float(rate) for at in times)
        for letter, times in record.events.items()
    }
    counted = [f"{letter} ×{len(times)}" for letter, times in events.items()] or ["none"]
    notes = [Note.of("record_interpolated", signals=len(record.names), file=name, events=counted)]
    covered = np.clip(clock[[0, -1]], time[0], time[-1])
    if np.ptp(covered) < MIN_COVERED * np.ptp(time):
        notes.append(Note.of("record_short", file=name, first_s=covered[0], last_s=covered[1]))
    return both, events, notes


@dataclass(frozen=True, slots=True)
class _Table:
    """One mocap file on the cameras' clock: dropped frames are rows of NaN."""

    columns: Mapping[str, int]
    values: Array
    stamps: Array
    first_frame: int
    rate_hz: float
    notes: tuple[Note, ...]

    def vectors(self, stems: Iterable[str]) -> Array:
        """Give the three columns of each of several quantities, (T, stems, 3)."""
        wanted = [(stem, f"{stem}{axis}") for stem in stems for axis in "XYZ"]
        for stem, name in wanted:
            if name not in self.columns:
                raise ValueError(
                    f"column {short(name)} is absent, but others of {short(stem)} are there"
                )
        columns = [self.columns[name] for _, name in wanted]
        return np.take(self.values, columns, axis=1).reshape(len(self.values), -1, 3)


def read_dflow(
    path: str | Path, stated: Stated | str | None = None, *, record: str | Path | None = None
) -> Recording:
    """Read a file of D-Flow's mocap module, and one of its record module beside it.

    Parameters
    ----------
    path
        The mocap file (.txt).
    stated
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`. Axes are by default
        D-Flow's, "right,up,back", units m, N and N·m.
    record
        A record file of the same session: its signals become analog channels on the cameras'
        clock, its events ``metadata.dflow_events``.

    Returns
    -------
    Recording
        SI units, lab axes. The frame number drives time; times start at 0 at the first frame.
        Each plate has identity rotation and its centre at the lab origin, so that its wrench is
        about the lab origin; its corners are unknown (NaN). All other columns are analog channels:
        volts, degrees, N·m, W as D-Flow writes them.

    Raises
    ------
    ValueError
        The file is damaged, truncated, or contradicts its units, axes or itself. One line.
    OSError
        A file cannot be opened.

    Notes
    -----
    A marker that no camera sees is written at zero or, before D-Flow 3.16.2, at its last place;
    both are gaps. One at exactly the same place, to the micrometre, as in the frame before was not
    seen: noise never repeats itself in three coordinates. Force is taken as acting on the subject,
    and moments as about the common origin of plates and cameras; `wrench_about_origin` checks this
    against the centres of pressure and takes another point where they demand it.
    """
    path = Path(path)
    with naming(path):
        return _read(path, as_stated(stated), Path(record) if record else None)


def _read(path: Path, stated: Stated, record: Path | None) -> Recording:
    table = _table(path)
    found = dict.fromkeys(m[1] for name in table.columns if (m := MARKER.fullmatch(name)))
    stems = [stem for stem in found if stem.lower() not in SEGMENTS]
    if not stems:
        raise ValueError("no markers: no column such as LASIS.PosX")
    markers = file_markers(stems, "m", partial(_positions, table, stems), stated, _gaps)
    numbers = dict.fromkeys(int(m[1]) for name in table.columns if (m := PLATE.fullmatch(name)))
    time = np.arange(len(table.values)) / table.rate_hz
    columns, plate_notes = plates_in_si(_plates(table, numbers, time), stated)
    to_lab, axes_notes = lab_axes(markers, [p.force for p in columns], stated, AXES, "D-Flow")
    plates, moment_notes = plates_about_origin(columns, to_lab)
    used = {f"{stem}.Pos{axis}" for stem in stems for axis in "XYZ"}
    used |= {f"FP{k}.{q}{axis}" for k in numbers for q in ("For", "Mom", "Cop") for axis in "XYZ"}
    analog = _analog(table, used, time)
    first_frame, stamps, table_notes = table.first_frame, table.stamps, table.notes
    del table  # as large as all that is read from it
    notes = [*axes_notes, *table_notes, *markers.notes]
    events: Mapping[str, tuple[float, ...]] = {}
    if record:
        signals = read_record(record)
        with naming(record):
            analog, events, clock_notes = on_clock(signals, record.name, stamps, time, analog)
        notes += [*signals.notes, *clock_notes]
    return Recording(
        source=path,
        markers=markers.in_lab(time, to_lab),
        plates=plates,
        analog=analog,
        first_frame=first_frame,
        metadata=Metadata(subject=markers.subject, software="D-Flow", dflow_events=events),
        stated=stated,
        notes=(*notes, *plate_notes, *moment_notes),
    )


def _table(path: Path) -> _Table:
    lines = lines_of(path)
    names = names_in(next(lines, "").rstrip(), "\t")
    for column in ("TimeStamp", "FrameNumber"):
        if column not in names:
            raise ValueError(f"not a D-Flow mocap file: its first line has no column {column}")
    if twice := sorted(name for name, count in Counter(names).items() if count > 1):
        raise ValueError(f"several columns have the same name: {listed(twice)}")
    values = parse_rows(((k, ln) for k, ln in enumerate(lines, start=2) if ln.strip()), "\t", names)
    columns = {name: k for k, name in enumerate(names)}
    frames, stamps = (values[:, columns[name]] for name in ("FrameNumber", "TimeStamp"))
    if len(frames) < 2:
        raise ValueError(f"it holds {len(frames)} frames, expected at least 2")
    if empty := np.count_nonzero(np.isnan(values).any(axis=1)):
        raise ValueError(f"{empty} rows have empty fields; D-Flow writes a number in every field")
    steps = np.diff(frames)
    if (frames % 1).any() or (steps < 0).any():
        raise ValueError("FrameNumber does not count upward; is this one recording?")
    new = np.concatenate([[True], steps > 0])
    frames, stamps = frames[new], stamps[new]
    index = (frames - frames[0]).astype(int)
    total = index[-1] + 1
    if len(frames) < 2 or total > MAX_DROPPED_RATIO * len(frames):
        raise ValueError(
            f"FrameNumber spans {total} frames, but the file holds {len(frames)} of them"
        )
    if total > len(frames) or not new.all():
        held, values = values[new], np.full((total, values.shape[1]), np.nan)
        values[index] = held
    rate, clock = _rate(index, stamps)
    notes = [*ending_notes(path), clock]
    if total > len(frames):
        notes.append(Note.of("frames_dropped", dropped=total - len(frames), frames=total))
    return _Table(
        columns=columns,
        values=values,
        stamps=values[:, columns["TimeStamp"]].copy(),
        first_frame=int(frames[0]),
        rate_hz=rate,
        notes=tuple(notes),
    )


def _rate(index: Array, stamps: Array) -> tuple[float, Note]:
    """Give the cameras' rate: the slope of the time stamps, or the customary rate next to it."""
    offset = index - index.mean()
    slope = float(offset @ stamps / (offset @ offset))
    if not MIN_FRAME_S < slope < MAX_FRAME_S:
        raise ValueError(
            f"its time stamps advance {slope:.3g} s per frame, expected seconds of a camera system"
        )
    nearest = float(CUSTOMARY_RATES_HZ[np.argmin(np.abs(CUSTOMARY_RATES_HZ * slope - 1))])
    rate = nearest if abs(nearest * slope - 1) < MAX_RATE_DIFFERENCE else 1 / slope
    scatter_s = float(np.ptp(stamps - index / rate))
    return rate, Note.of("frame_clock", rate_hz=rate, scatter_s=scatter_s)


def _positions(table: _Table, stems: Sequence[str], kept: Iterable[int]) -> Array:
    return table.vectors(f"{stems[k]}.Pos" for k in kept)


def _gaps(position: Array, names: Sequence[str]) -> list[Note]:
    """Make markers that no camera saw NaN, in place, and note how many."""
    zero = (position == 0).all(axis=-1)
    held = np.zeros_like(zero)
    for k in range(len(names)):  # one by one: a file may be as large as the memory allows
        held[1:, k] = (position[1:, k] == position[:-1, k]).all(axis=-1) & ~zero[1:, k]
    notes = []
    for unseen, code in ((zero, "markers_written_as_zero"), (held, "markers_held")):
        if unseen.any():
            position[unseen] = np.nan
            markers = [names[k] for k in np.flatnonzero(unseen.any(axis=0)).tolist()]
            notes.append(Note.of(code, samples=np.count_nonzero(unseen), markers=markers))
    return notes


def _plates(table: _Table, numbers: Iterable[int], time: Array) -> Iterator[PlateColumns | Note]:
    """Give the columns of each plate, or why it is left out."""
    for number in numbers:
        needed = [f"FP{number}.{quantity}{axis}" for quantity in ("For", "Mom") for axis in "XYZ"]
        if absent := [column for column in needed if column not in table.columns]:
            yield left_out(f"plate {number}", f"column {absent[0]} is absent")
            continue
        vectors = [f"FP{number}.{quantity}" for quantity in ("For", "Mom", "Cop")]
        vectors = vectors[: 3 if f"FP{number}.CopX" in table.columns else 2]
        values = (table.vectors([name])[:, 0] for name in vectors)
        yield PlateColumns(number, f"plate {number}", time, SI_UNITS, *values)


def _analog(table: _Table, used: set[str], time: Array) -> Analog | None:
    """Give all other columns as channels; where the body model failed, all of its are zero."""
    names = [n for n in table.columns if n not in used and n not in ("TimeStamp", "FrameNumber")]
    if not names:
        return None
    values = table.values[:, [table.columns[name] for name in names]]
    modelled = np.array([name.endswith((".Ang", ".Mom", ".Pow")) for name in names])
    if np.count_nonzero(modelled) > 1:
        failed = (values[:, modelled] == 0).all(axis=1)
        values[failed[:, None] & modelled] = np.nan
    units = [next((u for end, u in UNITS.items() if n.endswith(end)), "") for n in names]
    return Analog(time, tuple(names), tuple(units), values)
