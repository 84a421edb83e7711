"""Results as tables that other programs open: OpenSim's MOT, STO, TRC and external loads; CSV.

All are in the lab's axes (x forward, y left, z up), which are the ground axes of the model that
`pipeline.export.models.write_osim` writes, and in SI units but for angles in degrees where the
header says so. Gaps are NaN in MOT and STO, empty fields in TRC and CSV. OpenSim's tools fit
splines to whole columns, so give them an interval without gaps.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hbm.coordinates import COORDINATES, HBM_ORDER, INDEX, TREE
from hbm.dynamics import Dynamics
from hbm.markers import Markers
from hbm.motion import AnkleZero, Motion, clinical_angles
from hbm.spatial import Array
from pipeline.export.models import write_template
from pipeline.io.write import whole_file, write_csv, write_text
from pipeline.run.store import by_column, event_labels, following_blocks, stored_blocks
from pipeline.trial.result import TrialResult


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
        clinical angles (.csv), all of them and more by frame as columns of one table (.parquet),
        and the description of the loads (.xml).
    """
    suffixes = ["_angles.csv", "_coordinates.mot", "_forces.sto", "_loads.mot", ".trc"]
    suffixes += ["_frames.parquet", "_loads.xml"]
    written = [folder / f"{name}{suffix}" for suffix in suffixes]
    angles, coordinates, forces, loads, markers, frames, _ = written
    variant, dynamics = list(result.variants.items())[-1]
    pelvis = np.array([name.startswith("Pelvis") for name in COORDINATES])
    dynamics = dynamics.without_forces(np.outer(~result.counts, pelvis))
    write_csv(angle_table(result.motion, ankle_zero), angles)
    write_coordinates(result.motion, coordinates)
    write_forces(dynamics, forces)
    write_external_loads(result.motion.time, result.ground[variant], loads)
    write_trc(result.markers, markers)
    with whole_file(frames) as temporary:
        frame_table(result).to_parquet(temporary, index=False, compression="zstd")
    return written


def frame_table(result: TrialResult) -> pd.DataFrame:
    """Lay a trial out with one row per frame.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    pandas.DataFrame
        What `pipeline.run.store.write_trial` stores of each frame, not rounded, and what follows
        from it: ``q.NAME``, ``v.NAME``, ``a.NAME`` [rad or m, per s, per s²]; ``marker_error.NAME``
        [m]; per variant ``tau.measured.NAME`` [N·m or N].
    """
    motion = result.motion
    columns = {"time_s": motion.time, "event": event_labels(motion.time, result.events)}
    columns |= {"converged": motion.converged, "quality": result.quality}
    columns |= by_column(stored_blocks(result) | following_blocks(motion, result.variants))
    return pd.DataFrame(columns)


