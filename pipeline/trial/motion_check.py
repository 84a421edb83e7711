"""Check of a trial's motion: what the markers do not determine, and what cannot be."""

import numpy as np

from hbm.body import Body
from hbm.coordinates import LIMBS, TREE
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.joint_ranges import impossible_angles
from hbm.plausibility.marker_errors import large_marker_errors
from hbm.plausibility.uncertainty import uncertain_coordinates


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
        ``coordinates_locked``, ``coordinates_uncertain``, ``limb_interpolated``,
        ``coordinates_interpolated``, ``marker_samples_missing``, ``frames_unsolved``,
        ``segment_error_large``, ``marker_error_large`` and ``joint_angles_impossible``, where there
        are any. Samples are missing where a marker has a gap in a frame that was solved.
    """
    notes = []
    if body.locked:
        notes.append(Note.of("coordinates_locked", coordinates=body.locked))
    notes += [*uncertain_coordinates(body, motion), *_interpolated(body, motion)]
    used = [markers.names.index(name) for name in motion.markers]
    missing = np.count_nonzero(np.isnan(markers.position[:, used, 0])[motion.converged])
    if missing:
        notes.append(Note.of("marker_samples_missing", samples=missing))
    unsolved = np.count_nonzero(~motion.converged)
    if unsolved:
        notes.append(Note.of("frames_unsolved", unsolved=unsolved, frames=len(motion.time)))
    return (*notes, *large_marker_errors(body, motion), *impossible_angles(body, motion))


def _interpolated(body: Body, motion: Motion) -> list[Note]:
    """Name limbs and coordinates that markers do not show in frames that were solved."""
    free = np.array([name not in body.locked for name in motion.names])
    unseen = ~motion.observed & motion.converged[:, None] & free
    notes = []
    for limb, parts in LIMBS.items():
        own = np.array([c.segment in parts for c in TREE])
        heavy = own & free & [c.segment in body.segments for c in TREE]
        lost = unseen[:, heavy].all(axis=1) & heavy.any()
        if lost.any():
            mass = sum(body.segments[s].mass for s in parts if s in body.segments)
            share, frames = mass / body.mass, np.count_nonzero(lost)
            notes.append(Note.of("limb_interpolated", limb=limb, frames=frames, share=share))
            unseen[np.ix_(lost, own)] = False
    if unseen.any():
        names = tuple(np.array(motion.names)[unseen.any(axis=0)])
        frames = np.count_nonzero(unseen.any(axis=1))
        notes.append(Note.of("coordinates_interpolated", frames=frames, coordinates=names))
    return notes
