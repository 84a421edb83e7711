"""Inverse dynamics by Pinocchio: the recursive Newton–Euler algorithm on the body's own model.

The forces on the pelvis' three rotations are projections of the moment on axes that depend on the
pose, and at ±90° of pitch two of these axes coincide. This model therefore has two more
joints that always stand still, about the lab's X and Y axes at mid-hip, before the pelvis' rotation
about Z. The forces on these three joints are the moment about mid-hip in lab axes, in every pose.

Source: Carpentier et al. 2019 (IEEE/SICE Int Symp System Integration, 614) for the library,
Featherstone 2008 (Rigid Body Dynamics Algorithms) for the algorithm.
"""

from collections.abc import Collection
from functools import lru_cache
from typing import Any, Final

import numpy as np
import pinocchio as pin

from hbm.coordinates import INDEX, LAST_Q, N_Q, support
from hbm.model import Body
from hbm.spatial import GRAVITY_MPS2, Array

YAW: Final = INDEX["PelvisYaw"]
N_STILL: Final = 2
"""The joints that stand still come before yaw; with it, they are those of the moment."""
CACHED_BODIES: Final = 8


def free_dynamics(
    body: Body, q: Array, v: Array, a: Array, segments: Collection[str]
) -> tuple[Array, Array, dict[str, Array]]:
    """Give what a motion needs where nothing but gravity acts on the body.

    Generalised forces, (T, 46); the wrench needed at mid-hip, lab axes, (T, 6); segment -> its
    motion per unit rate of each coordinate that carries it, (T, C, 6). Undefined frames are NaN.
    """
    state = np.zeros((3, len(q), N_Q + N_STILL))
    for x, given in zip(state, (q, v, a), strict=True):
        x[:, :YAW], x[:, YAW + N_STILL :] = given[:, :YAW], given[:, YAW:]
    tau = np.empty_like(state[0])
    model = _model(body)
    data = model.createData()
    for frame, *of_frame in zip(tau, *state, strict=True):
        frame[:] = pin.rnea(model, data, *of_frame)
    forces = np.hstack([tau[:, :YAW], tau[:, YAW + N_STILL :]])
    return forces, tau[:, :6], _jacobians(body, q, segments)


def _jacobians(body: Body, q: Array, segments: Collection[str]) -> dict[str, Array]:
    chains = {s: support(LAST_Q[s]) for s in segments}
    carrying = sorted(set().union(*chains.values()))
    if not carrying:
        return {}
    model = _carrying_model(body, tuple(carrying))
    data = model.createData()
    motion = np.empty((len(q), len(carrying), 6))
    for frame, coordinates in zip(motion, q[:, carrying], strict=True):
        frame[:] = pin.computeJointJacobians(model, data, coordinates).T
    return {s: motion[:, np.searchsorted(carrying, chain)] for s, chain in chains.items()}


@lru_cache(maxsize=CACHED_BODIES)
def _model(body: Body) -> Any:
    """Copy the body's model, with the two joints that stand still."""
    model, copy, place = body.model, pin.Model(), [0]
    copy.gravity.linear = np.array([0.0, 0.0, -GRAVITY_MPS2])
    for i in range(1, model.njoints):
        parent = place[model.parents[i]]
        if i == YAW + 1:
            for joint in (pin.JointModelRX(), pin.JointModelRY()):
                parent = copy.addJoint(parent, joint, pin.SE3.Identity(), joint.shortname())
        place.append(_add_joint(copy, parent, model, i))
        copy.appendBodyToJoint(place[i], model.inertias[i], pin.SE3.Identity())
    return copy


@lru_cache(maxsize=CACHED_BODIES)
def _carrying_model(body: Body, coordinates: tuple[int, ...]) -> Any:
    """Copy those joints of the body's model that carry some segments, without inertias."""
    copy, place = pin.Model(), {0: 0}
    for i in (c + 1 for c in coordinates):
        place[i] = _add_joint(copy, place[body.model.parents[i]], body.model, i)
    return copy


def _add_joint(copy: Any, parent: int, model: Any, i: int) -> int:
    joint: int = copy.addJoint(parent, model.joints[i], model.jointPlacements[i], model.names[i])
    return joint
