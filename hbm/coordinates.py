"""The 46 coordinates and the segments of the Human Body Model, as one tree.

Every coordinate is a joint with a single axis, so positions and velocities have the same size.
Names are those of the Human Body Model (van den Bogert et al. 2013, Med Biol Eng Comput 51:1069).
In the neutral pose (all coordinates zero) the person stands upright with the arms hanging, palms
forward, and the frames of all segments are parallel to the lab: x forward, y left, z up.
The coordinates move 19 frames: 17 of the 18 segments, and two massless shoulder points that only
carry the acromion markers. The mid trunk has no coordinate of its own; it is fixed to the thorax.

Deviations from the original
----------------------------
* Coordinates are numbered depth first (a limb from trunk to tip, right before left), because
  Pinocchio's composite-rigid-body algorithm needs contiguous subtrees; `HBM_ORDER` is the order of
  the original's export, which alternates right and left.
* The shoulder rotates by abduction, flexion, internal rotation, in this order. The original's
  order, flexion first, is singular at 90° of abduction, that is in the T-pose.
"""

from dataclasses import dataclass
from typing import Final

Vector = tuple[float, float, float]
FORWARD: Final[Vector] = (1.0, 0.0, 0.0)
BACK: Final[Vector] = (-1.0, 0.0, 0.0)
LEFT: Final[Vector] = (0.0, 1.0, 0.0)
RIGHT: Final[Vector] = (0.0, -1.0, 0.0)
UP: Final[Vector] = (0.0, 0.0, 1.0)
DOWN: Final[Vector] = (0.0, 0.0, -1.0)


@dataclass(frozen=True, slots=True)
class Coordinate:
    """A single-axis joint.

    Attributes
    ----------
    name
        The Human Body Model's name.
    segment
        The segment or point that it moves, together with the other coordinates of the same joint.
    parent
        Number of the coordinate before it in the chain, -1 at the ground.
    translates
        Whether it is a translation along its axis [m] instead of a rotation about it [rad].
    axis
        Axis in the neutral pose; None where the subject's own landmarks define it.
    """

    name: str
    segment: str
    parent: int
    translates: bool
    axis: Vector | None


def _arm_and_leg(side: str) -> list[tuple[str, str, str, str, Vector | None]]:
    """Give the joints of one side: parent segment, segment, coordinate, kind, axis."""
    medial, outward, inward = (LEFT, BACK, UP) if side == "R" else (RIGHT, FORWARD, DOWN)
    name = {"R": "right_", "L": "left_"}[side]
    shoulder, arm, forearm, hand = (
        f"{name}{s}" for s in ("shoulder", "upper_arm", "forearm", "hand")
    )
    thigh, shank, foot, toes = (f"{name}{s}" for s in ("thigh", "shank", "foot", "toes"))
    return [
        ("thorax", shoulder, f"{side}ShoulderUp", "translation", UP),
        ("thorax", shoulder, f"{side}ShoulderForward", "translation", FORWARD),
        ("thorax", shoulder, f"{side}ShoulderInward", "translation", medial),
        (shoulder, arm, f"{side}ShoulderAbduction", "rotation", outward),
        (shoulder, arm, f"{side}ShoulderFlexion", "rotation", RIGHT),
        (shoulder, arm, f"{side}ShoulderInternalRotation", "rotation", inward),
        (arm, forearm, f"{side}ElbowFlexion", "rotation", None),
        (arm, forearm, f"{side}ForeArmPronation", "rotation", None),
        (forearm, hand, f"{side}WristFlexion", "rotation", None),
        (forearm, hand, f"{side}HandAbduction", "rotation", None),
        ("pelvis", thigh, f"{side}HipFlexion", "rotation", RIGHT),
        ("pelvis", thigh, f"{side}HipAbduction", "rotation", outward),
        ("pelvis", thigh, f"{side}HipInternalRotation", "rotation", inward),
        (thigh, shank, f"{side}KneeFlexion", "rotation", None),
        (shank, foot, f"{side}AnklePlantarFlexion", "rotation", None),
        (shank, foot, f"{side}FootPronation", "rotation", None),
        (foot, toes, f"{side}ToeFlexion", "rotation", None),
    ]


