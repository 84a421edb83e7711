"""Joint centres and axes from anatomical landmarks in a calibration pose.

Every rule names its source; where a landmark is missing the next documented rule is taken and said
so, and where none is left the error says which marker would do. All positions are in lab axes;
whichever way the subject faces makes no difference.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from hbm.segments import Sex
from hbm.spatial import Array

HipRule = Literal["harrington", "bell"]
SIDES: Final = {"right": "R", "left": "L"}


@dataclass(frozen=True, slots=True)
class Measures:
    """What is known of a subject beyond the markers.

    Attributes
    ----------
    sex
        "male", "female" or "unspecified".
    hip
        Hip centre by "harrington" (2007) or "bell" (1990), or functional centres: side -> position
        in the pelvis frame (origin mid-ASIS, x forward, y left, z up), (3,) [m].
    knee_width_m, ankle_width_m
        Joint widths, for marker sets without medial markers [m].
    marker_offset_m
        Marker radius plus base plate: how far a marker's centre is from the skin [m].
    """

    sex: Sex = "unspecified"
    hip: HipRule | Mapping[str, Array] = "harrington"
    knee_width_m: float | None = None
    ankle_width_m: float | None = None
    marker_offset_m: float = 0.009


@dataclass(slots=True)
class Anatomy:
    """Joint centres, axes and segment ends of a subject in the calibration pose.

    Attributes
    ----------
    points
        Positions by name, such as ``right_knee`` or ``neck``, (3,) [m]. What could not be seen
        (head or arms without markers) is absent.
    axes
        Unit vectors by name, such as ``right_knee``; all point to the subject's left in the
        anatomical position.
    frames
        Orientations of pelvis, trunk and head (columns: forward, left, up), (3, 3).
    notes
        Which rules stood in for missing landmarks.
    """

    points: dict[str, Array] = field(default_factory=dict)
    axes: dict[str, Array] = field(default_factory=dict)
    frames: dict[str, Array] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def locate_anatomy(landmarks: Mapping[str, Array], measures: Measures) -> Anatomy:
    """Find all joint centres and axes.

    Parameters
    ----------
    landmarks
        Landmark -> position in the calibration pose, (3,) [m], lab axes; missing ones absent.
    measures
        What is known of the subject beyond the markers.

    Returns
    -------
    Anatomy
        In the lab, in the calibration pose.

    Raises
    ------
    ValueError
        If a pelvis, leg or trunk landmark is missing and no rule can stand in for it.
    """
    anatomy = Anatomy()
    _pelvis(anatomy, landmarks, measures)
    for side in SIDES:
        _leg(anatomy, landmarks, measures, side)
    _trunk(anatomy, landmarks, measures)
    _head(anatomy, landmarks)
    for side in SIDES:
        _arm(anatomy, landmarks, side)
    return anatomy


def unit(vector: Array) -> Array:
    """Give a vector's direction, (3,)."""
    return np.asarray(vector / np.linalg.norm(vector))


def perpendicular(vector: Array, to: Array) -> Array:
    """Give the direction of the part of a vector that is perpendicular to another, (3,)."""
    along = unit(to)
    return unit(vector - (vector @ along) * along)


def frame(left: Array, up: Array, exact: Literal["left", "up"]) -> Array:
    """Give a rotation (columns: forward, left, up) from two directions, one kept exactly."""
    if exact == "left":
        y = unit(left)
        z = perpendicular(up, y)
    else:
        z = unit(up)
        y = perpendicular(left, z)
    return np.column_stack([np.cross(y, z), y, z])


def _need(landmarks: Mapping[str, Array], *names: str, purpose: str, instead: str) -> list[Array]:
    missing = [name for name in names if name not in landmarks]
    if missing:
        raise ValueError(
            f"{purpose} needs the landmark{'s' * (len(missing) > 1)} {', '.join(missing)}, which "
            f"no marker shows in the calibration pose; {instead} would do instead"
        )
    return [landmarks[name] for name in names]


def _mirror(point: Array, a: Array, b: Array) -> Array:
    """Reflect a point in the plane half-way between two points."""
    normal = unit(b - a)
    return np.asarray(point - 2 * ((point - (a + b) / 2) @ normal) * normal)


