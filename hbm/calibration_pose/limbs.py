"""Joints of legs and arms from their landmarks."""

from collections.abc import Mapping

import numpy as np

from hbm.calibration_pose.anatomy import TO_LEFT, Anatomy, Measures, need
from hbm.coordinates import SIDES
from hbm.notes import Note
from hbm.spatial import Array, distance, perpendicular, unit


def locate_leg(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures, side: str) -> None:
    """Find knee, ankle and foot.

    Without medial markers and widths the half widths are 0.118 and 0.085 of the distance from
    lateral epicondyle to lateral malleolus (Reed et al. 1999, SAE 1999-01-0959). The foot's length
    runs from the heel to the toe marker, or 1.25 of the way from heel to second metatarsal head.
    """
    s = SIDES[side]
    hip, pelvis_left = anatomy.points[f"{side}_hip"], anatomy.frames["pelvis"][:, 1]
    known = s + "LEK" in at and s + "LM" in at
    shank = distance(at[s + "LEK"], at[s + "LM"]) if known else None

    def half(width: float | None, share: float) -> float | None:
        if width is not None:
            return width / 2 + measures.marker_offset_m
        return None if shank is None else share * shank

    _hinge(
        anatomy,
        at,
        f"{side}_knee",
        (s + "LEK", s + "MEK"),
        proximal=hip,
        medial=hip - at[s + "GTRO"] if s + "GTRO" in at else TO_LEFT[side] * pelvis_left,
        half_width=half(measures.knee_width_m, 0.118),
        instead=f"{s}LEK with knee_width_m",
    )
    knee_axis = anatomy.axes[f"{side}_knee"]
    _hinge(
        anatomy,
        at,
        f"{side}_ankle",
        (s + "LM", s + "MM"),
        proximal=anatomy.points[f"{side}_knee"],
        medial=TO_LEFT[side] * knee_axis,
        half_width=half(measures.ankle_width_m, 0.085),
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
        tip = at.get(s + "TOE", heel + 1.25 * (front - heel))
    else:
        (front,) = need(at, s + "TOE", purpose=f"the {side} foot", instead=s + "MT2")
        tip = front
    along = unit(front - heel)
    anatomy.points |= {f"{side}_heel": heel, f"{side}_toe_tip": tip}
    anatomy.axes[f"{side}_foot"] = along
    if s + "MT2" in at and s + "MT5" in at:
        anatomy.points[f"{side}_toes"] = (at[s + "MT2"] + at[s + "MT5"]) / 2
        anatomy.axes[f"{side}_toes"] = TO_LEFT[side] * unit(at[s + "MT2"] - at[s + "MT5"])
    else:
        ball = at.get(s + "MT5", heel + 0.73 * (tip - heel))
        anatomy.points[f"{side}_toes"] = heel + ((ball - heel) @ along) * along
        anatomy.axes[f"{side}_toes"] = perpendicular(anatomy.axes[f"{side}_ankle"], along)


def locate_arm(anatomy: Anatomy, at: Mapping[str, Array], side: str) -> None:
    """Find shoulder, elbow, wrist and knuckle; absent if the arm has too few landmarks.

    Shoulder: 0.17 of the distance between the acromions below the acromion along the trunk (Rab et
    al. 2002, J Orthop Res 20:71); without the other acromion, that distance is twice the acromion's
    from the trunk's middle. Elbow without medial marker: 0.155 of the distance from lateral
    epicondyle to wrist (Reed et al. 1999) towards the line from shoulder to wrist.
    """
    s = SIDES[side]
    styloids = [at[name] for name in (s + "LW", s + "MW") if name in at]
    if not {s + "SHO", s + "LEE"} <= set(at) or not styloids:
        if styloids or any(s + name in at for name in ("LEE", "MEE", "FIN")):
            missing = [n for n in (s + "SHO", s + "LEE") if n not in at]
            missing += [] if styloids else [f"{s}LW or {s}MW"]
            anatomy.notes.append(Note.of("arm_not_located", side=side, missing=tuple(missing)))
        return
    trunk = anatomy.frames["trunk"]
    if {"LSHO", "RSHO"} <= set(at):
        width = distance(at["LSHO"], at["RSHO"])
    else:
        width = 2 * abs(float((at[s + "SHO"] - anatomy.points["trunk_top"]) @ trunk[:, 1]))
    shoulder = at[s + "SHO"] - 0.17 * width * trunk[:, 2]
    wrist, outer = np.mean(styloids, axis=0), at[s + "LEE"]
    reach = unit(wrist - shoulder)
    on_line = shoulder + ((outer - shoulder) @ reach) * reach
    _hinge(
        anatomy,
        at,
        f"{side}_elbow",
        (s + "LEE", s + "MEE"),
        proximal=shoulder,
        medial=on_line - outer,
        half_width=0.155 * distance(outer, wrist),
        instead=s + "MEE",
    )
    anatomy.points |= {f"{side}_shoulder": shoulder, f"{side}_wrist": wrist}
    if len(styloids) == 2:
        anatomy.axes[f"{side}_wrist"] = TO_LEFT[side] * unit(styloids[0] - styloids[1])
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
    """Find a joint's centre half-way between two markers, or beside the lateral one.

    Half-way: Dumas et al. 2007 (J Biomech 40:543). Beside: the chord construction of Davis et al.
    1991 (Hum Mov Sci 10:575) with the plane given by ``medial``.
    """
    lateral, other = names
    to_left = TO_LEFT[joint.split("_", maxsplit=1)[0]]
    if other in landmarks or half_width is None:
        outer, inner = need(landmarks, *names, purpose=f"the {joint}", instead=instead)
        center = (outer + inner) / 2
    else:
        (outer,) = need(landmarks, lateral, purpose=f"the {joint}", instead=other)
        center = _beside(outer, proximal, medial, half_width, joint)
        anatomy.notes.append(
            Note.of("joint_center_from_width", marker=other, joint=joint, lateral=lateral)
        )
    anatomy.points[joint] = center
    anatomy.axes[joint] = to_left * unit(center - outer)


def _beside(marker: Array, proximal: Array, medial: Array, reach: float, joint: str) -> Array:
    """Give the centre medial of a lateral marker, seen from the proximal joint at a right angle."""
    up = unit(proximal - marker)
    share = reach / distance(proximal, marker)
    if share >= 1:
        raise ValueError(
            f"the {joint} would be {reach * 1000:.0f} mm from its lateral marker, farther than "
            "the next joint; check the widths and the markers' names"
        )
    inward = perpendicular(medial, up)
    return np.asarray(marker + reach * (share * up + np.sqrt(1 - share**2) * inward))
