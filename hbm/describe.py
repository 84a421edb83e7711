"""A body in words: its segments and joints as tables, and what looks wrong about it."""

from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from hbm.calibration_pose.anatomy import SIDES, distance
from hbm.coordinates import MOVING, PARENT, SEGMENTS
from hbm.markers import Markers
from hbm.spatial import Array

if TYPE_CHECKING:
    from hbm.model import Body

LEGS_APART_M: Final = 0.03
MARKERS_APART_M: Final = 0.03
MASS_APART: Final = 0.05
PAIRS_NAMED: Final = 3


def describe(body: "Body") -> str:
    """Tell a body as two tables and its notes.

    Parameters
    ----------
    body
        The subject.

    Returns
    -------
    str
        Segments: mass [kg], length [m], centre of mass in the segment's frame [mm], principal
        moments of inertia [kg·m²]. Joints: place in the parent segment's frame, and in the neutral
        pose with the pelvis at the lab's origin [mm]. Then what was locked, estimated, and what
        looks wrong.
    """
    lines = [
        f"{body.mass:.1f} kg, {body.height_m:.2f} m, {body.sex}; "
        f"markers: {len(body.markers)} of {body.marker_set.title}",
        "",
        f"{'segment':16}{'mass':>8}{'length':>9}  {'centre of mass':>21}  {'inertia':>24}",
        f"{'':16}{'kg':>8}{'m':>9}  {'mm forward, left, up':>21}  {'kg·m², principal':>24}",
    ]
    for s in MOVING:
        part, length = body.inertias[s], _length(body, s)
        moments = np.linalg.eigvalsh(part.tensor)
        lines.append(
            f"{s:16}{part.mass:8.2f}{f'{length:.3f}' if length else '':>9}  "
            f"{_millimetres(part.center)}  " + "".join(f"{m:8.4f}" for m in moments)
        )
    lines += [
        "",
        f"{'joint of':16}{'in':16}{'mm forward, left, up':>21}  {'from pelvis, neutral':>21}",
    ]
    place = {"pelvis": np.zeros(3)}
    for s in SEGMENTS[1:]:
        offset = body.offsets[s]
        place[s] = place[PARENT[s]] + offset
        lines.append(f"{s:16}{PARENT[s]:16}{_millimetres(offset)}  {_millimetres(place[s])}")
    lines += ["", *body.notes]
    if body.locked:
        lines.append(f"locked at neutral, for no marker shows them: {', '.join(body.locked)}")
    return "\n".join([*lines, *implausible(body)])


def implausible(body: "Body", *, weighed_kg: float | None = None) -> tuple[str, ...]:
    """Say what looks wrong about a body.

    Parameters
    ----------
    body
        The subject.
    weighed_kg
        What force plates say of the body's mass [kg].

    Returns
    -------
    tuple[str, ...]
        Sentences: legs that differ by more than 3 cm, mass more than 5 % off the plates.
    """
    said = []
    legs = {side: _leg(body, side) for side in SIDES}
    if abs(legs["left"] - legs["right"]) > LEGS_APART_M:
        said.append(
            f"warning: the legs differ by {1000 * abs(legs['left'] - legs['right']):.0f} mm (left "
            f"{legs['left']:.3f} m, right {legs['right']:.3f} m from hip to ankle); check the "
            "markers of pelvis, knees and ankles"
        )
    off = 0.0 if weighed_kg is None else body.mass / weighed_kg - 1
    if abs(off) > MASS_APART:
        said.append(
            f"warning: the body's mass of {body.mass:.1f} kg is {100 * off:+.0f} % off the "
            f"{weighed_kg:.1f} kg that the plates say"
        )
    return tuple(said)


def changed_distances(body: "Body", markers: Markers) -> tuple[str, ...]:
    """Say which markers of one segment are not as far from each other as on the body.

    Parameters
    ----------
    body
        The subject, from the calibration pose.
    markers
        A trial.

    Returns
    -------
    tuple[str, ...]
        One sentence per segment: pairs whose median distance in the trial is more than 3 cm off,
        for a marker that has moved, is swapped with another or means something else.
    """
    said = []
    place = dict(zip(body.markers, body.marker_position, strict=True))
    for s in SEGMENTS:
        own = [
            name
            for name, segment in zip(body.markers, body.marker_segment, strict=True)
            if segment == s and name in markers.names
        ]
        changes = []
        for a, b in combinations(own, 2):
            apart = markers.position[:, [markers.names.index(n) for n in (a, b)]]
            now = np.linalg.norm(apart[:, 0] - apart[:, 1], axis=-1)
            if np.isfinite(now).any():
                changes.append((float(np.nanmedian(now)) - distance(place[a], place[b]), a, b))
        changes = sorted(
            (c for c in changes if abs(c[0]) > MARKERS_APART_M), key=lambda c: -abs(c[0])
        )
        if changes:
            pairs = ", ".join(f"{a}–{b} {1000 * c:+.0f} mm" for c, a, b in changes[:PAIRS_NAMED])
            more = f" and {len(changes) - PAIRS_NAMED} more" if len(changes) > PAIRS_NAMED else ""
            said.append(
                f"warning: on the {s} markers are not as far apart as in the calibration pose: "
                f"{pairs}{more}; has a marker moved, or are two swapped?"
            )
    return tuple(said)


def _length(body: "Body", s: str) -> float | None:
    """Length of a segment's inertial part; for the trunk, of both its parts."""
    parts = {"pelvis": ["lower_trunk"], "trunk": ["mid_trunk", "upper_trunk"]}.get(s, [s])
    lengths = [body.lengths[p] for p in parts if p in body.lengths]
    return sum(lengths) if lengths else None


def _leg(body: "Body", side: str) -> float:
    return sum(float(np.linalg.norm(body.offsets[f"{side}_{s}"])) for s in ("shank", "foot"))


def _millimetres(point: Array) -> str:
    return "".join(f"{round(1000 * float(x)):7d}" for x in point)
