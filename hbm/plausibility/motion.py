"""Checks of a body and of a motion: legs, joint angles, marker errors, what markers do not show."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, INDEX, N_Q, SIDES, TREE
from hbm.ik.continuity import BALL_JOINTS
from hbm.ik.problem import POSTURE_PRECISION, undetermined
from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.spatial import Array

MAX_LEG_DIFFERENCE_M: Final = 0.03
"""True differences rarely exceed 2 cm; a misplaced marker easily causes more."""


def implausible(body: Body) -> tuple[Note, ...]:
    """Find what is implausible about a body.

    Parameters
    ----------
    body
        The subject.

    Returns
    -------
    tuple of Note
        ``legs_differ`` by more than 3 cm.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> hbm.implausible(body)
    ()
    """
    legs = {side: _leg_length(body, side) for side in SIDES}
    difference = abs(legs["left"] - legs["right"])
    if difference <= MAX_LEG_DIFFERENCE_M:
        return ()
    return (
        Note.of("legs_differ", difference_m=difference, left_m=legs["left"], right_m=legs["right"]),
    )


def _leg_length(body: Body, side: str) -> float:
    return sum(float(np.linalg.norm(body.offsets[f"{side}_{s}"])) for s in ("shank", "foot"))


MIN_SHARE_NOTED: Final = 0.02
"""Share of the body's mass: both hands are 1.2 %, whose own motion hardly matters."""
ROTATES: Final = np.array([not c.translates for c in TREE])


def undetermined_notes(body: Body, motion: Motion) -> tuple[Note, ...]:
    """Name what a prior holds near neutral because the markers of a trial do not determine it.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it.

    Returns
    -------
    tuple of Note
        ``coordinates_locked``: those that no marker shows. ``coordinates_uncertain``: those that
        markers show, but more weakly than posture does. ``mass_not_shown``: the segments that
        therefore may be elsewhere, unless the body says so already.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> [note.code for note in undetermined_notes(body, hbm.solve_ik(body, static))]
    ['coordinates_locked']
    """
    if not motion.converged.any():
        return ()
    held, segments = undetermined(body, seen_markers(motion))
    observed = motion.observed.any(axis=0)
    locked = tuple(np.array(COORDINATES)[held & ~observed].tolist())
    weak = {
        COORDINATES[i]: np.degrees(POSTURE_PRECISION[i] ** -0.5)
        for i in np.flatnonzero(held & observed & ROTATES)
    }
    notes = [Note.of("coordinates_locked", coordinates=locked)] if locked else []
    if weak:
        notes.append(Note.of("coordinates_uncertain", deviation_deg=weak))
    return (*notes, *(n for n in mass_not_shown(body, segments) if n not in body.notes))


def seen_markers(motion: Motion) -> list[str]:
    """Give the markers that are seen in any frame of a motion."""
    seen = np.atleast_1d(np.isfinite(motion.marker_error).any(axis=0))
    return [name for name, ever in zip(motion.markers, seen, strict=True) if ever]


def mass_not_shown(body: Body, segments: tuple[str, ...]) -> tuple[Note, ...]:
    """Say what share of the body's mass these segments are, if it matters."""
    share = sum(body.segments[s].mass for s in segments) / body.mass
    noted = share >= MIN_SHARE_NOTED
    return (Note.of("mass_not_shown", segments=segments, share=share),) if noted else ()


