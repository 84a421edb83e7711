"""TRC files: marker trajectories as text."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.axes import parse_axes, settle_axes
from pipeline.io.input_file import naming
from pipeline.io.labels import marker_columns
from pipeline.io.recording import Metadata, Recording
from pipeline.io.stated import Stated, as_stated
from pipeline.io.text_table import ending_notes, lines_of, names_in, parse_rows, read_number

MIN_RATE_HZ, MAX_RATE_HZ = 1.0, 100_000.0
"""Of cameras."""
MAX_TIME_ERROR: Final = 0.1
"""In frames: files round their times, but not by more than this beyond half of their last digit."""
ROUNDED: Final = 1e-6
"""Of a digit: closer to a whole one, a number has no further digits."""


@dataclass(frozen=True, slots=True)
class Trajectories:
    """Marker trajectories in SI units and the file's own axes and clock.

    Attributes
    ----------
    time
        Times, (T,) [s].
    names
        Marker labels, as wanted.
    position
        Positions in the file's axes, (T, M, 3) [m]; gaps are NaN.
    first_frame
        Number of the first frame.
    subject
        Prefix of the labels in the file, empty where they have none.
    notes
        On units, labels and how the file ends.
    """

    time: Array
    names: tuple[str, ...]
    position: Array
    first_frame: int
    subject: str
    notes: tuple[Note, ...]


def read_trc(path: str | Path, stated: Stated | str | None = None) -> Recording:
    """Read a TRC file.

    Parameters
    ----------
    path
        The file.
    stated
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`.

    Returns
    -------
    Recording
        Markers in lab axes; times start at 0 at the first frame.

    Raises
    ------
    ValueError
        The file is damaged or truncated, its unit is unknown or contradicts the markers' extent,
        or its axes cannot be inferred. One line.
    OSError
        The file cannot be opened.

    Examples
    --------
    >>> import hbm, numpy as np, pipeline
    >>> from pipeline.export.opensim_tables import write_trc
    >>> standing = np.tile([[0.1, 0.1, 1.0], [0.1, -0.1, 1.0], [0.1, 0.1, 0.0]], (50, 1, 1))
    >>> markers = hbm.Markers(np.arange(50) / 100, ("LASIS", "RASIS", "LMT2"), standing)
    >>> write_trc(markers, "pose.trc")
    >>> recording = pipeline.read_trc("pose.trc", "forward,left,up")
    >>> recording.markers.names
    ('LASIS', 'RASIS', 'LMT2')
    """
    path, stated = Path(path), as_stated(stated)
    found = read_trajectories(path, stated)
    with naming(path):
        axes, notes = settle_axes(
            stated.axes, found.position, found.names, marker_set=stated.marker_set
        )
    position = found.position @ parse_axes(axes).T
    return Recording(
        source=path,
        markers=Markers(found.time - found.time[0], found.names, position),
        first_frame=found.first_frame,
        metadata=Metadata(subject=found.subject),
        stated=stated,
        notes=(*notes, *found.notes),
    )


def read_trajectories(path: Path, stated: Stated) -> Trajectories:
    """Read a TRC file in its own axes.

    Parameters
    ----------
    path
        The file.
    stated
        What is stated about its labels and unit.

    Returns
    -------
    Trajectories
        Positions in metres; empty fields and points at exactly zero are gaps. Times are regular
        from the first one at the file's rate, since files round them.

    Raises
    ------
    ValueError
        The file is damaged or truncated, or its unit is unknown or contradicts the markers'
        extent. One line.
    OSError
        The file cannot be opened.
    """
    with naming(path):
        return _parse(list(lines_of(path)), stated, ending_notes(path))


def _parse(lines: list[str], stated: Stated, notes: tuple[Note, ...]) -> Trajectories:
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise ValueError("not a TRC file: it does not begin with 'PathFileType'")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    if missing := {"DataRate", "NumFrames", "NumMarkers", "Units"} - set(header):
        raise ValueError(f"its header does not say {listed(sorted(missing))}")
    metre, unit_notes = stated.marker_unit(header["Units"])
    names = tuple(filter(None, names_in(lines[3], "\t")[2:]))
    markers, subject, label_notes = marker_columns(names, stated)
    columns = ["Frame#", "Time", *(f"{name} {axis}" for name in names for axis in "XYZ")]
    rows = [(k, line) for k, line in enumerate(lines[5:], start=6) if line.strip()]
    if _stated(header, "NumMarkers") != len(names):
        count = short(header["NumMarkers"])
        raise ValueError(f"its header says NumMarkers {count}, but it holds {len(names)}")
    if _stated(header, "NumFrames") != len(rows):
        count = short(header["NumFrames"])
        notes = (*notes, Note.of("frame_count_differs", header=count, found=len(rows)))
    if not rows or not names:
        raise ValueError("it holds no frames")
    filled = ((k, _with_last_gaps(line, len(columns))) for k, line in rows)
    values = parse_rows(filled, "\t", columns)
    if not np.isfinite(values[:, :2]).all():
        raise ValueError("a frame has no number or no time")
    position = values[:, 2:].reshape(len(rows), len(names), 3) * metre
    time, time_notes = _regular(values[:, 1], _stated(header, "DataRate"))
    position[~np.isfinite(position).all(axis=-1) | ~position.any(axis=-1)] = np.nan
    position = position[:, list(markers.values())]
    stated.check_span(position, header["Units"])
    return Trajectories(
        time,
        tuple(markers),
        position,
        int(values[0, 0]),
        subject,
        (*notes, *time_notes, *unit_notes, *label_notes),
    )


def _regular(stated: Array, rate_hz: float) -> tuple[Array, tuple[Note, ...]]:
    """Give regular times [s] at a rate, as the stated ones are but for their rounding."""
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise ValueError(
            f"its header says {rate_hz:g} Hz, expected {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
        )
    after = np.arange(len(stated)) / rate_hz
    rounding = _rounding(stated, rate_hz)
    time: Array = (float(np.mean(stated - after)) if rounding else stated[0]) + after
    wrong = np.flatnonzero(~(np.abs(stated - time) < MAX_TIME_ERROR / rate_hz + 2 * rounding))
    if len(wrong):
        k = wrong[0]
        raise ValueError(
            f"its times are not the regular times of its rate of {rate_hz:g} Hz: frame {k + 1} of "
            f"{len(time)} is at {stated[k]:.6g} s, expected {time[k]:.6g} s; correct DataRate, or "
            "export the file again"
        )
    if not rounding:
        return time, ()
    return time, (Note.of("times_rounded", digit_s=2 * rounding, rate_hz=rate_hz),)


def _rounding(stated: Array, rate_hz: float) -> float:
    """Give half of the last digit of rounded times [s]; 0 where the steps have no more digits."""
    for unit in (0.01, 0.001):
        if np.abs(stated / unit - np.round(stated / unit)).max() < ROUNDED:
            step = 1 / rate_hz / unit
            return 0.0 if abs(step - round(step)) < ROUNDED else unit / 2
    return 0.0


def _stated(header: Mapping[str, str], key: str) -> float:
    return read_number(header[key], f"{key} in the header")


def _with_last_gaps(line: str, count: int) -> str:
    """Add the tabs that some programs leave out where a frame's last markers are missing."""
    missing = count - line.count("\t") - 1
    return line + "\t" * missing if missing > 0 and missing % 3 == 0 else line
