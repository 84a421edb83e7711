"""Inverse dynamics of one frame by the kernels, in arrays that stay."""

import numpy as np

from hbm.coordinates import LAST_Q, MOVING, N_Q, support
from hbm.kernels.native import kernels
from hbm.model import Body
from hbm.spatial import Array, shift_wrench
from pipeline.trial.gait.contact import FEET
from pipeline.trial.gait.events import SIDES

ANKLES, TOES = ([MOVING.index(f"{s}_{part}") for s in SIDES] for part in ("foot", "toes"))


class LiveDynamics:
    """The equations of motion of one body.

    Parameters
    ----------
    body
        The subject.
    """

    def __init__(self, body: Body) -> None:
        self.kernels = kernels()
        self.geometry, self.inertia = body.geometry, body.inertia_vector
        self.chains = [np.array(support(LAST_Q[foot])) for foot in FEET]

    def feet(self, q: Array) -> Array:
        """Give the middle of the left and the right foot, ankle to toes, (2, 3) [m].

        Parameters
        ----------
        q
            Coordinates, (46,) [m and rad].
        """
        (poses,) = self.kernels.segment_poses(q[None], self.geometry)
        joints = poses.reshape(len(MOVING), 4, 3)[:, 3]
        return np.asarray((joints[ANKLES] + joints[TOES]) / 2)

    def needed(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """Give what a motion needs where nothing but gravity acts, as `hbm.engines`.

        Returns
        -------
        tau
            Generalized forces, (46,) [N, N·m].
        wrench
            On the pelvis, lab axes about mid-hip, (6,) [N, N·m].
        motion
            Of each coordinate per unit rate, (46, 6).
        """
        tau, wrench, motion = self.kernels.newton_euler(
            q[None], v[None], a[None], self.geometry, self.inertia
        )
        return tau[0], shift_wrench(wrench[0], q[:3]), motion.reshape(N_Q, 6)

    def under(
        self, needed: tuple[Array, Array, Array], by_foot: Array, pelvis: Array
    ) -> tuple[Array, Array]:
        """Give the generalized forces, (46,), and the residual, (6,), with wrenches on the feet.

        Parameters
        ----------
        needed
            As `needed` gives it.
        by_foot
            On the left and the right foot, lab axes about the lab origin, (2, 6) [N, N·m].
        pelvis
            Mid-hip in the lab, (3,) [m].
        """
        tau, wrench, motion = needed
        tau = tau.copy()
        for chain, acting in zip(self.chains, by_foot, strict=True):
            tau[chain] -= motion[chain] @ acting
        return tau, wrench - shift_wrench(by_foot[0] + by_foot[1], pelvis)
