"""Joint centres and axes from anatomical landmarks in a calibration pose.

Every rule names its source. Where a landmark is missing the next documented rule is used, with a
note; where there is none the error says which marker would do. All positions are in lab axes,
whatever direction the subject faces.

De Leva's lengths of the trunk are distances between landmarks that are projected on a segment's
longitudinal axis. Her rows agree only so: with VERT-CERV and with VERT-MIDG, whose ends lie a
hand's breadth apart in depth, the head's centre is 121.5 mm below the vertex; with CERV-XYPH and
with SUPR-XYPH, the upper trunk's is 122.6 mm below the cervicale; and the trunk's parts sum to the
trunk within 0.1 mm.
"""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hbm.calibration_pose.anatomy import (
    MEDIAL_SIGN,
    SHOULDER_DROP_PER_WIDTH,
    Anatomy,
    Measures,
    locate_arm,
    locate_leg,
    need,
)
from hbm.coordinates import SIDES, UP
from hbm.segments import SAMPLE_STATURE_M, Sex, columns_of
from hbm.spatial import Array, axes_from, cross, distance, dot, in_lab_axes, perpendicular, unit


def locate_anatomy(landmarks: Mapping[str, Array], measures: Measures) -> Anatomy:
    """Find all joint centres and axes.

    Parameters
    ----------
    landmarks
        Landmark -> position in F frames of the calibration pose, (F, 3) [m], lab axes; absent
        where missing.
    measures
        Properties of the subject that the markers do not show.

    Returns
    -------
    Anatomy
        In the lab, in the calibration pose; without head and arms if the trunk is not shown.

    Raises
    ------
    ValueError
        If a pelvis or leg landmark is missing that no rule can replace, or sides are swapped.
    """
    anatomy = Anatomy()
    locate_pelvis(anatomy, landmarks, measures)
    for side in SIDES:
        locate_leg(anatomy, landmarks, measures, side)
    landmarks = with_spine(anatomy, landmarks, measures.sex)
    locate_trunk(anatomy, landmarks, measures)
    if "thorax" in anatomy.frames:
        locate_trunk_levels(anatomy, landmarks, measures.sex)
        locate_head(anatomy, landmarks)
        for side in SIDES:
            locate_arm(anatomy, landmarks, measures, side)
    return anatomy


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


def locate_pelvis(anatomy: Anatomy, landmarks: Mapping[str, Array], measures: Measures) -> None:
    """Find the pelvis frame, both hip centres (the body's origin is midway) and the lumbar joint.

    The frame is that of ASIS and PSIS. A single missing iliac spine is taken as the mirror image of
    its opposite; the sacrum marker replaces both PSIS. Hip centres: `hip_center`. Lumbar joint:
    `LUMBAR_PER_PELVIS_WIDTH`. The leg length that the hips depend on is that of the markers or,
    without a medial malleolus, the measured one.
    """
    R, origin, back, rules = pelvis_frame(landmarks)
    anatomy.rules |= rules
    anatomy.frames["pelvis"] = R
    anatomy.points |= {"mid_asis": origin, "mid_psis": back}
    spines = _iliac_spines(landmarks)[0]
    # pelvis width between the ASIS, depth between the middles of ASIS and PSIS
    width, depth = distance(spines["LASIS"], spines["RASIS"]), distance(origin, back)
    for side, letter in SIDES.items():
        knee = landmarks.get(letter + "MEK", landmarks.get(letter + "LEK"))
        ankle = landmarks.get(letter + "MM", landmarks.get(letter + "LM"))
        leg = None
        if knee is not None and ankle is not None:  # the same when the knee is flexed
            leg = distance(spines[letter + "ASIS"], knee) + distance(knee, ankle)
        # a leg length to the lateral malleolus gives way to a measured one
        if leg is None or letter + "MM" not in landmarks:
            stated_m = measures.limb(side).leg_length_m
            leg = np.asarray(stated_m) if stated_m else leg
        center = hip_center(side, width, depth, leg, measures)
        anatomy.points[f"{side}_hip"] = origin + in_lab_axes(R, center)
        if leg is None and measures.hip == "harrington":
            rule = "hip centre by Harrington's single measures"
            anatomy.rules[f"the {side} leg length"] = rule
    # origin of the pelvis coordinates: the middle of the hips
    anatomy.points["pelvis"] = (anatomy.points["right_hip"] + anatomy.points["left_hip"]) / 2
    forward, up = LUMBAR_PER_PELVIS_WIDTH[measures.sex]
    lumbar = width[..., None] * np.array([forward, 0.0, up])
    anatomy.points["lumbar"] = origin + in_lab_axes(R, lumbar)


