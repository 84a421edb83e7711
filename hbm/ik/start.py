"""A first guess of the pose: segment after segment, each turned onto its own markers.

The pelvis is fitted rigidly; every further segment hangs at its joint and turns about it: by the
nearest rotation where the joint has three axes, by turns about each hinge in closed form where it
has one or two. Where so few markers of an upper arm or thigh are visible that nothing shows its
twist, several twists are tried and the limb that meets its markers best is kept. A cold start from
zeros ends in wrong minima; this one does not.
"""

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from hbm.coordinates import FIRST, LAST, PARENT, SEGMENTS, TREE, N, support
from hbm.ik.rotations import hinge_angles, nearest_rotation, parts_of_turns, three_angles
from hbm.spatial import Array, Indices, Mask, rotation_about

FOREARM_TURNS: Final = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)
NEUTRAL: Final = 1e-6 * np.eye(3)
SHOW_TWIST: Final = 2
BACKWARDS: Final = np.radians(-20.0)
TWISTS: Final = tuple(np.radians(range(45, 360, 45)))
ROOT_SEGMENTS: Final = ("pelvis", "trunk", "right_thigh", "left_thigh")
LIMBS: Final = {
    f"{side}_{first}": tuple(f"{side}_{s}" for s in (first, *rest))
    for side in ("right", "left")
    for first, *rest in (("upper_arm", "forearm", "hand"), ("thigh", "shank", "foot", "toes"))
}
Poses = dict[str, tuple[Array, Array]]


def starting_pose(
    position: Array,
    weight: Array,
    local: Array,
    segment: tuple[str, ...],
    offsets: Mapping[str, Array],
    axes: Mapping[str, Array],
) -> Array:
    """Guess the coordinates of many frames at once.

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
    offsets, axes
        The body's geometry (see `hbm.model.Body`).

    Returns
    -------
    Array
        Coordinates, (T, 46). Coordinates without markers are zero. Frames in which fewer than
        three markers show pelvis, trunk or thighs are NaN.
    """
    return _Start(position, weight, local, segment, offsets, axes).pose()


