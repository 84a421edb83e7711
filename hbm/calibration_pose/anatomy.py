"""Joint centres and axes of a subject, and the joints of arms and legs from their landmarks."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from hbm.coordinates import SIDES
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.segments import Sex
from hbm.spatial import Array, cross, distance, dot, perpendicular, unit

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "calibration_pose")

HipRule = Literal["harrington", "bell"]
MEDIAL_SIGN: Final = {"right": 1.0, "left": -1.0}
"""Side -> sign of the medial direction, where left is positive."""

MARKER_OFFSET_M: Final = 0.009
"""Distance of a marker's centre from the skin: radius of a 14 mm marker, and a base of 2 mm."""


@dataclass(frozen=True, slots=True)
class LimbMeasures:
    """Measures of one side of a subject, for what its markers do not show; None where unknown [m].

    Attributes
    ----------
    leg_length_m
        From ASIS to medial malleolus.
    knee_width_m, ankle_width_m, elbow_width_m
        Across the epicondyles or malleoli.
    wrist_width_m, hand_thickness_m
        From the back of the wrist or hand to the palm.
    shoulder_offset_m
        From the skin over the acromion to the shoulder's joint centre.
    """

    leg_length_m: float | None = None
    knee_width_m: float | None = None
    ankle_width_m: float | None = None
    elbow_width_m: float | None = None
    wrist_width_m: float | None = None
    hand_thickness_m: float | None = None
    shoulder_offset_m: float | None = None


@dataclass(frozen=True, slots=True)
class Measures:
    """Properties of a subject that the markers do not show, and the rule for the hips.

    Attributes
    ----------
    sex
        "male", "female" or "unspecified".
    hip
        Hip centre by "harrington" (2007) or "bell" (1990), or functional centres: side -> position
        in the pelvis frame (origin mid-ASIS, x forward, y left, z up), (3,) [m].
    limbs
        Side -> what was measured on it.
    marker_offset_m
        Marker radius plus base plate: distance of a marker's centre from the skin [m].
    """

    sex: Sex = "unspecified"
    hip: HipRule | Mapping[str, Array] = "harrington"
    limbs: Mapping[str, LimbMeasures] = field(default_factory=dict)
    marker_offset_m: float = MARKER_OFFSET_M

    def limb(self, side: str) -> LimbMeasures:
        """Give what was measured on a side."""
        return self.limbs.get(side, LimbMeasures())

    def to_center(self, width_m: float | None) -> float | None:
        """Give the distance of a joint's centre from a marker beside it [m]; None if unknown."""
        return None if width_m is None else width_m / 2 + self.marker_offset_m


@dataclass(slots=True)
class Anatomy:
    """Joint centres, axes and segment ends of a subject in F frames of the calibration pose.

    Attributes
    ----------
    points
        Positions by name, such as ``right_knee`` or ``neck``, (F, 3) [m]. Absent for a trunk, head
        or arms without markers.
    axes
        Unit vectors by name, such as ``right_knee``, (F, 3); all point to the subject's left in the
        anatomical position.
    frames
        Orientations of pelvis, thorax and head (columns: forward, left, up), (F, 3, 3). Absent for
        a trunk or head without markers.
    markers
        Landmarks that a device shows in place of their markers, (F, 3) [m].
    rules
        Missing landmark -> the rule that replaced it.
    notes
        What is wrong with the markers.
    """

    points: dict[str, Array] = field(default_factory=dict)
    axes: dict[str, Array] = field(default_factory=dict)
    frames: dict[str, Array] = field(default_factory=dict)
    markers: dict[str, Array] = field(default_factory=dict)
    rules: dict[str, str] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)


class MissingLandmark(ValueError):
    """No marker shows landmarks that the body needs; ``names`` are these landmarks."""

    def __init__(self, purpose: str, names: list[str], instead: str | None) -> None:
        several = "s" * (len(names) > 1)
        other = f" (or {instead})" if instead else ""
        super().__init__(
            f"{purpose} needs the landmark{several} {', '.join(names)}{other}, which no marker "
            "shows in the calibration pose"
        )
        self.names = names