RANGE_DEG: Final = {
    "TrunkFlexion": (-90.0, 130.0),
    "TrunkRightBend": (-75.0, 75.0),
    "TrunkLeftTwist": (-90.0, 90.0),
    "HeadFlexion": (-110.0, 110.0),
    "HeadRightBend": (-85.0, 85.0),
    "HeadLeftTwist": (-120.0, 120.0),
    "ElbowFlexion": (-40.0, 180.0),
    "ForeArmPronation": (-60.0, 230.0),
    "WristFlexion": (-120.0, 120.0),
    "HandAbduction": (-75.0, 75.0),
    "HipFlexion": (-75.0, 180.0),
    "HipAbduction": (-75.0, 130.0),
    "HipInternalRotation": (-110.0, 110.0),
    "KneeFlexion": (-45.0, 180.0),
    "AnklePlantarFlexion": (-70.0, 120.0),
    "FootPronation": (-75.0, 75.0),
    "ToeFlexion": (-120.0, 90.0),
}
"""Lowest and highest angle, without the side; zero as in `hbm.calibration_pose.shape`.

Each end lies 20° or more beyond what has been measured: passive ranges of 674 people of 2 to 69
years (Soucie et al. 2011, Haemophilia 17:500); active ones of foot, wrist and hip rotation (Boone
and Azen 1979, J Bone Joint Surg Am 61:756); plantar flexion of ballet dancers (89°, Russell et al.
2010, Foot Ankle Spec 3:324); internal rotation of hips with anteverted femora (90°). Misplaced
markers of an axis, and a pelvis whose markers are tilted by 30°, shift angles by that much. The
pelvis may have any orientation. Shoulders have no range in these angles, in which an arm reaches
one orientation in several ways."""

MAX_NAMED: Final = 6
"""Coordinates in a note: one wrong label turns several joints."""


def impossible_angles(body: Body, motion: Motion) -> tuple[Note, ...]:
    """Find joint angles beyond any human's range.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it.

    Returns
    -------
    tuple of Note
        One ``joint_angles_impossible``: the coordinates with their extremes, and the share of the
        solved frames in which any of them is beyond its `RANGE_DEG`. Coordinates that no marker
        observes do not count, nor those that a prior holds because markers hardly show them.

    Notes
    -----
    Angles are compared modulo full turns, and those of a ball joint in the one of their two
    equivalent sets, (a, b, c) and (a + π, π − b, c + π), that is nearer to the ranges.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> impossible_angles(body, hbm.solve_ik(body, static))
    ()
    """
    outside = ((motion.q < LOW) | (motion.q > HIGH)).any(axis=1)  # as they are: few frames
    solved = np.flatnonzero(motion.converged & outside)
    angle = _nearest_to_ranges(motion.q[solved])
    beyond = (_excess(angle) > 0) & motion.observed[solved]
    if beyond.any():
        beyond &= ~undetermined(body, seen_markers(motion))[0]
    if not beyond.any():
        return ()
    excess = np.where(beyond, _excess(angle), 0)
    frame, most = excess.argmax(axis=0), excess.max(axis=0)
    worst = [i for i in np.argsort(-most)[:MAX_NAMED] if most[i] > 0]
    extreme_deg = {COORDINATES[i]: np.degrees(angle[frame[i], i]) for i in worst}
    share = beyond.any(axis=1).sum() / np.count_nonzero(motion.converged)
    return (Note.of("joint_angles_impossible", share=share, extreme_deg=extreme_deg),)


def _limits() -> tuple[Array, Array]:
    """Give the lowest and highest value of every coordinate, (46,) each; infinite where none."""
    low, high = np.full(N_Q, -np.inf), np.full(N_Q, np.inf)
    for name, i in INDEX.items():
        joint = name if name in RANGE_DEG else name.removeprefix(name[0])
        if joint in RANGE_DEG and (joint == name or name[0] in SIDES.values()):
            low[i], high[i] = np.radians(RANGE_DEG[joint])
    return low, high


LOW, HIGH = _limits()
LIMITED: Final = np.isfinite(LOW)
LIMITED_BALL_JOINTS: Final = tuple(i for i in BALL_JOINTS if LIMITED[i])


def _excess(angle: Array, of: slice = slice(None)) -> Array:
    """Give how far coordinates, by default all 46, are beyond their ranges [rad]; 0 within."""
    return np.maximum(0, np.maximum(LOW[of] - angle, angle - HIGH[of]))


