"""MuJoCo with a hand-written Gauss–Newton on its sites, and its inverse dynamics."""

from pathlib import Path

import mujoco
import numpy as np

from tests.benchmarks.gauss_newton import solve

FEET = ("left_foot", "right_foot")


def tasks(folder: Path):
    given = dict(np.load(folder / "trial.npz"))
    program = MuJoCo(model_with_sites(folder / "body.urdf", given["markers"]), given)
    return {"ik": program.inverse_kinematics, "id": program.inverse_dynamics}


def model_with_sites(urdf, markers):
    """Load a body; its markers become sites, which are faster than bodies of their own."""
    spec = mujoco.MjSpec.from_file(str(urdf))
    for name in map(str, markers):
        link = spec.body(name)
        parent, place = link.parent, link.pos.copy()
        spec.delete(link)
        parent.add_site(name=name, pos=place)
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return spec.compile()


class MuJoCo:
    def __init__(self, model, given):
        self.model, self.data, self.given = model, mujoco.MjData(model), given
        self.dofs = [model.joint(str(name)).dofadr[0] for name in given["coordinates"]]
        self.sites = np.argsort([model.site(str(name)).id for name in given["markers"]])
        self.jacobian = np.zeros((model.nsite, 3, model.nv))

    def inverse_kinematics(self):
        start = np.empty(self.model.nq)
        start[self.dofs] = self.given["start"]
        measured = self.given["position"][:, self.sites]
        return solve(self.linearise, measured, start)[:, self.dofs]

    def linearise(self, q):
        model, data = self.model, self.data
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for site, rows in enumerate(self.jacobian):
            mujoco.mj_jacSite(model, data, rows, None, site)
        return data.site_xpos, self.jacobian.reshape(-1, model.nv)

    def inverse_dynamics(self):
        model, data = self.model, self.data
        q, v, a = (x[:, np.argsort(self.dofs)] for x in self.given["motion"])
        feet = [(model.body(foot).id, self.given[foot]) for foot in FEET]
        origin, tau, load = np.zeros(3), np.empty_like(q), np.empty(model.nv)
        for t in range(len(q)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[t], v[t], a[t]
            mujoco.mj_inverse(model, data)
            load[:] = 0
            for body, wrench in feet:
                mujoco.mj_applyFT(model, data, wrench[t, :3], wrench[t, 3:], origin, body, load)
            tau[t] = data.qfrc_inverse - load
        return tau[:, self.dofs]
