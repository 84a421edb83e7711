"""Check of a trial's motion: what the markers do not determine, and what cannot be."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from hbm.body import Body
from hbm.coordinates import LIMBS, TREE
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.motion import impossible_angles, large_marker_errors, undetermined_notes
from hbm.signals.samples import stretches
from hbm.spatial import Mask

MAX_UNSEEN_PELVIS_S: Final = 0.1
"""For so long, trunk and thighs show where a pelvis without markers is."""
MAX_UNSEEN_LIMB_S: Final = 0.2
LEGS: Final = ("left leg", "right leg")
MAX_MISSING_SHARE: Final = 0.5
"""Of the frames: a joint that more of them do not show has no markers, and no gaps."""
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


def shown_frames(body: Body, motion: Motion) -> Mask:
    """Find the frames of a trial in which markers show pelvis and legs.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion.

    Returns
    -------
    Mask
        (T,). A leg of which markers show no coordinate, one of its joints that markers show in
        other frames, and a pelvis without any marker, are not shown. Where markers vanish and
        return, the pose of what they helped to show jumps, and the filters have to settle as beside
        a gap of all markers.
    """
    gaps = [_no_pelvis_marker(body, motion)]
    for _, share, lost, _ in _lost_limbs(body, motion):
        if share >= MIN_HEAVY_SHARE:
            gaps.append(lost)
    for limb in LEGS:
        for part in LIMBS[limb]:
            own = np.array([c.segment == part for c in TREE])
            missing: Mask = np.asarray(_unseen(body, motion)[:, own].any(axis=1))
            if missing.mean() < MAX_MISSING_SHARE:
                gaps.append(missing)
    return np.asarray(~np.any(gaps, axis=0))


def _no_pelvis_marker(body: Body, motion: Motion) -> Mask:
    segment_of = body.segment_of
    of_pelvis = [segment_of[name] == "pelvis" for name in motion.markers]
    return np.asarray(np.isnan(motion.marker_error[:, of_pelvis]).all(axis=1))


def _unseen(body: Body, motion: Motion) -> Mask:
    """Find coordinates that markers do not show in frames that were solved, (T, 46)."""
    return np.asarray(~motion.observed & motion.converged[:, None] & _free(body, motion))


def _free(body: Body, motion: Motion) -> Mask:
    """Find coordinates that markers should show, (46,): of a leg, or shown in any frame."""
    of_legs = np.array([c.segment in {s for leg in LEGS for s in LIMBS[leg]} for c in TREE])
    locked = np.array([name in body.locked for name in motion.names])
    return np.asarray(motion.observed.any(axis=0) | of_legs & ~locked)


def _lost_limbs(body: Body, motion: Motion) -> Iterator[tuple[str, float, Mask, Mask]]:
    """Give limbs of which markers show no coordinate.

    Name, share of the body mass, frames (T,) among those that were solved, and which coordinates
    are the limb's, (46,).
    """
    free, unseen = _free(body, motion), _unseen(body, motion)
    for limb, parts in {"trunk": ("thorax",), **LIMBS}.items():
        own = np.array([c.segment in parts for c in TREE])
        heavy = own & free & [c.segment in body.segments for c in TREE]
        lost: Mask = np.asarray(unseen[:, heavy].all(axis=1) & heavy.any())
        if lost.any():
            mass = sum(body.segments[s].mass for s in parts if s in body.segments)
            yield limb, mass / body.mass, lost, own


def _pelvis_unseen(body: Body, motion: Motion) -> Mask:
    """Find the frames, (T,), in which the pelvis shows no marker for too long."""
    unseen = _no_pelvis_marker(body, motion)
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
        ``coordinates_locked``, ``coordinates_uncertain``, ``mass_not_shown``,
        ``limb_interpolated`` or ``limb_unknown``, ``coordinates_interpolated``,
        ``marker_samples_missing``,
        ``pelvis_unseen``, ``frames_unsolved``, ``segment_error_large``, ``marker_error_large`` and
        ``joint_angles_impossible``, where there are any. Samples are missing where a marker has a
        gap in a frame that was solved.
    """
    notes = [*undetermined_notes(body, motion), *_interpolated(body, motion)]
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
    unseen, notes = _unseen(body, motion), []
    for limb, share, lost, own in _lost_limbs(body, motion):
        longest_s = max(motion.time[b - 1] - motion.time[a] for a, b in stretches(lost))
        heavy_and_long = share >= MIN_HEAVY_SHARE and longest_s >= MAX_UNSEEN_LIMB_S
        code = "limb_unknown" if heavy_and_long else "limb_interpolated"
        notes.append(Note.of(code, limb=limb, frames=np.count_nonzero(lost), share=share))
        unseen[np.ix_(lost, own)] = False
    if unseen.any():
        names = tuple(np.array(motion.names)[unseen.any(axis=0)])
        frames = np.count_nonzero(unseen.any(axis=1))
        notes.append(Note.of("coordinates_interpolated", frames=frames, coordinates=names))
    return notes
