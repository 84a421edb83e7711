"""True joint moments of legs: what the segments beyond a joint need and the ground does not give.

Newton's and Euler's laws for the segments beyond a joint, of the person's true body; nothing of it
is shared with the inverse dynamics of `hbm`.
"""

from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.machine.platform import fit_trajectory
from pipeline.virtual_lab.person.anatomy import SIDES
from pipeline.virtual_lab.person.body import (
    COLUMN,
    LINKS,
    PARENT,
    Frame,
    Skeleton,
    frames,
    moved,
    placed,
)
from pipeline.virtual_lab.person.momentum import Oscillator, add_segment, second_moment
from pipeline.virtual_lab.person.walk import BLOCK_KNOTS, FORCES_PER_FRAME, Walk, foot_wrenches

JOINTS: Final = {
    "toes": (),
    "foot": ("FootPronation",),
    "talus": ("AnklePlantarFlexion",),
    "shank": ("KneeFlexion",),
    "thigh": ("HipFlexion", "HipAbduction", "HipInternalRotation"),
}
"""Segments of a leg from its tip on -> coordinates of the joint that carries each."""
COORDINATES: Final = tuple(
    side[0].upper() + name for side in SIDES for own in JOINTS.values() for name in own
)


def leg_moments(walk: Walk, time: Array) -> dict[str, Array]:
    """Give the true internal moments of the legs' coordinates.

    Parameters
    ----------
    walk
        How the person moved.
    time
        When, (T,) [s].

    Returns
    -------
    dict of str to Array
        Coordinate, such as "RHipFlexion" -> moment about its axis, positive in the direction in
        which it grows, (T,) [N·m].
    """
    motion, skeleton = walk.motion, walk.subject.skeleton
    rate_hz = FORCES_PER_FRAME * motion.rate_hz
    oscillators = [Oscillator(mass, rate_hz) for mass in walk.subject.wobbling]
    knots, parts = round(motion.duration * motion.rate_hz) + 1, list[Array]()
    for first in range(0, knots, BLOCK_KNOTS):
        state = tuple(
            motion.between_knots(FORCES_PER_FRAME, first, min(first + BLOCK_KNOTS, knots), k)
            for k in range(3)
        )
        at = motion.start + (FORCES_PER_FRAME * first + np.arange(state[0].shape[1])) / rate_hz
        feet = foot_wrenches(walk, at)
        parts.append(moments_of(skeleton, state, feet, oscillators))
    moments = fit_trajectory(np.concatenate(parts, axis=1).T, rate_hz, motion.start).at(time)
    return dict(zip(COORDINATES, moments.T, strict=True))


def moments_of(
    skeleton: Skeleton,
    state: tuple[Array, ...],
    feet: dict[str, Array],
    oscillators: list[Oscillator],
) -> Array:
    """Give the moments of `COORDINATES`, (12, T), in a state (55, T) with feet under (T, 6)."""
    found = frames(skeleton, state, [f"{side}_{part}" for side in SIDES for part in JOINTS])
    moments = dict[str, Array]()
    for side in SIDES:
        need = -feet[side].T
        for part, coordinates in JOINTS.items():
            segment = f"{side}_{part}"
            if segment in skeleton.inertias:
                inertia = skeleton.inertias[segment]
                add_segment(need, found[segment], inertia, second_moment(inertia))
            for oscillator in oscillators:
                if oscillator.mass.segment == segment:
                    oscillator.add_reaction(need, found[segment])
            names = [side[0].upper() + name for name in coordinates]
            moments |= _about_axes(skeleton, found, segment, state[0], need, names)
    return np.stack([moments[name] for name in COORDINATES])


def _about_axes(
    skeleton: Skeleton,
    found: dict[str, Frame],
    segment: str,
    q: Array,
    need: Array,
    names: list[str],
) -> dict[str, Array]:
    """Give the moment of a wrench (6, T) about the axes of a joint's coordinates, (T,) each."""
    parent = found[PARENT[segment]]
    offset = skeleton.offsets.get(segment, np.zeros(3))
    frame = placed(Frame(parent.rotation[:1], parent.origin, parent.acceleration), offset)
    moments = {}
    for k, link in enumerate(LINKS):
        if link.segment == segment:
            if link.name in names:
                axis = skeleton.axes[k] @ frame.rotation[0]
                about = need[3:] - np.cross(frame.origin, need[:3], axis=0)
                moments[link.name] = np.sum(axis * about, axis=0)
            frame = moved(frame, link, skeleton.axes[k], (q[COLUMN[link.name]],))
    return moments
