"""Joints of the legs from their landmarks."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.calibration_pose.anatomy import MEDIAL_SIGN, Anatomy, Measures, need
from hbm.calibration_pose.hinges import chord, locate_hinge
from hbm.coordinates import SIDES
from hbm.notes import Note
from hbm.spatial import Array, cross, distance, perpendicular, unit

HALF_WIDTH_PER_SHANK: Final = {"knee": 0.118, "ankle": 0.085}
"""Half the width of a joint without medial marker or stated width, as a share of the distance from
lateral epicondyle to lateral malleolus (Reed et al. 1999, SAE 1999-01-0959)."""

FOOT_PER_HEEL_TO_MT2: Final = 1.25
"""Length of the foot without a toe marker, from the heel marker."""

BALL_PER_FOOT: Final = 0.73
"""Ball of the foot without metatarsal markers, from the heel marker."""


def locate_leg(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures, side: str) -> None:
    """Find knee, ankle and foot.

    Knee: by the knee alignment device where one is in place (`alignment_corner`). Without it and
    without a medial marker, half the joint's width is as measured or by `HALF_WIDTH_PER_SHANK`, and
    medial is the pelvis' own direction (with a trochanter marker: towards the hip from it); for the
    ankle it is the knee's. The foot runs from the heel to the toe marker or, without one, as far as
    `FOOT_PER_HEEL_TO_MT2`.

    Deviations from the original
    ----------------------------
    Plug-in-Gait takes the medial directions from the markers on thigh and shank, which therefore
    stand on wands or get measured offsets. Many laboratories put them on the skin anywhere, which
    turns its knee axes by up to 40° (docs/marker_sets.md), so they only track here. Offsets of
    these markers and tibial torsion, which a file may state, are not used.
    """
    s = SIDES[side]
    sign, limb = MEDIAL_SIGN[side], measures.limb(side)
    hip, pelvis_left = anatomy.points[f"{side}_hip"], anatomy.frames["pelvis"][:, 1]
    device = alignment_corner(at, s, hip)
    if device is not None and s + "LEK" not in at:
        at = {**at, s + "LEK": device}
        anatomy.markers[s + "LEK"] = device
    known = s + "LEK" in at and s + "LM" in at
    shank = distance(at[s + "LEK"], at[s + "LM"]) if known else None

    def half_width(joint: str, width_m: float | None) -> float | None:
        by_shank = None if shank is None else HALF_WIDTH_PER_SHANK[joint] * shank
        return by_shank if width_m is None else measures.to_center(width_m)

    knee = half_width("knee", limb.knee_width_m)
    if device is not None and knee is not None:
        center = chord(device, hip, device - at[s + "KAX"], knee, f"{side}_knee")
        anatomy.points[f"{side}_knee"] = center
        anatomy.axes[f"{side}_knee"] = sign * unit(center - device)
        anatomy.notes.append(Note.of("knee_alignment_device", side=side))
    else:
        locate_hinge(
            anatomy,
            at,
            f"{side}_knee",
            (s + "LEK", s + "MEK"),
            proximal=hip,
            medial=hip - at[s + "GTRO"] if s + "GTRO" in at else sign * pelvis_left,
            half_width=knee,
            instead=f"{s}LEK with knee_width_m",
        )
    knee_axis = anatomy.axes[f"{side}_knee"]
    locate_hinge(
        anatomy,
        at,
        f"{side}_ankle",
        (s + "LM", s + "MM"),
        proximal=anatomy.points[f"{side}_knee"],
        medial=sign * knee_axis,
        half_width=half_width("ankle", limb.ankle_width_m),
        instead=f"{s}LM with ankle_width_m",
    )
    for joint, axis in (("knee", pelvis_left), ("ankle", knee_axis)):
        if anatomy.axes[f"{side}_{joint}"] @ axis < 0:
            raise ValueError(
                f"the {side} {joint}'s lateral marker lies on its medial side; left and right, or "
                "medial and lateral markers, are probably swapped"
            )
    _locate_foot(anatomy, at, side)


def alignment_corner(at: Mapping[str, Array], letter: str, hip: Array) -> Array | None:
    """Give the corner of a knee alignment device, which lies on the lateral epicondyle.

    Its three rods are equally long and at right angles; of the two corners that fit their ends, the
    one nearer to hip and lateral malleolus is meant. In Plug-in-Gait it is the knee marker of the
    calibration pose.

    Parameters
    ----------
    at
        Landmark -> position, (3,) [m].
    letter
        "L" or "R".
    hip
        Hip centre, (3,) [m].

    Returns
    -------
    Array or None
        (3,) [m]; None without the device or the malleolus.
    """
    names = [letter + name for name in ("KAX", "KD1", "KD2", "LM")]
    if not set(names) <= set(at):
        return None
    a, b, c, ankle = (at[name] for name in names)
    span = (distance(a, b) + distance(b, c) + distance(c, a)) / 3
    normal = unit(cross(b - a, c - a))
    corners = ((a + b + c) / 3 + way * span / np.sqrt(6) * normal for way in (1, -1))
    nearer: Array = min(corners, key=lambda p: distance(p, hip) + distance(p, ankle))
    return nearer


def _locate_foot(anatomy: Anatomy, at: Mapping[str, Array], side: str) -> None:
    s = SIDES[side]
    (heel,) = need(at, s + "HEE", purpose=f"the {side} foot", instead="no other marker")
    ball = [at[s + name] for name in ("MT1", "MT2") if s + name in at][:1]
    ball += [at[s + "MT5"]] if s + "MT5" in at else []
    if s + "MT2" in at or len(ball) == 2:
        front = at.get(s + "MT2", np.mean(ball, axis=0))
        tip = at.get(s + "TOE", heel + FOOT_PER_HEEL_TO_MT2 * (front - heel))
    else:
        (front,) = need(at, s + "TOE", purpose=f"the {side} foot", instead=s + "MT2")
        tip = front
    along = unit(front - heel)
    anatomy.points |= {f"{side}_heel": heel, f"{side}_toe_tip": tip}
    anatomy.axes[f"{side}_foot"] = along
    if len(ball) == 2:
        axis = MEDIAL_SIGN[side] * unit(ball[0] - ball[1])
        if axis @ anatomy.axes[f"{side}_ankle"] < 0:
            anatomy.notes.append(Note.of("metatarsals_swapped", side=side))
        anatomy.points[f"{side}_toes"] = (ball[0] + ball[1]) / 2
        anatomy.axes[f"{side}_toes"] = axis
    else:
        middle = at.get(s + "MT5", heel + BALL_PER_FOOT * (tip - heel))
        anatomy.points[f"{side}_toes"] = heel + ((middle - heel) @ along) * along
        anatomy.axes[f"{side}_toes"] = perpendicular(anatomy.axes[f"{side}_ankle"], along)
