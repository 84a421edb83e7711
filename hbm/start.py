"""A first guess of the pose: segment after segment, each turned onto its own markers.

The pelvis is fitted rigidly; every further segment hangs at its joint and turns about it: by the
nearest rotation where the joint has three axes, by turns about each hinge in closed form where it
has one or two. A cold start from zeros ends in wrong minima; this one does not.
"""

from typing import Final

import numpy as np

from hbm.coordinates import FIRST, LAST, PARENT, SEGMENTS, TREE, N
from hbm.spatial import Array, Indices, Mask, fit_rotation, rotation_about

SWEEPS: Final = 6
NEUTRAL_PULL: Final = 1e-6
ROOT_SEGMENTS: Final = ("pelvis", "trunk", "right_thigh", "left_thigh")
CYCLIC: Final = {(0, 1, 2), (1, 2, 0), (2, 0, 1)}


def starting_pose(
    position: Array,
    weight: Array,
    local: Array,
    segment: tuple[str, ...],
    offsets: dict[str, Array],
    axes: dict[str, Array],
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
        The body's geometry (see `hbm.body.Body`).

    Returns
    -------
    Array
        Coordinates, (T, 46). Coordinates without markers are zero. Frames in which fewer than
        three markers show pelvis, trunk or thighs are NaN.
    """
    frames = len(position)
    q = np.zeros((frames, N))
    placed = _neutral_origins(offsets)
    columns = {s: np.array([k for k, own in enumerate(segment) if own == s], int) for s in SEGMENTS}

    R, o, solved = _fit_root(position, weight, local, columns, placed)
    q[:, :3] = o
    q[:, 3:6] = _three_angles(R, 3)
    pose = {"pelvis": (R, o)}
    for s in SEGMENTS[1:]:
        R, o = pose[PARENT[s]]
        o = o + R @ offsets[s]
        turning = [i for i in range(FIRST[s], LAST[s] + 1) if not TREE[i].translates]
        own = columns[s]
        if turning and len(own):
            w = weight[:, own, None]
            seen = w.sum(axis=(1, 2)) > 0
            cross = np.einsum("tki,kj->tij", w * (position[:, own] - o[:, None]), local[own])
            cross = np.swapaxes(R, 1, 2) @ np.where(seen[:, None, None], cross, 0)
            if len(turning) == 3:
                turn = fit_rotation(cross + NEUTRAL_PULL * np.eye(3))
                q[:, turning] = _three_angles(turn, turning[0])
            else:
                hinges = [
                    np.array(axes[TREE[i].name] if TREE[i].axis is None else TREE[i].axis)
                    for i in turning
                ]
                q[:, turning], turn = _hinge_angles(cross + NEUTRAL_PULL * np.eye(3), hinges)
            R = R @ turn
        pose[s] = R, o
    q[~solved] = np.nan
    return q


def _neutral_origins(offsets: dict[str, Array]) -> dict[str, Array]:
    """Origins of all segments in the pelvis frame, all coordinates zero."""
    placed = {"pelvis": np.zeros(3)}
    for s in SEGMENTS[1:]:
        placed[s] = placed[PARENT[s]] + offsets[s]
    return placed


def _fit_root(
    position: Array,
    weight: Array,
    local: Array,
    columns: dict[str, Indices],
    placed: dict[str, Array],
) -> tuple[Array, Array, Mask]:
    """Fit the pelvis to its own markers, or with its neighbours held neutral if they are few."""
    frames = len(position)
    R, o = np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3))
    solved = np.zeros(frames, bool)
    for chosen in (ROOT_SEGMENTS[:1], ROOT_SEGMENTS[:2], ROOT_SEGMENTS):
        own = np.concatenate([columns[s] for s in chosen])
        if len(own) < 3:
            continue
        model = np.concatenate([placed[s] + local[columns[s]] for s in chosen])
        todo = ~solved & ((weight[:, own] > 0).sum(axis=1) >= 3)
        w = weight[todo][:, own]
        w = w / w.sum(axis=1, keepdims=True)
        measured = position[todo][:, own]
        center, model_center = np.einsum("tk,tki->ti", w, measured), w @ model
        spread = model - model_center[:, None]
        cross = np.einsum("tk,tki,tkj->tij", w, measured - center[:, None], spread)
        R[todo] = fit_rotation(cross)
        o[todo] = center - (R[todo] @ model_center[..., None])[..., 0]
        solved |= todo
    return R, o, solved


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


def _hinge_angles(cross: Array, hinges: list[Array]) -> tuple[Array, Array]:
    """Turn one or two hinges in sequence onto the measured directions, each in closed form."""
    angles = np.zeros((len(cross), len(hinges)))
    turns = [np.tile(np.eye(3), (len(cross), 1, 1)) for _ in hinges]
    for _ in range(SWEEPS if len(hinges) > 1 else 1):
        for h, axis in enumerate(hinges):
            before = np.swapaxes(turns[0], 1, 2) if h == 1 else np.eye(3)
            after = np.swapaxes(turns[1], 1, 2) if h == 0 and len(hinges) == 2 else np.eye(3)
            rest = before @ cross @ after
            twist = np.stack(
                [
                    rest[:, 2, 1] - rest[:, 1, 2],
                    rest[:, 0, 2] - rest[:, 2, 0],
                    rest[:, 1, 0] - rest[:, 0, 1],
                ],
                -1,
            )
            cosine = np.trace(rest, axis1=1, axis2=2) - np.einsum("i,tij,j->t", axis, rest, axis)
            angles[:, h] = np.arctan2(twist @ axis, cosine)
            turns[h] = rotation_about(axis, angles[:, h])
    return angles, turns[0] if len(hinges) == 1 else turns[0] @ turns[1]
