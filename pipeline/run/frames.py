"""A trial frame by frame, as the columns of a table and back."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import pyarrow as pa

from compensation.platform import PlatformPose
from hbm.coordinates import COORDINATES, HBM_ORDER
from hbm.dynamics import Dynamics
from hbm.engines.engine import EngineUsed
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.spatial import Array, Mask
from pipeline.io.recording import Event
from pipeline.run.header import TrialHeader, plates_of
from pipeline.trial.residuals import AXES, reported, variants
from pipeline.trial.result import CompensationUncertainty, TrialResult
from pipeline.trial.validity import Validity

WRENCH: Final = ("fx", "fy", "fz", "mx", "my", "mz")
POSE: Final = (*(f"r{row}{column}" for row in "123" for column in "123"), "x", "y", "z")
"""Rotation matrix, row by row, and position of the platform."""

MASKS: Final = tuple(field.name for field in fields(Validity))

Column = Array | Mask | Sequence[str]


@dataclass(frozen=True, slots=True)
class Frames:
    """The values of a result in every frame; see `pipeline.trial.result.TrialResult`."""

    markers: Markers
    motion: Motion
    dynamics: Mapping[str, Dynamics]
    ground: dict[str, dict[str, Array]]
    platform: PlatformPose | None
    ambiguous: Mask
    validity: Validity
    uncertainty: CompensationUncertainty | None


def frame_table(result: TrialResult) -> pa.Table:
    """Lay a trial out with one row per frame.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    pyarrow.Table
        ``time_s``; ``q.NAME``, ``v.NAME``, ``a.NAME`` [rad or m, per s, per s²] in the Human Body
        Model's order; per variant ``tau.measured.NAME`` [N·m or N] and ``residual.measured.Fx`` …
        ``Mz`` [N, N·m] as reported (x forward, y right, z up, about the pelvis origin);
        ``marker_error.NAME`` [m]; ``event``, such as "left foot_strike", on the frame nearest to
        it. In lab axes (X forward, Y left, Z up): ``ground.measured.left_foot.fx`` … ``mz`` [N,
        N·m] about the lab origin, ``marker.NAME.x`` [m] as measured, ``platform.r11`` … ``z``.
        ``converged``, ``observed.NAME``, ``gradient`` of the inverse kinematics; ``ambiguous``
        where the split of a plate between the feet is uncertain; ``valid.motion``,
        ``valid.plates`` and ``valid.settled``, all true where a residual counts
        (`pipeline.trial.validity.Validity`). With a calibration of the platform, one standard
        deviation due to the compensation: ``uncertainty.residual.Fx`` … and
        ``uncertainty.plate_1.fx`` …, lab axes about the lab origin [N, N·m].
    """
    motion, markers, pose = result.motion, result.markers, result.platform
    columns: dict[str, Column] = {"time_s": motion.time}
    for symbol, values in (("q", motion.q), ("v", motion.v), ("a", motion.a)):
        columns |= _by_coordinate(symbol, values)
    for variant, dynamics in variants(result).items():
        columns |= _by_coordinate(f"tau.{variant}", dynamics.tau)
        columns |= _columns(f"residual.{variant}", AXES, reported(dynamics.residual))
    columns |= _columns("marker_error", motion.markers, motion.marker_error)
    columns["event"] = _event_labels(motion.time, result.events)
    for variant, feet in result.ground.items():
        for foot, wrench in feet.items():
            columns |= _columns(f"ground.{variant}.{foot}", WRENCH, wrench)
    if pose is not None:
        both = np.hstack([pose.rotation.reshape(-1, 9), pose.position])
        columns |= _columns("platform", POSE, both)
    if (spread := result.uncertainty) is not None:
        columns |= _columns("uncertainty.residual", AXES, spread.residual)
        for plate, values in zip(result.plates, spread.plates, strict=True):
            columns |= _columns(f"uncertainty.plate_{plate.number}", WRENCH, values)
    for k, name in enumerate(markers.names):
        columns |= _columns(f"marker.{name}", "xyz", markers.position[:, k])
    columns |= _by_coordinate("observed", motion.observed)
    gradient = motion.gradient if motion.gradient is not None else np.full(len(motion.time), np.nan)
    columns |= {
        "converged": motion.converged,
        "gradient": gradient,
        "ambiguous": result.ambiguous,
        **{f"valid.{name}": getattr(result.validity, name) for name in MASKS},
    }
    return pa.table({name: pa.array(column) for name, column in columns.items()})


def read_frames(table: pa.Table, header: TrialHeader, engine: EngineUsed) -> Frames:
    """Read the columns of `frame_table` back.

    Parameters
    ----------
    table
        The table.
    header
        The same trial's header, which names markers and feet.
    engine
        The engine that computed its dynamics.

    Returns
    -------
    Frames
        Equal to the last bit to what was laid out.

    Raises
    ------
    KeyError
        If a column is missing.
    """

    def read(prefix: str, names: Iterable[str]) -> Array:
        found = [table.column(f"{prefix}.{name}").to_numpy() for name in names]
        return np.column_stack(found) if found else np.empty((table.num_rows, 0))

    time = table.column("time_s").to_numpy()
    measured = [read(f"marker.{name}", "xyz") for name in header.markers]
    position = np.stack(measured, axis=1) if measured else np.empty((len(time), 0, 3))
    motion = Motion(
        time=time,
        q=read("q", COORDINATES),
        v=read("v", COORDINATES),
        a=read("a", COORDINATES),
        markers=header.motion_markers,
        marker_error=read("marker_error", header.motion_markers),
        converged=table.column("converged").to_numpy(),
        observed=np.asarray(read("observed", COORDINATES), bool),
        gradient=table.column("gradient").to_numpy(),
    )
    dynamics, ground = {}, {}
    for variant, feet in header.feet.items():
        force = read(f"tau.{variant}", COORDINATES)
        residual = reported(read(f"residual.{variant}", AXES))
        dynamics[variant] = Dynamics(time, force, residual, force * motion.v, engine)
        ground[variant] = {foot: read(f"ground.{variant}.{foot}", WRENCH) for foot in feet}
    pose = read("platform", POSE) if header.platform_moves else None
    uncertainty = None
    if f"uncertainty.residual.{AXES[0]}" in table.column_names:
        of_plates = [read(f"uncertainty.plate_{p.number}", WRENCH) for p in plates_of(header)]
        residual = read("uncertainty.residual", AXES)
        uncertainty = CompensationUncertainty(tuple(of_plates), residual)
    return Frames(
        markers=Markers(time, header.markers, position),
        motion=motion,
        dynamics=dynamics,
        ground=ground,
        platform=None if pose is None else PlatformPose(pose[:, :9].reshape(-1, 3, 3), pose[:, 9:]),
        ambiguous=table.column("ambiguous").to_numpy(),
        validity=Validity(**{name: table.column(f"valid.{name}").to_numpy() for name in MASKS}),
        uncertainty=uncertainty,
    )


def _columns(prefix: str, names: Iterable[str], values: Array | Mask) -> dict[str, Column]:
    """Name the columns of (T, K) values, each in one piece, which Arrow need not copy."""
    columns = np.ascontiguousarray(values.T)
    return {f"{prefix}.{n}": column for n, column in zip(names, columns, strict=True)}


def _by_coordinate(prefix: str, values: Array | Mask) -> dict[str, Column]:
    """Name the columns of (T, 46) values, in the Human Body Model's order."""
    columns = _columns(prefix, COORDINATES, values)
    return {name: columns[name] for name in (f"{prefix}.{c}" for c in HBM_ORDER)}


def _event_labels(time: Array, events: Sequence[Event]) -> list[str]:
    """Give the events of each frame as text."""
    labels, between = [""] * len(time), (time[1:] + time[:-1]) / 2
    frames = np.searchsorted(between, [event.time for event in events])
    for nearest, event in zip(frames.tolist(), events, strict=True):
        labels[nearest] = " ".join(filter(None, (labels[nearest], f"{event.side} {event.label}")))
    return labels
