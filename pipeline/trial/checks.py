"""Checks of a trial's markers and motion: what is wrong, or cannot be."""

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from hbm.body import Body
from hbm.coordinates import LIMBS, TREE
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.plausibility.labels import (
    changed_distances,
    labels_exchanged,
    median_distances,
    repeated_positions,
    sides_exchanged,
)
from hbm.plausibility.motion import impossible_angles, large_marker_errors, undetermined_notes
from hbm.signals.samples import stretches
from hbm.spatial import Mask
from pipeline.io.recording import Recording

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "checks")

LENGTHS: Final = {
    "pelvis width": (("LASIS", "RASIS"),),
    "shank length": (("LLEK", "LLM"), ("RLEK", "RLM")),
    "foot length": (("LHEE", "LMT2"), ("RHEE", "RMT2")),
}
"""Name -> landmarks at its ends on each side."""


class MarkerChecks(NamedTuple):
    """What is wrong with the labels of a trial and its calibration pose.

    Attributes
    ----------
    sides
        Of trial and pose, those in which left and right are exchanged.
    exchanged
        Labels that change places within the trial.
    distances
        Between markers of a segment, that differ from those of the pose.
    held
        Positions that were held.
    """

    sides: tuple[Note, ...]
    exchanged: tuple[Note, ...]
    distances: tuple[Note, ...]
    held: tuple[Note, ...]

    @property
    def doubtful(self) -> bool:
        """Whether labels are exchanged or markers elsewhere: the motion tells nothing of plates."""
        return bool(self.sides or self.exchanged or self.distances)

    @property
    def notes(self) -> tuple[Note, ...]:
        """All but the distances, which another person's pose may explain."""
        return (*self.sides, *self.exchanged, *self.held)


def check_markers(body: Body, trial: Recording, pose: Recording) -> MarkerChecks:
    """Find wrong labels in a trial or its calibration pose, and positions that were held.

    Parameters
    ----------
    body
        The subject.
    trial, pose
        The trial, and the recording of the calibration pose; they may be the same.

    Returns
    -------
    MarkerChecks
        Sides, labels, distances, and positions that were held.
    """
    files = {id(file): file for file in (trial, pose)}.values()
    sides = (sides_exchanged(body.marker_set, f.markers, f.source.name) for f in files)
    return MarkerChecks(
        tuple(exchanged.note for exchanged in sides if exchanged is not None),
        labels_exchanged(trial.markers, body.markers),
        changed_distances(body, trial.markers),
        repeated_positions(body, trial.markers),
    )


def other_person(
    body: Body, trial: Recording, pose: Recording, known_kg: Mapping[str, float]
) -> Note | None:
    """Find out whether the calibration pose is another person's.

    Parameters
    ----------
    body
        From the pose.
    trial, pose
        The recordings.
    known_kg
        What is known of the body mass, by where it comes from.

    Returns
    -------
    Note or None
        ``static_of_another`` where two lengths, or one and the mass, differ by more than skin
        moves. Of a length on both sides the smaller difference counts.
    """
    marked = body.marker_set.present(body.markers).landmark
    differing = []
    for name, sides in LENGTHS.items():
        labels = [(marked.get(a, ""), marked.get(b, "")) for a, b in sides]
        lengths = np.transpose([median_distances(f.markers, labels) for f in (pose, trial)])
        # the side that differs less: a marker may have been moved on one side
        in_pose, in_trial = min(lengths, key=lambda pair: _lengths_apart(*pair))
        if (
            _lengths_apart(in_pose, in_trial) > LIMITS.skin_motion[name]
            and len({a > b for a, b in lengths}) == 1
        ):
            differing.append(f"{name} {1000 * in_pose:.0f} mm there, {1000 * in_trial:.0f} mm here")
    # masses of pose and trial may be of two people
    heavier = max(known_kg.values()) / min(known_kg.values()) - 1 > LIMITS.other_mass
    if not differing or len(differing) + heavier < LIMITS.fewest_differences:
        return None
    return Note.of("static_of_another", file=pose.source.name, lengths=differing, known_kg=known_kg)


def _lengths_apart(there: float, here: float) -> float:
    """Give by how much two lengths differ [m]; 0 where one is not known."""
    return abs(there - here) if np.isfinite(there - here) else 0.0


SEGMENTS: Final = np.array([coordinate.segment for coordinate in TREE])
"""That each coordinate moves, (46,)."""
OF_LEGS: Final = np.isin(SEGMENTS, [*LIMBS["left leg"], *LIMBS["right leg"]])
"""Coordinates of the legs, (46,)."""


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
    solved = motion.converged & np.isfinite(motion.a).all(axis=1)
    return np.asarray(solved & ~_pelvis_unseen(body, motion, LIMITS.longest_unseen_pelvis))


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
    unseen, gaps = _unseen(body, motion), [_pelvis_unseen(body, motion)]
    gaps += [
        lost
        for _, mass_fraction, lost, _ in _lost_limbs(body, motion)
        if mass_fraction >= LIMITS.heavy_limb
    ]
    for part in np.unique(SEGMENTS[OF_LEGS]):
        # a joint of a leg that markers show in other frames
        missing: Mask = np.asarray(unseen[:, part == SEGMENTS].any(axis=1))
        if missing.mean() < LIMITS.largest_missing:
            gaps.append(missing)
    return np.asarray(~np.any(gaps, axis=0))


