"""Check of a trial's motion: what the markers do not determine, and what cannot be."""

from typing import Final

import numpy as np

from hbm.body import Body
from hbm.coordinates import LIMBS, TREE
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.joint_ranges import impossible_angles
from hbm.plausibility.marker_errors import large_marker_errors
from hbm.plausibility.uncertainty import uncertain_coordinates
from hbm.signals.samples import stretches
from hbm.spatial import Mask

MAX_UNSEEN_PELVIS_S: Final = 0.1
"""For so long, trunk and thighs show where a pelvis without markers is."""
MAX_UNSEEN_LIMB_S: Final = 0.2
MIN_HEAVY_SHARE: Final = 0.1
"""Of body mass: a leg is more, an arm or the head less."""


def known_frames(body: Body, motion: Motion) -> Mask:
    """Find the frames of a trial in which the subject's motion is known.

    Parameters
    ----------
    body
        The subject.
    motion
        The filtered motion.

    Returns
    -------
    Mask
        (T,). Frames that were solved, but for those in which the pelvis shows no marker for 0.1 s
        or more: what trunk and thighs say of it is off by up to 10° then.
    """
    return np.asarray(np.isfinite(motion.a).all(axis=1) & ~_pelvis_unseen(body, motion))


def _pelvis_unseen(body: Body, motion: Motion) -> Mask:
    """Find the frames, (T,), in which the pelvis shows no marker for too long."""
    segment_of = body.segment_of
    of_pelvis = [segment_of[name] == "pelvis" for name in motion.markers]
    unseen: Mask = np.asarray(np.isnan(motion.marker_error[:, of_pelvis]).all(axis=1))
    for start, stop in stretches(unseen):
        if motion.time[stop - 1] - motion.time[start] < MAX_UNSEEN_PELVIS_S:
            unseen[start:stop] = False
    return unseen


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
        ``coordinates_locked``, ``coordinates_uncertain``, ``limb_interpolated`` or
        ``limb_unknown``, ``coordinates_interpolated``, ``marker_samples_missing``,
        ``pelvis_unseen``, ``frames_unsolved``, ``segment_error_large``, ``marker_error_large`` and
        ``joint_angles_impossible``, where there are any. Samples are missing where a marker has a
        gap in a frame that was solved.
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
    unseen = np.count_nonzero(motion.converged & _pelvis_unseen(body, motion))
    if unseen:
        notes.append(Note.of("pelvis_unseen", frames=unseen))
    if unsolved:
        notes.append(Note.of("frames_unsolved", unsolved=unsolved, frames=len(motion.time)))
    return (*notes, *large_marker_errors(body, motion), *impossible_angles(body, motion))


def _interpolated(body: Body, motion: Motion) -> list[Note]:
    """Name limbs and coordinates that markers do not show in frames that were solved."""
    free = np.array([name not in body.locked for name in motion.names])
    unseen = ~motion.observed & motion.converged[:, None] & free
    notes = []
    for limb, parts in {"trunk": ("thorax",), **LIMBS}.items():
        own = np.array([c.segment in parts for c in TREE])
        heavy = own & free & [c.segment in body.segments for c in TREE]
        lost = unseen[:, heavy].all(axis=1) & heavy.any()
        if lost.any():
            mass = sum(body.segments[s].mass for s in parts if s in body.segments)
            share, frames = mass / body.mass, np.count_nonzero(lost)
            longest_s = max(motion.time[b - 1] - motion.time[a] for a, b in stretches(lost))
            heavy_and_long = share >= MIN_HEAVY_SHARE and longest_s >= MAX_UNSEEN_LIMB_S
            code = "limb_unknown" if heavy_and_long else "limb_interpolated"
            notes.append(Note.of(code, limb=limb, frames=frames, share=share))
            unseen[np.ix_(lost, own)] = False
    if unseen.any():
        names = tuple(np.array(motion.names)[unseen.any(axis=0)])
        frames = np.count_nonzero(unseen.any(axis=1))
        notes.append(Note.of("coordinates_interpolated", frames=frames, coordinates=names))
    return notes
