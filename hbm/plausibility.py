"""Checks of a body against common sense, the force plates and a trial's markers."""

from itertools import combinations
from typing import Final

import numpy as np

from hbm.coordinates import MOVING, SIDES
from hbm.markers import Markers
from hbm.model import Body
from hbm.notes import Note
from hbm.spatial import distance

MAX_LEG_DIFFERENCE_M: Final = 0.03
"""True differences rarely exceed 2 cm; a misplaced marker easily causes more."""

MAX_DISTANCE_CHANGE_M: Final = 0.03
"""Skin moves markers of one segment against each other by up to 2 or 3 cm in walking."""

MAX_MASS_DIFFERENCE: Final = 0.05
"""Share of the body mass: more than clothes, shoes and a plate's gain error together."""

MAX_PAIRS_NAMED: Final = 3
"""A single displaced marker changes its distances to all others: three identify it."""


def implausible(body: Body, *, carried_kg: float | None = None) -> tuple[Note, ...]:
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
        ``legs_differ`` by more than 3 cm; ``mass_differs`` by more than 5 % from what the plates
        carry.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> for note in hbm.implausible(body, carried_kg=80.0):
    ...     print(note.code, f"{note.values['difference']:.3f}")
    mass_differs -0.068
    """
    notes = []
    legs = {side: _leg_length(body, side) for side in SIDES}
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
            for name, segment in zip(body.markers, body.marker_segment, strict=True)
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


def _leg_length(body: Body, side: str) -> float:
    return sum(float(np.linalg.norm(body.offsets[f"{side}_{s}"])) for s in ("shank", "foot"))
