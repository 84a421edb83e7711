"""A subject's body from a calibration pose: geometry, inertias and markers on the skeleton."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hbm.calibration_pose.anatomy import (
    BALL_PER_FOOT,
    MARKER_OFFSET_M,
    Anatomy,
    HipRule,
    LimbMeasures,
    Measures,
    MissingLandmark,
    straight_elbows,
)
from hbm.calibration_pose.landmarks import locate_anatomy, stand_trunk
from hbm.calibration_pose.shape import shape_of
from hbm.coordinates import COORDINATES, LAST_Q, LIMBS, MOVING, SEGMENTS, SIDES, support
from hbm.ik.problem import undetermined
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers, MarkerSet, marker_sets, recognise_marker_set
from hbm.model import Body
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.plausibility.motion import mass_not_shown
from hbm.poses import segment_frames
from hbm.segments import (
    LEGS_PER_STATURE,
    Inertia,
    Proportions,
    SegmentOverride,
    Sex,
    apply_overrides,
    proportions,
    segment_inertia,
)
from hbm.spatial import Array, Indices, distance, unit
from hbm.spelling import listed

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "body")

__all__ = ["Body", "build_body"]

PART_OF: Final = {"pelvis": "lower_trunk", "thorax": "upper_trunk"}
"""Segment -> its part of the body in de Leva's table, where the names differ."""

TOES_KG: Final = 1e-6
"""Mass of the toes, which de Leva's foot includes: not zero, so that no inertia is singular."""


FEET: Final = tuple(f"{side}_foot" for side in SIDES)
BALL_ABOVE_SOLE: Final = 0.12
"""Height of the ball's markers above the bare foot's sole, by the length of the foot."""


MIN_STATURE_M, MAX_STATURE_M = 0.5, 2.6
"""From an infant to beyond the tallest people; centimetres fall outside."""


class ImplausibleLegs(ValueError):
    """Markers that show legs of no person's length: they are not in metres."""


