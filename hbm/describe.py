"""A body in words: its segments and joints as tables, and what looks wrong about it."""

from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from hbm.calibration_pose.anatomy import SIDES, distance
from hbm.coordinates import PARENT, SEGMENTS, SEGMENTS_WITH_MASS
from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array

if TYPE_CHECKING:
    from hbm.model import Body

MAX_LEG_DIFFERENCE_M: Final = 0.03
"""True differences rarely exceed 2 cm; a misplaced marker easily makes more."""
MAX_DISTANCE_CHANGE_M: Final = 0.03
"""Skin moves markers of one segment against each other by up to 2 or 3 cm in walking."""
MAX_MASS_DIFFERENCE: Final = 0.05
"""Share of the body mass: more than clothes, shoes and a plate's gain error together."""
PAIRS_NAMED: Final = 3
"""A single displaced marker changes its distances to all others: three name it."""


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
    for s in SEGMENTS_WITH_MASS:
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
    locked = [Note.of("coordinates_locked", coordinates=body.locked)] if body.locked else []
    notes = (*body.notes, *locked, *implausible(body))
    return "\n".join([*lines, "", *map(str, notes)])


def implausible(body: "Body", *, carried_kg: float | None = None) -> tuple[Note, ...]:
    """Find what is implausible about a body.

    Parameters
    ----------
    body
        The subject.
    carried_kg
        The mass that the force plates carry over whole gait cycles [kg]; None where unknown.

    Returns
    -------
    tuple of Note
        ``legs_differ`` beyond 3 cm; ``mass_differs`` more than 5 % from what the plates carry.
    """
    notes = []
    legs = {side: _leg(body, side) for side in SIDES}
    difference = abs(legs["left"] - legs["right"])
    if difference > MAX_LEG_DIFFERENCE_M:
        notes.append(
            Note.of(
                "legs_differ", difference_m=difference, left_m=legs["left"], right_m=legs["right"]
            )
        )
    if carried_kg is not None and abs(body.mass / carried_kg - 1) > MAX_MASS_DIFFERENCE:
        difference = body.mass / carried_kg - 1
        notes.append(
            Note.of("mass_differs", mass_kg=body.mass, difference=difference, carried_kg=carried_kg)
        )
    return tuple(notes)


def changed_distances(body: "Body", markers: Markers) -> tuple[Note, ...]:
    """Find markers of one segment whose distances differ from those on the body.

    Parameters
    ----------
    body
        The subject, from the calibration pose.
    markers
        A trial.

    Returns
    -------
    tuple of Note
        One ``marker_distances_changed`` per segment: pairs whose median distance in the trial
        differs by more than 3 cm, for a marker has moved, is swapped with another or stands for
        something else.
    """
    notes = []
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
                change = float(np.nanmedian(now)) - distance(place[a], place[b])
                changes.append((f"{a}–{b}", change))
        changes = sorted(
            (c for c in changes if abs(c[1]) > MAX_DISTANCE_CHANGE_M), key=lambda c: -abs(c[1])
        )
        if changes:
            notes.append(
                Note.of(
                    "marker_distances_changed",
                    segment=s,
                    pairs=len(changes),
                    limit_m=MAX_DISTANCE_CHANGE_M,
                    largest_m=dict(changes[:PAIRS_NAMED]),
                )
            )
    return tuple(notes)


def _length(body: "Body", s: str) -> float | None:
    """Length of a segment's inertial part; for the trunk, of both its parts."""
    parts = {"pelvis": ["lower_trunk"], "trunk": ["mid_trunk", "upper_trunk"]}.get(s, [s])
    lengths = [body.lengths[p] for p in parts if p in body.lengths]
    return sum(lengths) if lengths else None


def _leg(body: "Body", side: str) -> float:
    return sum(float(np.linalg.norm(body.offsets[f"{side}_{s}"])) for s in ("shank", "foot"))


def _millimetres(point: Array) -> str:
    return "".join(f"{round(1000 * float(x)):7d}" for x in point)
