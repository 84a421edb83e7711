"""What a subject's motion implies: the poses of the segments, and the wrench of the ground."""

from typing import Final

import numpy as np

from hbm.coordinates import MOVING
from hbm.kernels.native import kernels
from hbm.poses import segment_frames
from hbm.spatial import Array
from pipeline.virtual_lab.person.subject import VirtualSubject
from pipeline.virtual_lab.trajectories import Trajectory

CHUNK_FRAMES: Final = 6000
"""Frames that are computed at a time, to bound memory."""


def ground_wrench(subject: VirtualSubject, motion: Trajectory, time: Array, jobs: int = 1) -> Array:
    """Give the wrench that the ground must exert for a motion, (T, 6) [N, N·m].

    In lab axes about the lab origin; exact, from the subject's true body.
    """
    body, parts = subject.body, []
    for start in range(0, len(time), CHUNK_FRAMES):
        part = time[start : start + CHUNK_FRAMES]
        state = [motion.at(part, k) for k in range(3)]
        parts.append(
            kernels().newton_euler(*state, body.geometry, body.inertia_vector, jobs=jobs)[1]
        )
    return np.concatenate(parts)


def segment_poses(subject: VirtualSubject, q: Array, names: list[str]) -> list[tuple[Array, Array]]:
    """Give rotation and origin of some segments, (T, 3, 3) and (T, 3) [m] each."""
    chosen = [MOVING.index(name) for name in names]
    parts = [
        segment_frames(subject.body, q[k : k + CHUNK_FRAMES])
        for k in range(0, len(q), CHUNK_FRAMES)
    ]
    rotation = np.concatenate([R[:, chosen] for R, _ in parts])
    origin = np.concatenate([o[:, chosen] for _, o in parts])
    return list(zip(np.moveaxis(rotation, 1, 0), np.moveaxis(origin, 1, 0), strict=True))
