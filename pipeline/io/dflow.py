"""Text files of Motek D-Flow's mocap module, with or without one of its record module."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array, Indices
from hbm.spelling import short
from pipeline.io.columns import DFLOW_PLATE, dflow_plates, file_markers, recording_of, vectors
from pipeline.io.input_file import naming
from pipeline.io.labels import require_unique, told_apart
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Analog, Fact, Recording
from pipeline.io.text_table import MAX_RATE_HZ, MIN_RATE_HZ, labels_in, read_table

SEGMENTS: Final = {
    *("pelvis", "thorax", "spine", "pelvislegs", "toes", "head"),
    *(f"{side}{name}" for side in "lr" for name in ("femur", "tibia", "foot", "toes")),
    *(f"{side}{name}" for side in "lr" for name in ("humerus", "forearm", "hand", "clavicle")),
}
"""Columns of D-Flow's body model that are named as markers are."""
MARKER: Final = re.compile(r"(.+)\.Pos[XYZ]")


def read_record(path: Path) -> tuple[Analog, list[Note | Fact]]:
    """Read a file of D-Flow's record module on its own clock, without its events.

    A ValueError where it is damaged.
    """
    with naming(path):
        table = read_table(path)
        (_, header), *rows = table.rows
        table.rows = [row for row in rows if row[1].lstrip()[:1] != "#"]
        names = labels_in(header, table.width)
        if names[0] != "Time":
            raise ValueError(f"not a D-Flow record file: its first column is {short(names[0])!r}")
        values = table.numbers(names)
        time = values[:, 0]
        if len(time) < 2 or not (np.diff(time) >= 0).all():
            raise ValueError(f"its {len(time)} rows are not two or more with increasing times")
        units = ("",) * len(names[1:])
        return Analog(time, tuple(names[1:]), units, values[:, 1:]), table.remarks


def on_clock(
    record: Analog,
    name: str,
    stamps: Array,
    time: Array,
    analog: Analog,
    remarks: list[Note | Fact],
) -> Analog:
    """Bring a record onto the cameras' clock.

    Parameters
    ----------
    record
        Signals on D-Flow's clock.
    name
        Its file's name, for the note.
    stamps
        D-Flow's time stamp of each camera frame, (T,) [s]; NaN where the frame was dropped.
    time
        The frames' times on the recording's clock, (T,) [s].
    analog
        Channels that are already on that clock, which the record's follow.
    remarks
        Becomes longer by the note ``record_short`` where the record covers less than nine tenths of
        the frames.

    Returns
    -------
    Analog
        All channels; NaN outside the record.

    Raises
    ------
    ValueError
        The two do not overlap in time, or a signal has the name of a channel.

    Notes
    -----
    Time stamps scatter and bunch up when D-Flow lags, so the clocks are related by a straight line
    through all of them, not frame by frame.
    """
    # stamp = start + rate · time, in D-Flow's seconds
    is_known = np.isfinite(stamps)
    rate, start = np.polyfit(time[is_known] - time[is_known].mean(), stamps[is_known], 1)
    start = float(np.median(stamps[is_known] - rate * time[is_known]))
    clock = (record.time - start) / rate
    if clock[-1] < time[0] or clock[0] > time[-1]:
        raise ValueError(
            f"its times {record.time[0]:.2f}–{record.time[-1]:.2f} s do not overlap the "
            f"markers' {start:.2f}–{start + rate * time[-1]:.2f} s; is it of the same trial?"
        )
    names = [*analog.names, *record.names]
    require_unique(names, "signals named like the mocap file's")
    at_frames = [np.interp(time, clock, signal, np.nan, np.nan) for signal in record.values.T]
    first_s, last_s = np.clip(clock[[0, -1]], time[0], time[-1])
    # both modules are started and stopped by hand, some frames apart
    if last_s - first_s < 0.9 * np.ptp(time):
        remarks.append(Note.of("record_short", file=name, first_s=first_s, last_s=last_s))
    values = np.column_stack([analog.values, *at_frames])
    return Analog(time, tuple(names), analog.units + record.units, values)


