"""Check of a trial's markers: wrong labels, positions not measured, a pose of another person."""

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from hbm.body import Body
from hbm.notes import Note
from hbm.plausibility.labels import (
    changed_distances,
    labels_exchanged,
    median_distance,
    repeated_positions,
    sides_exchanged,
)
from pipeline.io.recording import Recording

LENGTHS: Final = {
    "pelvis width": ((("LASIS", "RASIS"),), 0.010),
    "shank length": ((("LLEK", "LLM"), ("RLEK", "RLM")), 0.015),
    "foot length": ((("LHEE", "LMT2"), ("RHEE", "RMT2")), 0.010),
}
"""Name -> landmarks at its ends on each side, and by how much skin that moves changes it [m]: more
than in any of our recordings of a person (4, 9 and 8 mm)."""
OTHER_MASS: Final = 0.08
"""Difference of body masses by the smallest; that of wrong zeros and gains of plates is smaller."""
MIN_OTHER: Final = 2
"""Lengths that differ, and the mass: one length may be that of a marker that was moved."""
EXPLAINED: Final = {
    *("marker_distances_changed", "segment_error_large", "marker_error_large"),
    *("joint_angles_impossible", "mass_differs"),
}
"""What a pose of another person causes."""


def check_markers(body: Body, trial: Recording, pose: Recording) -> tuple[Note, ...]:
    """Find wrong labels in a trial or its calibration pose, and positions that were held.

    Parameters
    ----------
    body
        The subject.
    trial, pose
        The trial, and the recording of the calibration pose; they may be the same.

    Returns
    -------
    tuple of Note
        ``sides_exchanged``, ``labels_exchanged``, ``marker_distances_changed``,
        ``markers_frozen`` and ``markers_constant``, where there are any.
    """
    notes = list(sides_exchanged(body, trial.markers, trial.source.name))
    if pose is not trial:
        notes += sides_exchanged(body, pose.markers, pose.source.name)
    return (
        *notes,
        *labels_exchanged(trial.markers, body.markers),
        *changed_distances(body, trial.markers),
        *repeated_positions(body, trial.markers),
    )


def other_person(
    notes: Iterable[Note],
    body: Body,
    trial: Recording,
    pose: Recording,
    known_kg: Mapping[str, float],
) -> tuple[Note, ...]:
    """Find out whether the calibration pose is another person's.

    Parameters
    ----------
    notes
        Of the trial.
    body
        From the pose.
    trial, pose
        The recordings; they may be the same.
    known_kg
        What is known of the body mass, by where it comes from.

    Returns
    -------
    tuple of Note
        The notes; where two lengths, or one and the mass, differ by more than skin moves, with
        ``static_of_another`` first and without those that this explains. Of a length on both sides
        the smaller difference counts.
    """
    marked = body.marker_set.present(body.markers).landmark
    found = []
    for name, (sides, limit_m) in LENGTHS.items():
        labels = [[marked.get(end, "") for end in ends] for ends in sides]
        lengths = [
            [median_distance(each.markers, *pair) for each in (pose, trial)] for pair in labels
        ]
        there, here = min(lengths, key=lambda pair: _apart(*pair))
        if _apart(there, here) > limit_m and len({a > b for a, b in lengths}) == 1:
            found.append(f"{name} {1000 * there:.0f} mm there, {1000 * here:.0f} mm here")
    heavier = max(known_kg.values()) / min(known_kg.values()) - 1 > OTHER_MASS
    if not found or len(found) + heavier < MIN_OTHER:
        return tuple(notes)
    other = Note.of("static_of_another", file=pose.source.name, lengths=found, known_kg=known_kg)
    return (other, *(note for note in notes if note.code not in EXPLAINED))


def _apart(there: float, here: float) -> float:
    """Give by how much two lengths differ [m]; 0 where one is not known."""
    return abs(there - here) if np.isfinite(there - here) else 0.0
