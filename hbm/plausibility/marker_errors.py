"""Check of a motion: whether the model comes near the markers."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.spatial import Array

MAX_SEGMENT_ERROR_M: Final = 0.02
MAX_MARKER_ERROR_M: Final = 0.04
"""Root mean square over the trial: OpenSim's guideline for inverse kinematics (RMS error below
2 cm, largest below 4 cm; Hicks et al. 2015, J Biomech Eng 137:020905), here for a segment and for a
marker. Skin and simplified joints leave 5 to 15 mm in walking."""

MIN_MARKERS_OF_SEGMENT: Final = 2
"""A segment with a single marker is judged by the limit of a marker."""

MAX_NAMED: Final = 6
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
    farthest_m = {name: rms_m[name] for name in large[:MAX_NAMED]}
    return (Note.of(code, limit_m=limit_m, count=len(large), farthest_m=farthest_m),)
