"""A processed trial in the files of other programs."""

from pathlib import Path

import numpy as np
import pandas as pd

from hbm.clinical import AnkleZero, clinical_angles
from hbm.coordinates import COORDINATES, HBM_ORDER, INDEX, TREE
from hbm.motion import Motion
from pipeline.export.opensim_model import write_osim
from pipeline.export.opensim_tables import (
    write_coordinates,
    write_external_loads,
    write_forces,
    write_trc,
)
from pipeline.export.urdf import write_urdf
from pipeline.io.write import write_csv
from pipeline.trial.result import TrialResult


def write_models(
    result: TrialResult, *, osim: Path | None = None, urdf: Path | None = None
) -> list[Path]:
    """Write a trial's body as a model.

    Parameters
    ----------
    result
        The processed trial.
    osim, urdf
        Model files for OpenSim 4, and for Pinocchio, MuJoCo and ROS; not written where None.

    Returns
    -------
    list of Path
        The files written.
    """
    written = []
    for path, write in ((osim, write_osim), (urdf, write_urdf)):
        if path is not None:
            write(result.body, path)
            written.append(path)
    return written


def write_tables(
    result: TrialResult, folder: Path, name: str, ankle_zero: AnkleZero = "right_angle"
) -> list[Path]:
    """Write a trial's coordinates, forces, loads, markers and clinical angles.

    Parameters
    ----------
    result
        The processed trial. Forces and loads are of the plates compensated, where they are. Where
        these do not carry the subject, the forces of pelvis and legs are NaN.
    folder
        Where; made where there is none.
    name
        What the files' names begin with.
    ankle_zero
        See `angle_table`.

    Returns
    -------
    list of Path
        Coordinates and external loads (.mot), generalized forces (.sto), measured markers (.trc),
        clinical angles (.csv), and the description of the loads (.xml).
    """
    suffixes = "_angles.csv", "_coordinates.mot", "_forces.sto", "_loads.mot", ".trc"
    written = [folder / f"{name}{suffix}" for suffix in suffixes]
    angles, coordinates, forces, loads, markers = written
    variant, dynamics = list(result.variants.items())[-1]
    pelvis = np.array([name.startswith("Pelvis") for name in COORDINATES])
    dynamics = dynamics.without_forces(np.outer(~result.counts, pelvis))
    write_csv(angle_table(result.motion, ankle_zero), angles)
    write_coordinates(result.motion, coordinates)
    write_forces(dynamics, forces)
    write_external_loads(result.motion.time, result.ground[variant], loads)
    write_trc(result.markers, markers)
    return [*written, loads.with_suffix(".xml")]


def angle_table(motion: Motion, ankle_zero: AnkleZero = "right_angle") -> pd.DataFrame:
    """Lay out the clinical angles of a motion with one row per frame.

    Parameters
    ----------
    motion
        The coordinates.
    ankle_zero
        Where the ankle is zero, "right_angle" or "in_line"; see
        `hbm.clinical.clinical_angles`, which also gives the meaning of every sign.

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
