"""Pelvis, trunk and head from their landmarks."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.calibration_pose.anatomy import MEDIAL_SIGN, Anatomy, Measures, need
from hbm.coordinates import SIDES, UP
from hbm.notes import Note
from hbm.spatial import Array, axes_from, cross, distance, perpendicular, unit

LUMBAR_PER_PELVIS_WIDTH: Final = {
    "male": (-0.264, 0.126),
    "female": (-0.289, 0.172),
    "unspecified": (-0.2765, 0.149),
}
"""L5/S1 from mid-ASIS, forward and up, as shares of the distance between the ASIS (Reed et al.
1999, SAE 1999-01-0959, as adapted to ASIS and PSIS by Dumas et al. 2007, J Biomech 40:543)."""

NECK_PER_C7_TO_NOTCH: Final = {"male": 0.55, "female": 0.53, "unspecified": 0.54}
NECK_ELEVATION_DEG: Final = {"male": 8.0, "female": 14.0, "unspecified": 11.0}
"""C7/T1 from C7, as share of the distance from C7 to jugular notch and angle above that line (Reed
et al. 1999; Dumas et al. 2007)."""

TRUNK_LANDMARKS: Final = frozenset(("C7", "T2", "T8", "T10", "JN", "XIPH", "LSHO", "RSHO"))
HEAD_PAIRS: Final = ("HEAD", "FHEAD", "BHEAD", "MAS")
"""Landmarks of which the head has a left and a right one."""


def locate_pelvis(anatomy: Anatomy, landmarks: Mapping[str, Array], measures: Measures) -> None:
    """Find the pelvis frame, both hip centres (the body's origin is midway) and the lumbar joint.

    The frame is that of ASIS and PSIS. A single missing iliac spine is taken as the mirror image of
    its opposite; the sacrum marker replaces both PSIS. Hip centres: `hip_center`. Lumbar joint:
    `LUMBAR_PER_PELVIS_WIDTH`. The leg length that the hips depend on is that of the markers or,
    without a medial malleolus, the measured one.
    """
    R, origin, back, notes = pelvis_frame(landmarks)
    anatomy.notes += notes
    anatomy.frames["pelvis"] = R
    anatomy.points |= {"mid_asis": origin, "mid_psis": back}
    spines = _iliac_spines(landmarks)[0]
    width, depth = distance(spines["LASIS"], spines["RASIS"]), distance(origin, back)
    for side, letter in SIDES.items():
        leg = _leg_length(landmarks, letter, spines[letter + "ASIS"])
        if leg is None or letter + "MM" not in landmarks:
            leg = measures.limb(side).leg_length_m or leg
        anatomy.points[f"{side}_hip"] = origin + R @ hip_center(side, width, depth, leg, measures)
        if leg is None and measures.hip == "harrington":
            anatomy.notes.append(Note.of("hip_without_leg_length", side=side))
    anatomy.points["pelvis"] = (anatomy.points["right_hip"] + anatomy.points["left_hip"]) / 2
    forward, up = LUMBAR_PER_PELVIS_WIDTH[measures.sex]
    anatomy.points["lumbar"] = origin + R @ (width * np.array([forward, 0.0, up]))


def pelvis_frame(landmarks: Mapping[str, Array]) -> tuple[Array, Array, Array, list[Note]]:
    """Give the pelvis frame.

    Parameters
    ----------
    landmarks
        Landmark -> position, (3,) [m].

    Returns
    -------
    tuple
        Orientation (columns: forward, left, up), (3, 3); mid-ASIS and mid-PSIS, (3,) [m]; rules
        that replaced missing landmarks.

    Raises
    ------
    ValueError
        If ASIS or PSIS are missing that no rule can replace.
    """
    at, notes = _iliac_spines(landmarks)
    left, right = need(
        at, "LASIS", "RASIS", purpose="the pelvis", instead="one ASIS with both PSIS"
    )
    if "LPSIS" in at and "RPSIS" in at:
        back = (at["LPSIS"] + at["RPSIS"]) / 2
    else:
        (back,) = need(at, "SACR", purpose="the pelvis", instead="LPSIS with RPSIS")
        notes.append(Note.of("psis_missing"))
    origin, across = (left + right) / 2, left - right
    return axes_from(across, cross(origin - back, across), exact="left"), origin, back, notes


def _iliac_spines(landmarks: Mapping[str, Array]) -> tuple[dict[str, Array], list[Note]]:
    """Give the landmarks, a single missing iliac spine as the mirror image of its opposite."""
    at = dict(landmarks)
    notes: list[Note] = []
    for a, b in (("ASIS", "PSIS"), ("PSIS", "ASIS")):
        if "L" + b in landmarks and "R" + b in landmarks:
            for side, other in ("LR", "RL"):
                if side + a not in at and other + a in at:
                    normal = unit(at["R" + b] - at["L" + b])
                    middle = (at["L" + b] + at["R" + b]) / 2
                    point = at[other + a]
                    at[side + a] = point - 2 * ((point - middle) @ normal) * normal
                    notes.append(
                        Note.of("pelvis_landmark_mirrored", landmark=side + a, opposite=other + a)
                    )
    return at, notes


def hip_center(
    side: str, width: float, depth: float, leg: float | None, measures: Measures
) -> Array:
    """Give a hip centre in the pelvis frame.

    Parameters
    ----------
    side
        "right" or "left".
    width, depth
        Distance between the ASIS; from mid-ASIS to mid-PSIS [m].
    leg
        Leg length from ASIS to medial malleolus [m]; None where unknown.
    measures
        The rule, the sex and the marker offset.

    Returns
    -------
    Array
        From mid-ASIS: forward, left, up, (3,) [m].

    Raises
    ------
    ValueError
        If the rule is unknown, or a functional centre is missing.

    Notes
    -----
    Harrington et al. 2007 (J Biomech 40:595), Table 3: by width, depth and leg length, or by the
    best single measures where leg length is unknown. Bell et al. 1990 (J Biomech 23:617). Both
    refer to bone, so that the marker offset is subtracted from the forward coordinate.
    """
    outward = -MEDIAL_SIGN[side]
    if isinstance(measures.hip, Mapping):
        if side not in measures.hip:
            raise ValueError(f"functional hip centres must name right and left, {side} is missing")
        return np.array(measures.hip[side], float)
    if measures.hip == "bell":
        ahead, out, up = -0.19 * width, 0.36 * width, -0.30 * width
    elif measures.hip == "harrington":
        ahead = -0.24 * depth - 0.0099
        if leg is None:
            out, up = 0.33 * width + 0.0073, -0.30 * width - 0.0109
        else:
            out = 0.28 * depth + 0.16 * width + 0.0079
            up = -0.16 * width - 0.04 * leg - 0.0071
    else:
        raise ValueError(f"hip must be 'harrington' or 'bell', got {measures.hip!r}")
    return np.array([ahead - measures.marker_offset_m, outward * out, up])


def _leg_length(landmarks: Mapping[str, Array], letter: str, spine: Array) -> float | None:
    """Leg length from ASIS to medial malleolus by way of the knee, the same when it is flexed."""
    knee = landmarks.get(letter + "MEK", landmarks.get(letter + "LEK"))
    ankle = landmarks.get(letter + "MM", landmarks.get(letter + "LM"))
    if knee is None or ankle is None:
        return None
    return distance(spine, knee) + distance(knee, ankle)


def locate_trunk(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures) -> None:
    """Find the trunk's frame, its upper end and the neck; none if it has too few landmarks.

    The axis runs from the midpoint of T10 and xiphoid (where one is missing: the lumbar joint) to
    the midpoint of C7 and jugular notch. Without C7 or jugular notch, the midpoint of the acromions
    is the top of the axis. Without an acromion as well, the axis runs from the lumbar joint through
    the midpoint of T10 and xiphoid up to the level of the jugular notch. In both cases the neck is
    the upper end of the axis; else it follows from C7 and notch (`NECK_PER_C7_TO_NOTCH`).
    """
    low = "T10" in at and "XIPH" in at
    bottom = (at["T10"] + at["XIPH"]) / 2 if low else anatomy.points["lumbar"]
    notes = [] if low else [Note.of("trunk_axis_from_lumbar_joint")]
    if "C7" in at and "JN" in at:
        top, forward = (at["C7"] + at["JN"]) / 2, at["JN"] - at["C7"]
        R = axes_from(cross(top - bottom, forward), top - bottom, exact="up")
        neck = at["C7"] + _neck(forward, R[:, 2], measures)
    elif "LSHO" in at and "RSHO" in at:
        top = neck = (at["LSHO"] + at["RSHO"]) / 2
        R = axes_from(at["LSHO"] - at["RSHO"], top - bottom, exact="up")
        notes.append(Note.of("trunk_axis_to_acromions"))
    elif low and "JN" in at:
        root = anatomy.points["lumbar"]
        up = unit(bottom - root)
        top = neck = root + ((at["JN"] - root) @ up) * up
        R = axes_from(cross(up, at["XIPH"] - at["T10"]), up, exact="up")
        notes.append(Note.of("trunk_axis_to_jugular_notch"))
    else:
        if not TRUNK_LANDMARKS.isdisjoint(at):
            anatomy.notes.append(Note.of("trunk_not_located"))
        return
    pelvis = anatomy.frames["pelvis"]
    if R[:, 0] @ pelvis[:, 0] < 0 or R[:, 2] @ pelvis[:, 2] < 0:
        raise ValueError(
            "trunk and pelvis face opposite directions; front and back markers (C7, T10 against "
            "JN, XIPH; ASIS against PSIS) or left and right are probably swapped"
        )
    anatomy.frames["thorax"] = R
    anatomy.points |= {"trunk_top": top, "neck": neck}
    anatomy.notes += notes


def _neck(forward: Array, up: Array, measures: Measures) -> Array:
    """Give the neck's position from C7, (3,) [m]."""
    ahead, above = unit(forward), perpendicular(up, forward)
    length = NECK_PER_C7_TO_NOTCH[measures.sex] * float(np.linalg.norm(forward))
    angle = np.radians(NECK_ELEVATION_DEG[measures.sex])
    return np.asarray(length * (np.cos(angle) * ahead + np.sin(angle) * above))


def locate_head(anatomy: Anatomy, at: Mapping[str, Array]) -> None:
    """Find the head's frame from its left, right and top markers; none if it has too few.

    Without a marker on top, pairs of markers at the front and back of the head or on the mastoids
    show its left, and its up is the vertical of the lab: the head is taken as level in the
    calibration pose, as Plug-in-Gait does. Its top is then above the middle of front and back.
    """
    pairs = [name for name in HEAD_PAIRS if {"L" + name, "R" + name} <= set(at)]
    middle = {name: (at["L" + name] + at["R" + name]) / 2 for name in pairs}
    if "HEAD" in middle and "THEAD" in at:
        across, up = at["LHEAD"] - at["RHEAD"], at["THEAD"] - middle["HEAD"]
        anatomy.frames["head"] = axes_from(across, up, exact="left")
        anatomy.points["vertex"] = at["THEAD"]
    elif middle:
        across = np.sum([at["L" + name] - at["R" + name] for name in pairs], axis=0)
        anatomy.frames["head"] = axes_from(across, np.array(UP), exact="left")
        front = middle.get("FHEAD", at.get("GLAB"))
        back = middle.get("BHEAD", middle.get("MAS"))
        if front is not None and back is not None:
            anatomy.points["mid_head"] = (front + back) / 2
