"""A trial's body and results in the files of other programs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from hbm.clinical import AnkleZero, clinical_angles
from hbm.coordinates import HBM_ORDER, INDEX, TREE
from hbm.motion import Motion
from hbm.notes import warnings_first
from pipeline.export.bids import write_bids
from pipeline.export.opensim_model import write_osim
from pipeline.export.opensim_tables import (
    write_coordinates,
    write_external_loads,
    write_forces,
    write_trc,
)
from pipeline.export.urdf import write_urdf
from pipeline.io.write import write_csv
from pipeline.run.one_trial import process_request, read_requested
from pipeline.run.request import TrialRequest


@dataclass(frozen=True, slots=True)
class BidsTarget:
    """Where a recording goes in a BIDS data set: its folder, and labels of subject and task."""

    folder: Path
    subject: str
    task: str


def run(
    request: TrialRequest,
    *,
    osim: Path | None = None,
    urdf: Path | None = None,
    tables: Path | None = None,
    ankle_zero: AnkleZero = "right_angle",
    bids: BidsTarget | None = None,
) -> None:
    """Write what was asked for; process the trial where that needs it.

    Parameters
    ----------
    request
        Which trial, and how.
    osim, urdf
        Model files; not written where None.
    tables
        Folder for coordinates and external loads (.mot), generalized forces (.sto), markers (.trc)
        and clinical angles (.csv), named after the trial; not written where None.
    ankle_zero
        Where the angles' ankle is zero, "right_angle" or "in_line" (`hbm.clinical`).
    bids
        Data set that the recording is added to, unprocessed; not written where None.

    Raises
    ------
    ValueError, OSError
        If nothing was asked for, or the trial cannot be processed.
    """
    if not (osim or urdf or tables or bids):
        raise ValueError(
            "nothing to export; name --osim FILE, --urdf FILE, --tables DIR or --bids DIR"
        )
    written = []
    if bids is not None:
        written += write_bids(read_requested(request), bids.folder, bids.subject, bids.task)
    if osim or urdf or tables:
        written += _processed(request, osim, urdf, tables, ankle_zero)
    print("written: " + ", ".join(str(path) for path in written))


def angle_table(motion: Motion, ankle_zero: AnkleZero = "right_angle") -> pd.DataFrame:
    """Lay out the clinical angles of a motion with one row per frame.

    Parameters
    ----------
    motion
        The coordinates.
    ankle_zero
        See `hbm.clinical.clinical_angles`, which also gives the meaning of every sign.

    Returns
    -------
    pandas.DataFrame
        ``time_s``, then every coordinate in the Human Body Model's order, named with its unit:
        ``PelvisX_m``, ``RKneeFlexion_deg``; NaN where no marker ever shows it.

    Raises
    ------
    ValueError
        If the ankle's zero is unknown.
    """
    columns: dict[str, object] = {"time_s": motion.time}
    seen = motion.observed.any(axis=0)
    angles = clinical_angles(np.where(seen, motion.q, np.nan), ankle_zero=ankle_zero)
    for name, value in zip(HBM_ORDER, angles.T, strict=True):
        if TREE[INDEX[name]].translates:
            columns[f"{name}_m"] = value
        else:
            columns[f"{name}_deg"] = np.degrees(value)
    return pd.DataFrame(columns)


def _processed(
    request: TrialRequest,
    osim: Path | None,
    urdf: Path | None,
    tables: Path | None,
    ankle_zero: AnkleZero,
) -> list[Path]:
    """Process the trial and write the models and tables asked for."""
    result, recording = process_request(request)
    written = []
    for path, write in ((osim, write_osim), (urdf, write_urdf)):
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            write(result.body, path)
            written.append(path)
    if tables is not None:
        tables.mkdir(parents=True, exist_ok=True)
        stem = tables / request.trial.stem
        angles, coordinates, forces, loads, markers = made = [
            Path(f"{stem}{suffix}")
            for suffix in ("_angles.csv", "_coordinates.mot", "_forces.sto", "_loads.mot", ".trc")
        ]
        best = "measured" if result.compensated is None else "compensated"
        write_csv(angle_table(result.motion, ankle_zero), angles)
        write_coordinates(result.motion, coordinates)
        write_forces(result.compensated or result.measured, forces)
        write_external_loads(result.motion.time, result.ground[best], loads)
        write_trc(recording.markers, markers)
        written += made
        print(f"forces and loads are of the plates as {best}")
    for note in warnings_first(result.notes):
        print(f"- {'warning: ' * (note.level == 'warning')}{note} [{note.code}]")
    return written
