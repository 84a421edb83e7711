"""End points of trunk and head, and a body whose trunk and head have other ones."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hbm.body import Body
from hbm.calibration_pose.anatomy import Anatomy, Measures
from hbm.calibration_pose.frame_selection import select_frames
from hbm.calibration_pose.landmarks import height_per_cervicale, locate_anatomy
from hbm.markers import Markers
from hbm.segments import Proportions, proportions, segment_inertia
from hbm.spatial import Array

Landmarks = Mapping[str, Array]


@dataclass(frozen=True, slots=True)
class Ends:
    """Where a choice ends trunk and head, (3,) each [m].

    Attributes
    ----------
    top
        Upper end of the upper trunk.
    xiphoid
        Lower end of the upper trunk, upper end of the mid trunk.
    head
        Lower end of the head.
    head_base
        Where the length of a head that no marker shows begins.
    """

    top: Array
    xiphoid: Array
    head: Array
    head_base: Array


def on_axis(anatomy: Anatomy, point: Array) -> Array:
    """Project a point on the trunk's longitudinal axis, (3,) [m]."""
    up, top = anatomy.frames["thorax"][:, 2], anatomy.points["trunk_top"]
    return np.asarray(top + ((point - top) @ up) * up)


def levels(anatomy: Anatomy, at: Landmarks) -> Ends:
    """De Leva's CERV-XYPH, both on the trunk's axis; the head ends there too: as in the body."""
    cervicale = anatomy.points["cervicale"]
    return Ends(cervicale, anatomy.points["xiphoid"], cervicale, cervicale)


def levels_head_to_c7(anatomy: Anatomy, at: Landmarks) -> Ends:
    """The same trunk, but the head ends at the marker on C7."""
    neck = anatomy.points["neck"]
    return replace(levels(anatomy, at), head=at.get("C7", neck), head_base=neck)


def notch_level(anatomy: Anatomy, at: Landmarks) -> Ends:
    """De Leva's alternative SUPR-XYPH on the trunk's axis."""
    return replace(levels(anatomy, at), top=on_axis(anatomy, at["JN"]))


def midpoints(anatomy: Anatomy, at: Landmarks) -> Ends:
    """From midway between C7 and notch to midway between T10 and xiphoid; the head to C7.

    Where a marker is missing, from the upper end of the trunk's axis to a share of the way from it
    to mid-hip.
    """
    hips, top, neck = (anatomy.points[name] for name in ("pelvis", "trunk_top", "neck"))
    if {"T10", "XIPH"} <= set(at):
        xiphoid = (at["T10"] + at["XIPH"]) / 2
    else:
        xiphoid = hips + height_per_cervicale("xiphoid", "unspecified") * (top - hips)
    return Ends(top, xiphoid, at.get("C7", neck), neck)


def markers_themselves(anatomy: Anatomy, at: Landmarks) -> Ends:
    """From the marker on C7 to the marker on the xiphoid."""
    return Ends(at["C7"], at["XIPH"], at["C7"], at["C7"])


CHOICES: Final[dict[str, Callable[[Anatomy, Landmarks], Ends]]] = {
    "midpoints": midpoints,
    "CERV-XYPH, head to C7": levels_head_to_c7,
    "CERV-XYPH": levels,
    "SUPR-XYPH": notch_level,
    "markers": markers_themselves,
}
"""Title -> choice; the third is the body's own, the first was its choice in version 0.2."""

NOTCH_ROW: Final = {
    "male": np.array([0.1596, 0.2999, 0.716, 0.454, 0.659, 0.1707 / 1.741]),
    "female": np.array([0.1545 / 0.9999, 0.2077, 0.746, 0.502, 0.718, 0.1425 / 1.735]),
}
"""De Leva's (1996, Table 4) upper trunk SUPR-XYPH: mass, centre, gyration, length by stature."""


def with_ends(
    body: Body, choice: str, calibration: Markers, measures: Measures | None = None
) -> Body:
    """Give the body other end points of trunk and head.

    Parameters
    ----------
    body
        As `hbm.build_body` made it.
    choice
        One of `CHOICES`.
    calibration
        The recording that the body was built from.
    measures
        What it was built with; by default, its sex alone.

    Returns
    -------
    Body
        With other inertias of pelvis, mid trunk, thorax and head.

    Raises
    ------
    KeyError
        If the choice needs a marker that is missing.
    """
    sex = body.sex
    table = dict(proportions(sex))
    if choice == "SUPR-XYPH":
        columns = ("male", "female") if sex == "unspecified" else (sex,)
        row = np.mean([NOTCH_ROW[column] for column in columns], axis=0)
        table["upper_trunk"] = Proportions(row[0], row[1], row[2:5], row[5])
    share = table["mid_trunk"].length / (table["mid_trunk"].length + table["lower_trunk"].length)
    points: dict[str, list[Array]] = {s: [] for s in ("pelvis", "mid_trunk", "thorax", "head")}
    for at in _poses(body, calibration):
        anatomy = locate_anatomy(at, measures or Measures(sex))
        ends = CHOICES[choice](anatomy, at)
        hips, thorax = anatomy.points["pelvis"], anatomy.frames["thorax"]
        head = anatomy.frames.get("head", thorax)
        navel = ends.xiphoid + share * (hips - ends.xiphoid)
        length = table["head"].length * body.height_m
        vertex = anatomy.points.get("vertex", ends.head_base + length * head[:, 2])
        lumbar, neck = anatomy.points["lumbar"], anatomy.points["neck"]
        for s, R, origin, proximal, distal in (
            ("pelvis", anatomy.frames["pelvis"], hips, navel, hips),
            ("mid_trunk", thorax, lumbar, ends.xiphoid, navel),
            ("thorax", thorax, lumbar, ends.top, ends.xiphoid),
            ("head", head, neck, vertex, ends.head),
        ):
            left = np.array([0.0, 1.0, 0.0])
            points[s].append(np.stack([R.T @ (proximal - origin), R.T @ (distal - origin), left]))
    rows = {"pelvis": "lower_trunk", "thorax": "upper_trunk"}
    other = {
        s: segment_inertia(table[rows.get(s, s)], body.mass, *np.mean(each, axis=0))
        for s, each in points.items()
    }
    return replace(body, segments={**body.segments, **other})


def _poses(body: Body, calibration: Markers) -> list[dict[str, Array]]:
    """Landmarks in the frames of the calibration that the body was built from."""
    used = [name for name in body.marker_set.segment if name in calibration.names]
    frames, _ = select_frames(calibration, used, None)
    column = {name: i for i, name in enumerate(calibration.names)}
    return [
        {
            mark: calibration.position[frame, column[name]]
            for mark, name in body.marker_set.landmark.items()
            if name in column and not np.isnan(calibration.position[frame, column[name], 0])
        }
        for frame in frames
    ]
