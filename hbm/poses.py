"""Poses of segments, positions of markers and of the centre of mass at given coordinates."""

from collections.abc import Sequence

import numpy as np

from hbm.coordinates import MOVING
from hbm.kernels.native import kernels
from hbm.model import Body
from hbm.spatial import Array, in_lab_axes


def segment_frames(body: Body, q: Array) -> tuple[Array, Array]:
    """Give the frames of segments and shoulder points, in the order of `hbm.coordinates.MOVING`.

    Parameters
    ----------
    body
        The subject.
    q
        Coordinates, (T, 46) [m and rad].

    Returns
    -------
    rotation
        Orientations in the lab (columns: the segment's axes), (T, 19, 3, 3).
    origin
        Proximal joints in the lab, (T, 19, 3) [m].
    """
    poses = kernels().segment_poses(q, body.geometry)[0]
    # the kernel gives each frame column by column: three axes, then the origin
    poses = poses.reshape(len(q), len(MOVING), 4, 3)
    return np.swapaxes(poses[:, :, :3], 2, 3), poses[:, :, 3]


def joint_positions(body: Body, q: Array, segments: Sequence[str]) -> Array:
    """Give the proximal joints of some segments.

    Parameters
    ----------
    body
        The subject.
    q
        Coordinates, (T, 46) [m and rad].
    segments
        Of `hbm.coordinates.MOVING`.

    Returns
    -------
    Array
        Positions in the lab, (T, S, 3) [m].
    """
    return segment_frames(body, q)[1].take([MOVING.index(segment) for segment in segments], axis=1)


def marker_positions(body: Body, q: Array) -> Array:
    """Give the positions of the markers on the model, in the order of ``body.markers``.

    Parameters
    ----------
    body
        The subject.
    q
        Coordinates, (T, 46) [m and rad].

    Returns
    -------
    Array
        Positions in the lab, (T, K, 3) [m].
    """
    rotation, origin = segment_frames(body, q)
    segments = [MOVING.index(segment) for segment in body.marker_segment]
    # a third of the time of an index
    return origin.take(segments, axis=1) + in_lab_axes(
        rotation.take(segments, axis=1), body.marker_position
    )


def center_of_mass(body: Body, q: Array) -> Array:
    """Find the centre of mass of the whole body.

    Parameters
    ----------
    body
        The subject.
    q
        Coordinates, (T, 46) [m and rad].

    Returns
    -------
    Array
        Positions in the lab, (T, 3) [m].
    """
    bodies = body.rigid_bodies
    numbers = [MOVING.index(s) for s in bodies]
    rotation, origin = (frames[:, numbers] for frames in segment_frames(body, q))
    local = np.array([part.center for part in bodies.values()])
    # p = o + R p_local, averaged by mass: massless points do not count
    centers = origin + np.einsum("tsij,sj->tsi", rotation, local)
    return np.asarray(np.average(centers, axis=1, weights=[part.mass for part in bodies.values()]))