def _nearest_to_ranges(q: Array) -> Array:
    """Give equivalent coordinates, (F, 46), that are as little beyond their ranges as can be."""
    best = _within_a_turn(q)
    for i in LIMITED_BALL_JOINTS:
        joint = slice(i, i + 3)
        other = _within_a_turn(best[:, joint] * [1, -1, 1] + np.pi, joint)
        nearer = _excess(other, joint).sum(axis=1) < _excess(best[:, joint], joint).sum(axis=1)
        best[nearer, joint] = other[nearer]
    return best


def _within_a_turn(q: Array, of: slice = slice(None)) -> Array:
    """Add the full turns that bring angles within half a turn of the middle of their range."""
    angle, limited = q.copy(), LIMITED[of]
    middle = (LOW[of][limited] + HIGH[of][limited]) / 2
    angle[:, limited] = (q[:, limited] - middle + np.pi) % (2 * np.pi) - np.pi + middle
    return angle


MAX_SEGMENT_ERROR_M: Final = 0.02
MAX_MARKER_ERROR_M: Final = 0.04
"""Root mean square over the trial: OpenSim's guideline for inverse kinematics (RMS error below
2 cm, largest below 4 cm; Hicks et al. 2015, J Biomech Eng 137:020905), here for a segment and for a
marker. Skin and simplified joints leave 5 to 15 mm in walking."""

MIN_MARKERS_OF_SEGMENT: Final = 2
"""A segment with a single marker is judged by the limit of a marker."""

MAX_ERRORS_NAMED: Final = 6
"""Segments or markers in a note: one wrong label moves a whole limb."""


def large_marker_errors(body: Body, motion: Motion) -> tuple[Note, ...]:
    """Find segments and markers that the model does not come near.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it.

    Returns
    -------
    tuple of Note
        ``segment_error_large`` where the RMS error over a segment's markers exceeds 20 mm,
        ``marker_error_large`` where that of a marker exceeds 40 mm; the largest first.

    Examples
    --------
    With ``body`` from `build_body` and a trial in which the heel markers are exchanged:

    >>> import hbm
    >>> heels = {"LHEE": "RHEE", "RHEE": "LHEE"}
    >>> names = tuple(heels.get(name, name) for name in static.names)
    >>> trial = hbm.Markers(static.time, names, static.position)
    >>> for note in large_marker_errors(body, hbm.solve_ik(body, trial)):
    ...     print(note.code, *list(note.values["farthest_m"])[:2])
    segment_error_large left_foot right_foot
    marker_error_large LHEE RHEE
    """
    segment_of = body.segment_of
    of_marker: dict[str, Array] = {}
    of_segment: dict[str, list[Array]] = {}
    for name, error in zip(motion.markers, motion.marker_error.T, strict=True):
        known = error[np.isfinite(error)]
        if len(known):
            of_marker[name] = known
            of_segment.setdefault(segment_of[name], []).append(known)
    joined = {
        segment: np.concatenate(errors)
        for segment, errors in of_segment.items()
        if len(errors) >= MIN_MARKERS_OF_SEGMENT
    }
    return (
        *_above(joined, MAX_SEGMENT_ERROR_M, "segment_error_large"),
        *_above(of_marker, MAX_MARKER_ERROR_M, "marker_error_large"),
    )


def _above(error_m: Mapping[str, Array], limit_m: float, code: str) -> tuple[Note, ...]:
    """Note those whose RMS error exceeds the limit, the largest first."""
    rms_m = {name: float(np.sqrt(np.mean(error**2))) for name, error in error_m.items()}
    large = sorted((name for name in rms_m if rms_m[name] > limit_m), key=lambda name: -rms_m[name])
    if not large:
        return ()
    farthest_m = {name: rms_m[name] for name in large[:MAX_ERRORS_NAMED]}
    return (Note.of(code, limit_m=limit_m, count=len(large), farthest_m=farthest_m),)