def need(
    landmarks: Mapping[str, Array], *names: str, purpose: str, instead: str | None
) -> list[Array]:
    """Give landmarks, or raise `MissingLandmark` with the missing and what would replace them."""
    missing = [name for name in names if name not in landmarks]
    if missing:
        raise MissingLandmark(purpose, missing, instead)
    return [landmarks[name] for name in names]


HALF_WIDTH_PER_SHANK: Final = {"knee": 0.118, "ankle": 0.085}
"""Half the width of a joint without medial marker or stated width, as a share of the distance from
lateral epicondyle to lateral malleolus (Reed et al. 1999, SAE 1999-01-0959)."""


def locate_hinge(
    anatomy: Anatomy,
    at: Mapping[str, Array],
    measures: Measures,
    side: str,
    part: str,
    proximal: Array,
    medial: Array,
) -> None:
    """Find the centre of a knee or ankle midway between two markers, or medial to the lateral one.

    Midway: Dumas et al. 2007 (J Biomech 40:543). Medial: `chord`, with the plane that ``medial``
    gives, by half the joint's width as measured or by `HALF_WIDTH_PER_SHANK`.
    """
    s, joint, purpose = SIDES[side], f"{side}_{part}", f"the {side} {part}"
    lateral, other = (s + name for name in {"knee": ("LEK", "MEK"), "ankle": ("LM", "MM")}[part])
    # measured, else by the shank's length: half the width is the centre's depth
    width_m = getattr(measures.limb(side), f"{part}_width_m")
    half_width: ArrayLike | None = measures.to_center(width_m)
    if half_width is None and {s + "LEK", s + "LM"} <= at.keys():
        half_width = HALF_WIDTH_PER_SHANK[part] * distance(at[s + "LEK"], at[s + "LM"])
    if other in at or half_width is None:
        by_width = f"{lateral} with {part}_width_m"
        outer, inner = need(at, lateral, other, purpose=purpose, instead=by_width)
        # the width does not matter where both sides are marked
        center = (outer + inner) / 2
    else:
        (outer,) = need(at, lateral, purpose=purpose, instead=other)
        center = chord(outer, proximal, medial, half_width, joint)
        anatomy.rules[other] = f"{joint} half the joint's width medial to {lateral}"
    anatomy.points[joint] = center
    # axes point to the subject's left on both sides
    anatomy.axes[joint] = MEDIAL_SIGN[side] * unit(center - outer)


def chord(marker: Array, proximal: Array, medial: Array, offset: ArrayLike, joint: str) -> Array:
    """Give a joint's centre: at a given distance from a marker, at a right angle to the bone.

    ``proximal`` is the bone's other end, ``medial`` the direction from the marker towards the
    joint, of which the part along the bone does not count. A ValueError where the offset is longer
    than the bone. Kadaba et al. 1990 (J Orthop Res 8:383), Davis et al. 1991 (Hum Mov Sci 10:575).
    """
    # angle at the marker between bone and joint: its cosine is offset by length of the bone
    up, offset = unit(proximal - marker), np.asarray(offset)[..., None]
    cosine = offset / distance(proximal, marker)[..., None]
    if (cosine >= 1).any():
        raise ValueError(
            f"the {joint} would be {1000 * offset.max():.0f} mm from its lateral marker, farther "
            "than the next joint; check the widths and the markers' names"
        )
    # with the joint at the right angle: along the bone and inward from the marker
    inward = perpendicular(medial, up)
    return np.asarray(marker + offset * (cosine * up + np.sqrt(1 - cosine**2) * inward))


HALF_WIDTH_PER_FOREARM: Final = 0.155
"""Half the width of an elbow without medial marker or measured width, as a share of the distance
from lateral epicondyle to wrist (Reed et al. 1999, SAE 1999-01-0959)."""

SHOULDER_DROP_PER_WIDTH: Final = 0.17
"""Distance of the shoulder joint below the acromion, as a share of the distance between the
acromions (Rab et al. 2002, J Orthop Res 20:71)."""


