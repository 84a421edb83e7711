"""A first guess of the pose: segment after segment, each turned onto its own markers.

The pelvis is fitted rigidly; every further segment hangs at its joint and turns about it: by the
nearest rotation where the joint has three axes, by turns about each hinge in closed form where it
has one or two. Where so few markers of an upper arm or thigh are visible that nothing shows its
twist, four twists are tried and the limb that meets its markers best is kept. A cold start from
zeros ends in wrong minima; this one does not.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.coordinates import FIRST, LAST, PARENT, SEGMENTS, TREE, N
from hbm.spatial import Array, Indices, Mask, fit_rotation, rotation_about

SWEEPS: Final = 4
FOREARM_TURNS: Final = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)
NEUTRAL_PULL: Final = 1e-6
SHOW_TWIST: Final = 2
BACKWARDS: Final = np.radians(-20.0)
TWISTS: Final = tuple(np.radians(range(45, 360, 45)))
ROOT_SEGMENTS: Final = ("pelvis", "trunk", "right_thigh", "left_thigh")
LIMBS: Final = {
    f"{side}_{first}": tuple(f"{side}_{s}" for s in (first, *rest))
    for side in ("right", "left")
    for first, *rest in (("upper_arm", "forearm", "hand"), ("thigh", "shank", "foot", "toes"))
}
CYCLIC: Final = {(0, 1, 2), (1, 2, 0), (2, 0, 1)}


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
        self.axis = [np.array(axes[c.name] if c.axis is None else c.axis, float) for c in TREE]

    def pose(self) -> Array:
        every = np.arange(len(self.position))
        R, o, solved = self.root()
        q, miss = self.hang(every, R, o, 0.0)
        for first, limb in LIMBS.items():
            own = self.columns[first]
            hard = every[(self.weight[:, own] > 0).sum(axis=1) < SHOW_TWIST]
            if not len(hard):
                continue
            chain = slice(FIRST[first], LAST[limb[-1]] + 1)
            best = _implausibility(q[hard], {s: miss[s][hard] for s in limb})
            for twist in TWISTS:
                other, misses = self.hang(hard, R[hard], o[hard], twist)
                total = _implausibility(other, {s: misses[s] for s in limb})
                better = total < best
                q[hard[better], chain] = other[better, chain]
                best = np.minimum(total, best)
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
            if len(own) < 3:
                continue
            model = np.concatenate([placed[s] + self.local[self.columns[s]] for s in chosen])
            todo = ~solved & ((self.weight[:, own] > 0).sum(axis=1) >= 3)
            w = self.weight[todo][:, own]
            w = w / w.sum(axis=1, keepdims=True)
            measured = self.position[todo][:, own]
            center, model_center = np.einsum("tk,tki->ti", w, measured), w @ model
            spread = model - model_center[:, None]
            R[todo] = fit_rotation(_cross(w, measured - center[:, None], spread))
            o[todo] = center - (R[todo] @ model_center[..., None])[..., 0]
            solved |= todo
        return R, o, solved

    def hang(
        self, rows: Indices, R: Array, o: Array, twist: float
    ) -> tuple[Array, dict[str, Array]]:
        """Hang all segments on a pelvis.

        Parameters
        ----------
        rows
            Which frames, (F,).
        R, o
            The pelvis in them, (F, 3, 3) and (F, 3).
        twist
            By how much to twist upper arms and thighs about their length [rad].

        Returns
        -------
        q
            Coordinates, (F, 46).
        miss
            Segment -> weighted sum of squared distances of its markers, (F,).
        """
        q = np.zeros((len(rows), N))
        q[:, :3], q[:, 3:6] = o, _three_angles(R, 3)
        pose, miss = {"pelvis": (R, o)}, {}
        for s in SEGMENTS[1:]:
            R, o = pose[PARENT[s]]
            o = o + R @ self.offsets[s]
            own, back = self.columns[s], np.swapaxes(R, 1, 2)
            w, away = self.weight[rows][:, own], self.position[rows][:, own] - o[:, None]
            if self.turning[s] and len(own):
                toward = back @ _cross(w, away, self.local[own]) + NEUTRAL_PULL * np.eye(3)
                q[:, self.turning[s]], turn = self.turn(s, toward, twist)
                R = R @ turn
            elif len(own):
                slide = (back @ _mean(w, away)[..., None])[..., 0] - _mean(w, self.local[own])
                q[:, FIRST[s] : LAST[s] + 1] = slide @ np.array(self.axis[FIRST[s] : LAST[s] + 1]).T
                o = o + (R @ slide[..., None])[..., 0]
            pose[s] = R, o
            left = self.position[rows][:, own] - o[:, None] - self.local[own] @ np.swapaxes(R, 1, 2)
            miss[s] = np.einsum("tk,tki,tki->t", w, left, left)
        return q, miss

    def turn(self, s: str, toward: Array, twist: float) -> tuple[Array, Array]:
        """Turn a segment's joint onto its markers: angles, (F, n), and rotation, (F, 3, 3)."""
        joints = self.turning[s]
        if len(joints) < 3:
            begins = FOREARM_TURNS if s.endswith("forearm") else (0.0,)
            return _hinge_angles(toward, [self.axis[i] for i in joints], begins)
        turn = fit_rotation(toward)
        if s in LIMBS and twist:
            seen = np.swapaxes(turn, 1, 2) @ toward
            turn = turn @ rotation_about(_strongest(seen), np.full(len(turn), twist))
        return _three_angles(turn, joints[0]), turn


