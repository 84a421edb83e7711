"""Check of a trial's markers: whether those of one segment keep their distances."""

from itertools import combinations
from typing import Final

import numpy as np

from hbm.coordinates import MOVING
from hbm.markers import Markers
from hbm.model import Body
from hbm.notes import Note
from hbm.spatial import distance

MAX_DISTANCE_CHANGE_M: Final = 0.03
"""Skin moves markers of one segment against each other by up to 2 or 3 cm in walking."""

MAX_PAIRS_NAMED: Final = 3
"""A single displaced marker changes its distances to all others: three identify it."""


def changed_distances(body: Body, markers: Markers) -> tuple[Note, ...]:
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
        differs by more than 3 cm, because a marker has moved, is swapped with another or carries
        the wrong label.

    Examples
    --------
    With ``body`` from `build_body` and a trial in which a marker has moved by 8 cm:

    >>> import hbm
    >>> position = static.position.copy()
    >>> position[:, static.names.index("RLTHI"), 2] += 0.08
    >>> trial = hbm.Markers(static.time, static.names, position)
    >>> for note in hbm.changed_distances(body, trial):
    ...     print(note.values["segment"], *note.values["largest_m"])
    right_thigh RLEK–RLTHI RMEK–RLTHI
    """
    notes = []
    on_body = dict(zip(body.markers, body.marker_position, strict=True))
    for s in MOVING:
        own = [
            name
            for name, segment in body.segment_of.items()
            if segment == s and name in markers.names
        ]
        changes = []
        for a, b in combinations(own, 2):
            change = median_distance(markers, a, b) - distance(on_body[a], on_body[b])
            if np.isfinite(change):
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
                    largest_m=dict(changes[:MAX_PAIRS_NAMED]),
                )
            )
    return tuple(notes)


def median_distance(markers: Markers, first: str, second: str) -> float:
    """Give the median distance of two markers [m]; NaN where they are never seen together."""
    if not {first, second} <= set(markers.names):
        return float("nan")
    ends = (markers.position[:, markers.names.index(name)] for name in (first, second))
    apart = np.linalg.norm(np.subtract(*ends), axis=1)
    return float(np.nanmedian(apart)) if np.isfinite(apart).any() else float("nan")
