"""Joints of legs and arms from their landmarks."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.calibration_pose.anatomy import MEDIAL_SIGN, Anatomy, Measures, need
from hbm.coordinates import SIDES
from hbm.notes import Note
from hbm.spatial import Array, distance, perpendicular, unit

HALF_WIDTH_PER_SHANK: Final = {"knee": 0.118, "ankle": 0.085}
"""Half the width of a joint without medial marker or stated width, as a share of the distance from
lateral epicondyle to lateral malleolus (Reed et al. 1999, SAE 1999-01-0959)."""

HALF_WIDTH_PER_FOREARM: Final = 0.155
"""Half the width of an elbow without medial marker, as a share of the distance from lateral
epicondyle to wrist (Reed et al. 1999)."""

SHOULDER_DROP_PER_WIDTH: Final = 0.17
"""Distance of the shoulder joint below the acromion, as a share of the distance between the
acromions (Rab et al. 2002, J Orthop Res 20:71)."""

FOOT_PER_HEEL_TO_MT2: Final = 1.25
"""Length of the foot without a toe marker, from the heel marker."""

BALL_PER_FOOT: Final = 0.73
"""Ball of the foot without metatarsal markers, from the heel marker."""


def locate_leg(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures, side: str) -> None:
    """Find knee, ankle and foot.

    Without a medial marker, half the joint's width is as given or by `HALF_WIDTH_PER_SHANK`. The
    foot runs from the heel to the toe marker or, without one, as far as `FOOT_PER_HEEL_TO_MT2`.
    """
    s = SIDES[side]
    hip, pelvis_left = anatomy.points[f"{side}_hip"], anatomy.frames["pelvis"][:, 1]
    known = s + "LEK" in at and s + "LM" in at
    shank = distance(at[s + "LEK"], at[s + "LM"]) if known else None

    def half_width(joint: str, width_m: float | None) -> float | None:
        if width_m is not None:
            return width_m / 2 + measures.marker_offset_m
        return None if shank is None else HALF_WIDTH_PER_SHANK[joint] * shank

    _hinge(
        anatomy,
        at,
        f"{side}_knee",
        (s + "LEK", s + "MEK"),
        proximal=hip,
        medial=hip - at[s + "GTRO"] if s + "GTRO" in at else MEDIAL_SIGN[side] * pelvis_left,
        half_width=half_width("knee", measures.knee_width_m),
        instead=f"{s}LEK with knee_width_m",
    )
    knee_axis = anatomy.axes[f"{side}_knee"]
    _hinge(
        anatomy,
        at,
        f"{side}_ankle",
        (s + "LM", s + "MM"),
        proximal=anatomy.points[f"{side}_knee"],
        medial=MEDIAL_SIGN[side] * knee_axis,
        half_width=half_width("ankle", measures.ankle_width_m),
        instead=f"{s}LM with ankle_width_m",
    )
    for joint, axis in (("knee", pelvis_left), ("ankle", knee_axis)):
        if anatomy.axes[f"{side}_{joint}"] @ axis < 0:
            raise ValueError(
                f"the {side} {joint}'s lateral marker lies on its medial side; left and right, or "
                "medial and lateral markers, are probably swapped"
            )
    _foot(anatomy, at, side)


def _foot(anatomy: Anatomy, at: Mapping[str, Array], side: str) -> None:
    s = SIDES[side]
    (heel,) = need(at, s + "HEE", purpose=f"the {side} foot", instead="no other marker")
    if s + "MT2" in at:
        front = at[s + "MT2"]
        tip = at.get(s + "TOE", heel + FOOT_PER_HEEL_TO_MT2 * (front - heel))
    else:
        (front,) = need(at, s + "TOE", purpose=f"the {side} foot", instead=s + "MT2")
        tip = front
    along = unit(front - heel)
    anatomy.points |= {f"{side}_heel": heel, f"{side}_toe_tip": tip}
    anatomy.axes[f"{side}_foot"] = along
    if s + "MT2" in at and s + "MT5" in at:
        anatomy.points[f"{side}_toes"] = (at[s + "MT2"] + at[s + "MT5"]) / 2
        anatomy.axes[f"{side}_toes"] = MEDIAL_SIGN[side] * unit(at[s + "MT2"] - at[s + "MT5"])
    else:
        ball = at.get(s + "MT5", heel + BALL_PER_FOOT * (tip - heel))
        anatomy.points[f"{side}_toes"] = heel + ((ball - heel) @ along) * along
        anatomy.axes[f"{side}_toes"] = perpendicular(anatomy.axes[f"{side}_ankle"], along)


def locate_arm(anatomy: Anatomy, at: Mapping[str, Array], side: str) -> None:
    """Find shoulder, elbow, wrist and knuckle; none if the arm has too few landmarks.

    Shoulder: below the acromion along the trunk by `SHOULDER_DROP_PER_WIDTH`; without the other
    acromion, the width is twice the acromion's distance from the trunk's mid-plane. Elbow without
    medial marker: `HALF_WIDTH_PER_FOREARM` towards the line from shoulder to wrist.
    """
    s = SIDES[side]
    styloids = [at[name] for name in (s + "LW", s + "MW") if name in at]
    if not {s + "SHO", s + "LEE"} <= set(at) or not styloids:
        if styloids or any(s + name in at for name in ("LEE", "MEE", "FIN")):
            missing = [n for n in (s + "SHO", s + "LEE") if n not in at]
            missing += [] if styloids else [f"{s}LW or {s}MW"]
            anatomy.notes.append(Note.of("arm_not_located", side=side, missing=tuple(missing)))
        return
    thorax = anatomy.frames["thorax"]
    if {"LSHO", "RSHO"} <= set(at):
        width = distance(at["LSHO"], at["RSHO"])
    else:
        width = 2 * abs(float((at[s + "SHO"] - anatomy.points["trunk_top"]) @ thorax[:, 1]))
    shoulder = at[s + "SHO"] - SHOULDER_DROP_PER_WIDTH * width * thorax[:, 2]
    wrist, lateral = np.mean(styloids, axis=0), at[s + "LEE"]
    along = unit(wrist - shoulder)
    on_line = shoulder + ((lateral - shoulder) @ along) * along
    _hinge(
        anatomy,
        at,
        f"{side}_elbow",
        (s + "LEE", s + "MEE"),
        proximal=shoulder,
        medial=on_line - lateral,
        half_width=HALF_WIDTH_PER_FOREARM * distance(lateral, wrist),
        instead=s + "MEE",
    )
    anatomy.points |= {f"{side}_shoulder": shoulder, f"{side}_wrist": wrist}
    if len(styloids) == 2:
        anatomy.axes[f"{side}_wrist"] = MEDIAL_SIGN[side] * unit(styloids[0] - styloids[1])
    else:
        anatomy.axes[f"{side}_wrist"] = anatomy.axes[f"{side}_elbow"]
        anatomy.notes.append(Note.of("wrist_axis_from_elbow", side=side))
    if s + "FIN" in at:
        anatomy.points[f"{side}_knuckle"] = at[s + "FIN"]


def _hinge(
    anatomy: Anatomy,
    landmarks: Mapping[str, Array],
    joint: str,
    names: tuple[str, str],
    *,
    proximal: Array,
    medial: Array,
    half_width: float | None,
    instead: str,
) -> None:
    """Find a joint's centre midway between two markers, or medial to the lateral one.

    Midway: Dumas et al. 2007 (J Biomech 40:543). Medial: the chord construction of Davis et al.
    1991 (Hum Mov Sci 10:575) with the plane given by ``medial``.
    """
    lateral, other = names
    sign = MEDIAL_SIGN[joint.split("_", maxsplit=1)[0]]
    if other in landmarks or half_width is None:
        outer, inner = need(landmarks, *names, purpose=f"the {joint}", instead=instead)
        center = (outer + inner) / 2
    else:
        (outer,) = need(landmarks, lateral, purpose=f"the {joint}", instead=other)
        center = _chord(outer, proximal, medial, half_width, joint)
        anatomy.notes.append(
            Note.of("joint_center_from_width", marker=other, joint=joint, lateral=lateral)
        )
    anatomy.points[joint] = center
    anatomy.axes[joint] = sign * unit(center - outer)


def _chord(marker: Array, proximal: Array, medial: Array, half_width: float, joint: str) -> Array:
    """Give the centre medial to a lateral marker, at a right angle to the bone towards it."""
    up = unit(proximal - marker)
    share = half_width / distance(proximal, marker)
    if share >= 1:
        raise ValueError(
            f"the {joint} would be {half_width * 1000:.0f} mm from its lateral marker, farther "
            "than the next joint; check the widths and the markers' names"
        )
    inward = perpendicular(medial, up)
    return np.asarray(marker + half_width * (share * up + np.sqrt(1 - share**2) * inward))
