"""Axes of a file: stated by a person or inferred from what was recorded, and checked."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hbm.markers import MarkerSet, exchange, recognise_marker_set, usual_landmarks
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.samples import medians_of_known
from hbm.spatial import Array, Mask, cross
from hbm.spelling import listed, short
from pipeline.io.read_options import correction
from pipeline.io.recording import Fact

PELVIS_AND_SHOULDERS: Final = ("ASIS", "PSIS", "SHO")
TOES: Final = ("TOE", "MT2", "MT5", "MTS")
"""Landmarks without their side."""
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "axes")
MIN_MEAN_LOAD_N: Final[float] = LIMITS.least_mean_load
Pair = tuple[int, int]
DIRECTIONS: Final = {
    "forward": (1, 0, 0),
    "back": (-1, 0, 0),
    "left": (0, 1, 0),
    "right": (0, -1, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
}
PAIRS_NAMED: Final = 3
"""Marker pairs and contradictions that a note or message names: enough to check by eye."""
ABOVE: Final = "pelvis or shoulders above feet"


@dataclass(frozen=True, slots=True)
class Sites:
    """Columns of the markers that show how a subject stands.

    Attributes
    ----------
    high, low
        Markers of pelvis and shoulders, and of the feet.
    across
        (right, left) markers, by their labels "left/right"; of pelvis and shoulders where there
        are any.
    on_trunk
        Whether those are of pelvis and shoulders.
    every
        (right, left) markers of the whole body.
    feet
        (heel, toe) markers of one foot.
    no_set
        Why the labels are of no set; empty where they are of one.
    """

    high: list[int]
    low: list[int]
    across: Mapping[str, Pair]
    on_trunk: bool
    every: list[Pair]
    feet: list[Pair]
    no_set: str


@lru_cache
def find_sites(names: tuple[str, ...], marker_set: MarkerSet | None = None) -> Sites:
    """Find the markers that show how a subject stands, by the landmarks of their set.

    The set is by default the shipped one that the labels belong to; usual labels show the landmarks
    that it lacks.
    """
    column, no_set = {name: k for k, name in enumerate(names)}, ""
    try:
        of_set = (marker_set or recognise_marker_set(names)).present(names).landmark
    except ValueError as error:
        of_set, no_set = {}, str(error)
    marked = {**of_set, **usual_landmarks(names)} | of_set  # the set's come first, and count
    columns = {landmark: column[name] for landmark, name in marked.items()}
    trunk, all_pairs = _sides(columns, PELVIS_AND_SHOULDERS), _sides(columns) or _sides(column)
    heels_and_toes = ((f"{side}HEE", f"{side}{toe}") for side in "LR" for toe in TOES)
    feet = ("HEE", *TOES, "LM", "MM")  # heel, toes and ankles
    return Sites(
        high=[k for mark, k in columns.items() if mark[1:] in PELVIS_AND_SHOULDERS],
        low=[k for mark, k in columns.items() if mark[1:] in feet],
        across={f"{names[k]}/{names[right]}": (right, k) for right, k in trunk or all_pairs},
        on_trunk=bool(trunk),
        every=all_pairs,
        feet=[(columns[a], columns[b]) for a, b in heels_and_toes if {a, b} <= {*columns}],
        no_set=no_set,
    )


def between(position: Array, pairs: Iterable[Pair]) -> Array:
    """Give the vectors from the first to the second marker of each pair, (T, pairs, 3)."""
    start, end = np.reshape(np.array([*pairs], int), (-1, 2)).T
    return np.asarray(position[:, end] - position[:, start])


def typical(vectors: Array) -> Array:
    """Give the means of vectors, (N, ..., 3), without gaps and those far longer than most."""
    is_known = np.isfinite(vectors).all(axis=-1)
    with np.errstate(over="ignore", invalid="ignore"):
        # one damaged number outweighs thousands of frames in a mean
        length = np.where(is_known, np.linalg.norm(vectors, axis=-1), np.nan)
        usual = length <= LIMITS.largest_length_ratio * medians_of_known(length.T)
        total = np.where(usual[..., None], vectors, 0.0).sum(axis=0)
        return np.asarray(total / usual.sum(axis=0)[..., None])


def _sides(columns: Mapping[str, int], sites: Sequence[str] | None = None) -> list[Pair]:
    """Give (right, left) columns of the landmarks or labels that differ by their side only."""
    opposite = {"L": "R", "l": "r"}
    return [
        (columns[other], k)
        for name, k in columns.items()
        if name[:1] in opposite
        and (other := opposite[name[0]] + name[1:]) in columns
        and (sites is None or name[1:] in sites)
    ]


def above_feet(position: Array, sites: Sites) -> Array:
    """Give the vectors from the feet to pelvis and shoulders, (T, 3); NaN where one is unseen."""
    return _middle(position[:, sites.high]) - _middle(position[:, sites.low])


def _middle(points: Array) -> Array:
    """Give the mean of the points seen in each frame, (T, 3); NaN where none is."""
    is_seen = np.isfinite(points).all(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.where(is_seen, points, 0.0).sum(axis=1) / is_seen.sum(axis=1))


def parse_axes(axes: str) -> Array:
    """Give the rotation from a file's axes to the lab's.

    Parameters
    ----------
    axes
        Lab directions of the file's x, y and z axis: three of forward, back, left, right, up,
        down, separated by commas.

    Returns
    -------
    Array
        Rotation matrix, (3, 3): lab = matrix @ file.

    Raises
    ------
    ValueError
        A word is unknown, or the three do not form right-handed axes.
    """
    words = [word.strip().lower() for word in axes.split(",")]
    if len(words) != 3 or any(word not in DIRECTIONS for word in words):
        raise ValueError(
            f'axes {short(axes)!r} must be three of {", ".join(DIRECTIONS)}, such as "left,back,up"'
        )
    # columns are the file's axes in the lab; −1 is left-handed, 0 has a direction twice
    rotation = np.array([DIRECTIONS[word] for word in words], float).T
    if round(np.linalg.det(rotation)) != 1:
        raise ValueError(
            f"axes {short(axes)!r} are not right-handed axes of three different directions"
        )
    return rotation


class AxesUnknownError(ValueError):
    """A recording does not show where its axes point; a person or another recording may."""


def settle_axes(
    axes: str | None,
    position: ArrayLike,
    names: Sequence[str],
    *,
    marker_set: MarkerSet | None = None,
    plate_normals: ArrayLike = (),
    plate_forces: ArrayLike = (),
    screen_up: str = "",
    by: str = "as given",
    file: str = "",
) -> tuple[str, list[Note | Fact]]:
    """Infer the axes of a recording, or check those that a person or a program states.

    Parameters
    ----------
    axes
        Stated directions as `parse_axes` takes them, or None to infer them.
    position
        Marker positions in the file's axes, (T, M, 3); gaps are NaN; any unit.
    names
        Marker labels.
    marker_set
        The set that they are of; by default recognised from the labels.
    plate_normals
        Normals of the plates' surfaces in the file's axes, up or down, (P, 3).
    plate_forces
        Mean force of each plate on the subject in the file's axes, as `mean_force` gives it,
        (P, 3) [N].
    screen_up
        The file's own Y_SCREEN hint, such as "+Z"; empty where it gives none.
    by
        Why the stated axes hold, in words; empty not to note them.
    file
        Name of the recording, for options that exchange its labels.

    Returns
    -------
    axes
        The directions.
    notes
        ``axes`` with the evidence; the fact that some marker pairs lie the other way round, or that
        all do by the direction of the toes; ``subject_faces_sideways`` where the subject does not
        face forward by the stated axes.

    Raises
    ------
    AxesUnknownError
        Evidence is missing or contradicts itself; the message asks for the axes.
    ValueError
        Gravity contradicts the stated axes.

    Notes
    -----
    Up is where most of these have it: loaded plates push the subject, pelvis and shoulders are
    above feet and, less certain, surfaces of plates and Y_SCREEN. Left is from right-side to
    left-side markers; forward is left × up, checked against heel to toe. Stated axes are refused
    where up contradicts them; a subject may face any way in a lab, so that facing another way than
    forward is a warning only.
    """
    position = np.asarray(position, float)
    sites = find_sites(tuple(names), marker_set)
    forces = np.reshape(np.asarray(plate_forces, float), (-1, 3))
    evidence = {
        f"the load on plate {k}": force
        for k, force in enumerate(forces, start=1)
        if np.linalg.norm(force) > MIN_MEAN_LOAD_N
    }
    # of one who stands or walks, pelvis and shoulders are above the feet in most frames
    above = typical(above_feet(position, sites))
    if np.isfinite(above).all():
        evidence[ABOVE] = above
    if axes is None and not np.isfinite(position).any():
        raise AxesUnknownError(
            "no marker is ever visible: export the file again with its trajectories"
        )
    if axes is None:
        try:
            up, up_evidence = _infer_up(evidence, plate_normals, screen_up)
            left, pairs, doubts = _infer_left(position, sites, up, file)
        except AxesUnknownError as error:
            if sites.no_set and not sites.on_trunk:
                reason = f"{sites.no_set}; for plates without a person, give --axes"
            else:
                reason = (
                    f"axes cannot be inferred: {error}; give the axes, for example --axes "
                    'forward,left,up, or axes = "forward,left,up" in study.toml, or a static '
                    "recording that shows them (--static)"
                )
            raise AxesUnknownError(reason) from error
        words = tuple(map(_direction_name, np.transpose([cross(left, up), left, up])))
        by_toes = np.isfinite(between(position, sites.feet)).all(axis=-1).any()
        shown = (
            f"up by {', '.join(up_evidence)}; left by the marker pairs {', '.join(pairs)}; forward "
            f"by left and up{' and the direction of the toes' * bool(by_toes)}"
        )
        return ",".join(words), [Note.of("axes", axes=words, evidence=shown), *doubts]
    rotation = parse_axes(axes)
    # lab = rotation @ file: the third row is the lab's up in the file's axes
    up = rotation[2]
    down = [source for source, vector in evidence.items() if vector @ up < 0]
    with suppress(AxesUnknownError):  # most of all that shows up count, if they are no tie
        if _infer_up(evidence, plate_normals, screen_up)[0] @ up > 0:
            down = []
    if ABOVE in evidence and down:
        pulling = [f"{k}: reverse all" for k, n in enumerate(forces, 1) if n @ up < 0]
        raise ValueError(
            f"{_axis_name(up)} is up by the axes {axes}, but down by {down[0]}: the axes are "
            "wrong, or the plate stores the force that acts on itself"
            + (f"; then give {correction(*pulling)}" if pulling else "")
        )
    notes: list[Note | Fact] = []
    if by:
        notes.append(Note.of("axes", axes=split_axes(axes), evidence=by))
    try:
        left, pairs, doubts = _infer_left(position, sites, up, file)
    except AxesUnknownError:
        return axes, notes
    except ValueError as error:
        return axes, [*notes, Fact("in_doubt", "labels", str(error))]
    if (facing := _direction_name(rotation @ cross(left, up))) != "forward":
        notes.append(Note.of("subject_faces_sideways", direction=facing, marker_pairs=pairs))
    return axes, [*notes, *doubts]


def mean_force(force: Array) -> Array:
    """Give the mean of a plate's forces, (N, 3), without gaps and damaged samples, (3,) [N]."""
    components = np.ascontiguousarray(force.T)
    with np.errstate(invalid="ignore"):
        measured = np.all(np.abs(components) < LIMITS.largest_force, axis=0)
    return np.asarray(np.where(measured, components, 0.0).sum(axis=1) / max(len(force), 1))


