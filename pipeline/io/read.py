"""Read a recording of any format, recognised by the file's content and not by its name."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from pipeline.io.c3d.read import read_c3d
from pipeline.io.dflow import read_dflow
from pipeline.io.mox import ROOT, read_mox
from pipeline.io.nexus import read_nexus
from pipeline.io.nexus_blocks import is_nexus
from pipeline.io.opensim.trc import read_trc
from pipeline.io.opensim.trial import read_opensim_trial
from pipeline.io.recording import Recording
from pipeline.io.text_table import decoded

C3D_KEY: Final = 0x50
"""Second byte of every C3D file."""
HEAD_BYTES: Final = 65536
"""Read to recognise a format: the longest first line of D-Flow is shorter."""
MOX_ROOT_CHARACTERS: Final = 4096
"""The root of a .mox file is within them."""


def read_recording(
    path: str | Path,
    axes: str | None = None,
    forces: str | Path | None = None,
    *,
    record: str | Path | None = None,
    rename: Mapping[str, str] | None = None,
) -> Recording:
    """Read a trial of any known format.

    Parameters
    ----------
    path
        C3D, TRC, D-Flow mocap, Motek .mox or Vicon Nexus ASCII file, under whatever name.
    axes
        Lab directions of the file's axes, such as ``"left,back,up"``; by default inferred, or as
        the format defines them.
    forces
        MOT file with the ground reaction forces of a TRC file.
    record
        File of D-Flow's record module that goes with a D-Flow mocap file.
    rename
        Label in the file -> label wanted.

    Returns
    -------
    Recording
        In SI units and lab axes.

    Raises
    ------
    ValueError
        The content is of no known format, damaged, or needs another file beside it. One line.
    OSError
        A file cannot be opened.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> pipeline.read_recording("walk.c3d").markers.position.shape
    (800, 46, 3)
    """
    path = Path(path)
    kind = file_format(path)
    if forces is not None and kind != "TRC":
        raise ValueError(f"{path.name}: a file of forces goes with a TRC file, this is {kind}")
    if record is not None and kind != "D-Flow":
        raise ValueError(f"{path.name}: a record file goes with a D-Flow file, this is {kind}")
    if kind == "C3D":
        return read_c3d(path, axes, rename=rename)
    if kind == "D-Flow":
        return read_dflow(path, axes, record=record, rename=rename)
    if kind == "TRC" and forces is not None:
        return read_opensim_trial(path, forces, axes, rename=rename)
    reader = {"TRC": read_trc, "MOX": read_mox, "Nexus": read_nexus}[kind]
    return reader(path, axes, rename=rename)


def file_format(path: Path) -> str:
    """Recognise a file's format by its content.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        C3D, TRC, D-Flow, MOX or Nexus.

    Raises
    ------
    ValueError
        It is empty, of no format that is read, or holds forces or signals without markers.
    OSError
        The file cannot be opened.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if head[1:2] == bytes([C3D_KEY]) and not head[:1].isalpha():
        return "C3D"
    try:
        text = decoded(head[: len(head) // 2 * 2] if head[1:] else head)
    except ValueError as error:
        if "empty" in str(error):
            raise ValueError(f"{path.name}: {error}") from error
        text = ""
    lines = text.splitlines() or [""]
    first = [name.strip() for name in lines[0].split("\t")]
    if lines[0].startswith("PathFileType"):
        return "TRC"
    if ROOT in text[:MOX_ROOT_CHARACTERS]:
        return "MOX"
    if "FrameNumber" in first:
        return "D-Flow"
    if is_nexus(lines):
        return "Nexus"
    raise ValueError(f"{path.name}: {_why_not_read(lines, first)}")


def _why_not_read(lines: list[str], first: list[str]) -> str:
    if any(line.strip().lower() == "endheader" for line in lines):
        return "a MOT or STO table, which has no markers; give it beside a TRC file"
    if first[0] == "Time":
        return "a D-Flow record file, which has no markers; give it beside a D-Flow mocap file"
    return (
        "not a C3D file, nor TRC, D-Flow mocap text, Motek .mox or Vicon Nexus ASCII export, "
        "which are the formats that are read"
    )
