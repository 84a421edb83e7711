"""Which implementation of the equations of motion runs: the package's own kernels, or Pinocchio."""

from collections.abc import Callable, Collection, Mapping
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hbm.coordinates import LAST_Q, N_Q, support
from hbm.spatial import Array, shift_wrench

if TYPE_CHECKING:
    from hbm.model import Body

FreeDynamics = tuple[Array, Array, Mapping[str, Array]]
"""What a motion needs where nothing but gravity acts on the body.

Generalized forces of the 46 coordinates, (T, 46) [N and N·m]; the wrench needed at the pelvis,
(T, 6), lab axes, about mid-hip; segment -> its motion per unit rate of each of the C coordinates
that carry it, in the order of `hbm.coordinates.support`, (T, C, 6): velocity of the point at the
lab origin, angular velocity, lab axes. The product with a wrench on the segment about the lab
origin is the wrench's generalized forces."""


class Engine(NamedTuple):
    """An implementation of the equations of motion.

    Attributes
    ----------
    name
        With the version of the library that it runs on, such as "Pinocchio 4.1.0".
    free_dynamics
        ``(body, q, v, a, segments, jobs)`` -> `FreeDynamics` with the Jacobians of the segments.
    """

    name: str
    free_dynamics: Callable[["Body", Array, Array, Array, Collection[str], int], FreeDynamics]


def choose_engine() -> Engine:
    """Give the engine to run: compiled kernels, else Pinocchio, else kernels that casadi runs."""
    from hbm.kernels.native import kernels  # casadi, which takes a moment

    compiled = kernels().solve_frames is not None
    return kernels_engine() if compiled else pinocchio_engine() or kernels_engine()


def pinocchio_engine() -> Engine | None:
    """Give Pinocchio as an engine; None where it cannot be imported."""
    try:
        import pinocchio

        from hbm.engines.pinocchio import free_dynamics
    except ImportError:
        return None
    return Engine(f"Pinocchio {pinocchio.__version__}", free_dynamics)


@cache
def kernels_engine() -> Engine:
    """Give the package's own kernels as an engine."""
    from hbm.kernels.native import kernels

    def free_dynamics(
        body: "Body", q: Array, v: Array, a: Array, segments: Collection[str], jobs: int
    ) -> FreeDynamics:
        tau, wrench, motion = kernels().newton_euler(
            q, v, a, body.geometry, body.inertia_vector, jobs=jobs
        )
        motion = motion.reshape(-1, N_Q, 6)
        jacobians = {s: motion[:, np.array(support(LAST_Q[s]))] for s in segments}
        return tau, shift_wrench(wrench, q[:, :3]), jacobians

    return Engine(f"kernels generated with CasADi {version('casadi')}", free_dynamics)