def pelvis_frame(landmarks: Mapping[str, Array]) -> tuple[Array, Array, Array, dict[str, str]]:
    """Give the pelvis frame from ASIS and PSIS.

    Orientation (columns: forward, left, up), (..., 3, 3); mid-ASIS and mid-PSIS, (..., 3) [m];
    missing landmark -> rule that replaced it.
    """
    at, rules = _iliac_spines(landmarks)
    left, right = need(
        at, "LASIS", "RASIS", purpose="the pelvis", instead="one ASIS with both PSIS"
    )
    if "LPSIS" in at and "RPSIS" in at:
        back = (at["LPSIS"] + at["RPSIS"]) / 2
    else:
        (back,) = need(at, "SACR", purpose="the pelvis", instead="LPSIS with RPSIS")
        rules["PSIS"] = "the sacrum marker stands in for their midpoint"
    # left axis along the ASIS, forward in the plane of the four spines
    origin, across = (left + right) / 2, left - right
    return axes_from(across, cross(origin - back, across), exact="left"), origin, back, rules


def _iliac_spines(landmarks: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, str]]:
    """Give the landmarks, a single missing iliac spine as the mirror image of its opposite."""
    at = dict(landmarks)
    rules = {}
    for a, b in (("ASIS", "PSIS"), ("PSIS", "ASIS")):
        if "L" + b in landmarks and "R" + b in landmarks:
            for side, other in ("LR", "RL"):
                if side + a not in at and other + a in at:
                    # mirror plane: through the middle of the complete pair, across it
                    normal = unit(at["R" + b] - at["L" + b])
                    middle = (at["L" + b] + at["R" + b]) / 2
                    point = at[other + a]
                    at[side + a] = point - 2 * dot(point - middle, normal) * normal
                    rules[side + a] = f"the mirror image of {other + a}"
    return at, rules


def hip_center(
    side: str, width: ArrayLike, depth: ArrayLike, leg: ArrayLike | None, measures: Measures
) -> Array:
    """Give a hip centre in the pelvis frame.

    From mid-ASIS: forward, left, up, (..., 3) [m]. It depends on the distances between the ASIS
    (``width``) and from mid-ASIS to mid-PSIS (``depth``), and on the leg length from ASIS to medial
    malleolus, None where unknown [m].

    Notes
    -----
    Harrington et al. 2007 (J Biomech 40:595), Table 3: by width, depth and leg length, or by the
    best single measures where leg length is unknown. Bell et al. 1990 (J Biomech 23:617). Both
    refer to bone, so that the marker offset is subtracted from the forward coordinate.
    """
    outward, width, depth = -MEDIAL_SIGN[side], np.asarray(width), np.asarray(depth)
    if isinstance(measures.hip, Mapping):
        if side not in measures.hip:
            raise ValueError(f"functional hip centres must name right and left, {side} is missing")
        return np.array(measures.hip[side], float)
    if measures.hip == "bell":
        # Bell et al. 1990, by the width alone
        ahead, out, up = -0.19 * width, 0.36 * width, -0.30 * width
    elif measures.hip == "harrington":
        # Harrington et al. 2007 [m]: width and depth of the pelvis, leg length where known
        ahead = -0.24 * depth - 0.0099
        if leg is None:
            out, up = 0.33 * width + 0.0073, -0.30 * width - 0.0109
        else:
            out = 0.28 * depth + 0.16 * width + 0.0079
            up = -0.16 * width - 0.04 * np.asarray(leg) - 0.0071
    else:
        raise ValueError(f"hip must be 'harrington' or 'bell', got {measures.hip!r}")
    # rules count from the bone; markers lie a marker's offset in front of it
    center = ahead - measures.marker_offset_m, outward * out, up
    return np.stack(np.broadcast_arrays(*center), axis=-1)


