"""Joints of the arms from their landmarks."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.calibration_pose.anatomy import MEDIAL_SIGN, Anatomy, Measures
from hbm.calibration_pose.hinges import chord
from hbm.coordinates import SIDES
from hbm.notes import Note
from hbm.spatial import Array, cross, distance, unit

HALF_WIDTH_PER_FOREARM: Final = 0.155
"""Half the width of an elbow without medial marker or measured width, as a share of the distance
from lateral epicondyle to wrist (Reed et al. 1999, SAE 1999-01-0959)."""

SHOULDER_DROP_PER_WIDTH: Final = 0.17
"""Distance of the shoulder joint below the acromion, as a share of the distance between the
acromions (Rab et al. 2002, J Orthop Res 20:71)."""

STRAIGHT_ELBOW_RAD: Final = np.radians(15.0)
"""Flexion below which an error of 5 mm in half an elbow's width turns its axis by more than 9°."""


def locate_arm(anatomy: Anatomy, at: Mapping[str, Array], measures: Measures, side: str) -> None:
    """Find shoulder, elbow, wrist and knuckle; none if the arm has too few landmarks.

    Shoulder: `_shoulder`. Elbow: midway between its epicondyles or, without the medial one, by
    `elbow_center`, its half width as measured or by `HALF_WIDTH_PER_FOREARM`. Wrist: midway between
    its markers; for the ends of a wrist bar, half the wrist's width away from the bar, where it was
    measured. Knuckle: half the hand's thickness below its marker, where that was measured.
    """
    s, limb = SIDES[side], measures.limb(side)
    ulnar, radial = (
        next((at[s + name] for name in names if s + name in at), None)
        for names in (("LW", "WRB"), ("MW", "WRA"))
    )
    ends = [end for end in (ulnar, radial) if end is not None]
    if not {s + "SHO", s + "LEE"} <= set(at) or not ends:
        if ends or any(s + name in at for name in ("LEE", "MEE", "FIN")):
            missing = [n for n in (s + "SHO", s + "LEE") if n not in at]
            missing += [] if ends else [f"{s}LW or {s}MW"]
            anatomy.notes.append(Note.of("arm_not_located", side=side, missing=tuple(missing)))
        return
    shoulder = _shoulder(anatomy, at, measures, side)
    wrist, lateral = np.mean(ends, axis=0), at[s + "LEE"]
    half_width = measures.to_center(limb.elbow_width_m)
    if half_width is None:
        half_width = HALF_WIDTH_PER_FOREARM * distance(lateral, wrist)

    def elbow_with(wrist: Array) -> Array:
        if s + "MEE" in at:
            return np.asarray((lateral + at[s + "MEE"]) / 2)
        return elbow_center(shoulder, lateral, wrist, half_width, side)

    elbow = elbow_with(wrist)
    thumb = None if ulnar is None or radial is None else radial - ulnar
    bar = measures.to_center(limb.wrist_width_m) if {s + "WRA", s + "WRB"} <= set(at) else None
    if bar is not None and thumb is not None:
        wrist = wrist + bar * _palmar(thumb, wrist - elbow, side)
        elbow = elbow_with(wrist)
    anatomy.points |= {f"{side}_{j}": p for j, p in (("shoulder", shoulder), ("wrist", wrist))}
    anatomy.points[f"{side}_elbow"] = elbow
    anatomy.axes[f"{side}_elbow"] = MEDIAL_SIGN[side] * unit(elbow - lateral)
    if thumb is not None:
        anatomy.axes[f"{side}_wrist"] = -MEDIAL_SIGN[side] * unit(thumb)
    else:
        anatomy.axes[f"{side}_wrist"] = anatomy.axes[f"{side}_elbow"]
        anatomy.notes.append(Note.of("wrist_axis_from_elbow", side=side))
    if s + "FIN" in at:
        knuckle, half = at[s + "FIN"], measures.to_center(limb.hand_thickness_m)
        if half is not None and thumb is not None:
            down = _palmar(thumb, knuckle - wrist, side)
            knuckle = chord(knuckle, wrist, down, half, f"{side} knuckle")
        anatomy.points[f"{side}_knuckle"] = knuckle


def elbow_center(
    shoulder: Array, lateral: Array, wrist: Array, half_width: float, side: str
) -> Array:
    """Give the centre of an elbow that has a lateral marker only.

    The elbow's axis leads from the marker to the centre and is perpendicular to the plane of
    shoulder, elbow and wrist. Of the two planes through shoulder and wrist that are half the
    elbow's width from the marker, it is the one in which the elbow is flexed, not hyperextended.

    Parameters
    ----------
    shoulder, wrist
        Joint centres, (3,) [m].
    lateral
        Marker on the lateral epicondyle, (3,) [m].
    half_width
        Distance of the centre from the marker [m].
    side
        "right" or "left".

    Returns
    -------
    Array
        (3,) [m].

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
    along = unit(wrist - shoulder)
    outward = lateral - shoulder
    outward = outward - (outward @ along) * along
    share = min(half_width / float(np.linalg.norm(outward)), 1.0)
    outward = unit(outward)
    across = MEDIAL_SIGN[side] * cross(along, outward)
    return np.asarray(lateral + half_width * (np.sqrt(1 - share**2) * across - share * outward))


def elbow_notes(anatomies: list[Anatomy], landmarks: set[str]) -> list[Note]:
    """Say of the elbows without medial marker how their axes were found.

    Parameters
    ----------
    anatomies
        In the frames of the calibration pose.
    landmarks
        Those that are shown.

    Returns
    -------
    list of Note
        ``elbow_axis_from_plane`` or, below `STRAIGHT_ELBOW_RAD`, ``elbow_axis_uncertain``.
    """
    notes = []
    for side, s in SIDES.items():
        if s + "MEE" not in landmarks and f"{side}_elbow" in anatomies[0].points:
            flexion = float(np.mean([_flexion(anatomy, side) for anatomy in anatomies]))
            straight = flexion < STRAIGHT_ELBOW_RAD
            code = "elbow_axis_uncertain" if straight else "elbow_axis_from_plane"
            flexion_deg = float(np.degrees(flexion))
            notes.append(Note.of(code, side=side, marker=s + "MEE", flexion_deg=flexion_deg))
    return notes


def _flexion(anatomy: Anatomy, side: str) -> float:
    shoulder, elbow, wrist = (anatomy.points[f"{side}_{j}"] for j in ("shoulder", "elbow", "wrist"))
    cosine = unit(elbow - shoulder) @ unit(wrist - elbow)
    return float(np.arccos(np.clip(cosine, -1, 1)))


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
        notch = at["JN"] - measures.marker_offset_m * thorax[:, 0]
        down = MEDIAL_SIGN[side] * cross(notch - acromion, thorax[:, 0])
        reach = offset + measures.marker_offset_m
        return chord(acromion, notch, down, reach, f"{side} shoulder")
    if {"LSHO", "RSHO"} <= set(at):
        width = distance(at["LSHO"], at["RSHO"])
    else:
        width = 2 * abs(float((acromion - anatomy.points["trunk_top"]) @ thorax[:, 1]))
    return np.asarray(acromion - SHOULDER_DROP_PER_WIDTH * width * thorax[:, 2])


def _palmar(thumb: Array, along: Array, side: str) -> Array:
    """Give the direction from the back of a wrist or hand to the palm, (3,)."""
    return MEDIAL_SIGN[side] * unit(cross(thumb, along))
