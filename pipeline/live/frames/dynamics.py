"""Inverse dynamics of one frame by the kernels, in arrays that stay."""

import numpy as np

from hbm.coordinates import LAST_Q, MOVING, N_Q, support
from hbm.kernels.kernel import OneFrameKernel
from hbm.kernels.native import kernels
from hbm.model import Body
from hbm.spatial import Array, shift_wrench
from pipeline.trial.gait.carried import PLACES
from pipeline.trial.gait.contact import FEET

OF_PLACES = [MOVING.index(segment) for segment in PLACES]


class LiveDynamics:
    """The equations of motion of one body.

    Parameters
    ----------
    body
        The subject.
    """

    def __init__(self, body: Body) -> None:
        ready = kernels()
        self.segment_poses = OneFrameKernel(ready.segment_poses, body.geometry)
        self.newton_euler = OneFrameKernel(ready.newton_euler, body.geometry, body.inertia_vector)
        self.chains = [np.array(support(LAST_Q[foot])) for foot in FEET]

    def feet(self, q: Array) -> Array:
        """Give the middle of the left and the right foot, ankle to toes, (2, 3) [m].

        Parameters
        ----------
        q
            Coordinates, (46,) [m and rad].
        """
        ankles_and_balls = self.places(q)[1:]
        return np.asarray((ankles_and_balls[:2] + ankles_and_balls[2:]) / 2)

    def places(self, q: Array) -> Array:
        """Give pelvis, ankles and balls, left before right, coordinates (46,) to (5, 3) [m]."""
        (poses,) = self.segment_poses(q)
        return np.asarray(poses.reshape(len(MOVING), 4, 3)[OF_PLACES, 3])

    def needed(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """Give what a motion needs where nothing but gravity acts, as `hbm.engines`.

        Returns
        -------
        tau
            Generalized forces, (46,) [N, N·m].
        wrench
            On the pelvis, lab axes about the lab origin, (6,) [N, N·m].
        motion
            Of each coordinate per unit rate, (46, 6).
        """
        tau, wrench, motion = self.newton_euler(q, v, a)
        return tau.copy(), wrench.copy(), motion.reshape(N_Q, 6).copy()

    def under(
        self, needed: tuple[Array, Array, Array], by_foot: Array, pelvis: Array
    ) -> tuple[Array, Array]:
        """Give generalized forces and residuals with wrenches on the feet, of V variants.

        Parameters
        ----------
        needed
            As `needed` gives it.
        by_foot
            On the left and the right foot, lab axes about the lab origin, (V, 2, 6) [N, N·m].
        pelvis
            Mid-hip in the lab, (3,) [m].

        Returns
        -------
        tau, residual
            (V, 46) and (V, 6) [N, N·m].
        """
        alone, wrench, motion = needed
        tau = np.tile(alone, (len(by_foot), 1))
        for foot, chain in enumerate(self.chains):
            tau[:, chain] -= by_foot[:, foot] @ motion[chain].T
        return tau, shift_wrench(wrench - by_foot.sum(axis=1), pelvis)