def locate_trunk(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures) -> None:
    """Find the trunk's frame, its upper end and the neck; none if it has too few landmarks.

    The axis runs from the midpoint of T10 and xiphoid (where one is missing: the lumbar joint) to
    the midpoint of C7 and jugular notch. Without C7 or jugular notch, the midpoint of the acromions
    is the top of the axis. Without an acromion as well, the axis runs from the lumbar joint through
    the midpoint of T10 and xiphoid up to the level of the jugular notch. In both cases the neck is
    the upper end of the axis; else it follows from C7 and notch (`NECK_PER_C7_TO_NOTCH`).
    """
    # lower end of the trunk's axis: between T10 and xiphoid, else the lumbar joint
    low = "T10" in at and "XIPH" in at
    bottom = (at["T10"] + at["XIPH"]) / 2 if low else anatomy.points["lumbar"]
    rules = {} if low else {"T10 or XIPH": "trunk axis from the lumbar joint"}
    if "C7" in at and "JN" in at:
        # upper end between C7 and jugular notch, as ISB has it
        top, forward = (at["C7"] + at["JN"]) / 2, at["JN"] - at["C7"]
        R = axes_from(cross(top - bottom, forward), top - bottom, exact="up")
        length = NECK_PER_C7_TO_NOTCH[measures.sex] * distance(at["JN"], at["C7"])[..., None]
        angle, ahead = np.radians(NECK_ELEVATION_DEG[measures.sex]), unit(forward)
        # the neck's joint lies ahead of C7, raised from the line to the notch
        above = perpendicular(R[..., 2], forward)
        neck = at["C7"] + length * (np.cos(angle) * ahead + np.sin(angle) * above)
    elif "LSHO" in at and "RSHO" in at:
        top = neck = (at["LSHO"] + at["RSHO"]) / 2
        R = axes_from(at["LSHO"] - at["RSHO"], top - bottom, exact="up")
        rules["C7 or JN"] = "trunk axis to the middle of the acromions"
    elif low and "JN" in at:
        # without C7 the level of the notch on the axis through the lumbar joint
        root = anatomy.points["lumbar"]
        up = unit(bottom - root)
        top = neck = root + dot(at["JN"] - root, up) * up
        R = axes_from(cross(up, at["XIPH"] - at["T10"]), up, exact="up")
        rules["C7"] = "trunk axis from the lumbar joint to the level of JN"
    else:
        if not frozenset(("C7", "T2", "T8", "T10", "JN", "XIPH", "LSHO", "RSHO")).isdisjoint(at):
            needed = "C7 or T2 with JN, both acromions, or T10 or T8 with XIPH and JN"
            anatomy.rules[needed] = (
                "trunk upright in the lab, head and arms in line with it, without their markers"
            )
        return
    pelvis = anatomy.frames["pelvis"]
    # forward and up of both can be opposite only by wrong labels
    if any((dot(R[..., k], pelvis[..., k]) < 0).any() for k in (0, 2)):
        raise ValueError(
            "trunk and pelvis face opposite directions; front and back markers (C7, T10 against "
            "JN, XIPH; ASIS against PSIS) or left and right are probably swapped"
        )
    anatomy.frames["thorax"] = R
    anatomy.points |= {"trunk_top": top, "neck": neck}
    anatomy.rules |= rules


def locate_head(anatomy: Anatomy, at: Mapping[str, Array]) -> None:
    """Find the head's frame from its left, right and top markers; none if it has too few.

    Without a marker on top, pairs of markers at the front and back of the head or on the mastoids
    show its left, and its up is the vertical of the lab: the head is taken as level in the
    calibration pose, as Plug-in-Gait does. Its top is then above the middle of front and back.
    """
    pairs = [
        name for name in ("HEAD", "FHEAD", "BHEAD", "MAS") if {"L" + name, "R" + name} <= set(at)
    ]
    middle = {name: (at["L" + name] + at["R" + name]) / 2 for name in pairs}
    if "HEAD" in middle and "THEAD" in at:
        across, up = at["LHEAD"] - at["RHEAD"], at["THEAD"] - middle["HEAD"]
        anatomy.frames["head"] = axes_from(across, up, exact="left")
        anatomy.points["vertex"] = at["THEAD"]
    elif middle:
        # no marker on top: the head is taken as level in the calibration pose
        across = np.sum([at["L" + name] - at["R" + name] for name in pairs], axis=0)
        anatomy.frames["head"] = axes_from(across, np.array(UP), exact="left")
        front = middle.get("FHEAD", at.get("GLAB"))
        back = middle.get("BHEAD", middle.get("MAS"))
        if front is not None and back is not None:
            anatomy.points["mid_head"] = (front + back) / 2


HEIGHT_MM: Final[dict[str, dict[str, float]]] = {
    "male": {"cervicale": 603.3, "notch": 531.9, "mid_shoulders": 515.5, "xiphoid": 361.2},
    "female": {"cervicale": 614.8, "notch": 529.3, "mid_shoulders": 497.9, "xiphoid": 386.8},
}
"""Mean heights above mid-hip (de Leva 1996, Table 4: lengths CERV-MIDH, SUPR-MIDH, MIDS-MIDH, and
XYPH-OMPH with OMPH-MIDH)."""


def mean_height(level: str, sex: Sex, per: Callable[[str], float]) -> float:
    """Give de Leva's height of a level above mid-hip as a share of another length [mm]."""
    return float(np.mean([HEIGHT_MM[column][level] / per(column) for column in columns_of(sex)]))


def height_per_cervicale(level: str, sex: Sex) -> float:
    """Give the height of a level above mid-hip, as a share of the cervicale's."""
    return mean_height(level, sex, lambda column: HEIGHT_MM[column]["cervicale"])


