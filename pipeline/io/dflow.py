"""Text files of Motek D-Flow's mocap module, with or without one of its record module."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, rotate_wrench
from pipeline.io.axes import parse_axes, settle_axes
from pipeline.io.dflow_record import on_clock, read_record
from pipeline.io.labels import rename_markers
from pipeline.io.moment_reference import wrench_about_origin
from pipeline.io.recording import Analog, Metadata, Plate, Recording
from pipeline.io.text_table import parse_rows, read_lines
from pipeline.io.units import check_span

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
class _Table:
    """One mocap file on the cameras' clock: dropped frames are rows of NaN."""

    names: tuple[str, ...]
    values: Array
    stamps: Array
    first_frame: int
    rate_hz: float
    notes: tuple[Note, ...]

    def vector(self, stem: str) -> Array:
        wanted = [f"{stem}{axis}" for axis in "XYZ"]
        if absent := [name for name in wanted if name not in self.names]:
            raise ValueError(f"column {absent[0]} is absent, but others of {stem} are there")
        return self.values[:, [self.names.index(name) for name in wanted]]


def read_dflow(
    path: str | Path,
    axes: str | None = None,
    *,
    record: str | Path | None = None,
    rename: Mapping[str, str] | None = None,
    missing: Literal["auto", "held", "zero"] = "auto",
) -> Recording:
    """Read a file of D-Flow's mocap module, and one of its record module beside it.

    Parameters
    ----------
    path
        The mocap file (.txt).
    axes
        Lab directions of the file's x, y and z axis; by default D-Flow's, "right,up,back". Up is
        checked against markers and plates.
    record
        A record file of the same session: its signals become analog channels on the cameras'
        clock, its events ``metadata.dflow_events``.
    rename
        Label in the file -> label wanted.
    missing
        How this version of D-Flow writes a marker that no camera sees: "held" at its last place
        (before 3.16.2) or "zero"; by default both are gaps.

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
    A marker at exactly the same place, to the micrometre, as in the frame before was not seen:
    noise never repeats itself in three coordinates. Force is taken as acting on the subject, and
    moments as about the common origin of plates and cameras; `wrench_about_origin` checks this
    against the centres of pressure and takes another point where they demand it.
    """
    path = Path(path)
    try:
        return _read(path, axes, Path(record) if record else None, rename or {}, missing)
    except ValueError as error:
        named = any(str(error).startswith(f"{p.name}: ") for p in (Path(record or path), path))
        raise error if named else ValueError(f"{path.name}: {error}") from error


def _read(
    path: Path, axes: str | None, record: Path | None, rename: Mapping[str, str], missing: str
) -> Recording:
    table = _table(path)
    stems = dict.fromkeys(m[1] for name in table.names if (m := MARKER.fullmatch(name)))
    stems = {stem: None for stem in stems if stem.lower() not in SEGMENTS}
    if not stems:
        raise ValueError("no markers: no column such as LASIS.PosX")
    position = np.stack([table.vector(f"{stem}.Pos") for stem in stems], 1)
    gaps = _gaps(position, list(stems), missing)
    check_span(position, "m")
    plates = dict.fromkeys(int(m[1]) for name in table.names if (m := PLATE.fullmatch(name)))
    forces = [table.vector(f"FP{k}.For") for k in plates]
    names = tuple(rename_markers(dict.fromkeys(stems, 0), rename))
    loads = [np.nan_to_num(force).mean(axis=0) for force in forces]
    settled, axes_notes = settle_axes(axes or AXES, position, names, plate_forces=loads)
    if axes is None:
        default = Note.of("axes_of_format", axes=AXES.split(","), program="D-Flow")
        axes_notes = (default, *axes_notes[1:])
    to_lab = parse_axes(settled)
    time = np.arange(len(position)) / table.rate_hz
    placed = [_plate(table, k, time, to_lab) for k in plates]
    used = {f"{stem}.Pos{axis}" for stem in stems for axis in "XYZ"}
    used |= {f"FP{k}.{q}{axis}" for k in plates for q in ("For", "Mom", "Cop") for axis in "XYZ"}
    analog = _analog(table, used, time)
    notes = [*axes_notes, *table.notes, *gaps]
    events: Mapping[str, tuple[float, ...]] = {}
    if record:
        signals = read_record(record)
        analog, events, note = on_clock(signals, record.name, table.stamps, time, analog)
        notes.append(note)
    return Recording(
        source=path,
        markers=Markers(time, names, position @ to_lab.T),
        plates=tuple(plate for plate, _ in placed),
        analog=analog,
        first_frame=table.first_frame,
        metadata=Metadata(software="D-Flow", dflow_events=events),
        notes=(*notes, *(note for _, note in placed)),
    )