def _pelvis(anatomy: Anatomy, landmarks: Mapping[str, Array], measures: Measures) -> None:
    """Pelvis frame from ASIS and PSIS; origin of the body at mid-hip.

    Hip centres: Harrington et al. 2007 (J Biomech 40:595), by pelvic width, depth and leg length;
    or Bell et al. 1990 (J Biomech 23:617). A single missing spine is the mirror image of its
    opposite; the sacrum marker stands in for both PSIS.
    """
    at = dict(landmarks)
    for a, b in (("ASIS", "PSIS"), ("PSIS", "ASIS")):
        if "L" + b in at and "R" + b in at:
            for side, other in ("LR", "RL"):
                if side + a not in at and other + a in at:
                    at[side + a] = _mirror(at[other + a], at["L" + b], at["R" + b])
                    anatomy.notes.append(f"{side + a} is missing: taken as mirror of {other + a}")
    left, right = _need(
        at, "LASIS", "RASIS", purpose="the pelvis", instead="one ASIS with both PSIS"
    )
    if "LPSIS" in at and "RPSIS" in at:
        back = (at["LPSIS"] + at["RPSIS"]) / 2
    else:
        (back,) = _need(at, "SACR", purpose="the pelvis", instead="LPSIS and RPSIS")
        anatomy.notes.append("PSIS are missing: the sacrum marker stands for their middle")

    origin = (left + right) / 2
    across = left - right
    R = frame(across, np.cross(origin - back, across), exact="left")
    width, depth = float(np.linalg.norm(across)), float(np.linalg.norm(origin - back))
    anatomy.frames["pelvis"] = R
    anatomy.points |= {"mid_asis": origin, "mid_psis": back}

    for side, letter in SIDES.items():
        outward = 1.0 if side == "left" else -1.0
        if isinstance(measures.hip, Mapping):
            if side not in measures.hip:
                raise ValueError(f"functional hip centres must name right and left, {side} is not")
            local = np.asarray(measures.hip[side], float)
        elif measures.hip == "bell":
            local = width * np.array([-0.19, outward * 0.36, -0.30])
            local[0] -= measures.marker_offset_m
        elif measures.hip == "harrington":
            spine = left if side == "left" else right
            leg = _leg_length(landmarks, letter, spine)
            down = (
                -0.16 * width - 0.04 * leg - 0.0071 if leg is not None else -0.30 * width - 0.0109
            )
            out = 0.28 * depth + 0.16 * width + 0.0079 if leg is not None else 0.33 * width + 0.0073
            if leg is None:
                anatomy.notes.append(f"{side} hip by Harrington's rule without leg length")
            local = np.array([-0.24 * depth - 0.0099, outward * out, down])
            local[0] -= measures.marker_offset_m
        else:
            raise ValueError(f"hip must be 'harrington' or 'bell', got {measures.hip!r}")
        anatomy.points[f"{side}_hip"] = origin + R @ local
    anatomy.points["pelvis"] = (anatomy.points["right_hip"] + anatomy.points["left_hip"]) / 2

    share = {"male": (-0.264, 0.126), "female": (-0.289, 0.172), "unspecified": (-0.2765, 0.149)}
    back_share, up_share = share[measures.sex]
    anatomy.points["lumbar"] = origin + R @ (width * np.array([back_share, 0.0, up_share]))


def _leg_length(landmarks: Mapping[str, Array], letter: str, spine: Array) -> float | None:
    """Leg length ASIS to medial malleolus, over the knee so that a bent leg is as long."""
    knee = landmarks.get(letter + "MEK", landmarks.get(letter + "LEK"))
    ankle = landmarks.get(letter + "MM", landmarks.get(letter + "LM"))
    if knee is None or ankle is None:
        return None
    return float(np.linalg.norm(spine - knee) + np.linalg.norm(knee - ankle))