def with_spine(anatomy: Anatomy, at: Mapping[str, Array], sex: Sex) -> dict[str, Array]:
    """Give the landmarks, with other levels of the spine in place of a missing C7 or T10.

    T8 stands in for T10 as it is: both show the lower rib cage. T2 is raised to the level of C7,
    along the line from the lumbar joint to the midpoint of T2 and jugular notch, by the heights of
    cervicale and notch (`height_per_cervicale`).
    """
    spine = dict(at)
    if "T8" in at and "T10" not in at:
        spine["T10"] = at["T8"]
        anatomy.rules["T10"] = "T8 stands in for it"
    if {"T2", "JN"} <= set(at) and "C7" not in at:
        up = unit((at["T2"] + at["JN"]) / 2 - anatomy.points["lumbar"])
        notch, second = (dot(at[name] - anatomy.points["pelvis"], up) for name in ("JN", "T2"))
        spine["C7"] = at["T2"] + (notch / height_per_cervicale("notch", sex) - second) * up
        anatomy.rules["C7"] = "T2 stands in for it"
    return spine


def locate_trunk_levels(anatomy: Anatomy, at: Mapping[str, Array], sex: Sex) -> None:
    """Find the points ``cervicale``, ``mid_shoulders`` and ``xiphoid`` on the trunk's axis.

    Cervicale and xiphoid are C7 and XIPH, projected on the axis. Without C7, the cervicale's height
    above mid-hip follows from the jugular notch's or, without it, from the shoulders'; without
    XIPH, the xiphoid's follows from the cervicale's, as that of the shoulders always does
    (`height_per_cervicale`).

    Deviations from the original
    ----------------------------
    Where the Human Body Model ends the parts of the trunk is not known.
    tests/validation/trunk_ends.md compares these ends with others on recordings.
    """
    up = anatomy.frames["thorax"][..., 2]
    top, hips = anatomy.points["trunk_top"], anatomy.points["pelvis"]
    # de Leva's lengths are measured along the trunk's axis
    hips_on_axis = top + dot(hips - top, up) * up

    def height(point: Array) -> Array:
        return dot(point - hips, up)

    if "C7" in at:
        cervicale = height(at["C7"])
    elif "JN" in at:
        cervicale = height(at["JN"]) / height_per_cervicale("notch", sex)
        anatomy.rules["C7 (cervicale)"] = "its level on the trunk's axis follows from JN"
    else:
        drop = SHOULDER_DROP_PER_WIDTH * distance(at["LSHO"], at["RSHO"])[..., None]
        shoulders = height((at["LSHO"] + at["RSHO"]) / 2) - drop
        cervicale = shoulders / height_per_cervicale("mid_shoulders", sex)
        anatomy.rules["C7 (cervicale)"] = "its level on the trunk's axis follows from the acromions"
    if "XIPH" in at:
        xiphoid = height(at["XIPH"])
    else:
        xiphoid = height_per_cervicale("xiphoid", sex) * cervicale
        anatomy.rules["XIPH"] = "its level on the trunk's axis follows from the cervicale"
    # levels in another order come from wrong labels, and would turn masses around
    if not ((xiphoid > 0) & (xiphoid < cervicale)).all():
        lower_mm, upper_mm = 1000 * np.mean(xiphoid), 1000 * np.mean(cervicale)
        raise ValueError(
            f"along the trunk, the xiphoid lies {lower_mm:.0f} mm and the cervicale "
            f"{upper_mm:.0f} mm above the hips; check the labels XIPH, C7 and JN"
        )
    mid_shoulders = height_per_cervicale("mid_shoulders", sex) * cervicale
    levels = {"cervicale": cervicale, "mid_shoulders": mid_shoulders, "xiphoid": xiphoid}
    anatomy.points |= {name: hips_on_axis + level * up for name, level in levels.items()}


def stand_trunk(anatomy: Anatomy, height_m: float, sex: Sex) -> None:
    """Place a trunk that no marker shows: upright above the hips, with lengths by stature.

    In the calibration pose it stands vertically above the middle of the hips, however the iliac
    spines lie, and faces where the pelvis does; that is its frame.

    Notes
    -----
    In two recordings of people who stand or walk, the upper trunk's centre was 7 mm behind to 2 mm
    ahead of the hips; in a third with iliac spines marked at very different heights, 23 mm ahead.
    """
    pelvis, hips = anatomy.frames["pelvis"], anatomy.points["pelvis"]
    # upright in the lab, facing as the pelvis does
    upright = axes_from(cross(np.array(UP), pelvis[..., 0]), np.array(UP), exact="up")
    for level in ("cervicale", "mid_shoulders", "xiphoid"):
        height_per_stature = mean_height(level, sex, lambda column: 1000 * SAMPLE_STATURE_M[column])
        anatomy.points[level] = hips + height_per_stature * height_m * upright[..., 2]
    anatomy.points["neck"] = anatomy.points["cervicale"]
    anatomy.frames["thorax"] = upright
