"""A subject's body from a calibration pose: geometry, inertias and markers on the skeleton."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.calibration_pose.anatomy import SIDES, Anatomy, HipRule, Measures, distance
from hbm.calibration_pose.instants import calibrate
from hbm.calibration_pose.landmarks import locate_anatomy
from hbm.calibration_pose.shape import Shape, average, shape_of
from hbm.coordinates import COORDINATES, LAST_Q, SEGMENTS, SEGMENTS_WITH_MASS, support
from hbm.kinematics import solve_ik
from hbm.markers import Markers, MarkerSet, marker_sets, recognise_marker_set
from hbm.model import Body
from hbm.notes import Note
from hbm.overrides import SegmentOverride, apply_overrides
from hbm.poses import segment_frames
from hbm.segments import NO_INERTIA, Inertia, Proportions, Sex, proportions, segment_inertia
from hbm.spatial import Array, Indices

__all__ = ["Body", "build_body"]

PARTS: Final = {
    "pelvis": ("lower_trunk",),
    "trunk": ("mid_trunk", "upper_trunk"),
    "head": ("head",),
    **{
        f"{side}_{part}": (f"{side}_{part}",)
        for side in ("right", "left")
        for part in ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
    },
}
TOES_KG: Final = 1e-6
LEG_SHARE: Final = 0.245 + 0.246


def build_body(
    static_markers: Markers,
    *,
    mass: float,
    sex: Sex = "unspecified",
    marker_set: str | MarkerSet | None = None,
    height_m: float | None = None,
    window_s: tuple[float, float] | None = None,
    hip: HipRule | Mapping[str, Array] = "harrington",
    knee_width_m: float | None = None,
    ankle_width_m: float | None = None,
    marker_offset_m: float = 0.009,
    overrides: Mapping[str, SegmentOverride] | None = None,
) -> Body:
    """Build a subject's body from a calibration pose.

    Parameters
    ----------
    static_markers
        A T-pose, A-pose, quiet standing, or any stretch of walking; lab axes, facing anywhere.
    mass
        Body mass [kg].
    sex
        Which column of de Leva's table: "male", "female", or "unspecified" for the mean.
    marker_set
        Name of a shipped set or a set of one's own; by default recognised from the labels.
    height_m
        Stature [m], for parts that no marker shows; by default estimated from the legs.
    window_s
        Start and end of the calibration pose [s]; by default the quietest second, or the whole
        recording where nobody stands still.
    hip
        "harrington", "bell", or functional centres (see `hbm.calibration_pose.anatomy.Measures`).
    knee_width_m, ankle_width_m, marker_offset_m
        See `hbm.calibration_pose.anatomy.Measures`.
    overrides
        Segment -> what is known better than de Leva's table; the whole still weighs ``mass``.

    Returns
    -------
    Body
        Geometry averaged over the window, inertias by de Leva (1996). If the subject moves in the
        window, markers that are no landmarks sit where the skeleton, fitted to the same instants,
        sees them on average.

    Raises
    ------
    ValueError
        If mass or stature is implausible, no marker set fits, an override is impossible, or a
        landmark is missing that nothing can stand in for.
    """
    if not 10 <= mass <= 400:
        hint = "; that looks like grams, give kilograms" if mass > 1000 else ""
        raise ValueError(f"body mass must be between 10 and 400 kg, got {mass:g}{hint}")
    if height_m is not None and not 0.5 <= height_m <= 2.6:
        raise ValueError(f"stature must be between 0.5 and 2.6 m, got {height_m:g}")
    chosen = _choose(marker_set, static_markers)
    measures = Measures(sex, hip, knee_width_m, ankle_width_m, marker_offset_m)
    table = proportions(sex)

    used = [name for name in chosen.segment if name in static_markers.names]
    calibration = calibrate(static_markers, used, window_s)
    instants = _take(static_markers, used, calibration.frames)
    poses = [dict(zip(used, p, strict=True)) for p in instants.position]
    poses = [{name: p for name, p in at.items() if not np.isnan(p[0])} for at in poses]
    anatomies = [
        locate_anatomy({mark: at[n] for mark, n in chosen.landmark.items() if n in at}, measures)
        for at in poses
    ]
    notes = [calibration.note, *dict.fromkeys(note for a in anatomies for note in a.notes)]
    if height_m is None:
        height_m = float(np.mean([_stature(a) for a in anatomies]))
        notes.append(Note.of("stature_estimated", height_m=height_m))
    if overrides:
        notes.append(Note.of("inertia_overridden", segments=tuple(overrides)))
    shape = average(
        [
            shape_of(anatomy, table, height_m, at, chosen.segment)
            for anatomy, at in zip(anatomies, poses, strict=True)
        ]
    )
    markers = tuple(n for n in shape.markers if chosen.segment[n] not in _unlocated(anatomies[0]))
    segments = tuple(chosen.segment[name] for name in markers)
    body = Body(
        mass=float(mass),
        sex=sex,
        height_m=float(height_m),
        marker_set=chosen,
        markers=markers,
        marker_segment=segments,
        marker_position=np.array([shape.markers[name] for name in markers]),
        offsets=shape.offsets,
        axes=shape.axes,
        inertias=apply_overrides(_inertias(shape, table, mass), overrides or {}, mass),
        lengths={part: distance(ends[0], ends[1]) for part, ends in shape.ends.items()},
        locked=_unseen(set(segments)),
        notes=tuple(notes),
    )
    return body if calibration.still else _with_tracking_markers(body, instants)


def _choose(marker_set: str | MarkerSet | None, markers: Markers) -> MarkerSet:
    if marker_set is None:
        return recognise_marker_set(markers.names)
    if isinstance(marker_set, MarkerSet):
        return marker_set
    if marker_set not in marker_sets():
        raise ValueError(f"no marker set {marker_set!r}; known: {', '.join(marker_sets())}")
    return marker_sets()[marker_set]


def _take(markers: Markers, names: list[str], frames: Indices) -> Markers:
    columns = [markers.names.index(name) for name in names]
    return Markers(markers.time[frames], tuple(names), markers.position[frames][:, columns])


def _stature(anatomy: Anatomy) -> float:
    """Stature from both legs: hip to ankle is 0.491 of it (Drillis and Contini 1966).

    De Leva's mean lengths would not do: the women's thigh ends at another hip than the men's.
    """
    legs = [
        distance(anatomy.points[f"{side}_{a}"], anatomy.points[f"{side}_{b}"])
        for side in SIDES
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    return sum(legs) / 2 / LEG_SHARE


def _unlocated(anatomy: Anatomy) -> set[str]:
    """Segments of arms whose joints could not be found; where their markers ride is unknown."""
    arm = ("upper_arm", "forearm", "hand")
    return {f"{side}_{s}" for side in SIDES if f"{side}_elbow" not in anatomy.points for s in arm}


def _unseen(seen: set[str]) -> tuple[str, ...]:
    """Coordinates beyond which no marker rides."""
    shown = {i for s in seen for i in support(LAST_Q[s])}
    return tuple(name for i, name in enumerate(COORDINATES) if i not in shown)


def _inertias(shape: Shape, table: Mapping[str, Proportions], mass: float) -> dict[str, Inertia]:
    """Inertias of the moving segments; the toes' token mass is the foot's."""
    inertias = {s: NO_INERTIA for s in SEGMENTS_WITH_MASS}
    for s, parts in PARTS.items():
        for part in parts:
            row = table[part.removeprefix("right_").removeprefix("left_")]
            inertias[s] += segment_inertia(row, mass, *shape.ends[part])
    for side in SIDES:
        foot = inertias[f"{side}_foot"]
        inertias[f"{side}_foot"] = replace(foot, mass=foot.mass - TOES_KG)
        inertias[f"{side}_toes"] = Inertia(TOES_KG, np.zeros(3), TOES_KG * 1e-4 * np.eye(3))
    return inertias


def _with_tracking_markers(body: Body, instants: Markers) -> Body:
    """Move markers that are no landmarks to where the fitted skeleton sees them on average."""
    motion = solve_ik(body, instants)
    if not motion.converged.any():
        raise ValueError(
            "the skeleton fits the calibration pose in none of its instants; check the markers' "
            "names and the lab axes"
        )
    rotation, origin = segment_frames(body, motion.q[motion.converged])
    own = [SEGMENTS.index(s) for s in body.marker_segment]
    measured = _take(instants, list(body.markers), np.flatnonzero(motion.converged)).position
    away = measured - origin[:, own]
    local = np.einsum("tkji,tkj->tki", rotation[:, own], away).mean(axis=0)
    landmark = np.array([name in body.marker_set.landmark.values() for name in body.markers])
    position = np.where(landmark[:, None], body.marker_position, local)
    return replace(body, marker_position=position)