def build_body(
    static_markers: Markers,
    *,
    mass: float,
    sex: Sex = "unspecified",
    marker_set: str | MarkerSet | None = None,
    height_m: float | None = None,
    window_s: tuple[float, float] | None = None,
    hip: HipRule | Mapping[str, Array] = "harrington",
    limbs: Mapping[str, LimbMeasures] | None = None,
    marker_offset_m: float = MARKER_OFFSET_M,
    overrides: Mapping[str, SegmentOverride] | None = None,
    shoe_mass_kg: float | None = None,
    sole_height_m: float = 0.0,
) -> Body:
    """Build a subject's body from a calibration pose.

    Parameters
    ----------
    static_markers
        A T-pose, A-pose, quiet standing, or a recording of walking; lab axes, in any direction.
    mass
        Body mass, shoes included [kg].
    sex
        Column of de Leva's table: "male", "female", or "unspecified" for the mean.
    marker_set
        Name of a shipped set, or a custom set; by default recognised from the labels.
    height_m
        Stature [m], for parts that no marker shows; by default estimated from the legs.
    window_s
        Start and end of the calibration pose [s]; by default the second in which the markers move
        least, or the whole recording where the subject never stands still.
    hip
        "harrington", "bell", or functional centres (see `hbm.calibration_pose.anatomy.Measures`).
    limbs
        Side -> widths of its joints and other measures, where markers do not show them.
    marker_offset_m
        Distance of a marker's centre from the skin [m].
    overrides
        Segment -> inertia that is known better than from de Leva's table; the total mass stays
        ``mass``.
    shoe_mass_kg
        Mass of one shoe, of which each foot wears one (`shoe_inertia`) [kg]; 0 for bare feet; by
        default unknown, and not in the body.
    sole_height_m
        Thickness of its sole [m].

    Returns
    -------
    Body
        Geometry averaged over the window, inertias by de Leva (1996). If the subject moves in the
        window, markers that are not landmarks are placed where the skeleton, fitted to the same
        frames, has them on average. Single positions that jump by more than 10 cm do not count.

    Raises
    ------
    ValueError
        If mass, stature or the length of the legs is implausible, or no marker set fits; if an
        override is impossible, or states something worn on a foot besides its shoe; if a landmark
        is missing that no rule can replace.

    Examples
    --------
    With ``static``, the markers of a calibration pose:

    >>> import hbm
    >>> body = hbm.build_body(static, mass=74.6, sex="male")
    >>> body.marker_set.name
    'hbm2'
    >>> print(body)
    74.6 kg, 1.71 m, male; markers: 46 of Human Body Model 2, full body, 46 markers
    """
    if not LIMITS.least_mass <= mass <= LIMITS.largest_mass:
        hint = "; that looks like grams, give kilograms" if mass > 1000 else ""
        raise ValueError(
            f"body mass must be between {LIMITS.least_mass} and {LIMITS.largest_mass} kg, "
            f"got {mass:g}{hint}"
        )
    if height_m is not None and not MIN_STATURE_M <= height_m <= MAX_STATURE_M:
        raise ValueError(
            f"stature must be between {MIN_STATURE_M} and {MAX_STATURE_M} m, got {height_m:g}"
        )
    chosen = _marker_set(marker_set, static_markers)
    measures = Measures(sex, hip, limbs or {}, marker_offset_m)
    table = proportions(sex)

    present = chosen.present(static_markers.names)
    segment, landmark = chosen.segment | present.segment, present.landmark
    used = list(present.segment)
    # single jumps would hide the stillest second
    static_markers, jumps = without_jumps(static_markers, used)
    frames, speed = _select_frames(static_markers, used, window_s)
    calibration = _take(static_markers, used, frames)
    # in the frames that were selected a marker is always seen, or never
    at = dict(zip(used, np.moveaxis(calibration.position, 1, 0), strict=True))
    at = {name: position for name, position in at.items() if not np.isnan(position[0, 0])}
    try:
        landmarks = {mark: at[name] for mark, name in landmark.items() if name in at}
        anatomy = locate_anatomy(landmarks, measures)
    except MissingLandmark as error:
        labels = [chosen.landmark[name] for name in error.names if name in chosen.landmark]
        needed = f" with {', '.join(labels)}" if labels else " that has them"
        unused = [name for name in static_markers.names if name not in segment]
        others = f"; markers not in use: {listed(unused)}" if unused else ""
        raise ValueError(
            f"{error}; give a static recording{needed} (--static), or rename markers (--rename); "
            f"the set is {chosen.name}{others}"
        ) from error
    # a wrong unit of length shows in the legs, whatever the mass says
    by_legs_m = float(_stature(anatomy).mean())
    if not MIN_STATURE_M <= by_legs_m <= MAX_STATURE_M:
        raise ImplausibleLegs(
            f"the markers show the legs of a person of {by_legs_m:.2f} m, expected "
            f"{MIN_STATURE_M} to {MAX_STATURE_M} m: their unit is wrong"
        )
    stature_m = by_legs_m if height_m is None else height_m
    # markers of segments whose joints are unknown cannot be placed on the skeleton
    unlocated = _unlocated_segments(anatomy)
    at |= {chosen.landmark[mark]: position for mark, position in anatomy.markers.items()}
    # without trunk markers the trunk still has its mass: upright, by stature
    if "thorax" not in anatomy.frames:
        stand_trunk(anatomy, stature_m, sex)
    shape = shape_of(anatomy, table, stature_m, at, segment)
    markers = tuple(n for n in shape.markers if segment[n] not in unlocated)
    segments = tuple(segment[name] for name in markers)
    # a coordinate that carries no marked segment is locked in neutral
    shown = {i for s in set(segments) for i in support(LAST_Q[s])}
    # skin moves against bone while the subject moves: positions are then fitted below
    still = speed < LIMITS.still_speed
    posture = "standing still" if still else f"moving at {speed:.2f} m/s"
    pose = Note.of(
        "calibration_pose",
        start_s=calibration.time[0],
        stop_s=calibration.time[-1],
        instants=len(frames),
        posture=posture if len(static_markers.time) > 1 else "the one frame of its recording",
        height_m=stature_m,
        source="by the length of the legs" if height_m is None else "as given",
    )
    notes = [pose, *jumps, *anatomy.notes, *straight_elbows(anatomy)]
    if overrides:
        notes.append(Note.of("inertia_overridden", segments=tuple(overrides)))
    lengths = {s: float(distance(*ends[:2])) for s, ends in shape.ends.items()}
    overrides = dict(overrides or {})
    # a shoe is worn in addition: its mass is a part of the body's
    if shoe_mass_kg:
        notes.append(Note.of("shoes_stated", mass_kg=shoe_mass_kg, sole_height_m=sole_height_m))
        for foot in FEET:
            ball = shape.offsets[foot.replace("foot", "toes")]
            shoe = shoe_inertia(ball, lengths[foot], shoe_mass_kg, sole_height_m)
            override = overrides.get(foot, SegmentOverride())
            if override.worn is not None:
                raise ValueError(f"{foot}: both shoe_mass_kg and worn are stated; state one")
            overrides[foot] = replace(override, worn=shoe)
    elif shoe_mass_kg is None and overrides.keys().isdisjoint(FEET):
        notes.append(Note.of("no_shoes"))
    landmark_rules = tuple(f"{missing} ({rule})" for missing, rule in anatomy.rules.items())
    if landmark_rules:
        notes.append(Note.of("landmarks_substituted", rules=landmark_rules))
    body = Body(
        mass=float(mass),
        sex=sex,
        height_m=float(stature_m),
        marker_set=chosen,
        markers=markers,
        marker_segment=segments,
        marker_position=np.array([shape.markers[name] for name in markers]),
        offsets=shape.offsets,
        axes=shape.axes,
        segments=apply_overrides(_inertias(shape.ends, table, mass), overrides, mass),
        lengths=lengths,
        locked=tuple(name for i, name in enumerate(COORDINATES) if i not in shown),
        notes=tuple(notes),
        landmark_rules=landmark_rules,
    )
    # mass whose place no marker shows adds to the residual: said once, here
    if unseen := mass_not_shown(body, undetermined(body, markers)[1]):
        body = replace(body, notes=(*notes, *unseen))
    if not still:
        body = _with_fitted_tracking_markers(body, calibration, set(landmark.values()))
    return body


