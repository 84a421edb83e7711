"""The 3D scene: the body, markers, plates on their platform, forces and residuals.

What stays is drawn once (``draw_…``); what changes is sent for many instants at once (``send_…``).
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from compensation import PlatformPose, center_of_pressure
from hbm.coordinates import FIXED_TO, MOVING, PARENT
from hbm.markers import Markers
from hbm.model import Body
from hbm.poses import segment_frames
from hbm.segments import Inertia
from hbm.spatial import Array, rotate_wrench, shift_wrench
from pipeline.figures.style import COLOURS
from pipeline.io.recording import Plate
from pipeline.viewer.file import Stream, Timelines, printable, rgba, send

GROUND_N_PER_M: Final = 1000.0
"""The arrow of body weight is about as long as a leg."""
RESIDUAL_N_PER_M: Final = 500.0
RESIDUAL_NM_PER_M: Final = 250.0
"""Residuals of uncompensated perturbations, some 500 N and 250 N·m, are a metre long."""
ARROWS: Final = (
    f"Arrows: 1 m = {GROUND_N_PER_M:.0f} N; residual {RESIDUAL_N_PER_M:.0f} N, "
    f"{RESIDUAL_NM_PER_M:.0f} N·m"
)
MODELLED_COLOUR: Final = "#F0E442"
BODY_COLOURS: Final = {"left": "#BCD0EE", "right": "#F0DCBC", "middle": "#E2E2E2"}
ALPHA: Final = "38"
"""A fifth opaque: what is inside or below stays visible."""
MIN_ERROR_LINE_M: Final = 0.02
"""OpenSim's guideline for the RMS marker error; shorter lines would only obscure the body."""


