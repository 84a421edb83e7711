"""Checks of a body and of a motion: legs, joint angles, marker errors, what markers do not show.

With what residuals hold of the motion of segments that no marker shows.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, FIXED_TO, INDEX, LIMBS, N_Q, UP
from hbm.ik.continuity import BALL_JOINTS, other_set
from hbm.ik.problem import undetermined
from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.segments import LEGS_PER_STATURE
from hbm.spatial import GRAVITY_MPS2, Array, Mask, rotation_about
from hbm.spelling import packaged_toml

UNSEEN: Final = read_numbers("hbm", "thresholds.toml", "unseen")

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "motion")


def implausible(body: Body) -> tuple[Note, ...]:
    """Find what is implausible about a body.

    Parameters
    ----------
    body
        The subject.

    Returns
    -------
    tuple of Note
        ``legs_differ`` by more than 3 cm; ``stature_differs`` by more than 10 % from the stature
        that the legs suggest.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> implausible(body)
    ()
    """
    left_m, right_m = (
        sum(float(np.linalg.norm(body.offsets[f"{side}_{s}"])) for s in ("shank", "foot"))
        for side in ("left", "right")
    )
    difference_m, by_legs_m = abs(left_m - right_m), (left_m + right_m) / 2 / LEGS_PER_STATURE
    notes = list[Note]()
    if difference_m > LIMITS.leg_difference:
        lengths = {"left_m": left_m, "right_m": right_m}
        notes.append(Note.of("legs_differ", difference_m=difference_m, **lengths))
    if abs(body.height_m / by_legs_m - 1) > LIMITS.stature_difference:
        notes.append(Note.of("stature_differs", height_m=body.height_m, by_legs_m=by_legs_m))
    return tuple(notes)


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
        ``coordinates_held``: those that markers show more weakly than posture does, or not at all.
        ``mass_not_shown``: the segments that therefore may be elsewhere, unless the body says so
        already.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> [note.code for note in undetermined_notes(body, hbm.solve_ik(body, static))]
    ['coordinates_held']
    """
    names, (_, segments) = held_coordinates(body, motion), not_determined(body, motion)
    notes = [Note.of("coordinates_held", coordinates=names)] if names else []
    return (*notes, *(n for n in mass_not_shown(body, segments) if n not in body.notes))


def held_coordinates(body: Body, motion: Motion) -> tuple[str, ...]:
    """Name the coordinates that markers show more weakly than posture does, or not at all."""
    held, _ = not_determined(body, motion)
    return tuple(np.array(COORDINATES)[held].tolist())


def not_determined(body: Body, motion: Motion) -> tuple[Mask, tuple[str, ...]]:
    """Give what the markers that are seen in any frame do not determine, as `undetermined` does."""
    if not motion.converged.any():
        return np.zeros(N_Q, bool), ()
    return undetermined(body, tuple(seen_markers(motion)))


RANGE_DEG: Final = packaged_toml("hbm", "joint_ranges.toml")["possible_deg"]
"""Coordinate, without its side -> lowest and highest angle."""


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
    # an angle that markers do not show is no sign of a wrong label
    beyond = (_excess(angle) > 0) & motion.observed[solved]
    if beyond.any():
        beyond &= ~not_determined(body, motion)[0]
    if not beyond.any():
        return ()
    excess = np.where(beyond, _excess(angle), 0.0)
    frame, most = excess.argmax(axis=0), excess.max(axis=0)
    worst = [i for i in np.argsort(-most)[: LIMITS.angles_named] if most[i] > 0]
    extreme_deg = {COORDINATES[i]: np.degrees(angle[frame[i], i]) for i in worst}
    fraction = beyond.any(axis=1).sum() / np.count_nonzero(motion.converged)
    return (Note.of("joint_angles_impossible", share=fraction, extreme_deg=extreme_deg),)


def _limits() -> tuple[Array, Array]:
    """Give the lowest and highest value of every coordinate, (46,) each; a turn where none."""
    low, high = np.full((2, N_Q), [[-np.pi], [np.pi]])
    for name, ends in RANGE_DEG.items():
        for coordinate in (name, f"R{name}", f"L{name}"):
            if coordinate in INDEX:
                low[INDEX[coordinate]], high[INDEX[coordinate]] = np.radians(ends)
    return low, high


LOW, HIGH = _limits()


def _excess(angle: Array, of: slice = slice(None)) -> Array:
    """Give how far all or some coordinates, (F, n), are beyond their ranges [rad]; 0 within."""
    return np.maximum(0, np.maximum(LOW[of] - angle, angle - HIGH[of]))


def _nearest_to_ranges(q: Array) -> Array:
    """Give equivalent coordinates, (F, 46), that are as little beyond their ranges as can be."""
    best = _within_a_turn(q)
    for joint in (slice(i, i + 3) for i in BALL_JOINTS):
        # a pose is impossible if both sets of a joint's angles are
        other = _within_a_turn(other_set(best[:, joint]), joint)
        nearer = _excess(other, joint).sum(axis=1) < _excess(best[:, joint], joint).sum(axis=1)
        best[nearer, joint] = other[nearer]
    return best


