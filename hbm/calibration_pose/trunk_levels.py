"""Where de Leva divides the trunk: levels of landmarks on its longitudinal axis.

Her lengths are distances between landmarks that are projected on a segment's longitudinal axis.
Her rows agree only so: with VERT-CERV and with VERT-MIDG, whose ends lie a hand's breadth apart in
depth, the head's centre is 121.5 mm below the vertex; with CERV-XYPH and with SUPR-XYPH, the upper
trunk's is 122.6 mm below the cervicale; and the trunk's parts sum to the trunk within 0.1 mm.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.calibration_pose.anatomy import Anatomy
from hbm.calibration_pose.arms import SHOULDER_DROP_PER_WIDTH
from hbm.coordinates import UP
from hbm.notes import Note
from hbm.segments import SAMPLE_STATURE_M, Sex
from hbm.spatial import Array, axes_from, distance, unit

HEIGHT_MM: Final[dict[str, dict[str, float]]] = {
    "male": {"cervicale": 603.3, "notch": 531.9, "shoulders": 515.5, "xiphoid": 361.2},
    "female": {"cervicale": 614.8, "notch": 529.3, "shoulders": 497.9, "xiphoid": 386.8},
}
"""Mean heights above mid-hip (de Leva 1996, Table 4: lengths CERV-MIDH, SUPR-MIDH, MIDS-MIDH, and
XYPH-OMPH with OMPH-MIDH)."""


def height_per_cervicale(sex: Sex) -> dict[str, float]:
    """Give the heights of levels above mid-hip, as shares of the cervicale's.

    Parameters
    ----------
    sex
        "male", "female", or "unspecified" for the mean of both.

    Returns
    -------
    dict[str, float]
        By level: cervicale, notch, shoulders (joint centres), xiphoid.
    """
    columns = [HEIGHT_MM[s] for s in _columns(sex)]
    return {
        level: float(np.mean([column[level] / column["cervicale"] for column in columns]))
        for level in HEIGHT_MM["male"]
    }


def _columns(sex: Sex) -> tuple[str, ...]:
    return tuple(HEIGHT_MM) if sex == "unspecified" else (sex,)


def with_spine(anatomy: Anatomy, at: Mapping[str, Array], sex: Sex) -> dict[str, Array]:
    """Give the landmarks, with other levels of the spine in place of a missing C7 or T10.

    T8 stands in for T10 as it is: both show the lower rib cage. T2 is raised to the level of C7,
    along the line from the lumbar joint to the midpoint of T2 and jugular notch, by the heights of
    cervicale and notch (`height_per_cervicale`).

    Parameters
    ----------
    anatomy
        With the hips and the lumbar joint.
    at
        Landmark -> position, (3,) [m].
    sex
        Column of de Leva's table.

    Returns
    -------
    dict[str, Array]
        Landmark -> position, (3,) [m].
    """
    found = dict(at)
    if "T8" in at and "T10" not in at:
        found["T10"] = at["T8"]
        anatomy.notes.append(Note.of("landmark_stands_in", landmark="T10", other="T8"))
    if {"T2", "JN"} <= set(at) and "C7" not in at:
        up = unit((at["T2"] + at["JN"]) / 2 - anatomy.points["lumbar"])
        notch, second = ((at[name] - anatomy.points["pelvis"]) @ up for name in ("JN", "T2"))
        found["C7"] = at["T2"] + (notch / height_per_cervicale(sex)["notch"] - second) * up
        anatomy.notes.append(Note.of("landmark_stands_in", landmark="C7", other="T2"))
    return found


def locate_trunk_levels(anatomy: Anatomy, at: Mapping[str, Array], sex: Sex) -> None:
    """Find the points ``cervicale``, ``mid_shoulders`` and ``xiphoid`` on the trunk's axis.

    Cervicale and xiphoid are C7 and XIPH, projected on the axis. Without C7, the cervicale's height
    above mid-hip follows from the jugular notch's or, without it, from the shoulders'; without
    XIPH, the xiphoid's follows from the cervicale's, as that of the shoulders always does
    (`height_per_cervicale`).

    Parameters
    ----------
    anatomy
        With the hips and the trunk's axis.
    at
        Landmark -> position, (3,) [m].
    sex
        Column of de Leva's table.

    Raises
    ------
    ValueError
        If the xiphoid is not between the hips and the cervicale.

    Deviations from the original
    ----------------------------
    Where the Human Body Model ends the parts of the trunk is not known. docs/trunk_ends.md compares
    these ends with others on recordings.
    """
    up = anatomy.frames["thorax"][:, 2]
    top, hips = anatomy.points["trunk_top"], anatomy.points["pelvis"]
    hips_on_axis = top + ((hips - top) @ up) * up
    share = height_per_cervicale(sex)

    def height(point: Array) -> float:
        return float((point - hips) @ up)

    def infer(level: str, missing: str, shown: str, value: float) -> float:
        anatomy.notes.append(
            Note.of("trunk_level_from_proportions", level=level, missing=missing, shown=shown)
        )
        return value

    if "C7" in at:
        cervicale = height(at["C7"])
    elif "JN" in at:
        cervicale = infer("cervicale", "C7", "JN", height(at["JN"]) / share["notch"])
    else:
        drop = SHOULDER_DROP_PER_WIDTH * distance(at["LSHO"], at["RSHO"])
        shoulders = height((at["LSHO"] + at["RSHO"]) / 2) - drop
        cervicale = infer("cervicale", "C7", "the acromions", shoulders / share["shoulders"])
    if "XIPH" in at:
        xiphoid = height(at["XIPH"])
    else:
        xiphoid = infer("xiphoid", "XIPH", "the cervicale", share["xiphoid"] * cervicale)
    if not 0 < xiphoid < cervicale:
        raise ValueError(
            f"along the trunk, the xiphoid lies {1000 * xiphoid:.0f} mm and the cervicale "
            f"{1000 * cervicale:.0f} mm above the hips; check the labels XIPH, C7 and JN"
        )
    for name, value in (
        ("cervicale", cervicale),
        ("mid_shoulders", share["shoulders"] * cervicale),
        ("xiphoid", xiphoid),
    ):
        anatomy.points[name] = hips_on_axis + value * up


def stand_trunk(anatomy: Anatomy, height_m: float, sex: Sex) -> None:
    """Place a trunk that no marker shows: upright above the hips, with lengths by stature.

    Its coordinates stay at zero, so that its frame is the pelvis' one; but in the calibration pose
    it stands vertically above the middle of the hips, however the iliac spines lie.

    Parameters
    ----------
    anatomy
        With the pelvis and the lumbar joint.
    height_m
        Stature [m].
    sex
        Column of de Leva's table.

    Notes
    -----
    In two recordings of people who stand or walk, the upper trunk's centre was 7 mm behind to 2 mm
    ahead of the hips; in a third with iliac spines marked at very different heights, 23 mm ahead.
    """
    pelvis, hips = anatomy.frames["pelvis"], anatomy.points["pelvis"]
    upright = axes_from(pelvis[:, 1], np.array(UP), exact="up")
    columns = [(HEIGHT_MM[s], SAMPLE_STATURE_M[s]) for s in _columns(sex)]
    for level in ("cervicale", "shoulders", "xiphoid"):
        share = np.mean([heights[level] / 1000 / stature for heights, stature in columns])
        name = "mid_shoulders" if level == "shoulders" else level
        anatomy.points[name] = hips + share * height_m * upright[:, 2]
    anatomy.points["neck"] = anatomy.points["cervicale"]
    anatomy.frames |= {"thorax": pelvis, "upright": upright}