class _Start:
    """The measured markers of some frames, and the body that is hung onto them."""

    def __init__(
        self,
        position: Array,
        weight: Array,
        local: Array,
        segment: tuple[str, ...],
        offsets: Mapping[str, Array],
        axes: Mapping[str, Array],
    ) -> None:
        self.position, self.weight, self.local = position, weight, local
        self.offsets = offsets
        own = np.array(segment)
        self.columns = {s: np.flatnonzero(own == s) for s in SEGMENTS}
        self.turning = {
            s: [i for i in range(FIRST[s], LAST[s] + 1) if not TREE[i].translates] for s in SEGMENTS
        }
        self.axis = np.array([axes[c.name] if c.axis is None else c.axis for c in TREE], float)
        self.parts = parts_of_turns(self.axis)

    def pose(self) -> Array:
        every = np.arange(len(self.position))
        R, o, solved = self.root()
        q, pose = self.hang(every, R, o, np.zeros(len(every)), SEGMENTS[1:])
        for first, limb in LIMBS.items():
            own = self.columns[first]
            hard = every[(self.weight[:, own] > 0).sum(axis=1) < SHOW_TWIST]
            if not len(hard):
                continue
            again, twist = np.tile(hard, len(TWISTS)), np.repeat(TWISTS, len(hard))
            way = [s for s in SEGMENTS[1:] if s in limb or FIRST[s] in support(FIRST[first])]
            others, tried = self.hang(again, R[again], o[again], twist, way)
            before = self.implausibility(hard, limb, q[hard], pose, hard)
            after = self.implausibility(again, limb, others, tried).reshape(len(TWISTS), -1)
            best = after.argmin(axis=0) * len(hard) + np.arange(len(hard))
            better = after.min(axis=0) < before
            chain = slice(FIRST[first], LAST[limb[-1]] + 1)
            q[hard[better], chain] = others[best[better], chain]
        q[~solved] = np.nan
        return q

    def root(self) -> tuple[Array, Array, Mask]:
        """Fit the pelvis to its own markers; if they are few, with its neighbours held neutral."""
        frames = len(self.position)
        R, o = np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3))
        solved = np.zeros(frames, bool)
        placed = {"pelvis": np.zeros(3)}
        for s in SEGMENTS[1:]:
            placed[s] = placed[PARENT[s]] + self.offsets[s]
        for chosen in (ROOT_SEGMENTS[:1], ROOT_SEGMENTS[:2], ROOT_SEGMENTS):
            own = np.concatenate([self.columns[s] for s in chosen])
            if len(own) < 3 or solved.all():
                continue
            model = np.concatenate([placed[s] + self.local[self.columns[s]] for s in chosen])
            todo = ~solved & ((self.weight[:, own] > 0).sum(axis=1) >= 3)
            w = self.weight[todo][:, own]
            w = w / w.sum(axis=1, keepdims=True)
            measured = self.position[todo][:, own]
            center, model_center = np.einsum("tk,tki->ti", w, measured), w @ model
            spread = model - model_center[:, None]
            R[todo] = nearest_rotation(_cross(w, measured - center[:, None], spread))
            o[todo] = center - (R[todo] @ model_center[..., None])[..., 0]
            solved |= todo
        return R, o, solved

    def hang(
        self, rows: Indices, R: Array, o: Array, twist: Array, segments: Iterable[str]
    ) -> tuple[Array, Poses]:
        """Hang segments on a pelvis.

        Parameters
        ----------
        rows
            Which frames, (F,).
        R, o
            The pelvis in them, (F, 3, 3) and (F, 3).
        twist
            By how much to twist upper arms and thighs about their length, (F,) [rad].
        segments
            Which segments, each after the one it hangs on.

        Returns
        -------
        q
            Coordinates, (F, 46).
        pose
            Segment -> its rotation, (F, 3, 3), and origin, (F, 3).
        """
        q = np.zeros((len(rows), N))
        q[:, :3], q[:, 3:6] = o, three_angles(R, 3)
        pose = {"pelvis": (R, o)}
        for s in segments:
            R, o = pose[PARENT[s]]
            o = o + R @ self.offsets[s]
            own, back = self.columns[s], np.swapaxes(R, 1, 2)
            w, measured = self.weight[rows[:, None], own], self.position[rows[:, None], own]
            away = measured - o[:, None]
            if self.turning[s] and len(own):
                toward = back @ _cross(w, away, self.local[own]) + NEUTRAL
                q[:, self.turning[s]], turn = self.turn(s, toward, twist)
                R = R @ turn
            elif len(own):
                slide = (back @ _mean(w, away)[..., None])[..., 0] - _mean(w, self.local[own])
                q[:, FIRST[s] : LAST[s] + 1] = slide @ self.axis[FIRST[s] : LAST[s] + 1].T
                o = o + (R @ slide[..., None])[..., 0]
            pose[s] = R, o
        return q, pose

    def implausibility(
        self, rows: Indices, limb: tuple[str, ...], q: Array, pose: Poses, at: Indices | None = None
    ) -> Array:
        """Sum squared distances of a limb's markers, and more where its hinge bends backwards.

        Parameters
        ----------
        rows
            Which frames, (F,).
        limb
            Its segments, the elbow or knee between the first two.
        q
            Coordinates in them, (F, 46).
        pose
            Poses of the segments, in these frames or, if ``at`` is given, there.
        at
            Which of the poses, (F,).

        Returns
        -------
        Array
            (F,) [m² times the weights], and 1 more where the hinge bends backwards.
        """
        total = (q[:, FIRST[limb[1]]] < BACKWARDS).astype(float)
        for s in limb:
            own, (R, o) = self.columns[s], (x if at is None else x[at] for x in pose[s])
            model = self.local[own] @ np.swapaxes(R, 1, 2) + o[:, None]
            away = self.position[rows[:, None], own] - model
            total += np.einsum("tk,tki,tki->t", self.weight[rows[:, None], own], away, away)
        return np.asarray(total)

    def turn(self, s: str, toward: Array, twist: Array) -> tuple[Array, Array]:
        """Turn a segment's joint onto its markers: angles, (F, n), and rotation, (F, 3, 3)."""
        joints = self.turning[s]
        if len(joints) < 3:
            begins = FOREARM_TURNS if s.endswith("forearm") else (0.0,)
            return hinge_angles(toward, self.parts[joints], begins)
        turn = nearest_rotation(toward)
        if s in LIMBS and twist.any():
            seen = np.swapaxes(turn, 1, 2) @ toward
            turn = turn @ rotation_about(_strongest(seen), twist)
        return three_angles(turn, joints[0]), turn


def _cross(w: Array, measured: Array, model: Array) -> Array:
    """Give weighted cross-covariances, (F, 3, 3), of (F, K, 3) with (K, 3) or (F, K, 3)."""
    return np.asarray(np.swapaxes(w[..., None] * measured, 1, 2) @ model)


def _mean(w: Array, points: Array) -> Array:
    """Give weighted means of points, (F, K, 3) or (K, 3); zero where nothing has weight."""
    total = w.sum(axis=1, keepdims=True)
    share = w / np.where(total > 0, total, 1)
    return np.asarray((share[:, None] @ points)[:, 0])


def _strongest(spread: Array) -> Array:
    """Give the direction in which a segment's markers lie from its joint, (F, 3)."""
    return np.asarray(np.linalg.eigh(spread + np.swapaxes(spread, 1, 2))[1][..., -1])
