"""Inverse kinematics of the legs: joint angles from the pelvis and the poses of the soles."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.coordinates import INDEX
from hbm.spatial import Array
from pipeline.virtual_lab.person.body.extra_joints import ExtraJoints
from pipeline.virtual_lab.person.body.kinematics import Frame, chunks, frames, moved, placed
from pipeline.virtual_lab.person.body.skeleton import COLUMN, KNEE, LINKS, Skeleton
from pipeline.virtual_lab.person.sole import Sole

JOINT_WEIGHTS: Final = {
    "HipFlexion": 3e-4,
    "HipAbduction": 3e-4,
    "HipInternalRotation": 1e-3,
    "KneeFlexion": 1e-3,
    "AnklePlantarFlexion": 1e-4,
    "FootPronation": 1e-4,
}
"""Weights of the legs' coordinates towards their reference [m²/rad² per unit weight of a sole's
points]; chosen, small against the soles'. The knee's is larger, for a leg that is nearly straight
would otherwise bend by jerks."""
BALL_HALF_WIDTH_M: Final = 0.04
ANKLE_POINT_M: Final = 0.08
"""Sideways place of the two points of the ball, and height of a point near the ankle, by which a
sole is held."""
DAMPING: Final = 1e-6
MAX_STEP: Final = 0.2
TOLERANCE: Final = 1e-4
"""Of the Gauss-Newton iteration: damping, largest step and step at which it ends [rad and m]."""


@dataclass(frozen=True, slots=True)
class SoleTarget:
    """Where a sole should be.

    Attributes
    ----------
    sole
        The foot's sole.
    rotation, position
        Pose of the sole in the lab, (T, 3, 3) and (T, 3) [m].
    weight
        Weights of heel, ball inside and outside, and ankle, (T, 4).
    """

    sole: Sole
    rotation: Array
    position: Array
    weight: Array

    def frames(self, part: slice) -> "SoleTarget":
        """Give the target in some frames."""
        return SoleTarget(self.sole, self.rotation[part], self.position[part], self.weight[part])


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points of a foot: in its frame (4, 3), where they should be (3, 4, T), weights (4, T)."""

    on_foot: Array
    wanted: Array
    weight: Array


def solve_legs(
    skeleton: Skeleton,
    extra: ExtraJoints,
    reference: Array,
    targets: Mapping[str, SoleTarget],
    start: Array,
    height_weight: float,
    iterations: int,
) -> Array:
    """Find the joint angles of the legs with which the soles are where they should be.

    Parameters
    ----------
    skeleton, extra
        The person's.
    reference
        Wanted coordinates, (46, T); pelvis, trunk, head and arms are kept, the legs' are
        approached where the soles leave a choice or cannot be reached.
    targets
        Side -> target of its sole.
    start
        Coordinates to start from, (46, T).
    height_weight
        Weight that keeps the pelvis at its height: m² per m² of the soles' points.
    iterations
        At most.

    Returns
    -------
    Array
        Coordinates, (46, T).

    Notes
    -----
    Least squares over four points of each sole by Gauss–Newton. Each leg's six angles are
    eliminated from the normal equations, which leaves one for the pelvis' height.
    """
    solved = start.copy()
    points = {side: _points(target) for side, target in targets.items()}
    for part in chunks(reference.shape[1]):
        own = {
            side: _Points(p.on_foot, p.wanted[..., part], p.weight[:, part])
            for side, p in points.items()
        }
        solved[:, part] = _solve(
            skeleton, extra, reference[:, part], own, start[:, part], height_weight, iterations
        )
    return solved


def _points(target: SoleTarget) -> _Points:
    sole = target.sole
    rotation, origin = sole.foot_pose(target.rotation, target.position)
    ball, aside = sole.ball, BALL_HALF_WIDTH_M
    on_sole = np.array(
        [[sole.heel, 0, 0], [ball, aside, 0], [ball, -aside, 0], [0, 0, ANKLE_POINT_M]]
    )
    on_foot = (on_sole - sole.origin) @ sole.rotation
    wanted = np.einsum("tij,kj->ikt", rotation, on_foot) + origin.T[:, None]
    return _Points(on_foot, wanted, np.ascontiguousarray(target.weight.T))