def _within_a_turn(q: Array, of: slice = slice(None)) -> Array:
    """Add the full turns that bring angles within half a turn of the middle of their range."""
    middle = (LOW[of] + HIGH[of]) / 2
    return np.asarray((q - middle + np.pi) % (2 * np.pi) - np.pi + middle)


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
        ``marker_error_large`` where the RMS error over a segment's markers exceeds 20 mm, or that
        of a marker 40 mm; the largest first.

    Examples
    --------
    With ``body`` from `build_body` and a trial in which the heel markers are exchanged:

    >>> import hbm
    >>> heels = {"LHEE": "RHEE", "RHEE": "LHEE"}
    >>> names = tuple(heels.get(name, name) for name in static.names)
    >>> trial = hbm.Markers(static.time, names, static.position)
    >>> for note in large_marker_errors(body, hbm.solve_ik(body, trial)):
    ...     print(*list(note.values["farthest_m"])[:4])
    LHEE RHEE left_foot right_foot
    """
    segment_of = body.segment_of
    columns = {name: motion.markers.index(name) for name in seen_markers(motion)}
    of_segment: dict[str, list[int]] = {}
    for name, column in columns.items():
        of_segment.setdefault(segment_of[name], []).append(column)
    # a segment by all of its markers, each marker by itself
    judged = [(name, [column], LIMITS.marker_distance) for name, column in columns.items()]
    judged += [
        (segment, several, LIMITS.segment_distance)
        for segment, several in of_segment.items()
        if len(several) >= 2
    ]
    # root mean square over the frames in which a marker is seen
    square, large_m = np.square(motion.marker_error), dict[str, float]()
    number, total = np.isfinite(square).sum(axis=0), np.nansum(square, axis=0)
    for name, of_name, limit_m in judged:
        rms_m = float(np.sqrt(total[of_name].sum() / number[of_name].sum()))
        if rms_m > limit_m:
            large_m[name] = rms_m
    farthest_m = dict(sorted(large_m.items(), key=lambda item: -item[1])[: LIMITS.distances_named])
    return (Note.of("marker_error_large", farthest_m=farthest_m),) if large_m else ()


TRUNK: Final = ("mid_trunk", "thorax")
ARMS: Final = (*LIMBS["right arm"][1:], *LIMBS["left arm"][1:])


def unseen_segments(body: Body, motion: Motion) -> tuple[str, ...]:
    """Give the segments that the markers of a motion leave uncertain by more than 5 cm.

    Gives none that moves with a marker that is seen, and none where all are as light as hands.
    """
    shown = {body.segment_of[name] for name in seen_markers(motion)}
    _, uncertain = not_determined(body, motion)
    segments = tuple(s for s in uncertain if FIXED_TO.get(s, s) not in shown)
    return segments if mass_share(body, segments) >= LIMITS.least_mass else ()


def seen_markers(motion: Motion) -> list[str]:
    """Give the markers that are seen in any frame of a motion."""
    ever_seen = np.atleast_1d(np.isfinite(motion.marker_error).any(axis=0))
    return [name for name, ever in zip(motion.markers, ever_seen, strict=True) if ever]


def mass_share(body: Body, segments: Sequence[str]) -> float:
    """Give the share of the body's mass in segments."""
    return sum(body.segments[segment].mass for segment in segments) / body.mass


def mass_not_shown(body: Body, segments: tuple[str, ...]) -> tuple[Note, ...]:
    """Say what share of the body's mass these segments are, if it matters."""
    fraction = mass_share(body, segments)
    if fraction < LIMITS.least_mass:
        return ()
    return (Note.of("mass_not_shown", segments=segments, share=fraction),)


def unseen_covariance(body: Body, motion: Motion, frames: Mask) -> Array:
    """Give what the motion of unseen segments adds to the residual of somebody who walks.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion, T frames.
    frames
        Over which to average where the subject faces, (T,); without any, forward is the lab's X.

    Returns
    -------
    Array
        Covariance in lab axes about the pelvis origin, (6, 6) [N, N·m]. Zero where markers show
        trunk, head and arms; hands alone do not count.

    Notes
    -----
    Each part contributes by the share of its mass that is unseen. Other ways of moving differ:
    arms that are held forward in a squat add 6 % of body weight × stature to My.
    """
    segments = unseen_segments(body, motion)
    # [N] by body weight, [N·m] by body weight × stature
    percent_of = body.mass * GRAVITY_MPS2 / 100 * np.repeat([1.0, body.height_m], 3)
    variance = np.zeros(6)
    spread = ((TRUNK, UNSEEN.trunk), (("head",), UNSEEN.head), (ARMS, UNSEEN.arms))
    for part, percent in spread:
        unseen = [segment for segment in part if segment in segments]
        # independent parts: variances add, in proportion to the mass that is unseen
        fraction = mass_share(body, unseen) / mass_share(body, part)
        variance += fraction * np.square(percent_of * percent)
    # horizontal forces of a trunk above the pelvis are moments about it too
    covariance = np.diag(variance)
    for moment, force, correlation in ((3, 1, UNSEEN.mx_with_fy), (4, 0, UNSEEN.my_with_fx)):
        product = correlation * np.sqrt(variance[moment] * variance[force])
        covariance[moment, force] = covariance[force, moment] = product
    # from axes of heading to those of the lab, in every frame, and their mean
    yaw = motion.q[frames & motion.converged, INDEX["PelvisYaw"]]
    turns = np.kron(np.eye(2), rotation_about(UP, yaw if len(yaw) else [0.0]))
    return np.asarray((turns @ covariance @ turns.transpose(0, 2, 1)).mean(axis=0))
