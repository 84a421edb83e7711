"""A person in the T-pose: markers, and the joints that the Human Body Model finds from them.

The markers are those of a reference person, scaled limb by limb. The joints are the laboratory's
own statement of that model: joint centres midway between markers and by the published regressions
below, straightened limbs as the zero of the angles. It is used for people whose mechanics are the
model's, and as the mean from which other people differ.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from math import dist
from typing import Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.segments import Sex
from hbm.spatial import Array, axes_from, perpendicular, rotation_about, unit
from pipeline.virtual_lab.person.body import LINKS, PARENT

SIZES: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "anatomy")
FOOT: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "foot")

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
        side, _, part = segment.partition("_")
        joint = f"{side}_{_JOINT[part]}" if side in SIDES else _JOINT[segment]
        return self.points[joint]


_JOINT: Final = {
    **{"pelvis": "pelvis", "mid_trunk": "lumbar", "thorax": "mid_trunk", "head": "neck"},
    **{"shoulder": "shoulder", "upper_arm": "shoulder", "forearm": "elbow", "hand": "wrist"},
    **{"thigh": "hip", "shank": "knee", "talus": "ankle", "foot": "subtalar", "toes": "toes"},
}
"""Segment, without side -> the joint that carries it."""


def about(axis: Array, zero: Array, direction: Array) -> float:
    """Give the angle about an axis from one direction to another [rad]."""
    # in the plane across the axis: sine and cosine of the angle by cross and dot product
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
    # R = A_i(±a) A_j(±b) A_k(±c): its entries in row i and column k hold one angle each
    i, j, k = (int(np.flatnonzero(axis)[0]) for axis in order)
    sign = [sum(axis) for axis in order]
    # cyclic orders (x y z, y z x, z x y) and the others differ in the sign of the sines
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


@dataclass(frozen=True, slots=True)
class Proportions:
    """Sizes of a person's parts by those of the reference person of the same stature.

    Heights between floor, ankle, knee, hip, neck and crown; breadths of pelvis and shoulders;
    depth of the trunk; length of the foot; lengths of the arm's segments.
    """

    ankle: float = 1.0
    shank: float = 1.0
    thigh: float = 1.0
    trunk: float = 1.0
    head: float = 1.0
    pelvis: float = 1.0
    shoulders: float = 1.0
    depth: float = 1.0
    foot: float = 1.0
    upper_arm: float = 1.0
    forearm: float = 1.0
    hand: float = 1.0


def t_pose(names: Sequence[str], height_m: float, sex: Sex, proportions: Proportions) -> Array:
    """Give the markers of a person who stands upright with the arms held out, palms down.

    Parameters
    ----------
    names
        Marker labels of the Human Body Model's sets.
    height_m
        Stature [m].
    sex
        Women have a broader pelvis and narrower shoulders.
    proportions
        Individual proportions; the heights are scaled to add up to the stature.

    Returns
    -------
    Array
        Marker positions, (M, 3) [m]: x forward, y left, z up, floor at z = 0.

    """
    size, (hips, shoulders) = proportions, SIZES.breadths[sex]
    hips, shoulders = hips * size.pelvis, shoulders * size.shoulders
    heights = _scaled(SIZES.heights, (size.ankle, size.shank, size.thigh, size.trunk, size.head))
    # individual proportions must not change the stature
    heights *= SIZES.heights[-1] / heights[-1]
    reaches = _scaled(SIZES.reaches, (shoulders, size.upper_arm, size.forearm, size.hand))
    scale = {
        "pelvis": (size.depth, hips),
        "trunk": (size.depth, shoulders),
        "head": (1.0, 1.0),
        "leg": (1.0, hips),
        "foot": (size.foot, hips),
    }

    position = np.empty((len(names), 3))
    for k, name in enumerate(names):
        part, (x, y, z) = _reference()[name]
        # arms are held out: their segments are scaled sideways, and they follow the neck's height
        if part == "arm":
            y = np.sign(y) * np.interp(abs(y), SIZES.reaches, reaches)
            z += heights[4] - SIZES.heights[4]
        else:
            x, y = x * scale[part][0], y * scale[part][1]
            z = np.interp(z, SIZES.heights, heights)
        position[k] = x, y, z
    return np.asarray(position * height_m / SIZES.heights[-1])


def _scaled(marks: Sequence[float], factors: Sequence[float]) -> Array:
    """Scale each interval between marks by its own factor."""
    return np.append(0.0, np.cumsum(np.diff(marks) * factors))


@cache
def _reference() -> dict[str, tuple[str, tuple[float, float, float]]]:
    """Give part and position [m] of every point, both sides."""
    text = files("pipeline.virtual_lab.person").joinpath("t_pose.csv").read_text(encoding="utf-8")
    points = {}
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        x, y, z = (float(row[axis]) / 1000 for axis in "xyz")
        point, part = row["point"], row["part"]
        points[point] = part, (x, y, z)
        # the left side mirrors the right
        points.setdefault(re.sub("^(F?)R", r"\1L", point), (part, (x, -y, z)))
    points["STRN"], points["XYPH"] = points["JN"], points["XIPH"]
    return points


Landmarks = Mapping[str, Array]


def locate(at: Landmarks, shown: frozenset[str], sex: Sex, navel: float) -> Anatomy:
    """Find joint centres, frames and joint angles of a person who stands in a T-pose.

    Parameters
    ----------
    at
        All points of the reference person, by the names of the Human Body Model 2, (3,) [m].
    shown
        Which of them the marker set shows. Where it shows no medial side of knee and ankle, no
        second metatarsal head or no malleolus, the joints follow from what it shows.
    sex
        Of the person.
    navel
        Way from xiphoid to navel, as a fraction of that to mid-hip.

    Returns
    -------
    Anatomy
        In lab axes.

    Notes
    -----
    Joints midway between markers: Dumas et al. 2007 (J Biomech 40:543). Hips: Harrington et al.
    2007 (J Biomech 40:595), Table 3, less the height of a marker above the skin.
    """
    middles = {
        **{"mid_asis": ("RASIS", "LASIS"), "mid_psis": ("RPSIS", "LPSIS")},
        **{"trunk_bottom": ("T10", "XIPH"), "trunk_top": ("C7", "JN")},
        **{"mid_head": ("RHEAD", "LHEAD")},
    }
    # the sign is that of the way from the first to the second marker in medial direction
    joints = {
        **{"knee": ("LEK", "MEK", 1.0), "ankle": ("LM", "MM", 1.0), "toes": ("MT2", "MT5", -1.0)},
        **{"elbow": ("LEE", "MEE", 1.0), "wrist": ("LW", "MW", -1.0)},
    }
    anatomy = Anatomy({name: (at[a] + at[b]) / 2 for name, (a, b) in middles.items()})
    axes = dict[str, Array]()  # of the joints, to the left
    for side, medial in SIDES.items():
        for joint, (first, second, inward) in joints.items():
            one, other = (at[side[0].upper() + marker] for marker in (first, second))
            anatomy.points[f"{side}_{joint}"] = (one + other) / 2
            axes[f"{side}_{joint}"] = medial * inward * (other - one)
    _pelvis(anatomy, at, shown, sex)
    for side in SIDES:
        _leg(anatomy, at, shown, side, axes)
    _trunk_and_head(anatomy, at, sex, navel)
    for side in SIDES:
        _arm(anatomy, at, side, axes)
    return anatomy


def _pelvis(anatomy: Anatomy, at: Landmarks, shown: frozenset[str], sex: Sex) -> None:
    points = anatomy.points
    front, back = points["mid_asis"], points["mid_psis"]
    across = at["LASIS"] - at["RASIS"]
    R = axes_from(across, np.cross(front - back, across), exact="left")
    width, depth = float(np.linalg.norm(across)), dist(front, back)
    # hip centres from mid-ASIS by the pelvis' width and depth and the leg's length (Harrington)
    for side, medial in SIDES.items():
        s = side[0].upper()
        knee, ankle = (
            at[s + (inner if s + inner in shown else outer)]
            for inner, outer in (("MEK", "LEK"), ("MM", "LM"))
        )
        leg = dist(at[s + "ASIS"], knee) + dist(knee, ankle)
        hip = [
            -0.24 * depth - 0.0099 - SIZES.marker_from_skin,
            -medial * (0.28 * depth + 0.16 * width + 0.0079),
            -0.16 * width - 0.04 * leg - 0.0071,
        ]
        points[f"{side}_hip"] = front + R @ np.array(hip)
    points["pelvis"] = (points["right_hip"] + points["left_hip"]) / 2
    # L5/S1; T12/L1 coincides with it in the Human Body Model, which has one joint in the trunk
    ahead, above = SIZES.lumbar[sex]
    points["lumbar"] = points["mid_trunk"] = front + R @ (width * np.array([ahead, 0.0, above]))
    anatomy.rotations["pelvis"] = R
    # the pelvis' six coordinates: its place at mid-hip, and its angles in the lab
    yaw, pitch, roll = angles(R, ((0, 0, 1), (0, 1, 0), (1, 0, 0)))
    x, y, z = (float(value) for value in points["pelvis"])
    anatomy.q |= {"PelvisX": x, "PelvisY": y, "PelvisZ": z}
    anatomy.q |= {"PelvisYaw": yaw, "PelvisForwardPitch": pitch, "PelvisRightRoll": roll}


def _trunk_and_head(anatomy: Anatomy, at: Landmarks, sex: Sex, navel: float) -> None:
    points, rotations = anatomy.points, anatomy.rotations
    # the trunk's frame: up from the middle of T10 and xiphoid to that of C7 and jugular notch
    ahead = at["JN"] - at["C7"]
    along = points["trunk_top"] - points["trunk_bottom"]
    R = axes_from(np.cross(along, ahead), along, exact="up")
    up = R[:, 2]
    # C7/T1: some way from C7 towards the jugular notch, raised from that line
    fraction, elevation = SIZES.neck[sex]
    neck = rotation_about(-R[:, 1], np.radians(elevation)) @ ahead
    points["neck"] = at["C7"] + fraction * neck
    hips = points["pelvis"]
    # ends of the trunk's segments: on its axis at the heights of C7 and xiphoid
    base = points["trunk_top"] + ((hips - points["trunk_top"]) @ up) * up
    for name, marker in (("cervicale", "C7"), ("xiphoid", "XIPH")):
        points[name] = base + ((at[marker] - hips) @ up) * up
    points["navel"] = points["xiphoid"] + navel * (hips - points["xiphoid"])
    points["vertex"] = at["THEAD"]
    head = axes_from(at["LHEAD"] - at["RHEAD"], at["THEAD"] - points["mid_head"], exact="left")
    rotations |= {"mid_trunk": R, "thorax": R, "head": head}
    # flexion, bend to the right and twist to the left, of trunk on pelvis and head on trunk
    pelvis = rotations["pelvis"]
    order = ((0, 1, 0), (1, 0, 0), (0, 0, 1))
    names = ("Flexion", "RightBend", "LeftTwist")
    for part, turned in (("Trunk", pelvis.T @ R), ("Head", R.T @ head)):
        anatomy.q |= {part + n: a for n, a in zip(names, angles(turned, order), strict=True)}
    for segment, top, bottom in (
        ("pelvis", "navel", "pelvis"),
        ("mid_trunk", "xiphoid", "navel"),
        ("thorax", "cervicale", "xiphoid"),
        ("head", "vertex", "cervicale"),
    ):
        left = rotations[segment][:, 1]
        anatomy.ends[segment] = np.stack([points[top], points[bottom], left])


def _arm(anatomy: Anatomy, at: Landmarks, side: str, axes: Mapping[str, Array]) -> None:
    points, s, medial = anatomy.points, side[0].upper(), SIDES[side]
    thorax = anatomy.rotations["thorax"]
    width = dist(at["LSHO"], at["RSHO"])
    shoulder = points[f"{side}_shoulder"] = (
        at[s + "SHO"] - SIZES.shoulder_drop * width * thorax[:, 2]
    )
    elbow, wrist, knuckle = points[f"{side}_elbow"], points[f"{side}_wrist"], at[s + "FIN"]
    points[f"{side}_knuckle"] = knuckle
    elbow_axis, wrist_axis = unit(axes[f"{side}_elbow"]), unit(axes[f"{side}_wrist"])

    # the straight arm hangs along the upper arm's axis: the elbow flexes from there to the wrist
    upper = axes_from(elbow_axis, shoulder - elbow, exact="up")
    bend = -upper.T @ elbow_axis
    flexion = about(bend, np.array([0.0, 0, -1]), upper.T @ (wrist - elbow))
    flexed = upper @ rotation_about(bend, flexion)
    # pronation: from the elbow's to the wrist's axis, about the line between them
    along = flexed.T @ unit(elbow - wrist)
    turn = about(along, flexed.T @ elbow_axis, flexed.T @ wrist_axis)
    forearm = flexed @ rotation_about(along, turn)

    # the hand's two angles from the direction of its knuckle in axes of the wrist
    left = perpendicular(forearm.T @ wrist_axis, along)
    ahead = np.cross(left, along)
    x, y, z = np.stack([ahead, left, along]) @ forearm.T @ unit(knuckle - wrist)
    flex, abduct = float(np.arctan2(x, -z)), float(medial * np.arcsin(-y))
    hand = forearm @ rotation_about(-left, flex) @ rotation_about(-medial * ahead, abduct)

    anatomy.rotations |= {
        **{f"{side}_shoulder": thorax, f"{side}_upper_arm": upper},
        **{f"{side}_forearm": forearm, f"{side}_hand": hand},
    }
    anatomy.axes |= {
        **{f"{s}ElbowFlexion": bend, f"{s}ForeArmPronation": medial * along},
        **{f"{s}WristFlexion": -left, f"{s}HandAbduction": -medial * ahead},
    }
    order = ((-medial, 0, 0), (0, -1, 0), (0, 0, medial))
    names = ("Abduction", "Flexion", "InternalRotation")
    for name, angle in zip(names, angles(thorax.T @ upper, order), strict=True):
        anatomy.q[f"{s}Shoulder{name}"] = angle
    anatomy.q |= {
        **{f"{s}ElbowFlexion": flexion, f"{s}ForeArmPronation": medial * turn},
        **{f"{s}WristFlexion": flex, f"{s}HandAbduction": abduct},
    }
    anatomy.ends |= {
        f"{side}_upper_arm": np.stack([shoulder, elbow, elbow_axis]),
        f"{side}_forearm": np.stack([elbow, wrist, wrist_axis]),
        f"{side}_hand": np.stack([wrist, knuckle, wrist_axis]),
    }


def _leg(
    anatomy: Anatomy, at: Landmarks, shown: frozenset[str], side: str, axes: Mapping[str, Array]
) -> None:
    points, s, medial = anatomy.points, side[0].upper(), SIDES[side]
    pelvis, hip = anatomy.rotations["pelvis"], points[f"{side}_hip"]
    axis = {joint: unit(axes[f"{side}_{joint}"]) for joint in ("knee", "ankle", "toes")}
    # without medial markers, knee and ankle lie inwards of the lateral ones by half a joint's width
    half = dist(at[s + "LEK"], at[s + "LM"])
    if s + "MEK" not in shown:
        inward = hip - at[s + "GTRO"]
        points[f"{side}_knee"] = inside(at[s + "LEK"], hip, inward, SIZES.half_knee * half)
        axis["knee"] = medial * unit(points[f"{side}_knee"] - at[s + "LEK"])
    knee = points[f"{side}_knee"]
    if s + "MM" not in shown:
        inward = medial * axis["knee"]
        points[f"{side}_ankle"] = inside(at[s + "LM"], knee, inward, SIZES.half_ankle * half)
        axis["ankle"] = medial * unit(points[f"{side}_ankle"] - at[s + "LM"])
    ankle = points[f"{side}_subtalar"] = points[f"{side}_ankle"]
    # the foot's long axis and its tip, from the heel through the second metatarsal head or the toe
    heel = at[s + "HEE"]
    if s + "MT2" in shown:
        along, tip = unit(at[s + "MT2"] - heel), heel + FOOT.toe_tip * (at[s + "MT2"] - heel)
    else:
        along, tip = unit(at[s + "TOE"] - heel), at[s + "TOE"]
        points[f"{side}_toes"] = heel + ((at[s + "MT5"] - heel) @ along) * along
        axis["toes"] = perpendicular(axis["ankle"], along)

    # the knee's angle is zero in a straight leg, the ankle's where the foot is along the shank's x
    thigh = axes_from(axis["knee"], hip - knee, exact="up")
    bend = thigh.T @ axis["knee"]
    flexion = about(bend, np.array([0.0, 0, -1]), thigh.T @ (ankle - knee))
    shank = thigh @ rotation_about(bend, flexion)
    turn = shank.T @ axis["ankle"]
    plantar = about(turn, np.array([1.0, 0, 0]), shank.T @ along)
    foot = shank @ rotation_about(turn, plantar)

    parts = (("thigh", thigh), ("shank", shank), ("talus", foot), ("foot", foot), ("toes", foot))
    anatomy.rotations |= {f"{side}_{part}": R for part, R in parts}
    anatomy.axes |= {
        **{f"{s}KneeFlexion": bend, f"{s}AnklePlantarFlexion": turn},
        **{f"{s}FootPronation": -medial * _subtalar(foot.T @ along, medial)},
        **{f"{s}ToeFlexion": foot.T @ axis["toes"]},
    }
    order = ((0, -1, 0), (-medial, 0, 0), (0, 0, medial))
    names = ("Flexion", "Abduction", "InternalRotation")
    for name, angle in zip(names, angles(pelvis.T @ thigh, order), strict=True):
        anatomy.q[f"{s}Hip{name}"] = angle
    anatomy.q |= {f"{s}KneeFlexion": flexion, f"{s}AnklePlantarFlexion": plantar}
    anatomy.ends |= {
        f"{side}_thigh": np.stack([hip, knee, axis["knee"]]),
        f"{side}_shank": np.stack([knee, ankle, axis["knee"]]),
        f"{side}_foot": np.stack([heel, tip, axis["ankle"]]),
    }


def _subtalar(along: Array, medial: float) -> Array:
    inclination, deviation = np.radians(SIZES.subtalar)
    # forward, turned medially in the plane of the sole, then raised out of it
    left = perpendicular(np.array([0.0, 1.0, 0.0]), along)
    level = np.cos(deviation) * along + medial * np.sin(deviation) * left
    return np.asarray(np.cos(inclination) * level + np.sin(inclination) * np.cross(along, left))


def inside(marker: Array, proximal: Array, inward: Array, offset: float) -> Array:
    """Give a joint's centre at a distance from a marker, at a right angle to the bone, (3,) [m].

    Kadaba et al. 1990 (J Orthop Res 8:383).
    """
    # marker, joint and proximal end are a right triangle: cosine of its angle at the marker
    up = unit(proximal - marker)
    cosine = offset / dist(proximal, marker)
    return np.asarray(
        marker + offset * (cosine * up + np.sqrt(1 - cosine**2) * perpendicular(inward, up))
    )
