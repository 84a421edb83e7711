"""The body in the 3D scene: segment frames with bones, hulls and markers attached to them."""

from typing import Final

import numpy as np
import rerun as rr
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from hbm.coordinates import FIXED_TO, MOVING, PARENT
from hbm.model import Body
from hbm.segments import Inertia
from hbm.spatial import Array
from pipeline.viewer.file import Timelines, printable, rgba, send

MODELLED_COLOUR: Final = "#F0E442"
BODY_COLOURS: Final = {"left": "#BCD0EE", "right": "#F0DCBC", "middle": "#E2E2E2"}
HULL_ALPHA: Final = "38"
"""A fifth opaque: bones and markers stay visible inside."""
MIN_HULL_THICKNESS_M: Final = 0.01
"""Points that lie in a plane, apart from noise, have no hull."""
BONE_RADIUS_M: Final = 0.016
MARKER_RADIUS_M: Final = 0.006
AXIS_LENGTH_M: Final = 0.05
MIN_BONE_LENGTH_M: Final = 1e-3
HEAD_HALF_AXES: Final = np.array([0.7, 0.55, 0.95])
"""Half axes of the head's ellipsoid, as multiples of the distance of its centre of mass from the
neck."""


def draw_body(stream: rr.RecordingStream, body: Body) -> None:
    """Draw every segment's frame, and in it its bones, hull and modelled markers.

    A segment that is fixed to another has no pose of its own: it is a part of the other's drawing,
    as the ellipsoid that has its mass and moments of inertia at uniform density.

    Parameters
    ----------
    stream
        Recording to write to.
    body
        The body.
    """
    for segment in MOVING:
        entity = f"lab/body/{segment}"
        _draw_shape(stream, entity, body, segment)
        stream.log(f"{entity}/frame", rr.TransformAxes3D(AXIS_LENGTH_M), static=True)
        own = [i for i, name in enumerate(body.marker_segment) if name == segment]
        if own:
            stream.log(
                f"{entity}/markers",
                rr.Points3D(
                    body.marker_position[own],
                    radii=MARKER_RADIUS_M,
                    colors=rgba(MODELLED_COLOUR),
                    labels=[printable(f"{body.markers[i]}, modelled") for i in own],
                    show_labels=False,
                ),
                static=True,
            )
    for segment, carrier in FIXED_TO.items():
        part = _ellipsoid(body.segments[segment], segment)
        stream.log(f"lab/body/{carrier}/{segment}", part, static=True)


def send_body(
    stream: rr.RecordingStream, timelines: Timelines, rotation: Array, origin: Array
) -> None:
    """Send the poses of the segments that `draw_body` draws.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    rotation, origin
        From `hbm.poses.segment_frames`. A segment without a pose is not drawn.
    """
    for k, segment in enumerate(MOVING):
        send_pose(stream, f"lab/body/{segment}", timelines, rotation[:, k], origin[:, k])


def send_pose(
    stream: rr.RecordingStream, entity: str, timelines: Timelines, rotation: Array, origin: Array
) -> None:
    """Give an entity, and everything attached to it, a pose over time.

    Parameters
    ----------
    stream, timelines
        Recording to write to, and the time of each row.
    entity
        Path of the entity.
    rotation, origin
        Its pose in the lab, (T, 3, 3) and (T, 3) [m]. Where it is NaN, the position stays NaN,
        which hides the entity.
    """
    known = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
    quaternion = Rotation.from_matrix(np.where(known[:, None, None], rotation, np.eye(3))).as_quat()
    always = np.ones((len(origin), 1), bool)
    send(
        stream,
        entity,
        timelines,
        rr.Transform3D,
        always,
        translation=origin[:, None],
        quaternion=quaternion[:, None],
    )


def _draw_shape(stream: rr.RecordingStream, entity: str, body: Body, segment: str) -> None:
    """Draw a segment's bones, joint to joint, and the hull of its joints and markers."""
    side = segment.partition("_")[0]
    colour = BODY_COLOURS.get(side, BODY_COLOURS["middle"])
    if segment == "head":
        stream.log(f"{entity}/bones", _head(body.segments["head"].center, colour), static=True)
        return
    ends = _bone_ends(body, segment)
    if not len(ends):
        return
    upward = [[0, 0, 1]]
    stream.log(
        f"{entity}/bones",
        rr.Capsules3D(
            lengths=np.linalg.norm(ends, axis=1),
            radii=BONE_RADIUS_M,
            translations=np.zeros_like(ends),
            quaternions=[Rotation.align_vectors([end], upward)[0].as_quat() for end in ends],
            colors=rgba(colour),
            fill_mode="solid",
            labels=segment.replace("_", " "),
            show_labels=False,
        ),
        static=True,
    )
    own = np.array([name == segment for name in body.marker_segment])
    points = np.vstack([np.zeros(3), ends, body.marker_position[own]])
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[2] < MIN_HULL_THICKNESS_M:
        return
    hull = ConvexHull(points)
    stream.log(
        f"{entity}/hull",
        rr.Mesh3D(
            vertex_positions=points[hull.simplices].reshape(-1, 3),
            vertex_normals=np.repeat(hull.equations[:, :3], 3, axis=0),
            albedo_factor=rgba(colour + HULL_ALPHA)[0],
        ),
        static=True,
    )


def _head(center: Array, colour: str) -> rr.Ellipsoids3D:
    """Give the head's ellipsoid about its centre of mass, (3,) in the head's frame [m]."""
    return rr.Ellipsoids3D(
        centers=[center],
        half_sizes=[HEAD_HALF_AXES * np.linalg.norm(center)],
        colors=rgba(colour),
        fill_mode="solid",
        labels="head",
        show_labels=False,
    )


def _ellipsoid(part: Inertia, segment: str) -> rr.Ellipsoids3D:
    """Give the ellipsoid of uniform density that has a segment's mass and inertia."""
    moments, axes = np.linalg.eigh(part.tensor)
    squares = 2.5 / part.mass * (moments.sum() - 2 * moments)
    axes[:, 2] *= np.linalg.det(axes)
    return rr.Ellipsoids3D(
        centers=[part.center],
        half_sizes=[np.sqrt(np.maximum(squares, 0))],
        quaternions=[Rotation.from_matrix(axes).as_quat()],
        colors=rgba(BODY_COLOURS["middle"]),
        fill_mode="majorwireframe",
        labels=segment.replace("_", " "),
        show_labels=False,
    )


def _bone_ends(body: Body, segment: str) -> Array:
    """Give the ends of a segment's bones in its frame, (K, 3) [m].

    They are its distal joints or, where it has none, twice as far as its centre of mass.
    """
    children = [body.offsets[s] for s, parent in PARENT.items() if parent == segment]
    if not children and segment in body.segments:
        children = [2 * body.segments[segment].center]
    ends = [end for end in children if np.linalg.norm(end) > MIN_BONE_LENGTH_M]
    return np.array(ends).reshape(-1, 3)