def split_axes(axes: str) -> tuple[str, ...]:
    """Give the directions of the three axes, without spaces."""
    return tuple(word.strip() for word in axes.split(","))


def _infer_up(
    evidence: Mapping[str, Array], plate_normals: ArrayLike, screen_up: str
) -> tuple[Array, list[str]]:
    """Give the file's axis that points up, (3,), and what shows it."""
    if not evidence:
        raise AxesUnknownError(
            "no plate is loaded, and no marker of pelvis, shoulders and feet is seen"
        )
    signed = {source: _nearest_axis(vector, source) for source, vector in evidence.items()}
    normals = np.reshape(np.asarray(plate_normals, float), (-1, 3))
    surfaces = {f"the surface of plate {k}": -normal for k, normal in enumerate(normals, start=1)}
    lines = {source: _nearest_axis(normal, source) for source, normal in surfaces.items()}
    # plates are alike, so that they count once: by their loads, and by their surfaces
    of_plates = _most([axis for source, axis in signed.items() if source != ABOVE])
    of_surfaces = _most([*lines.values()])
    if screen_up[-1:].upper() in {"X", "Y", "Z"}:
        screen = np.eye(3)["XYZ".index(screen_up[-1].upper())]
        lines["Y_SCREEN"] = -screen if screen_up[:1] == "-" else screen
    # loads and the body have a direction; surfaces and screens show the line, less surely the way
    surely = [axis for axis in (of_plates, signed.get(ABOVE)) if axis is not None]
    rather = [axis for axis in (of_surfaces, lines.get("Y_SCREEN")) if axis is not None]
    # up needs most votes, and most witnesses for its line, whichever way these point
    up, witnesses = _most([*surely, *surely, *rather]), [*surely, *rather]
    if up is None or 2 * sum(abs(axis @ up) > 0.5 for axis in witnesses) <= len(witnesses):
        first, up = next(iter(signed.items()))
        contradicting = [source for source, axis in signed.items() if axis @ up < 0.5]
        contradicting += [source for source, axis in lines.items() if abs(axis @ up) < 0.5]
        raise AxesUnknownError(
            f"{_axis_name(up)} is up by {first}, "
            f"but not by {' and '.join(contradicting[:PAIRS_NAMED])}"
        )
    agreeing = [source for source, axis in signed.items() if axis @ up > 0.5]
    return up, agreeing + [source for source, axis in lines.items() if abs(axis @ up) > 0.5]


