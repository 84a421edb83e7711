"""A subject's shape: segment frames from the joint centres and axes of a calibration pose.

Expressed in the segments' frames, the next joints, the hinge axes, the markers and the ends of the
inertial parts stay the same when the subject moves. Shapes of several frames can therefore be
averaged, whether the subject stood still or walked.

Zero of the hinges: knee and elbow straight, foot at a right angle to the shank, forearm supinated
(wrist axis along the elbow's), hand in line with the forearm; foot pronation and toes as in the
calibration pose.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from hbm.calibration_pose.anatomy import MEDIAL_SIGN, Anatomy
from hbm.coordinates import DOWN, FIXED_TO, FORWARD, LEFT, PARENT, SIDES
from hbm.segments import Proportions
from hbm.spatial import (
    Array,
    axes_from,
    cross,
    dot,
    in_axes_of,
    in_lab_axes,
    perpendicular,
    rotation_about,
    unit,
)

SHOULDER_WIDTH_PER_STATURE: Final = 0.129
"""Distance of a shoulder that no marker shows from the trunk's axis (Drillis and Contini 1966, as
in Winter 2009, Fig. 4.1)."""


@dataclass(slots=True)
class Shape:
    """Geometry that stays the same while the subject moves, in the segments' frames.

    Attributes
    ----------
    offsets
        Segment or shoulder point -> its joint in the parent's frame, (3,) [m].
    axes
        Coordinate -> hinge axis in the frame before its rotation, unit vector (3,).
    ends
        Segment -> the proximal and distal end of its inertia and a lateral direction, (3, 3).
    markers
        Marker -> position, (3,) [m].
    """

    offsets: dict[str, Array] = field(default_factory=dict)
    axes: dict[str, Array] = field(default_factory=dict)
    ends: dict[str, Array] = field(default_factory=dict)
    markers: dict[str, Array] = field(default_factory=dict)


def shape_of(
    anatomy: Anatomy,
    table: Mapping[str, Proportions],
    height_m: float,
    markers: Mapping[str, Array],
    segment: Mapping[str, str],
) -> Shape:
    """Give the subject's shape: the mean of F frames of the recording.

    Parameters
    ----------
    anatomy
        Joint centres and axes in these frames, lab axes.
    table
        Segment proportions, for the parts that no marker shows.
    height_m
        Stature, for the same parts [m].
    markers
        Marker -> position in these frames, (F, 3) [m], lab axes.
    segment
        Marker -> segment.

    Returns
    -------
    Shape
        In segment frames; axes are unit vectors. A trunk, head and arms that no marker shows are
        in the neutral position.

    Notes
    -----
    The trunk's parts end where de Leva's (1996) do: the upper trunk at cervicale and xiphoid, both
    on the trunk's axis (`hbm.calibration_pose.landmarks`), the middle one at xiphoid and navel,
    the lower one at navel and mid-hip. The navel divides the way from xiphoid to mid-hip as in her
    means. The head ends at vertex and cervicale; a vertex that no marker shows is as far above the
    cervicale's level as in her means, over the middle of the head's markers. Parts that no marker
    shows have her mean lengths as shares of stature; their shoulders are at her level,
    `SHOULDER_WIDTH_PER_STATURE` apart from the axis.
    """
    build = _Builder(anatomy, table, height_m)
    build.trunk_and_head()
    for side in SIDES:
        build.arm(side)
        build.leg(side)
    shape = build.shape
    for s, parent in PARENT.items():
        # place of each joint in its parent's frame: Rᵀ (o_child − o_parent)
        R, o = build.frames[parent]
        shape.offsets[s] = in_axes_of(R, build.frames[s][1] - o)
    shape.markers = dict(markers)
    for s in {segment[name] for name in markers}:
        names = [name for name in markers if segment[name] == s]
        R, o = build.frames[s]
        # p_local = Rᵀ (p − o), row by row
        local = (np.stack([markers[name] for name in names], axis=1) - o[:, None]) @ R
        shape.markers |= zip(names, local.swapaxes(0, 1), strict=True)

    def means(of_frames: Mapping[str, Array]) -> dict[str, Array]:
        return dict(zip(of_frames, np.mean([*of_frames.values()], axis=1), strict=True))

    # a mean of unit vectors is shorter than one
    axes = {name: unit(axis) for name, axis in means(shape.axes).items()}
    return Shape(means(shape.offsets), axes, means(shape.ends), means(shape.markers))


def _angle_about(axis: Array, zero: Array, direction: Array) -> Array:
    """Give the angle about axes from one direction to another, both projected along them, (F,)."""
    # sine and cosine of the angle between the projections
    across = dot(axis, cross(zero, direction))
    along = dot(zero, direction) - dot(axis, zero) * dot(axis, direction)
    return np.asarray(np.arctan2(across, along)[..., 0])


def _subtalar(along: Array, medial: float) -> Array:
    """Give the subtalar axis, forward, in a foot whose long axis is ``along``.

    About it, pronation of the standing foot rotates the shank inward. About the foot's long axis
    it would not, and the markers of the feet would pull the pelvis sideways.
    """
    left = perpendicular(np.array(LEFT), along)
    # medially from the foot's long axis, upward from the sole (Manter 1941, Anat Rec 80:397)
    deviation, inclination = np.radians(16.0), np.radians(42.0)
    # turned inward in the sole's plane, then raised out of it
    level = np.cos(deviation) * along + medial * np.sin(deviation) * left
    return np.asarray(np.cos(inclination) * level + np.sin(inclination) * cross(along, left))


class _Builder:
    """Places segment frames on an anatomy, from the pelvis outward."""

    def __init__(self, anatomy: Anatomy, table: Mapping[str, Proportions], height_m: float) -> None:
        self.at, self.axes = anatomy.points, anatomy.axes
        self.length = {name: part.length * height_m for name, part in table.items()}
        self.shoulder_width = SHOULDER_WIDTH_PER_STATURE * height_m
        self.frames = {"pelvis": (anatomy.frames["pelvis"], self.at["pelvis"])}
        self.frames["thorax"] = anatomy.frames["thorax"], self.at["lumbar"]
        head = anatomy.frames.get("head", anatomy.frames["thorax"])
        self.frames["head"] = head, self.at["neck"]
        self.head_up = head[..., 2]
        self.shape = Shape()

    def ends(self, segment: str, proximal: Array, distal: Array, left: Array) -> None:
        """Store the ends that a segment's inertia is scaled to, in its frame."""
        R, o = self.frames[FIXED_TO.get(segment, segment)]
        self.shape.ends[segment] = np.stack([proximal - o, distal - o, left], axis=-2) @ R

    def trunk_and_head(self) -> None:
        at, length = self.at, self.length
        hips, cervicale, xiphoid = at["pelvis"], at["cervicale"], at["xiphoid"]
        lower, middle = length["lower_trunk"], length["mid_trunk"]
        # the navel is not marked: by de Leva's lengths of middle and lower trunk
        navel = xiphoid + middle / (middle + lower) * (hips - xiphoid)
        pelvis, thorax, head = (self.frames[s][0] for s in ("pelvis", "thorax", "head"))
        self.ends("pelvis", navel, hips, pelvis[..., 1])
        self.ends("mid_trunk", xiphoid, navel, thorax[..., 1])
        self.ends("thorax", cervicale, xiphoid, thorax[..., 1])
        up = self.head_up
        # along the head's axis: the point at the cervicale's level
        below = at.get("mid_head", cervicale)
        below = below + dot(cervicale - below, up) * up
        vertex = at.get("vertex", below + length["head"] * up)
        self.ends("head", vertex, cervicale, head[..., 1])

    def hanging_arm(self, side: str) -> None:
        """Place an arm that no marker shows: hanging from its shoulder, in the neutral pose."""
        s, sign, length = SIDES[side], MEDIAL_SIGN[side], self.length
        thorax, _ = self.frames["thorax"]
        ahead, left, up = (thorax[..., k] for k in range(3))
        # all frames of a neutral arm are parallel to the trunk's
        joints = [self.at["mid_shoulders"] - sign * self.shoulder_width * left]
        parts = [f"{side}_{part}" for part in ("upper_arm", "forearm", "hand")]
        self.frames[f"{side}_shoulder"] = thorax, joints[0]
        for part in parts:
            self.frames[part] = thorax, joints[-1]
            joints.append(joints[-1] - length[part.removeprefix(f"{side}_")] * up)
            self.ends(part, joints[-2], joints[-1], left)
        axes = {"ElbowFlexion": -left, "ForeArmPronation": sign * up}
        axes |= {"WristFlexion": -left, "HandAbduction": -sign * ahead}
        self.shape.axes |= {s + n: in_axes_of(thorax, axis) for n, axis in axes.items()}

    def arm(self, side: str) -> None:
        if f"{side}_elbow" not in self.at:
            self.hanging_arm(side)
            return
        at, s, axes = self.at, SIDES[side], self.shape.axes
        thorax, _ = self.frames["thorax"]
        sign = MEDIAL_SIGN[side]
        arm, forearm, hand = (f"{side}_{x}" for x in ("upper_arm", "forearm", "hand"))
        shoulder, elbow, wrist = (at[f"{side}_{x}"] for x in ("shoulder", "elbow", "wrist"))
        elbow_axis, wrist_axis = self.axes[f"{side}_elbow"], self.axes[f"{side}_wrist"]
        knuckle = at.get(f"{side}_knuckle")

        # upper arm: up exact, left near the elbow's axis
        R = axes_from(elbow_axis, shoulder - elbow, exact="up")
        self.frames[f"{side}_shoulder"] = thorax, shoulder
        self.frames[arm] = R, shoulder

        # forearm: from the upper arm by flexion about the elbow's axis, so that neutral is straight
        bend, along = -in_axes_of(R, elbow_axis), in_axes_of(R, unit(wrist - elbow))
        R = R @ rotation_about(bend, _angle_about(bend, np.array(DOWN), along))
        # and by pronation about its length, until the wrist's axis fits
        up, axis = in_axes_of(R, unit(elbow - wrist)), in_axes_of(R, elbow_axis)
        R = R @ rotation_about(up, _angle_about(up, axis, in_axes_of(R, wrist_axis)))
        self.frames[forearm] = R, elbow
        axes[f"{s}ElbowFlexion"], axes[f"{s}ForeArmPronation"] = bend, sign * up

        # wrist axes: flexion about the markers' line, abduction across it
        left = perpendicular(in_axes_of(R, wrist_axis), up)
        ahead = cross(left, up)
        axes[f"{s}WristFlexion"], axes[f"{s}HandAbduction"] = -left, -sign * ahead
        # a hand without knuckle is in line with the forearm
        tip = wrist - self.length["hand"] * in_lab_axes(R, up) if knuckle is None else knuckle
        along = in_axes_of(R, unit(tip - wrist))
        x, y, z = (dot(axis, along)[..., 0] for axis in (ahead, left, up))
        # hand: flexion, then abduction, that bring neutral to where the knuckle is
        R = R @ rotation_about(-left, np.arctan2(x, -z))
        R = R @ rotation_about(-sign * ahead, sign * np.arcsin(-y))
        self.frames[hand] = R, wrist

        self.ends(arm, shoulder, elbow, elbow_axis)
        self.ends(forearm, elbow, wrist, wrist_axis)
        self.ends(hand, wrist, tip, wrist_axis)

    def leg(self, side: str) -> None:
        at, s, axes = self.at, SIDES[side], self.shape.axes
        sign = MEDIAL_SIGN[side]
        thigh, shank, foot, toes = (f"{side}_{x}" for x in ("thigh", "shank", "foot", "toes"))
        hip, knee, ankle = (at[f"{side}_{x}"] for x in ("hip", "knee", "ankle"))
        knee_axis, ankle_axis = self.axes[f"{side}_knee"], self.axes[f"{side}_ankle"]

        # thigh: up exact, left near the knee's axis
        R = axes_from(knee_axis, hip - knee, exact="up")
        self.frames[thigh] = R, hip
        # shank: from the thigh by flexion about the knee's axis, so that neutral is straight
        bend, along = in_axes_of(R, knee_axis), in_axes_of(R, unit(ankle - knee))
        R = R @ rotation_about(bend, _angle_about(bend, np.array(DOWN), along))
        self.frames[shank] = R, knee
        axes[f"{s}KneeFlexion"] = bend

        # foot: from the shank by plantar flexion, so that in neutral it points forward
        bend, foot_axis = in_axes_of(R, ankle_axis), self.axes[f"{side}_foot"]
        along = in_axes_of(R, foot_axis)
        R = R @ rotation_about(bend, _angle_about(bend, np.array(FORWARD), along))
        self.frames[foot] = R, ankle
        self.frames[toes] = R, at[f"{side}_toes"]
        axes[f"{s}AnklePlantarFlexion"] = bend
        # pronation is about the subtalar axis; signs so that both sides pronate positively
        axes[f"{s}FootPronation"] = -sign * _subtalar(in_axes_of(R, foot_axis), sign)
        axes[f"{s}ToeFlexion"] = in_axes_of(R, self.axes[f"{side}_toes"])

        self.ends(thigh, hip, knee, knee_axis)
        self.ends(shank, knee, ankle, knee_axis)
        self.ends(foot, at[f"{side}_heel"], at[f"{side}_toe_tip"], ankle_axis)
