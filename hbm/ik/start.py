"""A starting pose from one frame's markers: segment by segment, each aligned with its markers.

The pelvis is fitted rigidly; every further segment is attached at its joint and rotates about it:
by the nearest rotation where the joint has three axes, by the best angle of each hinge where it has
one or two. Where so few markers of an upper arm or thigh are visible that nothing shows its axial
rotation, several axial rotations are tried and the one in which the limb fits its markers best is
kept. From such a start Newton's method finds the pose; from zeros it converges to wrong minima.
"""

from collections.abc import Iterable
from typing import Final

import numpy as np

from hbm.coordinates import FIRST_Q, LAST_Q, MOVING, N_Q, PARENT, support
from hbm.ik.rotations import hinge_angles, nearest_rotation, rotation_terms, three_angles
from hbm.model import Joint
from hbm.spatial import Array, Indices, Mask, rotation_about

FOREARM_STARTS_RAD: Final = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)
"""Pronations from which elbow and forearm are improved in turn: any pronation is within 60° of
one."""

NEUTRAL_COVARIANCE: Final = 1e-6 * np.eye(3)
"""Added to a joint's cross-covariance [m²]: where no marker is seen the joint stays neutral; a
marker contributes 1e-3 m² or more, against which it is negligible."""

MIN_MARKERS_AXIAL: Final = 2
"""Markers of an upper arm or thigh that show its axial rotation."""

MIN_FLEXION_RAD: Final = np.radians(-20.0)
"""Least flexion of elbow and knee: below it the limb bends the wrong way."""

AXIAL_ROTATIONS_RAD: Final = tuple(np.radians(range(45, 360, 45)))
"""Axial rotations tried where markers do not determine it: with zero, any is within 22.5° of
one."""

MIN_ROOT_MARKERS: Final = 3
"""Markers needed for the position and orientation of the pelvis."""

ROOT_SEGMENTS: Final = ("pelvis", "thorax", "right_thigh", "left_thigh")
"""Segments whose markers, with the joints held neutral, show the pelvis where its own are few."""

LIMBS: Final = {
    f"{side}_{first}": tuple(f"{side}_{s}" for s in (first, *rest))
    for side in ("right", "left")
    for first, *rest in (("upper_arm", "forearm", "hand"), ("thigh", "shank", "foot", "toes"))
}
"""First segment of each limb -> all its segments, elbow or knee between the first two."""