def _most(axes: Sequence[Array]) -> Array | None:
    """Give the axis on which more than half agree."""
    for axis in axes:
        if 2 * sum(axis @ other > 0.5 for other in axes) > len(axes):
            return axis
    return None


def _infer_left(
    position: Array, sites: Sites, up: Array, file: str
) -> tuple[Array, list[str], list[Note | Fact]]:
    """Give the file's axis that points to the subject's left, (3,), what shows it, and doubts."""
    # level parts: the pelvis drops to one side, and shoulders are not level
    across = between(position, sites.across.values())
    across = across - (across @ up)[..., None] * up
    by_pair = typical(across)
    is_seen: Mask = np.asarray(np.isfinite(by_pair).all(axis=-1))
    names = [short(name) for name, seen in zip(sites.across, is_seen, strict=True) if seen]
    if not names:
        absent = listed(sites.across or ["such as LASIS and RASIS"])
        raise AxesUnknownError(f"none of the marker pairs {absent} is seen")
    by_pair, across = by_pair[is_seen], across[:, is_seen]
    source = f"the marker pairs {', '.join(names[:PAIRS_NAMED])}"
    # opposite pairs show the same line; which way is left, most pairs of the whole body say
    same_way = by_pair * np.where(by_pair @ by_pair[0] < 0, -1, 1)[:, None]
    line = _nearest_axis(same_way.mean(axis=0), source)
    votes = np.nansum(np.sign(typical(between(position, sites.every)) @ line))
    if votes == 0:
        raise AxesUnknownError(
            f"of {source}, as many lie one way round as the other: labels are exchanged"
        )
    left = line * np.sign(votes)
    cosines = by_pair @ left / np.maximum(np.linalg.norm(by_pair, axis=1), np.finfo(float).tiny)
    # pairs that are not exchanged: whoever turns around has them the other way in many frames
    facing = across[:, cosines > 0]
    facing = facing[np.isfinite(facing).all(axis=-1)] @ left
    if sites.on_trunk and np.mean(facing > 0) < LIMITS.least_facing_one_way:
        raise AxesUnknownError("the subject turns around")
    reason = "left and right contradict most others: exchange them in the capture software, or "
    doubts: list[Note | Fact] = [
        Fact("in_doubt", f"marker pair {pair}", reason + exchange([tuple(pair.split("/"))], file))
        for pair, cosine in zip(names, cosines, strict=True)
        if cosine < LIMITS.largest_cosine_exchanged
    ]
    agreeing = [name for name, cosine in zip(names, cosines, strict=True) if cosine > 0]
    forward, pairs = cross(left, up), agreeing[:PAIRS_NAMED]
    if typical(between(position, sites.feet).reshape(-1, 3)) @ forward < 0:
        raise ValueError(
            f"forward is {_axis_name(forward)} by the marker pairs {', '.join(pairs)}, but the "
            "toes point the other way: all left and right labels are exchanged "
            f"({exchange([], file, True)}), those of heels and toes are, or the coordinates are "
            "mirrored (export the recording with right-handed axes)"
        )
    return left, pairs, doubts


def _nearest_axis(vector: Array, source: str) -> Array:
    k, angle_deg = int(np.argmax(np.abs(vector))), LIMITS.largest_angle_to_axis
    if not abs(vector[k]) > np.cos(np.deg2rad(angle_deg)) * np.linalg.norm(vector):
        raise AxesUnknownError(
            f"the direction of {source} is more than {angle_deg:g}° away from every axis of the "
            "file"
        )
    return np.asarray(np.sign(vector[k]) * np.eye(3)[k])


def _axis_name(axis: Array) -> str:
    k = int(np.argmax(np.abs(axis)))
    return f"{'+' if axis[k] > 0 else '-'}{'xyz'[k]}"


def _direction_name(vector: Array) -> str:
    return max(DIRECTIONS, key=lambda name: float(vector @ DIRECTIONS[name]))
