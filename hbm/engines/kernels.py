"""Inverse dynamics by the package's own kernels (`hbm.kernels.skeleton.newton_euler`)."""

from collections.abc import Collection

import numpy as np

from hbm.coordinates import LAST_Q, N_Q, support
from hbm.engines.engine import FreeDynamics
from hbm.kernels.native import kernels
from hbm.model import Body
from hbm.spatial import Array, shift_wrench


def free_dynamics(
    body: Body, q: Array, v: Array, a: Array, segments: Collection[str], jobs: int
) -> FreeDynamics:
    """Find what a motion needs where nothing but gravity acts on the body.

    Parameters
    ----------
    body
        The subject.
    q, v, a
        Coordinates and their derivatives, (T, 46) each.
    segments
        Those whose Jacobians are wanted.
    jobs
        Threads.

    Returns
    -------
    FreeDynamics
        Undefined frames are NaN.
    """
    state = q, v, a
    tau, wrench, motion = kernels().newton_euler(
        *state, body.geometry, body.inertia_vector, jobs=jobs
    )
    motion = motion.reshape(-1, N_Q, 6)
    jacobians = {s: motion[:, np.array(support(LAST_Q[s]))] for s in segments}
    return FreeDynamics(tau, shift_wrench(wrench, q[:, :3]), jacobians)