def _solve(
    skeleton: Skeleton,
    extra: ExtraJoints,
    reference: Array,
    points: Mapping[str, _Points],
    start: Array,
    height_weight: float,
    iterations: int,
) -> Array:
    q, height = reference.copy(), INDEX["PelvisZ"]
    q[height] = 0.0
    pelvis = frames(skeleton, (q,), ["pelvis"])["pelvis"]
    solved = [height, *(INDEX[letter + name] for letter in "RL" for name in JOINT_WEIGHTS)]
    q[solved] = start[solved]
    for _ in range(iterations):
        total = np.full(q.shape[1], height_weight + DAMPING)
        right = height_weight * (reference[height] - q[height])
        legs = []
        for side, own in points.items():
            letter = side[0].upper()
            rows = [INDEX[letter + name] for name in JOINT_WEIGHTS]
            jacobian, error = _jacobian(skeleton, extra, pelvis, q, letter, own)
            weighted = jacobian * own.weight
            prior = np.array(list(JOINT_WEIGHTS.values()))[:, None]
            square = np.einsum("aikt,bikt->abt", weighted, jacobian)
            square[range(6), range(6)] += prior + DAMPING
            wanted = np.einsum("aikt,ikt->at", weighted, error)
            wanted += prior * (reference[rows] - q[rows])
            coupling = weighted[:, 2].sum(axis=1)
            solution = _solve_symmetric(square, np.stack([wanted, coupling], axis=1))
            total += own.weight.sum(axis=0) - (coupling * solution[:, 1]).sum(axis=0)
            right += (own.weight * error[2]).sum(axis=0) - (coupling * solution[:, 0]).sum(axis=0)
            legs.append((rows, solution))
        rise = np.clip(right / total, -MAX_STEP, MAX_STEP)
        q[height] += rise
        largest = float(np.abs(rise).max())
        for rows, solution in legs:
            step = np.clip(solution[:, 0] - solution[:, 1] * rise, -MAX_STEP, MAX_STEP)
            q[rows] += step
            largest = max(largest, float(np.abs(step).max()))
        if largest < TOLERANCE:
            break
    return q


def _jacobian(
    skeleton: Skeleton, extra: ExtraJoints, pelvis: Frame, q: Array, letter: str, points: _Points
) -> tuple[Array, Array]:
    """Give how a sole's points move with the leg's angles, (6, 3, 4, T), and their error."""
    origin = pelvis.origin.copy()
    origin[2] += q[INDEX["PelvisZ"]]
    frame = Frame(pelvis.rotation, origin, pelvis.acceleration)
    knee = extra.of_knee(letter, q[INDEX[letter + "KneeFlexion"]])
    axes, places, segment = [], [], "pelvis"
    for k, link in _LEGS[letter]:
        if link.segment != segment:
            segment = link.segment
            frame = placed(frame, skeleton.offsets[segment])
        name = link.name[1:]
        if name in JOINT_WEIGHTS:
            axes.append(skeleton.axes[k] @ frame.rotation[0])
            places.append(frame.origin)
            value = q[COLUMN[link.name]]
        else:
            value = knee[KNEE.index(name)]
        frame = moved(frame, link, skeleton.axes[k], (value,))
    position = np.stack([frame.point(point) for point in points.on_foot], axis=1)
    jacobian = np.empty((len(axes), *position.shape))
    for row, axis, place in zip(jacobian, axes, places, strict=True):
        arm = position - place[:, None]
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            row[i] = axis[j] * arm[k] - axis[k] * arm[j]
    return jacobian, points.wanted - position


def _solve_symmetric(matrix: Array, right: Array) -> Array:
    """Solve positive definite systems (N, N, T) for right sides (N, M, T) by Cholesky's method."""
    count = len(matrix)
    lower, solution = np.zeros_like(matrix), right.copy()
    for j in range(count):
        below = matrix[j:, j] - (lower[j:, :j] * lower[j, :j]).sum(axis=1)
        lower[j:, j] = below / np.sqrt(below[0])
        solution[j] -= (lower[j, :j, None] * solution[:j]).sum(axis=0)
        solution[j] /= lower[j, j]
    for j in reversed(range(count)):
        solution[j] -= (lower[j + 1 :, j, None] * solution[j + 1 :]).sum(axis=0)
        solution[j] /= lower[j, j]
    return solution


_LEGS: Final = {
    letter: [
        (k, link)
        for k, link in enumerate(LINKS)
        if link.name.startswith(letter) and link.name[1:] in (*JOINT_WEIGHTS, *KNEE)
    ]
    for letter in "RL"
}
"""The coordinates from the pelvis to each foot."""