def _implausibility(q: Array, limb: Mapping[str, Array]) -> Array:
    """Squared distances of a limb's markers, more where its elbow or knee bends backwards, (F,)."""
    hinge = FIRST[list(limb)[1]]
    return np.asarray(np.sum(list(limb.values()), axis=0) + (q[:, hinge] < BACKWARDS))


def _cross(w: Array, measured: Array, model: Array) -> Array:
    """Give weighted cross-covariances, (F, 3, 3), of (F, K, 3) with (K, 3) or (F, K, 3)."""
    return np.asarray(np.swapaxes(w[..., None] * measured, 1, 2) @ model)


def _mean(w: Array, points: Array) -> Array:
    """Give weighted means of points, (F, K, 3) or (K, 3); zero where nothing has weight."""
    total = w.sum(axis=1, keepdims=True)
    share = w / np.where(total > 0, total, 1)
    return np.asarray((share[:, None] @ points)[:, 0])


def _three_angles(R: Array, first: int) -> Array:
    """Split rotations into the angles of three consecutive coordinates with coordinate axes."""
    axes = [np.array(TREE[i].axis, float) for i in range(first, first + 3)]
    i, j, k = (int(np.argmax(np.abs(axis))) for axis in axes)
    sign = 1.0 if (i, j, k) in CYCLIC else -1.0
    angles = [
        np.arctan2(-sign * R[..., j, k], R[..., k, k]),
        np.arcsin(np.clip(sign * R[..., i, k], -1, 1)),
        np.arctan2(-sign * R[..., i, j], R[..., i, i]),
    ]
    return np.stack([angle * axis.sum() for angle, axis in zip(angles, axes, strict=True)], -1)


def _strongest(spread: Array) -> Array:
    """Give the direction in which a segment's markers lie from its joint, (F, 3)."""
    return np.asarray(np.linalg.eigh(spread + np.swapaxes(spread, 1, 2))[1][..., -1])


def _hinge_angles(
    toward: Array, hinges: list[Array], begins: tuple[float, ...]
) -> tuple[Array, Array]:
    """Turn one or two hinges in sequence onto the measured directions, each in closed form.

    Two hinges take turns, from one or more first angles of the second; the best end is kept.
    """
    if len(hinges) == 1:
        angle = _best_angle(toward, hinges[0])
        return angle[:, None], rotation_about(hinges[0], angle)
    ends = []
    for begin in begins:
        second = np.full(len(toward), begin)
        for _ in range(SWEEPS):
            after = rotation_about(hinges[1], second)
            first = _best_angle(toward @ np.swapaxes(after, 1, 2), hinges[0])
            before = rotation_about(hinges[0], first)
            second = _best_angle(np.swapaxes(before, 1, 2) @ toward, hinges[1])
        turn = before @ rotation_about(hinges[1], second)
        ends.append((np.stack([first, second], 1), turn, np.einsum("tij,tij->t", turn, toward)))
    best = np.argmax([met for _, _, met in ends], axis=0)
    rows = np.arange(len(toward))
    angles, turns = (np.stack([end[k] for end in ends])[best, rows] for k in (0, 1))
    return angles, turns


def _best_angle(toward: Array, axis: Array) -> Array:
    """Give the turns about an axis that come nearest to cross-covariances, (F,)."""
    twist = np.stack(
        [
            toward[:, 2, 1] - toward[:, 1, 2],
            toward[:, 0, 2] - toward[:, 2, 0],
            toward[:, 1, 0] - toward[:, 0, 1],
        ],
        -1,
    )
    cosine = np.trace(toward, axis1=1, axis2=2) - (toward @ axis) @ axis
    return np.asarray(np.arctan2(twist @ axis, cosine))
