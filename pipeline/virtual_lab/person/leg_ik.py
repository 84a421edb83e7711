"""Inverse kinematics of the legs: joint angles from the pelvis and the poses of the soles."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.body import Body
from hbm.coordinates import INDEX, MOVING, N_Q
from hbm.kernels.native import kernels
from hbm.kernels.skeleton import N_SUMS
from hbm.spatial import Array
from pipeline.virtual_lab.person.sole import Sole

CHUNK_FRAMES: Final = 4000
"""Frames that are solved at a time, to bound memory."""
FIXED_WEIGHT: Final = 1e3
"""Weight that keeps a coordinate at its reference [m²/rad²]; so large that it does not move.
"""
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
TOLERANCE: Final = 1e-5
MAX_ITERATIONS: Final = 12
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


def solve_legs(
    body: Body,
    reference: Array,
    targets: Mapping[str, SoleTarget],
    start: Array,
    height_weight: float,
    jobs: int = 1,
) -> Array:
    """Find the joint angles of the legs with which the soles are where they should be.

    Parameters
    ----------
    body
        The person's body.
    reference
        Wanted coordinates, (T, 46); pelvis, trunk, head and arms are kept, the legs' are
        approached where the soles leave a choice or cannot be reached.
    targets
        Side -> target of its sole.
    start
        Coordinates to start from, (T, 46).
    height_weight
        Weight that keeps the pelvis at its height: m² per m² of the soles' points.
    jobs
        Number of threads.

    Returns
    -------
    Array
        Coordinates, (T, 46).

    Notes
    -----
    Least squares over four points of each sole by Gauss–Newton, with the inverse kinematics'
    kernel.
    """
    weights = np.full(N_Q, FIXED_WEIGHT)
    weights[INDEX["PelvisZ"]] = height_weight
    for name, value in JOINT_WEIGHTS.items():
        for side in "RL":
            weights[INDEX[side + name]] = value
    parts = (slice(k, k + CHUNK_FRAMES) for k in range(0, len(reference), CHUNK_FRAMES))
    solved = [
        _solve(
            body,
            reference[part],
            [target.frames(part) for target in targets.values()],
            start[part],
            weights,
            jobs,
        )
        for part in parts
    ]
    return np.concatenate(solved)


def _solve(
    body: Body,
    reference: Array,
    targets: list[SoleTarget],
    start: Array,
    weights: Array,
    jobs: int,
) -> Array:
    frames = len(reference)
    sums = np.zeros((frames, len(MOVING), N_SUMS))
    for target in targets:
        sole, weight = target.sole, target.weight
        rotation, origin = sole.foot_pose(target.rotation, target.position)
        ball, aside = sole.ball, BALL_HALF_WIDTH_M
        on_sole = np.array(
            [[sole.heel, 0, 0], [ball, aside, 0], [ball, -aside, 0], [0, 0, ANKLE_POINT_M]]
        )
        on_foot = (on_sole - sole.origin) @ sole.rotation
        in_lab = np.einsum("tij,kj->tki", rotation, on_foot) + origin[:, None]
        own = sums[:, MOVING.index(sole.segment)]
        (x, y, z), ones = on_foot.T, np.ones(len(on_foot))
        moments = np.stack([ones, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], axis=1)
        weighted = weight[:, :, None] * in_lab
        own[:, :10] = weight @ moments
        own[:, 10:13] = weighted.sum(axis=1)
        own[:, 13:22] = np.einsum("tki,ka->tai", weighted, on_foot).reshape(frames, 9)
        own[:, 22] = np.sum(weighted * in_lab, axis=(1, 2))
    flat_sums = sums.reshape(frames, -1)
    prior = np.tile(weights, (frames, 1))
    damping, curvature = np.full((frames, 1), DAMPING), np.zeros((frames, 1))
    q = start.copy()
    for _ in range(MAX_ITERATIONS):
        step, _ = kernels().newton_step(
            q, flat_sums, prior, reference, damping, curvature, body.geometry, jobs=jobs
        )
        q += np.clip(step, -MAX_STEP, MAX_STEP)
        if np.abs(step).max() < TOLERANCE:
            break
    return q
