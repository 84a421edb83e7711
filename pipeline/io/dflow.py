"""Text files of Motek D-Flow's mocap module, with or without one of its record module."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import short
from pipeline.io.columns import (
    FileMarkers,
    PlateColumns,
    file_markers,
    left_out,
    recording_of,
)
from pipeline.io.input_file import naming
from pipeline.io.labels import require_unique
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

Events = dict[str, tuple[float, ...]]
"""Letter -> times [s]."""


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
        ``cut_short`` where the file ends within a line, or the counts of events are missing that
        D-Flow writes last.
    """

    time: Array
    names: tuple[str, ...]
    values: Array
    events: Events
    notes: list[Note]


def read_record(path: str | Path) -> Record:
    """Read a file of D-Flow's record module; a ValueError where it is damaged."""
    path = Path(path)
    with naming(path):
        return _record(path)


def _record(path: Path) -> Record:
    lines = lines_of(path)
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
    time = values[:, 0]
    if len(values) < 2 or not (np.diff(time) >= 0).all():
        raise ValueError(f"its {len(values)} rows are not two or more with increasing times")
    counts = Counter(name for name, _ in marks)
    for name, stated in totals.items():
        if counts[name] != stated:
            raise ValueError(f"it counts {stated} events {name} but holds {counts[name]}")
    notes = ending_notes(path)
    if set(counts) - set(totals):
        notes.append(Note.of("cut_short", file=path.name, sign="its events are not counted"))
    events: Events = {}
    for name, row in marks:
        around = time[max(row - 1, 0) : row + 1]
        events[name] = (*events.get(name, ()), float(around.mean()))
    return Record(time, tuple(names[1:]), values[:, 1:], events, notes)


def on_clock(
    record: Record, name: str, stamps: Array, time: Array, analog: Analog | None
) -> tuple[Analog, Events, list[Note]]:
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
        On the recording's clock.
    notes
        ``record_short`` where the record covers less than nine tenths of the frames.

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
    names = known.names + record.names
    require_unique(names, "signals named like the mocap file's")
    signals = [np.interp(time, clock, values, np.nan, np.nan) for values in record.values.T]
    units = known.units + ("",) * len(record.names)
    both = Analog(time, names, units, np.column_stack([known.values, *signals]))
    events = {
        letter: tuple((at - start) / float(rate) for at in times)
        for letter, times in record.events.items()
    }
    covered = np.clip(clock[[0, -1]], time[0], time[-1])
    notes = []
    if np.ptp(covered) < MIN_COVERED * np.ptp(time):
        notes.append(Note.of("record_short", file=name, first_s=covered[0], last_s=covered[1]))
    return both, events, notes


@dataclass(frozen=True, slots=True)
class _Table:
    """One mocap file on the cameras' clock: dropped frames are rows of NaN."""

    columns: Mapping[str, int]
    values: Array
    first_frame: int
    rate_hz: float
    notes: list[Note]

    def vectors(self, stems: Iterable[str]) -> Array:
        """Give the three columns of each of several quantities, (T, stems, 3)."""
        wanted = [f"{stem}{axis}" for stem in stems for axis in "XYZ"]
        if absent := [name for name in wanted if name not in self.columns]:
            raise ValueError(f"column {short(absent[0])} is absent, but others of it are there")
        columns = [self.columns[name] for name in wanted]
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
    markers, plates, time, stamps, attributes = _columns(path, stated)
    events: Events = {}
    if record:
        signals = read_record(record)
        with naming(record):
            analog = attributes["analog"]
            attributes["analog"], events, notes = on_clock(
                signals, record.name, stamps, time, analog
            )
        attributes["notes"] += [*signals.notes, *notes]
    metadata = Metadata(subject=markers.subject, software="D-Flow", dflow_events=events)
    return recording_of(
        path,
        stated,
        markers,
        time,
        plates,
        axes=AXES,
        program="D-Flow",
        metadata=metadata,
        **attributes,
    )


