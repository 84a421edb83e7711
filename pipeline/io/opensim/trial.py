"""Trials in OpenSim's formats: markers in a TRC file, ground reaction forces in a MOT file."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, rotate_wrench
from pipeline.io.axes import parse_axes, settle_axes
from pipeline.io.labels import rename_markers
from pipeline.io.opensim.sto import Table, read_mot
from pipeline.io.opensim.trc import read_trajectories
from pipeline.io.recording import Plate, Recording

MAX_ROUNDING: Final = 0.05
"""In steps: times printed with few digits differ from even ones by less."""
FORCE_COLUMN: Final = re.compile(r"(?P<stem>.*force.*)_v(?P<axis>[xyz])")


def read_opensim_trial(
    trc: str | Path,
    grf_mot: str | Path,
    axes: str | None = None,
    *,
    rename: Mapping[str, str] | None = None,
) -> Recording:
    """Read markers from a TRC file and ground reaction forces from a MOT file.

    Parameters
    ----------
    trc
        Marker trajectories.
    grf_mot
        Forces, points of application and torques in OpenSim's naming, N, m and N·m, on the same
        clock and in the same axes as the markers.
    axes
        Lab directions of the files' x, y and z axis, such as ``"forward,up,right"``; up is checked
        against markers and forces. Where absent they are inferred, and the notes state them.
    rename
        Label in the TRC file -> label wanted.

    Returns
    -------
    Recording
        Times start at 0 at the first frame of the TRC file. Each force is a plate with identity
        rotation and centre at the lab origin, so that its wrench in the plate is the wrench about
        the lab origin; its corners are unknown (NaN).

    Raises
    ------
    ValueError
        As `read_trc` and `read_mot`, or the table names no forces. One line.
    OSError
        A file cannot be opened.

    Notes
    -----
    Moment about the origin of force f at point p with torque t: p × f + t. Where a force is exactly
    zero its point has no meaning and is not used. MOT files often print times with so few digits
    that the steps look uneven; force times within a twentieth of a step of even ones become even.

    Examples
    --------
    >>> import numpy as np, pipeline
    >>> from pipeline.export.opensim_tables import write_external_loads, write_trc
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> walk = simulate_trial("walk.c3d", duration_s=8.0)
    >>> write_trc(pipeline.read_c3d("walk.c3d").markers, "walk.trc")
    >>> feet = {"left_foot": walk.left, "right_foot": walk.right}
    >>> write_external_loads(walk.time, feet, "walk_grf.mot")
    >>> recording = pipeline.read_opensim_trial("walk.trc", "walk_grf.mot")
    >>> len(recording.plates)
    2
    """
    trc, grf_mot = Path(trc), Path(grf_mot)
    found, table = read_trajectories(trc), read_mot(grf_mot)
    wrenches = _wrenches(table, grf_mot.name)
    try:
        names = tuple(rename_markers(dict.fromkeys(found.names, 0), rename or {}))
        axes, axes_notes = settle_axes(
            axes,
            found.position,
            names,
            plate_forces=[np.nan_to_num(w[:, :3]).mean(axis=0) for w in wrenches.values()],
        )
        to_lab = parse_axes(axes)
        markers = Markers(found.time - found.time[0], names, found.position @ to_lab.T)
    except ValueError as error:
        raise ValueError(f"{trc.name}: {error}") from error
    plates = tuple(
        Plate.at_origin(k, _evened(table.time) - found.time[0], rotate_wrench(wrench, to_lab))
        for k, wrench in enumerate(wrenches.values(), start=1)
    )
    return Recording(
        source=trc,
        markers=markers,
        plates=plates,
        first_frame=found.first_frame,
        notes=(
            *axes_notes,
            Note.of("time_origin", start_s=found.time[0], file=trc.name),
            Note.of("plates_from_forces", forces=tuple(wrenches), file=grf_mot.name),
        ),
    )


def _evened(time: Array) -> Array:
    """Give even times where the printed ones are those but for their rounding."""
    even = np.linspace(time[0], time[-1], len(time))
    step = even[1] - even[0] if len(time) > 1 else 0.0
    return even if np.abs(time - even).max() <= MAX_ROUNDING * step else time


def _wrenches(table: Table, source: str) -> dict[str, Array]:
    stems = dict.fromkeys(
        found["stem"] for name in table.names if (found := FORCE_COLUMN.fullmatch(name))
    )
    if not stems:
        raise ValueError(
            f"{source}: no forces such as ground_force_vx; columns: {', '.join(table.names)}"
        )
    return {stem: _wrench(table, stem, source) for stem in stems}


def _wrench(table: Table, stem: str, source: str) -> Array:
    try:
        force, point, torque = (
            np.column_stack([table.column(f"{prefix}{axis}") for axis in "xyz"])
            for prefix in (f"{stem}_v", f"{stem}_p", f"{stem.replace('force', 'torque')}_")
        )
    except KeyError as error:
        raise ValueError(f"{source}: {error.args[0]}") from error
    point = np.where(force.any(axis=1, keepdims=True), point, 0)
    return np.hstack([force, np.cross(point, force) + torque])