def _unseen(body: Body, motion: Motion) -> Mask:
    """Find coordinates that markers do not show in frames that were solved, (T, 46)."""
    return np.asarray(~motion.observed & motion.converged[:, None] & _free(body, motion))


def _free(body: Body, motion: Motion) -> Mask:
    """Find coordinates that markers should show, (46,): of a leg, or shown in any frame."""
    locked = np.isin(motion.names, [*body.locked])
    return np.asarray(motion.observed.any(axis=0) | OF_LEGS & ~locked)


def _lost_limbs(body: Body, motion: Motion) -> Iterator[tuple[str, float, Mask, Mask]]:
    """Give limbs of which markers show no coordinate.

    Name, share of the body mass, frames (T,) among those that were solved, and which coordinates
    are the limb's, (46,).
    """
    free, unseen = _free(body, motion), _unseen(body, motion)
    for limb, parts in {"trunk": ("thorax",), **LIMBS}.items():
        of_limb, with_mass = np.isin(SEGMENTS, parts), [s for s in parts if s in body.segments]
        # parts that are segments of this body: others have no mass and change no residual
        heavy = free & np.isin(SEGMENTS, with_mass)
        lost: Mask = np.asarray(unseen[:, heavy].all(axis=1) & heavy.any())
        if lost.any():
            yield limb, sum(body.segments[s].mass for s in with_mass) / body.mass, lost, of_limb


def _pelvis_unseen(body: Body, motion: Motion, least_s: float = 0.0) -> Mask:
    """Find the frames, (T,), in which the pelvis shows no marker, at least for some time."""
    segment_of = body.segment_of
    # the pelvis carries six coordinates: without its markers all segments move with them
    of_pelvis = [segment_of[name] == "pelvis" for name in motion.markers]
    unseen: Mask = np.asarray(np.isnan(motion.marker_error[:, of_pelvis]).all(axis=1))
    for start, stop in stretches(unseen):
        if motion.time[stop - 1] - motion.time[start] < least_s:
            unseen[start:stop] = False
    return unseen


def check_motion(
    body: Body, motion: Motion, markers: Markers
) -> tuple[tuple[Note, ...], tuple[Note, ...]]:
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
    notes
        ``coordinates_held``, ``mass_not_shown``, ``limb_unknown``, ``pelvis_unseen``, ``gaps`` and
        ``interpolated``, where there are any. Samples are missing where a marker has a gap in a
        frame that was solved.
    misfits
        What does not fit the body: ``marker_error_large`` and ``joint_angles_impossible``.
    """
    notes, interpolated = [*undetermined_notes(body, motion)], dict[str, int]()
    unseen = _unseen(body, motion)
    for limb, mass_fraction, lost, of_limb in _lost_limbs(body, motion):
        longest_s = max(motion.time[b - 1] - motion.time[a] for a, b in stretches(lost))
        frames = interpolated[limb] = int(np.count_nonzero(lost))
        unseen[np.ix_(lost, of_limb)] = False
        if mass_fraction >= LIMITS.heavy_limb and longest_s >= LIMITS.longest_unseen_limb:
            notes.append(Note.of("limb_unknown", limb=limb, frames=frames, share=mass_fraction))
    counts = zip(motion.names, unseen.sum(axis=0).tolist(), strict=True)
    # coordinates of limbs that are lost as a whole are counted once, by the limb
    interpolated |= {name: count for name, count in counts if count}
    pelvis_unseen = motion.converged & _pelvis_unseen(body, motion, LIMITS.longest_unseen_pelvis)
    if pelvis_unseen.any():
        notes.append(Note.of("pelvis_unseen", frames=np.count_nonzero(pelvis_unseen)))
    used = [markers.names.index(name) for name in motion.markers]
    # gaps of markers in frames that were solved from the others
    samples = np.count_nonzero(np.isnan(markers.position[:, used, 0])[motion.converged])
    unsolved = np.count_nonzero(~motion.converged)
    frames = len(motion.time)
    if samples or unsolved:
        notes.append(Note.of("gaps", samples=samples, unsolved=unsolved, frames=frames))
    if interpolated:
        notes.append(Note.of("interpolated", frames=interpolated))
    misfits = (*large_marker_errors(body, motion), *impossible_angles(body, motion))
    return tuple(notes), misfits


def plates_apart(recording: Recording) -> tuple[Note, ...]:
    """Say where plates and markers were recorded, if not at the same time.

    ``plates_apart`` where the plates cover less than 0.9 of the markers' time.
    """
    start_s, stop_s = recording.markers.time[[0, -1]]
    first_s = max(plate.time[0] for plate in recording.plates)
    last_s = min(plate.time[-1] for plate in recording.plates)
    if min(last_s, stop_s) - max(first_s, start_s) >= LIMITS.least_shared * (stop_s - start_s):
        return ()
    times = {"first_s": first_s, "last_s": last_s, "start_s": start_s, "stop_s": stop_s}
    return (Note.of("plates_apart", **times),)