def _columns(
    path: Path, stated: Stated
) -> tuple[FileMarkers, list[PlateColumns | Note], Array, Array, dict[str, Any]]:
    """Give markers, plates, the frames' times and time stamps, (T,) [s], and the rest."""
    table = _table(path)
    found = dict.fromkeys(m[1] for name in table.columns if (m := MARKER.fullmatch(name)))
    stems = [stem for stem in found if stem.lower() not in SEGMENTS]
    if not stems:
        raise ValueError("no markers: no column such as LASIS.PosX")
    time = np.arange(len(table.values)) / table.rate_hz
    unseen = 0

    def positions(kept: Iterable[int]) -> Array:
        nonlocal unseen
        position = table.vectors(f"{stems[k]}.Pos" for k in kept)
        unseen = _remove_unseen(position)
        return position

    markers = file_markers(stems, "m", positions, stated)
    numbers = dict.fromkeys(int(m[1]) for name in table.columns if (m := PLATE.fullmatch(name)))
    used = {f"{stem}.Pos{axis}" for stem in stems for axis in "XYZ"}
    used |= {f"FP{k}.{q}{axis}" for k in numbers for q in ("For", "Mom", "Cop") for axis in "XYZ"}
    attributes = {
        "analog": _analog(table, used, time),
        "first_frame": table.first_frame,
        "notes": [*table.notes, *[Note.of("markers_unseen", samples=unseen)] * (unseen > 0)],
    }
    stamps = table.values[:, table.columns["TimeStamp"]].copy()
    return markers, [_plate(table, k, time) for k in numbers], time, stamps, attributes


def _table(path: Path) -> _Table:
    lines = lines_of(path)
    names = names_in(next(lines, "").rstrip(), "\t")
    if not {"TimeStamp", "FrameNumber"} <= {*names}:
        raise ValueError("not a D-Flow mocap file: no column TimeStamp or no column FrameNumber")
    require_unique(names, "several columns have the same name")
    values = parse_rows(((k, ln) for k, ln in enumerate(lines, start=2) if ln.strip()), "\t", names)
    columns = {name: k for k, name in enumerate(names)}
    if empty := np.count_nonzero(np.isnan(values).any(axis=1)):
        raise ValueError(f"{empty} rows have empty fields; D-Flow writes a number in every field")
    frames = values[:, columns["FrameNumber"]]
    steps = np.diff(frames, prepend=frames[:1] - 1)
    if (frames % 1).any() or (steps < 0).any():
        raise ValueError("FrameNumber does not count upward; is this one recording?")
    new = steps > 0
    index = (frames[new] - frames[:1]).astype(int)
    total = index[-1] + 1 if len(index) else 0
    if len(index) < 2 or total > MAX_DROPPED_RATIO * len(index):
        raise ValueError(
            f"FrameNumber spans {total} frames, but the file holds {len(index)} of them, expected "
            "at least 2 and half of all"
        )
    first_frame = int(frames[0])
    stamps = values[new, columns["TimeStamp"]]
    if total > len(index) or not new.all():
        held, values = values[new], np.full((total, values.shape[1]), np.nan)
        values[index] = held
    rate_hz = _rate_hz(index, stamps)
    scatter_s = np.ptp(stamps - index / rate_hz)
    notes = ending_notes(path)
    notes.append(Note.of("sample_clock", of="frames", rate_hz=rate_hz, scatter_s=scatter_s))
    if dropped := total - len(index):
        notes.append(Note.of("samples_dropped", of="frames", dropped=dropped, samples=total))
    return _Table(columns, values, first_frame, rate_hz, notes)


def _rate_hz(index: Array, stamps: Array) -> float:
    """Give the cameras' rate: the slope of the time stamps, or the customary rate next to it."""
    offset = index - index.mean()
    slope = float(offset @ stamps / (offset @ offset))
    if not MIN_FRAME_S < slope < MAX_FRAME_S:
        raise ValueError(
            f"its time stamps advance {slope:.3g} s per frame, expected seconds of a camera system"
        )
    nearest = float(CUSTOMARY_RATES_HZ[np.argmin(np.abs(CUSTOMARY_RATES_HZ * slope - 1))])
    return nearest if abs(nearest * slope - 1) < MAX_RATE_DIFFERENCE else 1 / slope


def _remove_unseen(position: Array) -> int:
    """Make markers that are at zero or held in place NaN, (T, M, 3), and count the samples."""
    unseen = np.asarray(~position.any(axis=-1))
    for k in range(position.shape[1]):  # one by one: a file may be as large as the memory allows
        unseen[1:, k] |= (position[1:, k] == position[:-1, k]).all(axis=-1)
    position[unseen] = np.nan
    return int(np.count_nonzero(unseen))


def _plate(table: _Table, number: int, time: Array) -> PlateColumns | Note:
    """Give the columns of a plate, or why it is left out."""
    needed = [f"FP{number}.{quantity}{axis}" for quantity in ("For", "Mom") for axis in "XYZ"]
    if absent := [column for column in needed if column not in table.columns]:
        return left_out(f"plate {number}", f"column {absent[0]} is absent")
    quantities = ("For", "Mom", "Cop")[: 3 if f"FP{number}.CopX" in table.columns else 2]
    vectors = (table.vectors([f"FP{number}.{quantity}"])[:, 0] for quantity in quantities)
    return PlateColumns(number, f"plate {number}", time, *vectors)


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
