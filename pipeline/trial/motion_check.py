"""Check of a trial's motion: what the markers do not determine, and what cannot be."""

import numpy as np

from hbm.body import Body
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.joint_ranges import impossible_angles
from hbm.plausibility.marker_errors import large_marker_errors


def check_motion(body: Body, motion: Motion, markers: Markers) -> tuple[Note, ...]:
    """Find what was locked, interpolated, left out or not solved in a trial's motion.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it, unfiltered.
    markers
        The trial's markers, at the same T frames.

    Returns
    -------
    tuple of Note
        ``coordinates_locked``, ``coordinates_interpolated``, ``marker_samples_missing``,
        ``frames_unsolved``, ``segment_error_large``, ``marker_error_large`` and
        ``joint_angles_impossible``, where there are any. Samples are missing where a marker has a
        gap in a frame that was solved.
    """
    notes = []
    if body.locked:
        notes.append(Note.of("coordinates_locked", coordinates=body.locked))
    free = np.array([name not in body.locked for name in motion.names])
    unseen = (~motion.observed & motion.converged[:, None])[:, free]
    if unseen.any():
        names = np.array(motion.names)[free][unseen.any(axis=0)]
        frames = np.count_nonzero(unseen.any(axis=1))
        notes.append(Note.of("coordinates_interpolated", frames=frames, coordinates=tuple(names)))
    used = [markers.names.index(name) for name in motion.markers]
    missing = np.count_nonzero(np.isnan(markers.position[:, used, 0])[motion.converged])
    if missing:
        notes.append(Note.of("marker_samples_missing", samples=missing))
    unsolved = np.count_nonzero(~motion.converged)
    if unsolved:
        notes.append(Note.of("frames_unsolved", unsolved=unsolved, frames=len(motion.time)))
    return (*notes, *large_marker_errors(body, motion), *impossible_angles(body, motion))
