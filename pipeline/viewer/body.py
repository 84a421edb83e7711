"""The body in the scene: every segment's frame, with bones, flesh and markers that ride on it."""

from typing import Final

import numpy as np
import rerun as rr
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from hbm.coordinates import MASSLESS, PARENT, SEGMENTS
from hbm.model import Body
from hbm.spatial import Array
from pipeline.viewer.file import Timelines, printable, rgba, send

MODELLED_COLOUR: Final = "#F0E442"
BODY_COLOURS: Final = {"left": "#BCD0EE", "right": "#F0DCBC", "middle": "#E2E2E2"}
FLESH_ALPHA: Final = "38"
FLAT_M: Final = 0.01
HEAD_HALF_AXES: Final = np.array([0.7, 0.55, 0.95])
"""Relative to the distance of the head's centre of mass from the neck."""


def log_body(
    stream: rr.RecordingStream, timelines: Timelines, body: Body, rotation: Array, origin: Array
) -> None:
    """Draw every segment's frame, bones and modelled markers, which move with the frame.

    Parameters
    ----------
    stream, timelines
        Where to and when.
    body
        The body.
    rotation, origin
        From `hbm.poses.segment_frames`. A segment without a pose is not drawn.
    """
    for k, segment in enumerate(SEGMENTS):
        entity = f"lab/body/{segment}"
        log_pose(stream, entity, timelines, rotation[:, k], origin[:, k])
        _log_shape(stream, entity, body, segment)
        stream.log(f"{entity}/frame", rr.TransformAxes3D(0.05), static=True)
        mine = [i for i, name in enumerate(body.marker_segment) if name == segment]
        if mine:
            stream.log(
                f"{entity}/markers",
                rr.Points3D(
                    body.marker_position[mine],
                    radii=0.006,
                    colors=rgba(MODELLED_COLOUR),
                    labels=[printable(f"{body.markers[i]}, modelled") for i in mine],
                    show_labels=False,
                ),
                static=True,
            )


def log_pose(
    stream: rr.RecordingStream, entity: str, timelines: Timelines, rotation: Array, origin: Array
) -> None:
    """Move an entity and all below it.

    Parameters
    ----------
    stream, timelines
        Where to and when.
    entity
        Path of the entity.
    rotation, origin
        Its pose in the lab, (T, 3, 3) and (T, 3) [m]. Where it is NaN, the position stays NaN,
        which hides the entity.
    """
    known = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
    quaternion = Rotation.from_matrix(np.where(known[:, None, None], rotation, np.eye(3))).as_quat()
    once = np.ones((len(origin), 1), bool)
    send(
        stream,
        entity,
        timelines,
        rr.Transform3D,
        once,
        translation=origin[:, None],
        quaternion=quaternion[:, None],
    )


def _log_shape(stream: rr.RecordingStream, entity: str, body: Body, segment: str) -> None:
    """Draw a segment: bones from its joint to the next, in the hull of its joints and markers."""
    side = segment.partition("_")[0]
    colour = BODY_COLOURS.get(side, BODY_COLOURS["middle"])
    if segment == "head":
        stream.log(f"{entity}/bones", _head(body.inertias["head"].center, colour), static=True)
        return
    ends = _bone_ends(body, segment)
    if not len(ends):
        return
    upward = [[0, 0, 1]]
    stream.log(
        f"{entity}/bones",
        rr.Capsules3D(
            lengths=np.linalg.norm(ends, axis=1),
            radii=0.016,
            translations=np.zeros_like(ends),
            quaternions=[Rotation.align_vectors([end], upward)[0].as_quat() for end in ends],
            colors=rgba(colour),
            fill_mode="solid",
            labels=segment.replace("_", " "),
            show_labels=False,
        ),
        static=True,
    )
    mine = np.array([name == segment for name in body.marker_segment])
    points = np.vstack([np.zeros(3), ends, body.marker_position[mine]])
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[2] < FLAT_M:
        return
    hull = ConvexHull(points)
    stream.log(
        f"{entity}/flesh",
        rr.Mesh3D(
            vertex_positions=points[hull.simplices].reshape(-1, 3),
            vertex_normals=np.repeat(hull.equations[:, :3], 3, axis=0),
            albedo_factor=rgba(colour + FLESH_ALPHA)[0],
        ),
        static=True,
    )


def _head(center: Array, colour: str) -> rr.Ellipsoids3D:
    """Draw a head about its centre of mass, sized by that point's distance from the neck."""
    return rr.Ellipsoids3D(
        centers=[center],
        half_sizes=[HEAD_HALF_AXES * np.linalg.norm(center)],
        colors=rgba(colour),
        fill_mode="solid",
        labels="head",
        show_labels=False,
    )


def _bone_ends(body: Body, segment: str) -> Array:
    """Give where a segment's bones end, in its frame: at the next joints, or beyond its mass."""
    children = [body.offsets[s] for s, parent in PARENT.items() if parent == segment]
    if not children and segment not in MASSLESS:
        children = [2 * body.inertias[segment].center]
    return np.array([end for end in children if np.linalg.norm(end) > 1e-3]).reshape(-1, 3)
