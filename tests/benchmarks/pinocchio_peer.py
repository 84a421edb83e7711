"""Pinocchio with a Gauss–Newton in NumPy, and its recursive Newton–Euler algorithm."""

from pathlib import Path

import numpy as np
import pinocchio as pin

from tests.benchmarks.gauss_newton import solve

FEET = ("left_foot", "right_foot")


def tasks(folder: Path):
    given = dict(np.load(folder / "trial.npz"))
    program = Pinocchio(load_model(folder), given)
    return {"ik": program.inverse_kinematics, "id": program.inverse_dynamics}


def load_model(folder: Path):
    return pin.buildModelFromUrdf(str(folder / "body.urdf"))


class Pinocchio:
    def __init__(self, model, given):
        self.model, self.data, self.given = model, model.createData(), given
        ours = [str(name) for name in given["coordinates"]]
        self.order = [ours.index(name) for name in list(model.names)[1:]]
        frames = [model.frames[model.getFrameId(str(name))] for name in given["markers"]]
        self.joints, self.owner = np.unique([f.parentJoint for f in frames], return_inverse=True)
        self.local = np.array([f.placement.translation for f in frames])
        moved = np.array([self.coordinates_of(int(joint)) for joint in self.joints])
        self.mask = np.repeat(moved[self.owner], 3, axis=0).astype(float)
        self.maps = np.zeros((len(frames), 3, 6))
        self.maps[:, (0, 1, 2), (0, 1, 2)] = 1

    def coordinates_of(self, joint):
        """Mark the coordinates that move a joint."""
        return np.isin(np.arange(1, self.model.njoints), list(self.model.supports[joint]))

    def inverse_kinematics(self):
        measured, start = self.given["position"], self.given["start"][self.order]
        return self.in_our_order(solve(self.linearise, measured, start))

    def linearise(self, q):
        """Map the joint Jacobians (v above ω) to the velocities of all markers: v + ω × r."""
        motions = pin.computeJointJacobians(self.model, self.data, q)
        poses = np.array([self.data.oMi[int(j)].homogeneous for j in self.joints])[self.owner]
        points = np.einsum("kij,kj->ki", poses[:, :3, :3], self.local) + poses[:, :3, 3]
        x, y, z = points.T
        rotation = self.maps[:, :, 3:]
        rotation[:, 0, 1], rotation[:, 0, 2] = z, -y
        rotation[:, 1, 0], rotation[:, 1, 2] = -z, x
        rotation[:, 2, 0], rotation[:, 2, 1] = y, -x
        jacobian = self.maps.reshape(-1, 6) @ motions
        jacobian *= self.mask
        return points, jacobian

    def inverse_dynamics(self):
        model, data = self.model, self.data
        q, v, a = (x[:, self.order] for x in self.given["motion"])
        feet = [(model.frames[model.getFrameId(f)].parentJoint, self.given[f]) for f in FEET]
        loads = pin.StdVec_Force()
        loads.extend([pin.Force.Zero() for _ in range(model.njoints)])
        tau = np.empty_like(q)
        for t in range(len(q)):
            pin.forwardKinematics(model, data, q[t])
            for joint, wrench in feet:
                loads[joint] = data.oMi[joint].actInv(pin.Force(wrench[t]))
            tau[t] = pin.rnea(model, data, q[t], v[t], a[t], loads)
        return self.in_our_order(tau)

    def in_our_order(self, columns):
        out = np.empty_like(columns)
        out[:, self.order] = columns
        return out