def _beside(marker: Array, proximal: Array, medial: Array, distance: float) -> Array:
    """Joint centre medial of a lateral marker, seen from the proximal joint at a right angle."""
    up = unit(proximal - marker)
    share = distance / float(np.linalg.norm(proximal - marker))
    inward = perpendicular(medial, up)
    return np.asarray(marker + distance * (share * up + np.sqrt(1 - share**2) * inward))


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
    """Joint centre half-way between two epicondyles, or beside the lateral one.

    Half-way: Dumas et al. 2007 (J Biomech 40:543). Beside: the chord construction of Davis et al.
    1991 (Hum Mov Sci 10:575) with the plane given by ``medial``.
    """
    lateral, medial_name = names
    to_left = 1.0 if joint.startswith("right") else -1.0
    (outer,) = _need(landmarks, lateral, purpose=f"the {joint}", instead=instead)
    if medial_name in landmarks:
        inner = landmarks[medial_name]
        anatomy.points[joint] = (outer + inner) / 2
        anatomy.axes[joint] = to_left * unit(inner - outer)
        return
    if half_width is None:
        _need(landmarks, medial_name, purpose=f"the {joint}", instead=instead)
    assert half_width is not None
    center = _beside(outer, proximal, medial, half_width)
    anatomy.points[joint] = center
    anatomy.axes[joint] = to_left * unit(center - outer)
    anatomy.notes.append(
        f"{medial_name} is missing: {joint} centre {half_width * 1000:.0f} mm medial of {lateral}"
    )


def _leg(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures, side: str) -> None:
    """Knee, ankle and foot.

    Without medial markers and widths the half widths are 0.118 and 0.085 of the distance from
    lateral epicondyle to lateral malleolus (Reed et al. 1999, SAE 1999-01-0959).
    """
    s = SIDES[side]
    hip = anatomy.points[f"{side}_hip"]
    inward = (1.0 if side == "right" else -1.0) * anatomy.frames["pelvis"][:, 1]
    shank = (
        float(np.linalg.norm(at[s + "LEK"] - at[s + "LM"]))
        if s + "LEK" in at and s + "LM" in at
        else None
    )

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
        medial=hip - at[s + "GTRO"] if s + "GTRO" in at else inward,
        half_width=half(measures.knee_width_m, 0.118),
        instead="a marker on the lateral epicondyle with knee_width_m",
    )
    knee_axis = anatomy.axes[f"{side}_knee"]
    _hinge(
        anatomy,
        at,
        f"{side}_ankle",
        (s + "LM", s + "MM"),
        proximal=anatomy.points[f"{side}_knee"],
        medial=knee_axis if side == "right" else -knee_axis,
        half_width=half(measures.ankle_width_m, 0.085),
        instead="a marker on the lateral malleolus with ankle_width_m",
    )
    (heel,) = _need(at, s + "HEE", purpose=f"the {side} foot", instead="a heel marker")
    if s + "MT2" in at:
        front = at[s + "MT2"]
        tip = at.get(s + "TOE", heel + 1.25 * (front - heel))
    else:
        (front,) = _need(at, s + "TOE", purpose=f"the {side} foot", instead=s + "MT2")
        tip = front
    anatomy.points |= {f"{side}_heel": heel, f"{side}_toe_tip": tip}
    along = unit(front - heel)
    anatomy.axes[f"{side}_foot"] = along
    if s + "MT2" in at and s + "MT5" in at:
        anatomy.points[f"{side}_toes"] = (at[s + "MT2"] + at[s + "MT5"]) / 2
        to_left = 1.0 if side == "right" else -1.0
        anatomy.axes[f"{side}_toes"] = to_left * unit(at[s + "MT2"] - at[s + "MT5"])
    else:
        ball = at.get(s + "MT5", heel + 0.73 * (tip - heel))
        anatomy.points[f"{side}_toes"] = heel + ((ball - heel) @ along) * along
        anatomy.axes[f"{side}_toes"] = perpendicular(anatomy.axes[f"{side}_ankle"], along)


