"""What is around the body in the 3D scene: markers, plates, platform, forces and residuals."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr

from compensation import PlatformPose, center_of_pressure
from hbm.coordinates import MOVING
from hbm.markers import Markers
from hbm.model import Body
from hbm.spatial import Array, rotate_wrench, shift_wrench
from pipeline.figures.style import COLOURS
from pipeline.trial.result import PlateSurface
from pipeline.viewer.body import send_pose
from pipeline.viewer.file import Timelines, printable, rgba, send

GROUND_N_PER_M: Final = 1000.0
"""The arrow of body weight is about as long as a leg."""
RESIDUAL_N_PER_M: Final = 500.0
RESIDUAL_NM_PER_M: Final = 250.0
"""Residuals of uncompensated perturbations, some 500 N and 250 N·m, are a metre long."""
GROUND_SCALE: Final = f"ground reaction 1 m = {GROUND_N_PER_M:.0f} N"
RESIDUAL_SCALES: Final = (
    f"residual force 1 m = {RESIDUAL_N_PER_M:.0f} N, moment 1 m = {RESIDUAL_NM_PER_M:.0f} N·m"
)
MOMENT_COLOURS: Final = {"measured": "#E69F00", "compensated": "#56B4E9"}
MEASURED_COLOUR: Final = "#009E73"
ERROR_COLOUR: Final = "#CC79A7"
PLATE_COLOUR: Final = "#8A8F98"
MIN_ERROR_LINE_M: Final = 0.02
"""OpenSim's guideline for the RMS marker error; shorter lines would only obscure the body."""
MARKER_RADIUS_M: Final = 0.009
ERROR_LINE_RADIUS_M: Final = 0.004
PLATE_EDGE_RADIUS_M: Final = 0.004
PLATE_ALPHA: Final = "38"
GROUND_ARROW_RADIUS_M: Final = 0.014
RESIDUAL_ARROW_RADIUS_M: Final = 0.008


def draw_markers(stream: rr.RecordingStream, names: Sequence[str]) -> None:
    """Draw what stays of the measured markers: names, sizes and colours.

    Parameters
    ----------
    stream
        Recording to write to.
    names
        Names of the markers.
    """
    stream.log(
        "lab/markers/measured",
        rr.Points3D.from_fields(
            radii=MARKER_RADIUS_M,
            colors=rgba(MEASURED_COLOUR),
            labels=[printable(name) for name in names],
            show_labels=False,
        ),
        static=True,
    )
    stream.log(
        "lab/markers/error",
        rr.LineStrips3D.from_fields(radii=ERROR_LINE_RADIUS_M, colors=rgba(ERROR_COLOUR)),
        static=True,
    )


def send_markers(
    stream: rr.RecordingStream,
    timelines: Timelines,
    markers: Markers,
    body: Body,
    rotation: Array,
    origin: Array,
) -> None:
    """Send the measured markers, and lines to the modelled ones where they are far apart.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    markers
        Measured markers, at the same T instants.
    body
        The body.
    rotation, origin
        From `hbm.poses.segment_frames`.
    """
    everything = np.ones(markers.position.shape[:2], bool)
    entity = "lab/markers/measured"
    send(stream, entity, timelines, rr.Points3D, everything, positions=markers.position)
    known = [name for name in body.markers if name in markers.names]
    lines = np.empty((len(origin), len(known), 2, 3))
    for i, name in enumerate(known):
        k = body.markers.index(name)
        own = MOVING.index(body.marker_segment[k])
        lines[:, i, 0] = markers.position[:, markers.names.index(name)]
        lines[:, i, 1] = rotation[:, own] @ body.marker_position[k] + origin[:, own]
    far = np.linalg.norm(lines[:, :, 1] - lines[:, :, 0], axis=-1) > MIN_ERROR_LINE_M
    send(stream, "lab/markers/error", timelines, rr.LineStrips3D, far, strips=lines)


def send_platform(
    stream: rr.RecordingStream, timelines: Timelines, platform: PlatformPose | None
) -> None:
    """Send the pose of the platform with its plates.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    platform
        At the same T instants; None where it stands still.
    """
    if platform is not None:
        send_pose(stream, "lab/platform", timelines, platform.rotation, platform.position)