def _tree() -> tuple[Coordinate, ...]:
    right, left = _arm_and_leg("R"), _arm_and_leg("L")
    rows = [
        ("ground", "pelvis", "PelvisX", "translation", FORWARD),
        ("ground", "pelvis", "PelvisY", "translation", LEFT),
        ("ground", "pelvis", "PelvisZ", "translation", UP),
        ("ground", "pelvis", "PelvisYaw", "rotation", UP),
        ("ground", "pelvis", "PelvisForwardPitch", "rotation", LEFT),
        ("ground", "pelvis", "PelvisRightRoll", "rotation", FORWARD),
        ("pelvis", "thorax", "TrunkFlexion", "rotation", LEFT),
        ("pelvis", "thorax", "TrunkRightBend", "rotation", FORWARD),
        ("pelvis", "thorax", "TrunkLeftTwist", "rotation", UP),
        ("thorax", "head", "HeadFlexion", "rotation", LEFT),
        ("thorax", "head", "HeadRightBend", "rotation", FORWARD),
        ("thorax", "head", "HeadLeftTwist", "rotation", UP),
        *right[:10],
        *left[:10],
        *right[10:],
        *left[10:],
    ]
    tree: list[Coordinate] = []
    last = {"ground": -1}
    for parent, segment, name, kind, axis in rows:
        before = last.get(segment, last[parent])
        tree.append(Coordinate(name, segment, before, kind == "translation", axis))
        last[segment] = len(tree) - 1
    return tuple(tree)


TREE: Final = _tree()
"""All coordinates, every one after its parent."""

COORDINATES: Final = tuple(c.name for c in TREE)
"""Names of the coordinates, limb by limb: the order of `Motion.q` and of `Body.model`."""
N_Q: Final = len(TREE)
INDEX: Final = {name: i for i, name in enumerate(COORDINATES)}
"""Coordinate -> its number."""

SIDES: Final = {"right": "R", "left": "L"}
"""Side in the names of segments -> in those of coordinates, markers and landmarks."""

MOVING: Final = tuple(dict.fromkeys(c.segment for c in TREE))
"""What the coordinates move: 17 segments and the two shoulder points, each after its parent."""

FIXED_TO: Final = {"mid_trunk": "thorax"}
"""Segment without coordinates -> the one that carries it and whose frame it shares."""

SEGMENTS: Final = ("pelvis", *FIXED_TO, *(s for s in MOVING[1:] if not s.endswith("_shoulder")))
"""The 18 segments of the Human Body Model; each has a mass."""

RIGID_BODIES: Final = tuple(s for s in MOVING if s in SEGMENTS)
"""The 17 bodies of the equations of motion: a segment with what is fixed to it."""

FIRST_Q: Final = {s: next(i for i, c in enumerate(TREE) if c.segment == s) for s in MOVING}
LAST_Q: Final = {c.segment: i for i, c in enumerate(TREE)}
LAST_Q.update({s: LAST_Q[carrier] for s, carrier in FIXED_TO.items()})
"""Segment or point -> numbers of the first and the last coordinate that moves it with its joint."""

PARENT: Final = {s: TREE[TREE[FIRST_Q[s]].parent].segment for s in MOVING if s != "pelvis"}
"""What moves -> the segment or point that it is attached to."""

LIMBS: Final = {
    "head": ("head",),
    **{
        f"{side} {limb}": tuple(f"{side}_{s}" for s in segments)
        for side in SIDES
        for limb, segments in (
            ("arm", ("shoulder", "upper_arm", "forearm", "hand")),
            ("leg", ("thigh", "shank", "foot", "toes")),
        )
    },
}
"""Head, arms and legs -> their segments and points; they move none of each other's."""

CARRIERS: Final = ("pelvis", "thorax")
"""What carries head and limbs."""

SUBJECT_OFFSETS: Final = tuple(FIRST_Q[s] for s in PARENT)
"""Coordinates whose place in the parent's frame the subject's landmarks define."""

SUBJECT_AXES: Final = tuple(i for i, c in enumerate(TREE) if c.axis is None)
"""Coordinates whose axes they define."""


def support(i: int) -> tuple[int, ...]:
    """Give the coordinates that carry coordinate ``i``: itself and its ancestors, tip to root."""
    chain = []
    while i >= 0:
        chain.append(i)
        i = TREE[i].parent
    return tuple(chain)


def _hbm_order() -> tuple[str, ...]:
    """Give the names in the order of the original's export: pairs alternate, right first."""
    middle = COORDINATES[:12]
    arm = (
        *("ShoulderUp", "ShoulderForward", "ShoulderInward"),
        *("ShoulderFlexion", "ShoulderAbduction", "ShoulderInternalRotation"),
        *("ElbowFlexion", "ForeArmPronation", "WristFlexion", "HandAbduction"),
    )
    leg = (
        *("HipFlexion", "HipAbduction", "HipInternalRotation", "KneeFlexion"),
        *("AnklePlantarFlexion", "FootPronation", "ToeFlexion"),
    )
    return middle + tuple(side + name for name in arm + leg for side in "RL")


HBM_ORDER: Final = _hbm_order()
"""Names of the coordinates in the order of the original's export."""
