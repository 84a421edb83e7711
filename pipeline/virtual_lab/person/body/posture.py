"""A person in a posture: joint centres, segment frames and joint angles."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from hbm.spatial import Array, perpendicular
from pipeline.virtual_lab.person.body.skeleton import LINKS, PARENT

SIDES: Final = {"right": 1.0, "left": -1.0}
"""Side -> sign of its medial direction, where left is positive."""


@dataclass(slots=True)
class Anatomy:
    """A person in the T-pose.

    Attributes
    ----------
    points
        Joint centres and segment ends by name, (3,) [m], lab axes.
    rotations
        Segment -> orientation of its frame (columns: forward, left, up of the straight posture).
    q
        Coordinate -> value in the T-pose [rad and m]; those that are absent are zero.
    axes
        Coordinate -> axis in the frame before its rotation, (3,), where it is the person's own.
    ends
        Segment -> its proximal and distal end and a lateral direction, (3, 3), lab axes.
    """

    points: dict[str, Array] = field(default_factory=dict)
    rotations: dict[str, Array] = field(default_factory=dict)
    q: dict[str, float] = field(default_factory=dict)
    axes: dict[str, Array] = field(default_factory=dict)
    ends: dict[str, Array] = field(default_factory=dict)

    def origin(self, segment: str) -> Array:
        """Give the joint that carries a segment, (3,) [m], lab axes."""
        return self.points[_JOINT.get(segment) or _limb_joint(segment)]


_JOINT: Final = {"pelvis": "pelvis", "mid_trunk": "lumbar", "thorax": "mid_trunk", "head": "neck"}
_LIMB_JOINT: Final = {
    **{"shoulder": "shoulder", "upper_arm": "shoulder", "forearm": "elbow", "hand": "wrist"},
    **{"thigh": "hip", "shank": "knee", "talus": "ankle", "foot": "subtalar", "toes": "toes"},
}


def _limb_joint(segment: str) -> str:
    side, _, part = segment.partition("_")
    return f"{side}_{_LIMB_JOINT[part]}"


def about(axis: Array, zero: Array, direction: Array) -> float:
    """Give the angle about an axis from one direction to another [rad]."""
    first, second = perpendicular(zero, axis), perpendicular(direction, axis)
    return float(np.arctan2(axis @ np.cross(first, second), first @ second))


def angles(
    rotation: Array, order: tuple[tuple[float, float, float], ...]
) -> tuple[float, float, float]:
    """Give the three angles of a rotation about signed coordinate axes, in sequence [rad].

    Parameters
    ----------
    rotation
        The product of the three rotations, (3, 3).
    order
        Their axes: unit vectors along plus or minus x, y and z, each once.

    Returns
    -------
    tuple of float
        The second within ± 90°.
    """
    i, j, k = (int(np.flatnonzero(axis)[0]) for axis in order)
    sign = [sum(axis) for axis in order]
    parity = 1.0 if (j - i) % 3 == 1 else -1.0
    first = np.arctan2(-parity * rotation[j, k], rotation[k, k])
    second = np.arcsin(np.clip(parity * rotation[i, k], -1, 1))
    third = np.arctan2(-parity * rotation[i, j], rotation[i, i])
    return (float(sign[0] * first), float(sign[1] * second), float(sign[2] * third))


def offsets_of(anatomy: Anatomy) -> dict[str, Array]:
    """Give each segment's joint in the parent's frame, (3,) [m]."""
    return {
        s: anatomy.rotations[p].T @ (anatomy.origin(s) - anatomy.origin(p))
        for s, p in PARENT.items()
    }


def axes_of(anatomy: Anatomy) -> Array:
    """Give the axes of all coordinates, (55, 3)."""
    return np.array(
        [anatomy.axes[link.name] if link.axis is None else link.axis for link in LINKS], float
    )