def locate_arm(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures, side: str) -> None:
    """Find shoulder, elbow, wrist and knuckle; none if the arm has too few landmarks.

    Shoulder: `_shoulder`. Elbow: midway between its epicondyles or, without the medial one, by
    `elbow_center`, its half width as measured or by `HALF_WIDTH_PER_FOREARM`. Wrist: midway between
    its markers; for the ends of a wrist bar, half the wrist's width away from the bar, where it was
    measured. Knuckle: half the hand's thickness below its marker, where that was measured.
    """
    s, limb, sign = SIDES[side], measures.limb(side), MEDIAL_SIGN[side]
    # a wrist has markers of its own or the two ends of a bar
    ulnar, radial = at.get(s + "LW", at.get(s + "WRB")), at.get(s + "MW", at.get(s + "WRA"))
    ends = [end for end in (ulnar, radial) if end is not None]
    missing = [name for name in (s + "SHO", s + "LEE") if name not in at]
    missing += [] if ends else [f"{s}LW or {s}MW"]
    if missing:
        if ends or any(s + name in at for name in ("LEE", "MEE", "FIN")):
            rule = f"the {side} arm stays in neutral, its markers beyond the shoulder are not used"
            anatomy.rules[" and ".join(missing)] = rule
        return
    shoulder = _shoulder(anatomy, at, measures, side)
    wrist, lateral = np.mean(ends, axis=0), at[s + "LEE"]
    half_width: ArrayLike | None = measures.to_center(limb.elbow_width_m)
    if half_width is None:
        half_width = HALF_WIDTH_PER_FOREARM * distance(lateral, wrist)

    def elbow_with(wrist: Array) -> Array:
        if s + "MEE" in at:
            return np.asarray((lateral + at[s + "MEE"]) / 2)
        return elbow_center(shoulder, lateral, wrist, half_width, side)

    elbow = elbow_with(wrist)
    # from the little finger's side to the thumb's: the wrist flexes about it
    thumb = None if ulnar is None or radial is None else radial - ulnar
    bar = measures.to_center(limb.wrist_width_m) if {s + "WRA", s + "WRB"} <= set(at) else None
    if bar is not None and thumb is not None:
        # a bar lies on the back of the wrist; the elbow's plane moves with the wrist
        wrist = wrist + bar * _palmar(thumb, wrist - elbow, side)
        elbow = elbow_with(wrist)
    anatomy.points |= {f"{side}_shoulder": shoulder, f"{side}_elbow": elbow, f"{side}_wrist": wrist}
    anatomy.axes[f"{side}_elbow"] = sign * unit(elbow - lateral)
    if s + "MEE" not in at:
        rule = f"{side} elbow axis across the plane of shoulder, elbow and wrist"
        anatomy.rules[s + "MEE"] = rule
    if thumb is not None:
        anatomy.axes[f"{side}_wrist"] = -sign * unit(thumb)
    else:
        anatomy.axes[f"{side}_wrist"] = anatomy.axes[f"{side}_elbow"]
        anatomy.rules[f"a {side} wrist marker"] = "its axis is taken as the elbow's"
    if s + "FIN" in at:
        knuckle, half = at[s + "FIN"], measures.to_center(limb.hand_thickness_m)
        if half is not None and thumb is not None:
            down = _palmar(thumb, knuckle - wrist, side)
            knuckle = chord(knuckle, wrist, down, half, f"{side} knuckle")
        anatomy.points[f"{side}_knuckle"] = knuckle


def elbow_center(
    shoulder: Array, lateral: Array, wrist: Array, half_width: ArrayLike, side: str
) -> Array:
    """Give the centre of an elbow that has a lateral marker only.

    The elbow's axis leads from the marker to the centre and is perpendicular to the plane of
    shoulder, elbow and wrist. Of the two planes through shoulder and wrist that are half the
    elbow's width from the marker, it is the one in which the elbow is flexed, not hyperextended.

    Notes
    -----
    With the marker at distance d from the line of shoulder and wrist, the axis is at the angle
    arccos(half_width / d) to the perpendicular from the marker to that line. In a straight arm d is
    the half width, and the axis that perpendicular; so there is no change of rule between straight
    and bent. But an error of 5 mm in the half width turns the axis by 2° at 60° of flexion, by 4°
    at 30°, by 9° at 15° and by up to 20° below.

    Deviations from the original
    ----------------------------
    Plug-in-Gait offsets the elbow perpendicular to the plane of shoulder, *marker* and wrist, and
    takes the perpendicular to the plane with the elbow so found as its axis. The two planes are 10
    to 30° apart, so that this axis is not quite the one that leads to the marker.
    """
    along, half_width = unit(wrist - shoulder), np.asarray(half_width)[..., None]
    # part of the marker's place that is perpendicular to the line of shoulder and wrist
    outward = lateral - shoulder
    outward = outward - dot(outward, along) * along
    # a marker nearer to the line than half the width: a straight arm, whose axis is outward
    cosine = np.minimum(half_width / np.linalg.norm(outward, axis=-1, keepdims=True), 1.0)
    outward = unit(outward)
    # of both planes that are half the width away, the one that flexes the elbow
    across = MEDIAL_SIGN[side] * cross(along, outward)
    return np.asarray(lateral + half_width * (np.sqrt(1 - cosine**2) * across - cosine * outward))