def draw_plates(stream: rr.RecordingStream, plates: Iterable[PlateSurface]) -> None:
    """Draw the plates on the platform.

    Parameters
    ----------
    stream
        Recording to write to.
    plates
        Where the plates are with the platform in neutral; those of unknown corners are left out.
    """
    for plate in plates:
        if not np.isfinite(plate.corners).all():
            continue
        entity = f"lab/platform/plate_{plate.number}"
        stream.log(
            f"{entity}/surface",
            rr.Mesh3D(
                vertex_positions=plate.corners,
                triangle_indices=[[0, 1, 2], [0, 2, 3]],
                albedo_factor=rgba(PLATE_COLOUR + PLATE_ALPHA)[0],
            ),
            static=True,
        )
        stream.log(
            f"{entity}/edge",
            rr.LineStrips3D(
                [plate.corners[[0, 1, 2, 3, 0]]],
                radii=PLATE_EDGE_RADIUS_M,
                colors=rgba(PLATE_COLOUR),
                labels=f"plate {plate.number}",
                show_labels=False,
            ),
            static=True,
        )


def draw_arrows(stream: rr.RecordingStream, variant: str) -> None:
    """Draw what stays of a variant's arrows: sizes, colours and names.

    Parameters
    ----------
    stream
        Recording to write to.
    variant
        "measured" or "compensated".
    """
    stream.log(
        f"lab/ground_reaction/{variant}",
        rr.Arrows3D.from_fields(radii=GROUND_ARROW_RADIUS_M, colors=rgba(COLOURS[variant])),
        static=True,
    )
    stream.log(
        f"lab/residual/{variant}",
        rr.Arrows3D.from_fields(
            radii=RESIDUAL_ARROW_RADIUS_M,
            colors=rgba(COLOURS[variant], MOMENT_COLOURS[variant]),
            labels=[f"residual force, {variant}", f"residual moment, {variant}"],
            show_labels=False,
        ),
        static=True,
    )


def send_ground(
    stream: rr.RecordingStream,
    timelines: Timelines,
    variant: str,
    feet: Mapping[str, Array],
    *,
    surface_m: float,
    platform: PlatformPose | None,
    threshold_n: float,
) -> None:
    """Send the ground reaction force of both feet at the centre of pressure.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    variant
        "measured" or "compensated".
    feet
        Foot -> wrench on it in lab axes about the lab origin, (T, 6) [N, N·m].
    surface_m
        Height of the plates' surface with the platform in neutral [m].
    platform
        The platform's pose at the same T instants; None where it stands still.
    threshold_n
        A foot with less vertical force gets no arrow [N].
    """
    at = np.stack(
        [pressure_point(wrench, surface_m, platform, threshold_n) for wrench in feet.values()], 1
    )
    force = np.stack([wrench[:, :3] for wrench in feet.values()], 1)
    loaded = np.asarray(np.isfinite(at + force).all(axis=2))
    entity = f"lab/ground_reaction/{variant}"
    send(stream, entity, timelines, rr.Arrows3D, loaded, origins=at, vectors=force / GROUND_N_PER_M)


def pressure_point(
    wrench: Array, surface_m: float, platform: PlatformPose | None, threshold_n: float
) -> Array:
    """Give the centre of pressure on a surface that may move.

    Parameters
    ----------
    wrench
        In lab axes about the lab origin, (T, 6) [N, N·m].
    surface_m
        Height of the surface with the platform in neutral [m].
    platform
        The platform's pose; None where it stands still.
    threshold_n
        Below this force along the surface's normal there is none [N].

    Returns
    -------
    Array
        Points in the lab, (T, 3) [m]; NaN where the surface is not loaded.
    """
    if platform is not None:
        back = np.swapaxes(platform.rotation, 1, 2)
        wrench = rotate_wrench(shift_wrench(wrench, platform.position), back)
    point = center_of_pressure(wrench, threshold_n, surface_m)
    return point if platform is None else platform.to_lab(point)


def send_residual(
    stream: rr.RecordingStream, timelines: Timelines, variant: str, residual: Array, pelvis: Array
) -> None:
    """Send the residual force and moment at the pelvis origin.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    variant
        "measured" or "compensated".
    residual
        In lab axes about the pelvis origin, (T, 6) [N, N·m].
    pelvis
        The pelvis origin, (T, 3) [m].
    """
    vectors = np.stack(
        [residual[:, :3] / RESIDUAL_N_PER_M, residual[:, 3:] / RESIDUAL_NM_PER_M], axis=1
    )
    origins = np.repeat(pelvis[:, None], 2, axis=1)
    known = np.asarray(np.isfinite(vectors + origins).all(axis=2))
    entity = f"lab/residual/{variant}"
    send(stream, entity, timelines, rr.Arrows3D, known, origins=origins, vectors=vectors)
