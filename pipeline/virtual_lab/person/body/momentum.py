"""The wrench of the ground, from the rate of change of linear and angular momentum."""

from collections.abc import Sequence

import numpy as np

from hbm.segments import Inertia
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.virtual_lab.person.body.kinematics import Frame, chunks, frames
from pipeline.virtual_lab.person.body.skeleton import Skeleton
from pipeline.virtual_lab.person.body.wobbling import Oscillator


def ground_wrench(
    skeleton: Skeleton,
    motion: tuple[Array, Array, Array],
    oscillators: Sequence[Oscillator] = (),
) -> Array:
    """Give the wrench that the ground must exert on a person.

    Parameters
    ----------
    skeleton
        The person's.
    motion
        Coordinates and their first and second derivatives, (55, T) each [rad and m, s].
    oscillators
        Wobbling masses, which the motion at equal intervals drives from rest.

    Returns
    -------
    Array
        In lab axes about the lab origin, (T, 6) [N, N·m].

    Notes
    -----
    Newton's and Euler's laws for the whole body: the wrench is the sum over all mass of
    ``(p̈ - g) dm`` and ``p × (p̈ - g) dm``. With ``p = o + R x`` in each segment both integrals
    depend on its mass, its centre and ``J = ∫ x xᵀ dm`` alone: the moment of ``R x × R̈ x`` is the
    antisymmetric part of ``R J R̈ᵀ``.
    """
    count = motion[0].shape[1]
    wrench = np.zeros((6, count))
    parts = [(name, part, second_moment(part)) for name, part in skeleton.inertias.items()]
    for chunk in chunks(count):
        found = frames(skeleton, tuple(values[:, chunk] for values in motion))
        own = wrench[:, chunk]
        for name, part, moment in parts:
            _add_segment(own, found[name], part, moment)
        for oscillator in oscillators:
            oscillator.add_reaction(own, found[oscillator.mass.segment])
    return wrench.T


def center_of_mass(skeleton: Skeleton, q: Array) -> Array:
    """Give the centre of mass at coordinates (55, T), (T, 3) [m]."""
    center = np.zeros((3, q.shape[1]))
    for chunk in chunks(q.shape[1]):
        found = frames(skeleton, (q[:, chunk],))
        for name, part in skeleton.inertias.items():
            center[:, chunk] += part.mass * found[name].point(part.center)
    return center.T / skeleton.mass


def second_moment(part: Inertia) -> Array:
    """Give ``∫ x xᵀ dm`` of a segment about its frame's origin, (3, 3) [kg·m²]."""
    about_center = np.trace(part.tensor) / 2 * np.eye(3) - part.tensor
    return np.asarray(about_center + part.mass * np.outer(part.center, part.center))


def add_force(wrench: Array, force: Array, place: Array) -> None:
    """Add a force (3, T) [N] that acts at a place (3, T) [m] to a wrench (6, T)."""
    wrench[:3] += force
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        wrench[3 + i] += place[j] * force[k] - place[k] * force[j]


def _add_segment(wrench: Array, frame: Frame, part: Inertia, moment: Array) -> None:
    rotation, _, second = frame.rotation
    first = part.mass * part.center
    arm, inertial = first @ rotation, first @ second
    upward = frame.acceleration.copy()
    upward[2] += GRAVITY_MPS2
    add_force(wrench, part.mass * upward + inertial, frame.origin)
    turned = np.asarray(moment @ rotation)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        own = (turned[j] * second[k]).sum(axis=0) - (turned[k] * second[j]).sum(axis=0)
        wrench[3 + i] += arm[j] * upward[k] - arm[k] * upward[j] + own