def straight_elbows(anatomy: Anatomy) -> list[Note]:
    """Name elbows without medial marker that are almost straight, on average over the frames."""
    notes = []
    for side, s in SIDES.items():
        if s + "MEE" in anatomy.rules:
            flexion = float(_flexion(anatomy, side).mean())
            if flexion < np.radians(LIMITS.straight_elbow):
                values = {"marker": s + "MEE", "flexion_deg": np.degrees(flexion)}
                notes.append(Note.of("elbow_axis_uncertain", side=side, **values))
    return notes


def _flexion(anatomy: Anatomy, side: str) -> Array:
    shoulder, elbow, wrist = (anatomy.points[f"{side}_{j}"] for j in ("shoulder", "elbow", "wrist"))
    cosine = dot(unit(elbow - shoulder), unit(wrist - elbow))
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))


def _shoulder(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures, side: str) -> Array:
    """Give the shoulder's joint centre.

    Below the acromion along the trunk by `SHOULDER_DROP_PER_WIDTH`; without the other acromion, the
    width is twice the acromion's distance from the trunk's mid-plane. A measured shoulder offset is
    laid off as in Plug-in-Gait: in the trunk's frontal plane, at a right angle to the line from the
    jugular notch.
    """
    acromion, thorax = at[SIDES[side] + "SHO"], anatomy.frames["thorax"]
    offset = measures.limb(side).shoulder_offset_m
    if offset is not None and "JN" in at:
        # the skin lies a marker's offset behind the marker's centre
        notch = at["JN"] - measures.marker_offset_m * thorax[..., 0]
        down = MEDIAL_SIGN[side] * cross(notch - acromion, thorax[..., 0])
        reach = offset + measures.marker_offset_m
        return chord(acromion, notch, down, reach, f"{side} shoulder")
    if {"LSHO", "RSHO"} <= set(at):
        width = distance(at["LSHO"], at["RSHO"])
    else:
        # twice the distance from the trunk's mid-plane, where the other acromion is not marked
        width = 2 * np.abs(dot(acromion - anatomy.points["trunk_top"], thorax[..., 1]))[..., 0]
    return np.asarray(acromion - SHOULDER_DROP_PER_WIDTH * width[..., None] * thorax[..., 2])


def _palmar(thumb: Array, along: Array, side: str) -> Array:
    """Give the direction from the back of a wrist or hand to the palm, (3,)."""
    return MEDIAL_SIGN[side] * unit(cross(thumb, along))


FOOT_PER_HEEL_TO_MT2: Final = 1.25
"""Length of the foot without a toe marker, from the heel marker."""

BALL_PER_FOOT: Final = 0.73
"""Ball of the foot without metatarsal markers, from the heel marker."""


