"""Read a recording of any format, recognised by its content and not by its name."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from pipeline.io.axes import AxesUnknownError
from pipeline.io.c3d.data import KEY
from pipeline.io.c3d.read import read_c3d_file
from pipeline.io.dflow import read_dflow
from pipeline.io.input_file import RENAME, UNUSABLE, naming, open_file
from pipeline.io.mended_plates import with_mended_plates
from pipeline.io.mox import ROOT, read_mox
from pipeline.io.nexus import is_nexus, read_nexus
from pipeline.io.opensim import is_cortex, read_trc
from pipeline.io.qualisys import read_qualisys
from pipeline.io.read_options import ReadOptions, as_stated
from pipeline.io.recording import Recording
from pipeline.io.text_table import EMPTY, decoded
from pipeline.io.write import PART
from pipeline.io.xdf import MAGIC, read_xdf

READERS: Final[dict[str, Callable[..., Recording]]] = {
    "C3D": read_c3d_file,
    "TRC": read_trc,
    "D-Flow": read_dflow,
    "MOX": read_mox,
    "Nexus": read_nexus,
    "Qualisys": read_qualisys,
    "XDF": read_xdf,
}
"""What reads each format, given path, what is stated, and a file of forces or record beside it."""
FORCES_BESIDE: Final = ("TRC", "Qualisys")
"""Formats whose forces are in a file of their own."""


def read_recording(
    path: str | Path,
    options: ReadOptions | str | None = None,
    forces: str | Path | None = None,
    *,
    record: str | Path | None = None,
    static: Path | None = None,
) -> Recording:
    """Read a trial of any known format.

    Parameters
    ----------
    path
        C3D, TRC, D-Flow mocap, Motek .mox, Vicon Nexus ASCII, Qualisys TSV or XDF file, under
        whatever name.
    options
        What is stated about it: axes, units, labels. A text states the axes alone, such as
        ``"left,back,up"``; by default they are inferred, or as the format defines them.
    forces
        MOT or .forces file with the ground reaction forces of a TRC file, or one of the files of
        forces of a Qualisys export, if they do not lie beside it.
    record
        File of D-Flow's record module that goes with a D-Flow mocap file.
    static
        A static recording of the same laboratory, in the same format: its axes hold where those of
        the trial cannot be inferred.

    Returns
    -------
    Recording
        In SI units and lab axes.

    Raises
    ------
    ValueError
        The content is of no known format, damaged, or needs another file beside it; it contradicts
        what is stated. One line.
    OSError
        A file cannot be opened.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> pipeline.read_recording("walk.c3d").markers.position.shape
    (800, 46, 3)
    """
    path, options = Path(path), as_stated(options)
    kind = file_format(path)
    with naming(path):
        if forces is not None and kind not in FORCES_BESIDE:
            raise ValueError(f"a file of forces goes with a TRC or Qualisys file, this is {kind}")
        if record is not None and kind != "D-Flow":
            raise ValueError(f"a record file goes with a D-Flow file, this is {kind}")
        files = [Path(file) for file in (forces, record) if file is not None]
        try:
            return with_mended_plates(READERS[kind](path, options.of_file(path.name), *files))
        except AxesUnknownError:
            if static is None or file_format(static) != kind:
                raise
        with naming(static):
            axes = READERS[kind](static, options.of_file(static.name)).axes
        by = f"as in the static recording {static.name}; this recording does not show them itself"
        there = replace(options.of_file(path.name), axes=",".join(axes), axes_by=by)
        return with_mended_plates(READERS[kind](path, there, *files))


def file_format(path: Path) -> str:
    """Recognise a file's format by its content.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        C3D, TRC, D-Flow, MOX, Nexus, Qualisys or XDF.

    Raises
    ------
    ValueError
        It is empty, of no format that is read, or holds forces or signals without markers.
    OSError
        The file cannot be opened.
    """
    with open_file(path) as file, naming(path):
        if UNUSABLE.search(path.name):
            raise ValueError(RENAME)
        if path.name.startswith(".") and path.suffix == PART:
            raise ValueError("a part of a file whose writing was stopped; delete it")
        return _format(file.read(65536))  # the longest first line of D-Flow is shorter


def is_recording(path: Path) -> bool:
    """Whether the beginning of a file is that of a recording."""
    with suppress(ValueError, OSError):
        return bool(file_format(path))
    return False


def read_with_any_axes(path: Path) -> Recording:
    """Read a recording whose axes may be unknown: of an empty treadmill, or somebody who turns."""
    try:
        return read_recording(path)
    except ValueError:
        return read_recording(path, "forward,left,up")


def _format(head: bytes) -> str:
    if head[1:2] == bytes([KEY]) and not head[:1].isalpha() and not head.startswith(b'"Path'):
        return "C3D"
    if head.startswith(MAGIC):
        return "XDF"
    try:
        text = decoded(head[: len(head) // 2 * 2] if head[1:] else head)
    except ValueError as error:
        if str(error) == EMPTY:
            raise
        text = ""
    lines = text.splitlines() or [""]
    first = [name.strip() for name in lines[0].split("\t")]
    # the keys of a Qualisys file, of which each event has one, are within a hundred lines
    firsts = {line.split("\t")[0].strip('"') for line in lines[:100]}
    kinds = {
        "TRC": lines[0].strip('"').startswith("PathFileType"),
        "Qualisys": "MARKER_NAMES" in firsts,
        "MOX": ROOT in text[:4096],
        "D-Flow": "FrameNumber" in first,
        "Nexus": is_nexus(lines),
    }
    if any(kinds.values()):
        return next(kind for kind, shown in kinds.items() if shown)
    endings = {line.strip().lower() for line in lines}
    without_markers = {
        ("forces of Qualisys", "the trajectories' file"): "FORCE_PLATE_NAME" in firsts,
        ("a .forces file of Cortex", "it with a TRC file"): is_cortex(lines[0]),
        ("a MOT or STO table", "it with a TRC file"): "endheader" in endings,
        ("a D-Flow record file", "it with a D-Flow mocap file"): first[0] == "Time",
    }
    for (what, remedy), shown in without_markers.items():
        if shown:
            raise ValueError(f"{what}, which has no markers; give {remedy}")
    raise ValueError(
        "not a C3D file, nor TRC, D-Flow mocap text, Motek .mox, Vicon Nexus ASCII export, "
        "Qualisys TSV or XDF, which are the formats that are read"
    )
