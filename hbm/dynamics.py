"""Inverse dynamics of a filtered motion, and the pelvis residual."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, INDEX, LAST_Q, N_Q, support
from hbm.kernels.native import kernels
from hbm.model import Body
from hbm.motion import Motion
from hbm.signals.filtering import Method, butterworth
from hbm.spatial import Array, Mask, freeze_arrays, frozen, shift_wrench

FRAMES_AT_ONCE: Final = 2000
"""Bounds the memory for intermediate results, 2 to 3 kB a frame."""


@dataclass(frozen=True, slots=True)
class Dynamics:
    """Generalized forces and pelvis residual of a motion.

    Attributes
    ----------
    time
        (T,) [s].
    tau
        Generalized forces of the 46 coordinates in the order of `hbm.coordinates.COORDINATES`,
        (T, 46) [N and N·m]; the first six are the residual on the pelvis coordinates' own axes.
    residual
        Wrench that would have to act on the pelvis to close the equations of motion, (T, 6) [N,
        N·m]: lab axes (X forward, Y left, Z up), about the pelvis origin (mid-hip).
    power
        Power of each coordinate's generalized force, (T, 46) [W].
    engine
        Name and version of what computed them (`engine_name`).

    Examples
    --------
    With ``static``, the markers of a calibration pose, and ``body``, built from them:

    >>> import hbm
    >>> standing = hbm.filter_motion(hbm.solve_ik(body, static))
    >>> dynamics = hbm.inverse_dynamics(body, standing, {})
    >>> dynamics.tau.shape, dynamics.residual.shape
    ((100, 46), (100, 6))
    >>> f"arm held out sideways: {dynamics.force('LShoulderAbduction').mean():.1f} N·m"
    'arm held out sideways: 10.3 N·m'
    """

    time: Array
    tau: Array
    residual: Array
    power: Array
    engine: str

    def __post_init__(self) -> None:
        frames = len(self.time)
        shapes = dict.fromkeys(("tau", "power"), (frames, N_Q))
        freeze_arrays(self, "dynamics", time=(frames,), residual=(frames, 6), **shapes)

    def without_forces(self, unknown: Mask) -> "Dynamics":
        """Give the same with some generalized forces and their power left out, (T, 46)."""
        tau, power = (frozen(np.where(unknown, np.nan, x)) for x in (self.tau, self.power))
        return replace(self, tau=tau, power=power)

    def force(self, coordinate: str) -> Array:
        """Give one coordinate's generalized force by name, (T,) [N or N·m]."""
        if coordinate not in INDEX:
            raise KeyError(f"no coordinate {coordinate!r}; there are: {', '.join(COORDINATES)}")
        return np.asarray(self.tau[:, INDEX[coordinate]])


def filter_motion(motion: Motion, *, cutoff: float = 6.0, method: Method = "zero_phase") -> Motion:
    """Low-pass the coordinates and differentiate them.

    Parameters
    ----------
    motion
        As `solve_ik` gave it.
    cutoff
        Cut-off frequency [Hz].
    method
        "realtime" or "zero_phase" (see `hbm.signals.filtering.butterworth`); use the same for the
        forces.

    Returns
    -------
    Motion
        With filtered ``q`` and its derivatives ``v`` and ``a``; the rest as it was.

    Raises
    ------
    ValueError
        If the motion is shorter than the filter needs.

    Examples
    --------
    With ``static``, the markers of a calibration pose, and ``body``, built from them:

    >>> import hbm, numpy as np
    >>> motion = hbm.solve_ik(body, static)
    >>> bool(np.isnan(motion.v).all())
    True
    >>> smooth = hbm.filter_motion(motion, cutoff=6.0, method="zero_phase")
    >>> bool(np.abs(smooth.v).max() < 1e-6)
    True
    """
    smooth = butterworth(motion.q, motion.time, cutoff, method)
    return replace(motion, q=smooth.value, v=smooth.velocity, a=smooth.acceleration)