def locate_leg(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures, side: str) -> None:
    """Find knee, ankle and foot.

    Knee: by the knee alignment device where one is in place (`alignment_corner`). Without it and
    without a medial marker, medial is the pelvis' own direction (with a trochanter marker: towards
    the hip from it); for the ankle it is the knee's. The foot runs from the heel to the toe marker
    or, without one, as far as `FOOT_PER_HEEL_TO_MT2`.

    Deviations from the original
    ----------------------------
    Plug-in-Gait takes the medial directions from the markers on thigh and shank, which therefore
    stand on wands or get measured offsets. Many laboratories put them on the skin anywhere, which
    turns its knee axes by up to 40° (docs/marker_sets.md), so they only track here. Offsets of
    these markers and tibial torsion, which a file may state, are not used.
    """
    s, sign = SIDES[side], MEDIAL_SIGN[side]
    hip, pelvis_left = anatomy.points[f"{side}_hip"], anatomy.frames["pelvis"][..., 1]
    medial = hip - at[s + "GTRO"] if s + "GTRO" in at else sign * pelvis_left
    corner = alignment_corner(at, s, hip)
    if corner is not None:
        if s + "LEK" not in at:
            anatomy.markers[s + "LEK"] = corner
        at = {name: p for name, p in at.items() if name != s + "MEK"} | {s + "LEK": corner}
        medial = corner - at[s + "KAX"]
    locate_hinge(anatomy, at, measures, side, "knee", hip, medial)
    knee, knee_axis = anatomy.points[f"{side}_knee"], anatomy.axes[f"{side}_knee"]
    locate_hinge(anatomy, at, measures, side, "ankle", knee, sign * knee_axis)
    for joint, axis, end in (("knee", pelvis_left, "EK"), ("ankle", knee_axis, "M")):
        if (dot(anatomy.axes[f"{side}_{joint}"], axis) < 0).any():
            raise ValueError(
                f"the {side} {joint}'s lateral marker lies on its medial side; left and right, or "
                f"medial and lateral markers (landmarks {s}L{end}, {s}M{end}), are probably swapped"
            )
    _locate_foot(anatomy, at, side)


def alignment_corner(at: Mapping[str, Array], letter: str, hip: Array) -> Array | None:
    """Give the corner of a knee alignment device, which lies on the lateral epicondyle.

    Its three rods are equally long and at right angles; of the two corners that fit their ends, the
    one nearer to hip and lateral malleolus is meant. In Plug-in-Gait it is the knee marker of the
    calibration pose. None without the device or the malleolus.
    """
    names = [letter + name for name in ("KAX", "KD1", "KD2", "LM")]
    if not set(names) <= set(at):
        return None
    a, b, c, ankle = (at[name] for name in names)
    span = (distance(a, b) + distance(b, c) + distance(c, a)) / 3
    height = span[..., None] / np.sqrt(6) * unit(cross(b - a, c - a))
    corner, other = ((a + b + c) / 3 + way * height for way in (1, -1))
    apart, others = (distance(p, hip) + distance(p, ankle) for p in (corner, other))
    return np.asarray(np.where((apart <= others)[..., None], corner, other))


def _locate_foot(anatomy: Anatomy, at: Mapping[str, Array], side: str) -> None:
    s = SIDES[side]
    (heel,) = need(at, s + "HEE", purpose=f"the {side} foot", instead=None)
    ball = [at[s + name] for name in ("MT1", "MT2") if s + name in at][:1]
    ball += [at[s + "MT5"]] if s + "MT5" in at else []
    if s + "MT2" in at or len(ball) == 2:
        front = at.get(s + "MT2", np.mean(ball, axis=0))
        tip = at.get(s + "TOE", heel + FOOT_PER_HEEL_TO_MT2 * (front - heel))
    elif s + "MTS" in at:
        inward = anatomy.points[f"{side}_ankle"] - at[s + "LM"]
        heel, front = heel + inward, at[s + "MTS"] + inward
        tip = heel + FOOT_PER_HEEL_TO_MT2 * (front - heel)
        anatomy.rules[s + "MT2"] = "foot half the ankle's width medial to its two markers"
    else:
        (front,) = need(at, s + "TOE", purpose=f"the {side} foot", instead=s + "MT2")
        tip = front
    along = unit(front - heel)
    anatomy.points |= {f"{side}_heel": heel, f"{side}_toe_tip": tip}
    anatomy.axes[f"{side}_foot"] = along
    if len(ball) == 2:
        axis = MEDIAL_SIGN[side] * unit(ball[0] - ball[1])
        if (dot(axis, anatomy.axes[f"{side}_ankle"]) < 0).any():
            anatomy.notes.append(Note.of("metatarsals_swapped", side=side))
        anatomy.points[f"{side}_toes"] = (ball[0] + ball[1]) / 2
        anatomy.axes[f"{side}_toes"] = axis
    else:
        middle = at.get(s + "MT5", heel + BALL_PER_FOOT * (tip - heel))
        anatomy.points[f"{side}_toes"] = heel + dot(middle - heel, along) * along
        anatomy.axes[f"{side}_toes"] = perpendicular(anatomy.axes[f"{side}_ankle"], along)