def read_dflow(path: Path, options: ReadOptions, record: Path | None = None) -> Recording:
    """Read a file of D-Flow's mocap module, and one of its record module beside it.

    Parameters
    ----------
    path
        The mocap file (.txt).
    options
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`. Axes are by default
        D-Flow's, "right,up,back", units m, N and N·m.
    record
        A record file of the same session: its signals become analog channels on the cameras'
        clock.

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
    columns, first_frame, rate_hz, remarks = _columns(path)
    matches = filter(None, map(MARKER.fullmatch, columns))
    stems = [s for s in dict.fromkeys(m[1] for m in matches) if s.lower() not in SEGMENTS]
    if not stems:
        raise ValueError("no markers: no column such as LASIS.PosX")
    stamps = columns["TimeStamp"]
    time = np.arange(len(stamps)) / rate_hz
    markers = file_markers(
        stems,
        "m",
        lambda kept: vectors(columns, (f"{stems[k]}.Pos" for k in kept)),
        options,
        held=True,
    )
    plates = list(dflow_plates(columns, time))
    used = {f"{stem}.Pos{axis}" for stem in stems for axis in "XYZ"}
    used |= {name for name in columns if DFLOW_PLATE.fullmatch(name)}
    analog = _analog(columns, used, time)
    if record:
        signals, of_record = read_record(record)
        with naming(record):
            analog = on_clock(signals, record.name, stamps, time, analog, remarks)
        remarks += of_record
    del stamps
    columns.clear()  # as large as all that is read from it
    return recording_of(
        path,
        options,
        markers,
        time,
        plates,
        axes="right,up,back",
        program="D-Flow",
        notes=remarks,
        analog=analog if analog.names else None,
        first_frame=first_frame,
    )


def _columns(path: Path) -> tuple[dict[str, Array], int, float, list[Note | Fact]]:
    """Give columns at all frames, of which dropped ones are NaN, first frame, and rate [Hz]."""
    table = read_table(path)
    (_, header), *table.rows = table.rows
    names = labels_in(header, table.width)
    if not {"TimeStamp", "FrameNumber"} <= {*names}:
        raise ValueError("not a D-Flow mocap file: no column TimeStamp or no column FrameNumber")
    values = table.numbers(names)
    numbered = names.index("FrameNumber")
    new = np.diff(values[:, numbered], prepend=-1.0) != 0
    table.rows = [row for row, is_new in zip(table.rows, new, strict=True) if is_new]
    frames, values = table.regular(values[new], numbered, 1.0, "FrameNumber")
    stamps = values[:, names.index("TimeStamp")]
    index = np.flatnonzero(np.isfinite(stamps))
    rate_hz = _rate_hz(index, stamps[index])
    scatter_s = np.ptp(stamps[index] - index / rate_hz)
    table.remarks.append(Note.of("sample_clock", of="frames", rate_hz=rate_hz, scatter_s=scatter_s))
    columns = table.distinct(told_apart(names, MARKER), values)
    return columns, int(frames[0]), rate_hz, table.remarks


def _rate_hz(index: Indices, stamps: Array) -> float:
    """Give the cameras' rate: the slope of the time stamps, or the customary rate next to it."""
    slope = float(np.polyfit(index, stamps, 1)[0])
    if not 1 / MAX_RATE_HZ < slope < 1 / MIN_RATE_HZ:
        raise ValueError(f"its time stamps advance {slope:.3g} s per frame, expected 1e-5 to 1 s")
    customary = [30, 50, 60, 100, 120, 125, 128, 150, 200, 240, 250, 256, 300, 400, 500, 1000]
    nearest = min(map(float, customary), key=lambda rate_hz: abs(rate_hz * slope - 1))
    # the slope of time stamps that lag is a customary rate to 2 %
    return nearest if abs(nearest * slope - 1) < 0.02 else 1 / slope


def _analog(columns: Mapping[str, Array], used: set[str], time: Array) -> Analog:
    """Give all other columns as channels; where the body model failed, all of its are zero."""
    names = [n for n in columns if n not in used and n not in ("TimeStamp", "FrameNumber")]
    values = np.reshape([columns[name] for name in names], (len(names), len(time))).T
    modelled = np.array([name.endswith((".Ang", ".Mom", ".Pow")) for name in names])
    if np.count_nonzero(modelled) > 1:
        values[(values[:, modelled] == 0).all(axis=1)[:, None] & modelled] = np.nan
    by_ending = {".Anlg": "V", ".Ang": "deg", ".Mom": "N·m", ".Pow": "W"}
    units = [next((u for end, u in by_ending.items() if n.endswith(end)), "") for n in names]
    return Analog(time, tuple(names), tuple(units), values)
