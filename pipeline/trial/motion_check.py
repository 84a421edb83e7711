"""Check of a trial's motion: coordinates and frames that the markers do not determine."""

import numpy as np

from hbm.body import Body
from hbm.motion import Motion
from hbm.notes import Note


def check_motion(body: Body, motion: Motion) -> tuple[Note, ...]:
    """Find what was locked, interpolated, left out or not solved in a trial's motion.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it, unfiltered.

    Returns
    -------
    tuple of Note
        ``coordinates_locked``, ``coordinates_interpolated``, ``marker_samples_missing`` and
        ``frames_unsolved``, where there are any.
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
    missing = np.count_nonzero(np.isnan(motion.marker_error))
    if missing:
        notes.append(Note.of("marker_samples_missing", samples=missing))
    unsolved = np.count_nonzero(~motion.converged)
    if unsolved:
        notes.append(Note.of("frames_unsolved", unsolved=unsolved, frames=len(motion.time)))
    return tuple(notes)