def inverse_dynamics(
    body: Body, motion: Motion, wrenches: Mapping[str, Array], *, jobs: int = 1
) -> Dynamics:
    """Find the generalized forces of a motion under external wrenches.

    Parameters
    ----------
    body
        The subject.
    motion
        Filtered motion, with ``v`` and ``a``.
    wrenches
        Segment -> wrench acting on it, (T, 6) [N, N·m], lab axes about the lab origin; low-passed
        with the same filter as the motion. The joints' forces depend on the segment that a wrench
        acts on; the residual does not.
    jobs
        Threads.

    Returns
    -------
    Dynamics
        Frames that the motion or a wrench leaves undefined are NaN.

    Raises
    ------
    ValueError
        If a segment is unknown, a wrench's shape is wrong, or the motion has not been filtered.

    Notes
    -----
    Newton–Euler: ``tau = M(q) a + c(q, v) − Jᵀ w`` (van den Bogert et al. 2013, Med Biol Eng
    Comput 51:1069). The force residual is ``Σ m(a − g) − Σ F`` and the moment residual the same
    balance of moments about the pelvis origin.

    Deviations from the original
    ----------------------------
    The residual moment is given in lab axes, not as generalized forces of the pelvis' Euler
    angles; ``tau[:, 3:6]`` holds the latter.

    Examples
    --------
    Standing still without ground reaction force, the residual is body weight; with it, nothing.
    ``static`` are the markers of a calibration pose, ``body`` is built from them:

    >>> import hbm, numpy as np
    >>> standing = hbm.filter_motion(hbm.solve_ik(body, static))
    >>> without = hbm.inverse_dynamics(body, standing, {})
    >>> f"{without.residual[50, 2]:.1f} N, {74.6 * 9.81:.1f} N"
    '731.8 N, 731.8 N'
    >>> weight = np.tile([0, 0, 74.6 * 9.81, 0, 0, 0], (100, 1))
    >>> ground = hbm.inverse_dynamics(body, standing, {"left_foot": weight})
    >>> bool(np.abs(ground.residual[:, :3]).max() < 1e-6)
    True
    """
    return inverse_dynamics_variants(body, motion, [wrenches], jobs=jobs)[0]


def inverse_dynamics_variants(
    body: Body, motion: Motion, variants: Sequence[Mapping[str, Array]], *, jobs: int = 1
) -> list[Dynamics]:
    """Do `inverse_dynamics` for several sets of wrenches in one evaluation of the equations.

    Parameters
    ----------
    body, motion, jobs
        As for `inverse_dynamics`.
    variants
        Sets of wrenches, such as plates as measured and compensated.

    Returns
    -------
    list[Dynamics]
        One per variant.

    Examples
    --------
    With ``static``, the markers of a calibration pose, and ``body``, built from them:

    >>> import hbm, numpy as np
    >>> standing = hbm.filter_motion(hbm.solve_ik(body, static))
    >>> half = np.tile([0, 0, 74.6 * 9.81 / 2, 0, 0, 0], (100, 1))
    >>> feet = [{"left_foot": half}, {"left_foot": half, "right_foot": half}]
    >>> one, both = inverse_dynamics_variants(body, standing, feet)
    >>> f"{one.residual[50, 2]:.1f} N, {abs(both.residual[50, 2]):.1f} N"
    '365.9 N, 0.0 N'
    """
    # a wrench on an unknown segment, or of another length, would be left out without a word
    frames = len(motion.time)
    for wrenches in variants:
        for segment, wrench in wrenches.items():
            if segment not in LAST_Q:
                raise ValueError(f"no segment {segment!r}; there are: {', '.join(LAST_Q)}")
            if np.shape(wrench) != (frames, 6):
                raise ValueError(
                    f"wrench on {segment} must have shape ({frames}, 6), got {np.shape(wrench)}"
                )
    if frames and np.isnan(motion.v).all() and not np.isnan(motion.q).all():
        raise ValueError("the motion has no velocities; filter it first with filter_motion")

    # generalized forces and residual of each variant, (T, 52)
    forces = [np.empty((frames, N_Q + 6)) for _ in variants]
    for first in range(0, frames, FRAMES_AT_ONCE):
        block = slice(first, first + FRAMES_AT_ONCE)
        q, v, a = (np.asarray(x[block]) for x in (motion.q, motion.v, motion.a))
        # what the motion needs where nothing but gravity acts on the body, and the motion per unit
        # rate of each coordinate: velocity of the point at the lab origin, angular velocity
        state = q, v, a, body.geometry, body.inertia_vector
        tau, wrench_needed, rates = kernels().newton_euler(*state, jobs=jobs)
        # moments about the pelvis origin, which moves: forces stay
        needed, rates = shift_wrench(wrench_needed, q[:, :3]), rates.reshape(-1, N_Q, 6)
        for wrenches, force in zip(variants, forces, strict=True):
            # tau = M a + c − Jᵀ w, where the transpose of the rates is Jᵀ about the lab origin
            force[block, :N_Q] = tau
            external = np.zeros_like(needed)
            for segment, wrench in wrenches.items():
                acting = np.asarray(wrench, float)[block]
                external += acting
                # only coordinates between pelvis and segment carry its wrench
                chain = np.array(support(LAST_Q[segment]))
                force[block, chain] -= np.einsum("tci,ti->tc", rates[:, chain], acting)
            # the residual is what is needed beyond what acts, about the pelvis origin
            force[block, N_Q:] = needed - shift_wrench(external, q[:, :3])
    return [
        # power [W]: generalized force times rate, as one coordinate moves one axis
        Dynamics(motion.time, tau, residual, frozen(tau * motion.v), engine_name())
        for tau, residual in (np.split(frozen(force), [N_Q], axis=1) for force in forces)
    ]


@cache
def engine_name() -> str:
    """Give the name and version of what computes inverse dynamics, as results state it."""
    return f"kernels generated with CasADi {version('casadi')}"
