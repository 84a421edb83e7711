"""A starting pose from one frame's markers: segment by segment, each aligned with its markers.

The pelvis is fitted rigidly; every further segment is attached at its joint and rotates about it:
by the nearest rotation where the joint has three axes, by the best angle of each hinge where it has
one or two. From such a start Newton's method finds a pose; from zeros it converges to wrong minima.
"""

from collections.abc import Iterable
from typing import Final

import numpy as np

from hbm.coordinates import FIRST_Q, LAST_Q, MOVING, N_Q, PARENT
from hbm.ik.rotations import hinge_angles, nearest_rotation, rotation_terms, three_angles
from hbm.model import Joint
from hbm.spatial import Array, Mask

FOREARM_STARTS_RAD: Final = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)
"""Pronations from which elbow and forearm are improved in turn: any pronation is within 60° of
one."""

NEUTRAL_COVARIANCE: Final = 1e-6 * np.eye(3)
"""Added to a joint's cross-covariance [m²]: where no marker is seen the joint stays neutral; a
marker contributes 1e-3 m² or more, against which it is negligible."""

MIN_ROOT_MARKERS: Final = 3
"""Markers needed for the position and orientation of the pelvis."""

ROOT_SEGMENTS: Final = (
    ("pelvis",),
    ("pelvis", "thorax"),
    ("pelvis", "thorax", "right_thigh", "left_thigh"),
    MOVING,
)
"""Segments whose markers, with the joints held neutral, show the pelvis: the first that suffice."""

Poses = dict[str, tuple[Array, Array]]
"""Segment -> its rotation, (F, 3, 3), and origin, (F, 3) [m]."""


def starting_pose(
    position: Array,
    weight: Array,
    local: Array,
    segment: tuple[str, ...],
    joints: tuple[Joint, ...],
) -> Array:
    """Estimate the coordinates of many frames at once.

    Parameters
    ----------
    position
        Measured markers in the lab, (T, K, 3) [m]; any finite value where the weight is 0.
    weight
        Marker weights, 0 where missing, (T, K).
    local
        Marker positions in their segments, (K, 3) [m].
    segment
        Segment of each marker, (K,).
    joints
        The body's skeleton.

    Returns
    -------
    Array
        Coordinates, (T, 46). Coordinates without markers are zero. Frames with fewer than three
        markers are NaN.
    """
    return _Start(position, weight, local, segment, joints).coordinates()


class _Start:
    """The measured markers of some frames, and the body that is aligned with them."""

    def __init__(
        self,
        position: Array,
        weight: Array,
        local: Array,
        segment: tuple[str, ...],
        joints: tuple[Joint, ...],
    ) -> None:
        self.position, self.weight, self.local = position, weight, local
        self.offsets = {s: joints[i].offset for s, i in FIRST_Q.items()}
        own = np.array(segment)
        self.columns = {s: np.flatnonzero(own == s) for s in MOVING}
        self.rotations = {
            s: [i for i in range(FIRST_Q[s], LAST_Q[s] + 1) if not joints[i].translates]
            for s in MOVING
        }
        self.axis = np.array([joint.axis for joint in joints])
        self.terms = rotation_terms(self.axis)

    def coordinates(self) -> Array:
        R, o, solved = self.pelvis()
        q = np.zeros((len(self.position), N_Q))
        q[:, :3], q[:, 3:6] = o, three_angles(R, 3)
        self.align(q, {"pelvis": (R, o)}, MOVING[1:])
        q[~solved] = np.nan
        return q

    def pelvis(self) -> tuple[Array, Array, Mask]:
        """Fit the pelvis to its own markers; if they are few, with its neighbours held neutral."""
        frames = len(self.position)
        R, o = np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3))
        solved = np.zeros(frames, bool)
        neutral = {"pelvis": np.zeros(3)}
        for s in MOVING[1:]:
            neutral[s] = neutral[PARENT[s]] + self.offsets[s]
        for segments in ROOT_SEGMENTS:
            own = np.concatenate([self.columns[s] for s in segments])
            if len(own) < MIN_ROOT_MARKERS or solved.all():
                continue
            model = np.concatenate([neutral[s] + self.local[self.columns[s]] for s in segments])
            todo = ~solved & ((self.weight[:, own] > 0).sum(axis=1) >= MIN_ROOT_MARKERS)
            w = self.weight[todo][:, own]
            w = w / w.sum(axis=1, keepdims=True)
            measured = self.position[todo][:, own]
            center, model_center = np.einsum("tk,tki->ti", w, measured), w @ model
            centered = model - model_center[:, None]
            R[todo] = nearest_rotation(_cross_covariance(w, measured - center[:, None], centered))
            o[todo] = center - (R[todo] @ model_center[..., None])[..., 0]
            solved |= todo
        return R, o, solved

    def align(self, q: Array, poses: Poses, segments: Iterable[str]) -> None:
        """Align segments with their markers, from trunk to tip.

        Parameters
        ----------
        q
            Coordinates, (F, 46); those of the segments are overwritten.
        poses
            Of what carries the segments; theirs are added.
        segments
            Each after its parent.
        """
        for s in segments:
            R, o = poses[PARENT[s]]
            o = o + R @ self.offsets[s]
            own, to_parent = self.columns[s], np.swapaxes(R, 1, 2)
            w, from_joint = self.weight[:, own], self.position[:, own] - o[:, None]
            coordinates = slice(FIRST_Q[s], LAST_Q[s] + 1)
            q[:, coordinates] = 0
            if self.rotations[s] and len(own):
                covariance = to_parent @ _cross_covariance(w, from_joint, self.local[own])
                angles, rotation = self.rotate(s, covariance + NEUTRAL_COVARIANCE)
                q[:, coordinates] = angles
                R = R @ rotation
            elif len(own):
                mean = (to_parent @ _mean(w, from_joint)[..., None])[..., 0]
                translation = mean - _mean(w, self.local[own])
                q[:, coordinates] = translation @ self.axis[coordinates].T
                o = o + (R @ translation[..., None])[..., 0]
            poses[s] = R, o

    def rotate(self, s: str, covariance: Array) -> tuple[Array, Array]:
        """Align a segment about its joint: angles, (F, n), and their rotation, (F, 3, 3)."""
        joint = self.rotations[s]
        if len(joint) < 3:
            starts = FOREARM_STARTS_RAD if s.endswith("forearm") else (0.0,)
            return hinge_angles(covariance, self.terms[joint], starts)
        rotation = nearest_rotation(covariance)
        return three_angles(rotation, joint[0]), rotation


def _cross_covariance(w: Array, measured: Array, model: Array) -> Array:
    """Give weighted cross-covariances, (F, 3, 3), of (F, K, 3) with (K, 3) or (F, K, 3)."""
    return np.asarray(np.swapaxes(w[..., None] * measured, 1, 2) @ model)


def _mean(w: Array, points: Array) -> Array:
    """Give weighted means of points, (F, K, 3) or (K, 3); zero where nothing has weight."""
    total = w.sum(axis=1, keepdims=True)
    share = w / np.where(total > 0, total, 1)
    return np.asarray((share[:, None] @ points)[:, 0])
