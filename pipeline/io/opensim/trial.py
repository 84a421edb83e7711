"""Trials in OpenSim's formats: markers in a TRC file, ground reaction forces in a MOT file."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, rotate_wrench
from hbm.spelling import listed, short
from pipeline.io.axes import mean_force, parse_axes, settle_axes
from pipeline.io.input_file import naming
from pipeline.io.moment_reference import wrench_of_torque
from pipeline.io.opensim.sto import Table, read_mot
from pipeline.io.opensim.trc import read_trajectories
from pipeline.io.recording import Metadata, Plate, Recording
from pipeline.io.stated import Stated, as_stated

MAX_ROUNDING: Final = 0.05
"""In steps: times printed with few digits differ from even ones by less."""
FORCE_COLUMN: Final = re.compile(r"(?P<stem>.*force.*)_(?P<letter>[vf])[xyz]")
TORQUE_COLUMNS: Final = (
    ("torque", "_"),
    ("moment", "_"),
    ("torque", "_m"),
    ("moment", "_m"),
    ("force", "_m"),
)
"""How programs call the torques of ``ground_force_vx``: ``ground_torque_x``, `` ground_force_mx``:
word in the place of "force", and what stands before the axis."""


@dataclass(frozen=True, slots=True)
class _Force:
    """One force of a table in SI units and the file's axes: its point and its torque."""

    name: str
    force: Array
    point: Array
    torque: Array


def read_opensim_trial(
    trc: str | Path, grf_mot: str | Path, stated: Stated | str | None = None
) -> Recording:
    """Read markers from a TRC file and ground reaction forces from a MOT file.

    Parameters
    ----------
    trc
        Marker trajectories.
    grf_mot
        Forces, points of application and torques in OpenSim's naming, on the same clock and in the
        same axes as the markers; N, m and N·m, if no other units are stated.
    stated
        What is stated about the files, as for `pipeline.io.c3d.read.read_c3d`.

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
    Moment about the origin of force f at point p with torque t: p × f + t, unless t turns out to be
    the moment about a fixed point (`wrench_of_torque`). Where a force is exactly zero its point has
    no meaning and is not used. MOT files often print times with so few digits that the steps look
    uneven; force times within a twentieth of a step of even ones become even.

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
    trc, grf_mot, stated = Path(trc), Path(grf_mot), as_stated(stated)
    found, table = read_trajectories(trc, stated), read_mot(grf_mot)
    with naming(grf_mot):
        forces, force_notes = _forces(table, stated)
    with naming(trc):
        axes, axes_notes = settle_axes(
            stated.axes,
            found.position,
            found.names,
            marker_set=stated.marker_set,
            plate_forces=[mean_force(each.force) for each in forces],
        )
    to_lab = parse_axes(axes)
    time = _evened(table.time) - found.time[0]
    plates: list[Plate] = []
    torque_notes: list[Note] = []
    for k, each in enumerate(forces, start=1):
        wrench, notes = wrench_of_torque(
            each.force, each.torque, each.point, to_lab[2], f"plate {k} ({each.name})"
        )
        plates.append(Plate.at_origin(k, time, rotate_wrench(wrench, to_lab)))
        torque_notes += notes
    names = [each.name for each in forces]
    return Recording(
        source=trc,
        markers=Markers(found.time - found.time[0], found.names, found.position @ to_lab.T),
        plates=tuple(plates),
        first_frame=found.first_frame,
        metadata=Metadata(subject=found.subject),
        stated=stated,
        notes=(
            *axes_notes,
            *found.notes,
            *table.notes,
            Note.of("time_origin", start_s=found.time[0], file=trc.name),
            Note.of("plates_from_forces", forces=names, file=grf_mot.name),
            *force_notes,
            *torque_notes,
        ),
    )


def _evened(time: Array) -> Array:
    """Give even times where the printed ones are those but for their rounding."""
    even = np.linspace(time[0], time[-1], len(time))
    step = even[1] - even[0] if len(time) > 1 else 0.0
    return even if np.abs(time - even).max() <= MAX_ROUNDING * step else time


def _forces(table: Table, stated: Stated) -> tuple[list[_Force], list[Note]]:
    """Give the forces that have all columns, and notes on units and the others."""
    stems = dict.fromkeys(
        (found["stem"], found["letter"])
        for name in table.names
        if (found := FORCE_COLUMN.fullmatch(name))
    )
    if not stems:
        raise ValueError(f"no forces such as ground_force_vx; columns: {listed(table.names)}")
    units = stated.force_unit("N"), stated.pressure_unit("m"), stated.moment_unit("Nm")
    forces, notes = [], [*stated.plate_notes(["N"], ["Nm"], ["m"])]
    for stem, letter in stems:
        torques = dict.fromkeys(
            stem.replace("force", word) + before for word, before in TORQUE_COLUMNS
        )
        there = [name for name in torques if f"{name}x" in table.columns]
        columns = f"{stem}_{letter}", f"{stem}_p", (there or [*torques])[0]
        needed = [f"{name}{axis}" for name in columns for axis in "xyz"]
        if absent := [name for name in needed if name not in table.columns]:
            reason = f"column {short(absent[0])} is absent"
            notes.append(Note.of("plate_left_out", plate=short(stem), reason=reason))
            continue
        if len(there) > 1:
            raise ValueError(
                f"the torques of {short(stem)} are there twice, as {short(there[0])}x and "
                f"{short(there[1])}x; remove those that are not free torques"
            )
        force, point, torque = (
            unit * np.column_stack([table.column(f"{name}{axis}") for axis in "xyz"])
            for name, unit in zip(columns, units, strict=True)
        )
        point = np.where(force.any(axis=1, keepdims=True), point, 0)
        forces.append(_Force(short(stem), force, point, torque))
    return forces, notes