def _trunk(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures) -> None:
    """Trunk axis from the middle of T10 and xiphoid to the middle of C7 and jugular notch.

    Neck (C7/T1): 0.55 (women 0.53) of the distance C7 to jugular notch, 8° (14°) above that line
    (Reed et al. 1999; Dumas et al. 2007). Without C7 or jugular notch the acromions stand in: their
    middle is the top of the axis, and the neck lies on it.
    """
    pelvis = anatomy.frames["pelvis"]
    low = [at[name] for name in ("T10", "XIPH") if name in at]
    bottom = (low[0] + low[1]) / 2 if len(low) == 2 else anatomy.points["lumbar"]
    if len(low) == 2:
        anatomy.points["xiphoid_level"] = bottom
    if "C7" in at and "JN" in at:
        top, forward = (at["C7"] + at["JN"]) / 2, at["JN"] - at["C7"]
        up = top - bottom
        R = frame(np.cross(up, forward), up, exact="up")
        share, lift = {"male": (0.55, 8.0), "female": (0.53, 14.0), "unspecified": (0.54, 11.0)}[
            measures.sex
        ]
        ahead = unit(forward)
        above = perpendicular(R[:, 2], ahead)
        reach = share * float(np.linalg.norm(forward))
        anatomy.points["neck"] = at["C7"] + reach * (
            np.cos(np.radians(lift)) * ahead + np.sin(np.radians(lift)) * above
        )
        anatomy.points["cervicale"] = at["C7"]
    else:
        left, right = _need(
            at, "LSHO", "RSHO", purpose="the trunk", instead="C7 with JN (jugular notch)"
        )
        top = (left + right) / 2
        R = frame(left - right, top - bottom, exact="up")
        anatomy.points["neck"] = top
        anatomy.notes.append("C7 or JN is missing: the trunk's axis ends between the acromions")
    if len(low) < 2:
        anatomy.notes.append("T10 or XIPH is missing: the trunk's axis starts at the lumbar joint")
    if R[:, 0] @ pelvis[:, 0] < 0:
        raise ValueError(
            "the trunk markers face backwards relative to the pelvis; front and back markers "
            "(C7, T10 against JN, XIPH) or left and right are probably swapped"
        )
    anatomy.frames["trunk"] = R
    anatomy.points["trunk_top"] = top


def _head(anatomy: Anatomy, at: Mapping[str, Array]) -> None:
    """Head from its left, right and top markers; absent if one of them is."""
    if not {"LHEAD", "RHEAD", "THEAD"} <= set(at):
        return
    across, middle = at["LHEAD"] - at["RHEAD"], (at["LHEAD"] + at["RHEAD"]) / 2
    anatomy.frames["head"] = frame(across, at["THEAD"] - middle, exact="left")
    anatomy.points["vertex"] = at["THEAD"]


def _arm(anatomy: Anatomy, at: Mapping[str, Array], side: str) -> None:
    """Shoulder, elbow, wrist and knuckle; absent if the arm has too few landmarks.

    Shoulder: 0.17 of the distance between the acromions below the acromion along the trunk (Rab et
    al. 2002, J Orthop Res 20:71). Elbow without medial marker: 0.155 of the distance from lateral
    epicondyle to wrist (Reed et al. 1999) towards the line from shoulder to wrist.
    """
    s = SIDES[side]
    wrist_names = [n for n in (s + "LW", s + "MW") if n in at]
    if not {"LSHO", "RSHO", s + "LEE"} <= set(at) or not wrist_names:
        return
    drop = 0.17 * float(np.linalg.norm(at["LSHO"] - at["RSHO"]))
    shoulder = at[s + "SHO"] - drop * anatomy.frames["trunk"][:, 2]
    wrist = np.mean([at[n] for n in wrist_names], axis=0)
    outer = at[s + "LEE"]
    reach = unit(wrist - shoulder)
    on_line = shoulder + ((outer - shoulder) @ reach) * reach
    _hinge(
        anatomy,
        at,
        f"{side}_elbow",
        (s + "LEE", s + "MEE"),
        proximal=shoulder,
        medial=on_line - outer,
        half_width=0.155 * float(np.linalg.norm(outer - wrist)),
        instead="a marker on the lateral epicondyle",
    )
    anatomy.points |= {f"{side}_shoulder": shoulder, f"{side}_wrist": wrist}
    if len(wrist_names) == 2:
        to_left = 1.0 if side == "right" else -1.0
        anatomy.axes[f"{side}_wrist"] = to_left * unit(at[s + "LW"] - at[s + "MW"])
    else:
        anatomy.axes[f"{side}_wrist"] = anatomy.axes[f"{side}_elbow"]
        anatomy.notes.append(f"{side} wrist has one marker: its axis is taken as the elbow's")
    if s + "FIN" in at:
        anatomy.points[f"{side}_knuckle"] = at[s + "FIN"]