def _table(path: Path) -> _Table:
    lines = read_lines(path)
    names = [name.strip() for name in lines[0].rstrip().split("\t")]
    for column in ("TimeStamp", "FrameNumber"):
        if column not in names:
            raise ValueError(f"not a D-Flow mocap file: its first line has no column {column}")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"several columns have the same name: {', '.join(twice)}")
    rows = [(k, line) for k, line in enumerate(lines[1:], start=2) if line.strip()]
    values = parse_rows([line for _, line in rows], "\t", names, [k for k, _ in rows])
    frames, stamps = (values[:, names.index(name)] for name in ("FrameNumber", "TimeStamp"))
    if len(frames) < 2:
        raise ValueError(f"it holds {len(frames)} frames, expected at least 2")
    if empty := np.count_nonzero(np.isnan(values).any(axis=1)):
        raise ValueError(f"{empty} rows have empty fields; D-Flow writes a number in every field")
    steps = np.diff(frames)
    if (frames % 1).any() or (steps < 0).any():
        raise ValueError("FrameNumber does not count upward; is this one recording?")
    new = np.concatenate([[True], steps > 0])
    frames, stamps, values = frames[new], stamps[new], values[new]
    index = (frames - frames[0]).astype(int)
    total = index[-1] + 1
    if len(frames) < 2 or total > MAX_DROPPED_RATIO * len(frames):
        raise ValueError(
            f"FrameNumber spans {total} frames, but the file holds {len(frames)} of them"
        )
    full = np.full((total, values.shape[1]), np.nan)
    full[index] = values
    rate, clock = _rate(index, stamps)
    notes = [clock]
    if not new.all():
        notes.append(Note.of("rows_repeated", rows=np.count_nonzero(~new)))
    if total > len(frames):
        notes.append(Note.of("frames_dropped", dropped=total - len(frames), frames=total))
    return _Table(
        names=tuple(names),
        values=full,
        stamps=full[:, names.index("TimeStamp")],
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


def _gaps(position: Array, names: Sequence[str], missing: str) -> list[Note]:
    """Make markers that no camera saw NaN, in place, and note how many."""
    zero = (position == 0).all(axis=-1)
    held = np.zeros_like(zero)
    held[1:] = (np.diff(position, axis=0) == 0).all(axis=-1) & ~zero[1:]
    notes = []
    for kind, unseen, code in (
        ("zero", zero, "markers_written_as_zero"),
        ("held", held, "markers_held"),
    ):
        if missing in ("auto", kind) and unseen.any():
            position[unseen] = np.nan
            with_gaps = unseen.any(axis=0)
            markers = [name for name, gap in zip(names, with_gaps, strict=True) if gap]
            notes.append(Note.of(code, samples=np.count_nonzero(unseen), markers=markers))
    return notes


def _plate(table: _Table, number: int, time: Array, to_lab: Array) -> tuple[Plate, Note]:
    force, moment = (table.vector(f"FP{number}.{quantity}") for quantity in ("For", "Mom"))
    has_pressure = f"FP{number}.CopX" in table.names
    wrench, note = wrench_about_origin(
        force,
        moment,
        table.vector(f"FP{number}.Cop") if has_pressure else None,
        to_lab[2],
        f"plate {number}",
    )
    return Plate.at_origin(number, time, rotate_wrench(wrench, to_lab)), note


def _analog(table: _Table, used: set[str], time: Array) -> Analog | None:
    """Give all other columns as channels; where the body model failed, all of its are zero."""
    rest = [k for k, n in enumerate(table.names) if n not in used | {"TimeStamp", "FrameNumber"}]
    if not rest:
        return None
    names = [table.names[k] for k in rest]
    values = table.values[:, rest]
    modelled = np.array([name.endswith((".Ang", ".Mom", ".Pow")) for name in names])
    if np.count_nonzero(modelled) > 1:
        failed = (values[:, modelled] == 0).all(axis=1)
        values[failed[:, None] & modelled] = np.nan
    units = [next((u for end, u in UNITS.items() if n.endswith(end)), "") for n in names]
    return Analog(time, tuple(names), tuple(units), values)