Poses = dict[str, tuple[Array, Array]]


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
        Coordinates, (T, 46). Coordinates without markers are zero. Frames in which fewer than
        three markers show pelvis, thorax or thighs are NaN.
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
        frames = np.arange(len(self.position))
        R, o, solved = self.pelvis()
        q, poses = self.align(frames, R, o, np.zeros(len(frames)), MOVING[1:])
        for first, limb in LIMBS.items():
            own = self.columns[first]
            unclear = frames[(self.weight[:, own] > 0).sum(axis=1) < MIN_MARKERS_AXIAL]
            if not len(unclear):
                continue
            tries = len(AXIAL_ROTATIONS_RAD)
            again, axial = np.tile(unclear, tries), np.repeat(AXIAL_ROTATIONS_RAD, len(unclear))
            chain = [s for s in MOVING[1:] if s in limb or FIRST_Q[s] in support(FIRST_Q[first])]
            tried_q, tried_poses = self.align(again, R[again], o[again], axial, chain)
            before = self.misfit(unclear, limb, q[unclear], poses, unclear)
            after = self.misfit(again, limb, tried_q, tried_poses).reshape(tries, -1)
            best = after.argmin(axis=0) * len(unclear) + np.arange(len(unclear))
            better = after.min(axis=0) < before
            coordinates = slice(FIRST_Q[first], LAST_Q[limb[-1]] + 1)
            q[unclear[better], coordinates] = tried_q[best[better], coordinates]
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
        for segments in (ROOT_SEGMENTS[:1], ROOT_SEGMENTS[:2], ROOT_SEGMENTS):
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

    def align(
        self, rows: Indices, R: Array, o: Array, axial: Array, segments: Iterable[str]
    ) -> tuple[Array, Poses]:
        """Align segments with their markers, from the pelvis outward.

        Parameters
        ----------
        rows
            Numbers of the frames, (F,).
        R, o
            The pelvis in them, (F, 3, 3) and (F, 3).
        axial
            Additional rotation of upper arms and thighs about their length, (F,) [rad].
        segments
            The segments, each after its parent.

        Returns
        -------
        q
            Coordinates, (F, 46).
        poses
            Segment -> its rotation, (F, 3, 3), and origin, (F, 3).
        """
        q = np.zeros((len(rows), N_Q))
        q[:, :3], q[:, 3:6] = o, three_angles(R, 3)
        poses = {"pelvis": (R, o)}
        for s in segments:
            R, o = poses[PARENT[s]]
            o = o + R @ self.offsets[s]
            own, to_parent = self.columns[s], np.swapaxes(R, 1, 2)
            w, measured = self.weight[rows[:, None], own], self.position[rows[:, None], own]
            from_joint = measured - o[:, None]
            if self.rotations[s] and len(own):
                covariance = to_parent @ _cross_covariance(w, from_joint, self.local[own])
                angles, rotation = self.rotate(s, covariance + NEUTRAL_COVARIANCE, axial)
                q[:, self.rotations[s]] = angles
                R = R @ rotation
            elif len(own):
                mean = (to_parent @ _mean(w, from_joint)[..., None])[..., 0]
                translation = mean - _mean(w, self.local[own])
                along = self.axis[FIRST_Q[s] : LAST_Q[s] + 1]
                q[:, FIRST_Q[s] : LAST_Q[s] + 1] = translation @ along.T
                o = o + (R @ translation[..., None])[..., 0]
            poses[s] = R, o
        return q, poses

    def misfit(
        self,
        rows: Indices,
        limb: tuple[str, ...],
        q: Array,
        poses: Poses,
        selected: Indices | None = None,
    ) -> Array:
        """Sum squared distances of a limb's markers, and 1 where its hinge bends the wrong way.

        Parameters
        ----------
        rows
            Numbers of the frames, (F,).
        limb
            Its segments, elbow or knee between the first two.
        q
            Coordinates in them, (F, 46).
        poses
            Of the segments, in these frames.
        selected
            Rows of the poses that belong to these frames, (F,); by default all.

        Returns
        -------
        Array
            (F,) [m² times the weights].
        """
        total = (q[:, FIRST_Q[limb[1]]] < MIN_FLEXION_RAD).astype(float)
        for s in limb:
            R, o = (x if selected is None else x[selected] for x in poses[s])
            own = self.columns[s]
            model = self.local[own] @ np.swapaxes(R, 1, 2) + o[:, None]
            error = self.position[rows[:, None], own] - model
            total += np.einsum("tk,tki,tki->t", self.weight[rows[:, None], own], error, error)
        return np.asarray(total)

    def rotate(self, s: str, covariance: Array, axial: Array) -> tuple[Array, Array]:
        """Align a segment about its joint: angles, (F, n), and their rotation, (F, 3, 3)."""
        joint = self.rotations[s]
        if len(joint) < 3:
            starts = FOREARM_STARTS_RAD if s.endswith("forearm") else (0.0,)
            return hinge_angles(covariance, self.terms[joint], starts)
        rotation = nearest_rotation(covariance)
        if s in LIMBS and axial.any():
            in_segment = np.swapaxes(rotation, 1, 2) @ covariance
            rotation = rotation @ rotation_about(_main_direction(in_segment), axial)
        return three_angles(rotation, joint[0]), rotation


def _cross_covariance(w: Array, measured: Array, model: Array) -> Array:
    """Give weighted cross-covariances, (F, 3, 3), of (F, K, 3) with (K, 3) or (F, K, 3)."""
    return np.asarray(np.swapaxes(w[..., None] * measured, 1, 2) @ model)


def _mean(w: Array, points: Array) -> Array:
    """Give weighted means of points, (F, K, 3) or (K, 3); zero where nothing has weight."""
    total = w.sum(axis=1, keepdims=True)
    share = w / np.where(total > 0, total, 1)
    return np.asarray((share[:, None] @ points)[:, 0])


def _main_direction(covariance: Array) -> Array:
    """Give the direction in which a segment's markers lie from its joint, (F, 3)."""
    symmetric = covariance + np.swapaxes(covariance, 1, 2)
    return np.asarray(np.linalg.eigh(symmetric)[1][..., -1])