def angle_table(motion: Motion, ankle_zero: AnkleZero = "right_angle") -> pd.DataFrame:
    """Lay out the clinical angles of a motion with one row per frame.

    Parameters
    ----------
    motion
        The coordinates.
    ankle_zero
        Where the ankle is zero, "right_angle" or "in_line"; see
        `hbm.motion.clinical_angles`, which also gives the meaning of every sign.

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
    is_observed = motion.observed.any(axis=0)
    angles = clinical_angles(np.where(is_observed, motion.q, np.nan), ankle_zero=ankle_zero)
    columns = {"time_s": motion.time}
    for name, value in zip(HBM_ORDER, angles.T, strict=True):
        columns[f"{name}_{'m' if _translates(name) else 'deg'}"] = _in_degrees(name, value)
    return pd.DataFrame(columns)


def _translates(name: str) -> bool:
    return TREE[INDEX[name]].translates


def _in_degrees(name: str, value: Array) -> Array:
    """Give a coordinate in degrees if it is a rotation, else in metres."""
    return value if _translates(name) else np.degrees(value)


def write_coordinates(motion: Motion, path: str | Path) -> None:
    """Write a motion's coordinates, for example as ``trial.mot``.

    Parameters
    ----------
    motion
        The motion.
    path
        Where to write.

    Notes
    -----
    Columns in the Human Body Model's order, rotations in degrees, translations in metres. They are
    the model's coordinates; `hbm.motion` gives the shoulder angles of the original's export.
    """
    columns = {name: _in_degrees(name, motion.coordinate(name)) for name in HBM_ORDER}
    _write_table(path, motion.time, columns, in_degrees=True)


def write_forces(dynamics: Dynamics, path: str | Path) -> None:
    """Write generalized forces as OpenSim's inverse dynamics does, for example as ``trial_id.sto``.

    Parameters
    ----------
    dynamics
        The forces.
    path
        Where to write.

    Notes
    -----
    Columns ``<coordinate>_force`` [N] for translations and ``<coordinate>_moment`` [N·m] for
    rotations, in the Human Body Model's order. The six of the pelvis are the residual: forces along
    lab axes, moments about the axes of yaw, pitch and roll through the pelvis origin (mid-hip).
    """
    columns = {
        f"{name}_{'force' if _translates(name) else 'moment'}": dynamics.force(name)
        for name in HBM_ORDER
    }
    _write_table(path, dynamics.time, columns, in_degrees=False)


def write_external_loads(time: Array, wrenches: Mapping[str, Array], path: str | Path) -> None:
    """Write the external loads on the subject: a table, and OpenSim's description of it.

    Parameters
    ----------
    time
        (T,) [s].
    wrenches
        Segment -> wrench acting on it, (T, 6) [N, N·m], lab axes about the lab origin.
    path
        Where to write the table, for example ``trial_grf.mot``. The description goes to the same
        name with the ending ``.xml`` and names the table without its folder.

    Notes
    -----
    The point of application is always the lab origin and the torque the moment about it, so that
    no point goes to infinity while a plate is unloaded. To OpenSim's dynamics this is the same;
    its arrows are drawn at the origin.
    """
    path, columns = Path(path), dict[str, Array]()
    for segment, wrench in wrenches.items():
        parts = wrench[:, :3], np.zeros((len(time), 3)), wrench[:, 3:]
        for end, part in zip(("force_v", "force_p", "torque_"), parts, strict=True):
            columns |= {f"{segment}_{end}{axis}": part[:, k] for k, axis in enumerate("xyz")}
    _write_table(path, time, columns, in_degrees=False)
    write_template("loads.xml", path.with_suffix(".xml"), name=path.stem, segments=wrenches)


def write_trc(markers: Markers, path: str | Path) -> None:
    """Write marker trajectories as TRC, in metres.

    Parameters
    ----------
    markers
        The markers; samples must be evenly spaced in time, since the format has one rate.
    path
        Where to write.

    Raises
    ------
    ValueError
        If there are fewer than two samples or they are not evenly spaced.
    """
    frames, count = len(markers.time), len(markers.names)
    rate = f"{even_rate_hz(markers.time, 'TRC'):.10g}"
    header = {"DataRate": rate, "CameraRate": rate, "NumFrames": frames, "NumMarkers": count}
    header |= {"Units": "m", "OrigDataRate": rate, "OrigDataStartFrame": 1, "OrigNumFrames": frames}
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}",
        "\t".join(header),
        "\t".join(map(str, header.values())),
        "\t".join(["Frame#", "Time", "\t\t\t".join(markers.names)]),
        "\t".join(["", "", *(f"{axis}{k + 1}" for k in range(count) for axis in "XYZ")]),
    ]
    table = pd.DataFrame(markers.position.reshape(frames, -1))
    table.insert(0, "time", markers.time)
    table.index += 1
    rows = table.to_csv(sep="\t", header=False, lineterminator="\n")
    write_text("\n".join(lines) + f"\n\n{rows}", Path(path))


def even_rate_hz(time: Array, format_name: str) -> float:
    """Give the rate of times that a format with one rate needs evenly spaced; else a ValueError."""
    rate = (len(time) - 1) / np.ptp(time) if len(time) > 1 else np.nan
    regular = time[:1] + np.arange(len(time)) / rate
    # a tenth of a sampling interval; rounding of written times is smaller
    if not np.abs(time - regular).max(initial=0) < 0.1 / rate:
        raise ValueError(f"{format_name} needs two or more samples, evenly spaced in time")
    return float(rate)


def _write_table(
    path: str | Path, time: Array, columns: Mapping[str, Array], *, in_degrees: bool
) -> None:
    path = Path(path)
    header = [
        path.stem,
        "version=1",
        f"nRows={len(time)}",
        f"nColumns={len(columns) + 1}",
        f"inDegrees={'yes' if in_degrees else 'no'}",
        "endheader",
        "\t".join(["time", *columns]),
    ]
    values = np.column_stack([time, *columns.values()])
    form: Any = {"header": "\n".join(header), "comments": "", "encoding": "utf-8"}
    with whole_file(path) as temporary:
        np.savetxt(temporary, values, "%.17g", "\t", **form)