def draw_scene(
    stream: Stream,
    body: Body,
    markers: Sequence[str],
    plates: Iterable[Plate],
    variants: Iterable[str],
) -> None:
    """Draw what stays of the whole scene: lab, body, measured markers, plates, arrows."""

    def stay(entity: str, shape: Any) -> None:
        stream.log(f"lab/{entity}", shape, static=True)

    stream.log("lab", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stay("axes", rr.TransformAxes3D(0.2))
    for segment in MOVING:
        on_segment = [i for i, name in enumerate(body.marker_segment) if name == segment]
        for part, shape in _shapes(body, segment, on_segment):
            stay(f"body/{segment}/{part}", shape)
        stay(f"body/{segment}/frame", rr.TransformAxes3D(0.05))
        if on_segment:
            names = [printable(f"{body.markers[i]}, modelled") for i in on_segment]
            look = _look(MODELLED_COLOUR, 0.006, names)
            stay(f"body/{segment}/markers", rr.Points3D(body.marker_position[on_segment], **look))
    for segment, carrier in FIXED_TO.items():  # a part of the other's drawing, without own pose
        fixed = _ellipsoid(body.segments[segment], segment, "majorwireframe")
        stay(f"body/{carrier}/{segment}", fixed)
    names = [printable(name) for name in markers]
    look = _look("#009E73", 0.009, names)
    stay("markers/measured", rr.Points3D.from_fields(**look))
    lines = rr.LineStrips3D.from_fields(radii=0.004, colors=rgba("#CC79A7"))
    stay("markers/error", lines)
    grey = "#8A8F98"
    for plate in plates:
        if np.isfinite(plate.corners).all():
            entity = f"platform/plate_{plate.number}"
            surface = rr.Mesh3D(
                vertex_positions=plate.corners,
                triangle_indices=[[0, 1, 2], [0, 2, 3]],
                albedo_factor=rgba(grey + ALPHA)[0],
            )
            stay(f"{entity}/surface", surface)
            look = _look(grey, 0.004, [f"plate {plate.number}"])
            stay(f"{entity}/edge", rr.LineStrips3D([plate.corners[[0, 1, 2, 3, 0]]], **look))
    of_moments = {"measured": "#E69F00", "compensated": "#56B4E9"}
    for variant in variants:
        names = [f"residual force, {variant}", f"residual moment, {variant}"]
        look = _look(COLOURS[variant], 0.008, names)
        look["colors"] = rgba(COLOURS[variant], of_moments[variant])
        stay(f"residual/{variant}", rr.Arrows3D.from_fields(**look))
        arrows = rr.Arrows3D.from_fields(radii=0.014, colors=rgba(COLOURS[variant]))
        stay(f"ground_reaction/{variant}", arrows)


def _look(colour: str, radius_m: float, names: Sequence[str]) -> dict[str, Any]:
    """Give colour, size and names of shapes, which are shown when one is pointed at."""
    return {"colors": rgba(colour), "radii": radius_m, "labels": names, "show_labels": False}


def _shapes(body: Body, segment: str, on_segment: list[int]) -> Iterable[tuple[str, Any]]:
    """Give a segment's bones, joint to joint, and the hull of its joints and own markers."""
    if segment == "head":
        yield "skull", _ellipsoid(body.segments["head"], segment, "solid")
    colour = BODY_COLOURS.get(segment.partition("_")[0], BODY_COLOURS["middle"])
    children = [body.offsets[child] for child, parent in PARENT.items() if parent == segment]
    if not children and segment in body.segments:
        children = [(1 if segment == "head" else 2) * body.segments[segment].center]
    # joints in one place have no bone between them
    ends = np.array([end for end in children if np.linalg.norm(end) > 1e-3])
    if not len(ends):
        return
    bones = rr.Capsules3D(
        lengths=np.linalg.norm(ends, axis=1),
        translations=np.zeros_like(ends),
        quaternions=[Rotation.align_vectors([end], [[0, 0, 1]])[0].as_quat() for end in ends],
        fill_mode="solid",
        **_look(colour, 0.016, [segment.replace("_", " ")]),
    )
    yield "bones", bones
    # points that lie in a plane, apart from noise, have no hull
    points = np.vstack([np.zeros(3), ends, body.marker_position[on_segment]])
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if segment != "head" and len(points) > 3 and spread[2] > 0.01:
        hull = ConvexHull(points)
        surface = rr.Mesh3D(
            vertex_positions=points[hull.simplices].reshape(-1, 3),
            vertex_normals=np.repeat(hull.equations[:, :3], 3, axis=0),
            albedo_factor=rgba(colour + ALPHA)[0],
        )
        yield "hull", surface


def _ellipsoid(part: Inertia, segment: str, fill: Any) -> rr.Ellipsoids3D:
    """Give the ellipsoid of uniform density that has a segment's mass and inertia."""
    # m/5 (b² + c²) about each principal axis of half sizes a, b, c; right-handed axes
    moments, axes = np.linalg.eigh(part.tensor)
    squares = 2.5 / part.mass * (moments.sum() - 2 * moments)
    axes[:, 2] *= np.linalg.det(axes)
    return rr.Ellipsoids3D(
        centers=[part.center],
        half_sizes=[np.sqrt(np.maximum(squares, 0))],
        quaternions=[Rotation.from_matrix(axes).as_quat()],
        colors=rgba(BODY_COLOURS["middle"]),
        fill_mode=fill,
        labels=segment.replace("_", " "),
        show_labels=False,
    )


def _send_pose(
    stream: Stream, entity: str, timelines: Timelines, rotation: Array, origin: Array
) -> None:
    """Give an entity, and all attached to it, a pose in the lab, (T, 3, 3) and (T, 3) [m].

    Where it is NaN, the position stays NaN, which hides the entity.
    """
    is_finite = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
    quaternion = Rotation.from_matrix(
        np.where(is_finite[:, None, None], rotation, np.eye(3))
    ).as_quat()
    fields = {"translation": origin[:, None], "quaternion": quaternion[:, None]}
    send(stream, entity, timelines, rr.Transform3D, np.ones((len(origin), 1), bool), **fields)


def send_scene(
    stream: Stream,
    timelines: Timelines,
    body: Body,
    q: Array,
    markers: Markers,
    platform: PlatformPose | None,
    ground: Mapping[str, Array],
    residual: Mapping[str, Array],
    *,
    surface_m: float,
    threshold_n: float,
) -> None:
    """Send all that moves at T instants.

    Markers and coordinates, (T, 46) [m, rad]; of each variant the wrenches on both feet, lab axes
    about the lab origin, (T, 2, 6), and the residual in lab axes at the pelvis, (T, 6) [N, N·m].
    The surface of the plates is so high with the platform in neutral; a foot with less vertical
    force than the threshold has no arrow.
    """
    is_finite = np.isfinite(q).all(axis=1, keepdims=True)
    rotation, origin = segment_frames(body, np.where(is_finite, q, np.nan))  # whole, or not at all
    for k, segment in enumerate(MOVING):
        _send_pose(stream, f"lab/body/{segment}", timelines, rotation[:, k], origin[:, k])
    everything = np.ones(markers.position.shape[:2], bool)
    entity = "lab/markers/measured"
    send(stream, entity, timelines, rr.Points3D, everything, positions=markers.position)
    # lines from measured to modelled markers, where these are far apart
    measured = [k for k, name in enumerate(body.markers) if name in markers.names]
    lines = np.empty((len(q), len(measured), 2, 3))
    for i, k in enumerate(measured):
        carrier = MOVING.index(body.marker_segment[k])
        lines[:, i, 0] = markers.position[:, markers.names.index(body.markers[k])]
        lines[:, i, 1] = rotation[:, carrier] @ body.marker_position[k] + origin[:, carrier]
    far = np.linalg.norm(lines[:, :, 1] - lines[:, :, 0], axis=-1) > MIN_ERROR_LINE_M
    send(stream, "lab/markers/error", timelines, rr.LineStrips3D, far, strips=lines)
    if platform is not None:
        _send_pose(stream, "lab/platform", timelines, platform.rotation, platform.position)
    scale = np.array([RESIDUAL_N_PER_M, RESIDUAL_NM_PER_M])[:, None]
    pelvis = np.repeat(q[:, None, :3], 2, axis=1)
    for variant, wrenches in ground.items():
        feet = (wrenches[:, foot] for foot in (0, 1))
        at = [pressure_point(wrench, surface_m, platform, threshold_n) for wrench in feet]
        force = wrenches[:, :, :3] / GROUND_N_PER_M
        drawn = residual[variant].reshape(-1, 2, 3) / scale
        for entity, origins, vectors in (
            (f"lab/ground_reaction/{variant}", np.stack(at, 1), force),
            (f"lab/residual/{variant}", pelvis, drawn),
        ):
            present = np.asarray(np.isfinite(origins + vectors).all(axis=2))
            send(stream, entity, timelines, rr.Arrows3D, present, origins=origins, vectors=vectors)


def pressure_point(
    wrench: Array, surface_m: float, platform: PlatformPose | None, threshold_n: float
) -> Array:
    """Give the centre of pressure on a surface that may move, (T, 3) [m]; NaN where unloaded."""
    if platform is not None:
        # in the platform's frame, where its surface is level
        back = np.swapaxes(platform.rotation, 1, 2)
        wrench = rotate_wrench(shift_wrench(wrench, platform.position), back)
    point = center_of_pressure(wrench, threshold_n, surface_m)
    return point if platform is None else platform.to_lab(point)
