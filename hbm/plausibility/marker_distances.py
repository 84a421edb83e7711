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
            pair = markers.position[:, [markers.names.index(n) for n in (a, b)]]
            in_trial = np.linalg.norm(pair[:, 0] - pair[:, 1], axis=-1)
            if np.isfinite(in_trial).any():
                change = float(np.nanmedian(in_trial)) - distance(on_body[a], on_body[b])
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