def _marker_set(marker_set: str | MarkerSet | None, markers: Markers) -> MarkerSet:
    """Give the marker set that is stated or recognised; refuse one of which no label is there."""
    if marker_set is None:
        return recognise_marker_set(markers.names)
    if isinstance(marker_set, MarkerSet):
        chosen = marker_set
    elif marker_set in marker_sets():
        chosen = marker_sets()[marker_set]
    else:
        raise ValueError(f"no marker set {marker_set!r}; known: {', '.join(marker_sets())}")
    if not chosen.present(markers.names).markers:
        raise ValueError(
            f"none of the {len(chosen.markers)} markers of set {chosen.name!r} is in the "
            f"recording, which has {listed(markers.names)}; correct the set's labels, or choose "
            "another set"
        )
    return chosen


def _take(markers: Markers, names: list[str], frames: Indices) -> Markers:
    columns = [markers.names.index(name) for name in names]
    return Markers(markers.time[frames], tuple(names), markers.position[frames][:, columns])


def _stature(anatomy: Anatomy) -> Array:
    """Estimate stature in each frame, (F,) [m], from the mean length of the legs.

    De Leva's mean lengths are not used: the women's thigh ends at a different hip centre than the
    men's.
    """
    legs = [
        distance(anatomy.points[f"{side}_{a}"], anatomy.points[f"{side}_{b}"])
        for side in SIDES
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    return np.asarray(np.sum(legs, axis=0) / 2 / LEGS_PER_STATURE)


def _unlocated_segments(anatomy: Anatomy) -> set[str]:
    """Segments whose joints could not be found, so that their markers cannot be placed."""
    if "thorax" not in anatomy.frames:
        return {*MOVING[1:]} - {*LIMBS["right leg"], *LIMBS["left leg"]}
    unlocated = [side for side in SIDES if f"{side}_elbow" not in anatomy.points]
    return {segment for side in unlocated for segment in LIMBS[f"{side} arm"][1:]}


def _inertias(
    ends: Mapping[str, Array], table: Mapping[str, Proportions], mass: float
) -> dict[str, Inertia]:
    """Inertias of the segments; that of the toes is taken from the foot."""
    inertias = {}
    for s in SEGMENTS:
        if s in ends:
            part = PART_OF.get(s, s).removeprefix("right_").removeprefix("left_")
            inertias[s] = segment_inertia(table[part], mass, *ends[s])
        else:
            # de Leva's foot includes the toes: what these get, the foot loses
            foot = s.replace("toes", "foot")
            inertias[foot] = replace(inertias[foot], mass=inertias[foot].mass - TOES_KG)
            # a radius of gyration of the toes' own size, 1 cm
            tensor = TOES_KG * 0.01**2 * np.eye(3)
            inertias[s] = Inertia(TOES_KG, np.zeros(3), tensor)
    return inertias


def shoe_inertia(ball: Array, length: float, mass_kg: float, sole_height_m: float) -> Inertia:
    """Give a shoe, in the frame of its foot.

    Its mass is spread evenly over the length of the foot, at half the height of the sole: the upper
    weighs little.

    Parameters
    ----------
    ball
        The joint of the toes in that frame, (3,) [m].
    length
        Length of the foot [m].
    mass_kg, sole_height_m
        Mass and thickness of the sole.
    """
    # level direction of the foot, in the foot's frame
    along = unit(ball * [1.0, 1.0, 0.0])
    # from the ball back to the middle of the foot, and down to half the sole's thickness
    middle = ball + (0.5 - BALL_PER_FOOT) * length * along
    middle[2] = ball[2] - BALL_ABOVE_SOLE * length - sole_height_m / 2
    # of a rod along the foot: m L² / 12 about the two axes across it
    tensor = mass_kg * length**2 / 12 * (np.eye(3) - np.outer(along, along))
    return Inertia(mass_kg, middle, tensor)


def _with_fitted_tracking_markers(body: Body, calibration: Markers, landmarks: set[str]) -> Body:
    """Move markers that are not landmarks to their mean position on the fitted skeleton."""
    # frames that the skeleton fits show where each marker is on its segment on average
    motion = solve_ik(body, calibration)
    if not motion.converged.any():
        raise ValueError(
            "the skeleton fits no frame of the calibration pose; check the markers' names and the "
            "lab axes"
        )
    rotation, origin = segment_frames(body, motion.q[motion.converged])
    tracked = set(calibration.names) - landmarks
    tracking = [k for k, name in enumerate(body.markers) if name in tracked]
    on = [MOVING.index(body.marker_segment[k]) for k in tracking]
    names = [body.markers[k] for k in tracking]
    measured = _take(calibration, names, np.flatnonzero(motion.converged)).position
    # p_local = Rᵀ (p − o), averaged over the frames
    local = np.einsum("tkji,tkj->tki", rotation[:, on], measured - origin[:, on]).mean(axis=0)
    position = body.marker_position.copy()
    position[tracking] = local
    return replace(body, marker_position=position)


def without_jumps(markers: Markers, names: list[str]) -> tuple[Markers, tuple[Note, ...]]:
    """Make gaps of single positions that are far from their marker's next ones, and note them."""
    position, jumps = markers.position.copy(), dict[str, int]()
    # NaN where a marker has gaps
    farthest = np.abs(np.diff(position, axis=0)).max(axis=(0, 2), initial=0)
    columns = {name: markers.names.index(name) for name in names}
    for name in (name for name in names if not farthest[columns[name]] < LIMITS.longest_jump / 2):
        path = position[:, columns[name]]
        # steps over gaps are judged too, between samples that are known
        frames = np.flatnonzero(~np.isnan(path[:, 0]))
        if len(frames) < 3 or np.abs(np.diff(path[frames], axis=0)).max() < LIMITS.longest_jump / 2:
            continue
        # the median of five is near a position that moves, and far from one or two that jump
        windows = sliding_window_view(np.pad(path[frames], ((2, 2), (0, 0)), "reflect"), 5, axis=0)
        away_m = np.linalg.norm(path[frames] - np.median(windows, axis=-1), axis=-1)
        far = frames[away_m > LIMITS.longest_jump]
        if 0 < far.size < LIMITS.most_jumps * frames.size:
            path[far], jumps[name] = np.nan, far.size
    note = Note.of("jumps_left_out", positions=sum(jumps.values()), of_marker=jumps)
    return Markers(markers.time, markers.names, position), (note,) if jumps else ()


WINDOW_S: Final = 1.0
"""Duration of the calibration pose to look for."""


def _select_frames(
    markers: Markers, used: list[str], window_s: tuple[float, float] | None
) -> tuple[Indices, float]:
    """Select the frames that the body is built from.

    Parameters
    ----------
    markers
        The calibration recording.
    used
        Labels of the marker set that are in it.
    window_s
        Start and end [s]; by default the second in which the markers move least or, where the
        subject never stands still, the whole recording: over many strides periodic motion of the
        skin averages out.

    Returns
    -------
    frames
        At most 100, evenly spread, in which all markers that are ever visible are visible, (F,).
    speed
        Mean speed of the markers in them [m/s].

    Raises
    ------
    ValueError
        If the window holds no frame, or no frame shows all markers at once.
    """
    time = markers.time
    first_s, last_s = window_s or (-np.inf, np.inf)
    window = np.flatnonzero((time >= first_s) & (time < last_s))
    if not len(window):
        raise ValueError(
            f"the calibration window {first_s:g}–{last_s:g} s holds no frame; the recording runs "
            f"from {time[0]:g} to {time[-1]:g} s"
        )
    paths = np.moveaxis(markers.position, 0, -1)[[markers.names.index(name) for name in used]]
    visible = ~np.isnan(paths[:, 0, window].T)
    # all joints are needed in the same frame; a marker that is never seen is no obstacle
    complete = window[visible[:, visible.any(axis=0)].all(axis=1)]
    if not len(complete):
        rarest = used[int(np.argmin(np.where(visible.any(axis=0), visible.sum(axis=0), np.inf)))]
        raise ValueError(
            f"no frame from {time[window[0]]:.2f} to {time[window[-1]]:.2f} s shows all "
            f"calibration markers at once; {rarest} is missing most often; choose another window"
        )
    speed = _speed(paths, time)
    if window_s is None:
        complete = _stillest(complete, speed, time)
    # evenly spread frames are as good as all
    spread = np.unique(np.linspace(0, len(complete) - 1, 100).round().astype(int))
    known_speeds = speed[complete][~np.isnan(speed[complete])]
    return complete[spread], float(np.mean(known_speeds)) if len(known_speeds) else 0.0


def _speed(paths: Array, time: Array) -> Array:
    """Give the mean speed of the visible markers, (K, 3, T), around each frame, (T,) [m/s]."""
    speed = np.full(len(time), np.nan)
    if len(time) < 2:
        return speed
    # over an interval, since noise of single frames is no motion
    # tremor averages out over 0.1 s, and marker noise of 1 mm gives 0.01 m/s
    step = min(max(1, round(0.1 / float(np.median(np.diff(time))))), len(time) - 1)
    distances = np.sqrt(((paths[..., step:] - paths[..., :-step]) ** 2).sum(axis=1))
    count = np.count_nonzero(~np.isnan(distances), axis=0)
    # mean over the visible markers [m/s]; at the middle of each interval
    mean = np.nansum(distances, axis=0) / (time[step:] - time[:-step]) / np.maximum(count, 1)
    speed[step // 2 : step // 2 + len(mean)] = np.where(count > 0, mean, np.nan)
    return speed


def _stillest(complete: Indices, speed: Array, time: Array) -> Indices:
    """Keep the complete frames of the stillest second; all of them if the subject never stands."""
    frames = complete[~np.isnan(speed[complete])]
    if not len(frames):
        return complete
    # mean speed of every window of a second, by differences of the running sum
    total = np.concatenate([[0.0], np.cumsum(speed[frames])])
    starts, stops = np.arange(len(frames)), np.searchsorted(time[frames], time[frames] + WINDOW_S)
    count = stops - starts
    # windows that gaps leave half empty are not compared
    mean = np.where(2 * count >= count.max(), (total[stops] - total[starts]) / count, np.inf)
    best = int(np.argmin(mean))
    if mean[best] >= LIMITS.still_speed:
        return complete
    begin = time[frames[best]]
    return np.asarray(complete[(time[complete] >= begin) & (time[complete] < begin + WINDOW_S)])
