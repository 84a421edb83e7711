"""Checks of a trial's markers, motion and plates: what is wrong, or cannot be."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from hbm.body import Body
from hbm.coordinates import LIMBS, TREE
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.labels import (
    changed_distances,
    labels_exchanged,
    median_distance,
    repeated_positions,
    sides_exchanged,
)
from hbm.plausibility.motion import impossible_angles, large_marker_errors, undetermined_notes
from hbm.signals.samples import stretches
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS, Array, Mask, rotate_wrench, shift_wrench
from hbm.spelling import written
from pipeline.io.recording import Recording
from pipeline.trial.subject import TENTH_S, common_tenths, tenths

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
    files = {id(each): each for each in (trial, pose)}.values()
    sides = (sides_exchanged(body.marker_set, f.markers, f.source.name) for f in files)
    return MarkerChecks(
        tuple(each.note for each in sides if each is not None),
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
    found = []
    for name, (sides, limit_m) in LENGTHS.items():
        labels = [[marked.get(end, "") for end in ends] for ends in sides]
        lengths = [
            [median_distance(each.markers, *pair) for each in (pose, trial)] for pair in labels
        ]
        there, here = min(lengths, key=lambda pair: _lengths_apart(*pair))
        if _lengths_apart(there, here) > limit_m and len({a > b for a, b in lengths}) == 1:
            found.append(f"{name} {1000 * there:.0f} mm there, {1000 * here:.0f} mm here")
    heavier = max(known_kg.values()) / min(known_kg.values()) - 1 > OTHER_MASS
    if not found or len(found) + heavier < MIN_OTHER:
        return None
    return Note.of("static_of_another", file=pose.source.name, lengths=found, known_kg=known_kg)


def _lengths_apart(there: float, here: float) -> float:
    """Give by how much two lengths differ [m]; 0 where one is not known."""
    return abs(there - here) if np.isfinite(there - here) else 0.0


MAX_UNSEEN_PELVIS_S: Final = 0.1
"""For so long, trunk and thighs show where a pelvis without markers is."""
MAX_UNSEEN_LIMB_S: Final = 0.2
SEGMENTS: Final = np.array([coordinate.segment for coordinate in TREE])
"""That each coordinate moves, (46,)."""
OF_LEGS: Final = np.isin(SEGMENTS, [*LIMBS["left leg"], *LIMBS["right leg"]])
"""Coordinates of the legs, (46,)."""
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
    solved = motion.converged & np.isfinite(motion.a).all(axis=1)
    return np.asarray(solved & ~_pelvis_unseen(body, motion, MAX_UNSEEN_PELVIS_S))


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
    gaps += [lost for _, share, lost, _ in _lost_limbs(body, motion) if share >= MIN_HEAVY_SHARE]
    for part in np.unique(SEGMENTS[OF_LEGS]):
        missing: Mask = np.asarray(unseen[:, part == SEGMENTS].any(axis=1))
        if missing.mean() < MAX_MISSING_SHARE:
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
        heavy = free & np.isin(SEGMENTS, with_mass)
        lost: Mask = np.asarray(unseen[:, heavy].all(axis=1) & heavy.any())
        if lost.any():
            yield limb, sum(body.segments[s].mass for s in with_mass) / body.mass, lost, of_limb


def _pelvis_unseen(body: Body, motion: Motion, least_s: float = 0.0) -> Mask:
    """Find the frames, (T,), in which the pelvis shows no marker, at least for some time."""
    segment_of = body.segment_of
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
    for limb, share, lost, of_limb in _lost_limbs(body, motion):
        longest_s = max(motion.time[b - 1] - motion.time[a] for a, b in stretches(lost))
        frames = interpolated[limb] = int(np.count_nonzero(lost))
        unseen[np.ix_(lost, of_limb)] = False
        if share >= MIN_HEAVY_SHARE and longest_s >= MAX_UNSEEN_LIMB_S:
            notes.append(Note.of("limb_unknown", limb=limb, frames=frames, share=share))
    counts = zip(motion.names, unseen.sum(axis=0).tolist(), strict=True)
    interpolated |= {name: count for name, count in counts if count}
    pelvis_unseen = motion.converged & _pelvis_unseen(body, motion, MAX_UNSEEN_PELVIS_S)
    if pelvis_unseen.any():
        notes.append(Note.of("pelvis_unseen", frames=np.count_nonzero(pelvis_unseen)))
    used = [markers.names.index(name) for name in motion.markers]
    samples = np.count_nonzero(np.isnan(markers.position[:, used, 0])[motion.converged])
    unsolved = np.count_nonzero(~motion.converged)
    frames = len(motion.time)
    if samples or unsolved:
        notes.append(Note.of("gaps", samples=samples, unsolved=unsolved, frames=frames))
    if interpolated:
        notes.append(Note.of("interpolated", frames=interpolated))
    misfits = (*large_marker_errors(body, motion), *impossible_angles(body, motion))
    return tuple(notes), misfits


MAX_REST_SHARE: Final = 0.1
"""Of body weight that a plate without load may read; more is taken as load."""
REST_SPREAD_N: Final = 6.0
"""Means of a tenth of a second of an unloaded plate lie this close together: noise and creep."""
MIN_REST_S: Final = 0.3
"""In all, so that a foot that lands or leaves does not count as rest: one swing of a foot."""
MAX_REST_N: Final = 10.0
"""About 1 kg: plates drift by less between two zeroings."""
MAX_TOTAL_REST_N: Final = 20.0
"""Of all plates together: 3 % of the weight of a light adult."""

MAX_REST: Final = np.array([10.0, 10.0, np.inf, 5.0, 5.0, 5.0])
"""Of an unloaded plate, moments about its centre [N, N·m]; real plates, zeroed before the session,
read a few newtons. The vertical force is judged by itself."""
MIN_ZERO: Final = np.array([5.0, 5.0, 1.0, 2.5, 2.5, 2.5])
"""Smaller readings of an unloaded plate need no correction [N, N·m]."""
MIN_LOADED: Final = 0.05
"""Of body weight: below it a foot lands or leaves, and a plate with a dead band reads zero."""
MAX_HELD_S: Final = 0.005
MIN_BESIDE: Final = 0.05
"""Of a component's largest value, on both sides of samples that are exactly zero for so short a
time: a foot lands and leaves slowly enough for a plate to read what is in between."""

BEYOND_NOISE: Final = 8.0
"""By the usual change from sample to sample: nearer to zero, noise passes through it."""

MIN_SHARED_TIME: Final = 0.9
"""Of the markers' time that the plates must cover: recordings end some frames apart."""


class WrongZeros(NamedTuple):
    """What unloaded plates read [N], other components that are far from zero, what corrects it."""

    rest_n: Mapping[str, float]
    components: tuple[str, ...]
    mendings: tuple[str, ...]

    def note(self, remedy: str, body_kg: float) -> Note:
        """Give the note about it."""
        total_n, components = sum(self.rest_n.values()), self.components or ["none"]
        sizes = {"total_n": total_n, "mass_kg": total_n / GRAVITY_MPS2, "body_kg": body_kg}
        words = {"components": components, "remedy": remedy}
        return Note.of("plates_not_zeroed", rest_n=self.rest_n, **sizes, **words)


def check_plates(
    recording: Recording, wrenches: Sequence[Array], mass_kg: float
) -> tuple[WrongZeros | None, tuple[Note, ...]]:
    """Find plates that are not zero when nobody is on them, or that lost samples or time.

    Parameters
    ----------
    recording
        The trial.
    wrenches
        Per plate, action on the subject in lab axes at the markers' times, without what a moving
        platform adds, (T, 6) [N, N·m].
    mass_kg
        Body mass.

    Returns
    -------
    WrongZeros or None
        Where an unloaded plate reads more than 10 N either way, all together more than 20 N, or
        another component is more than 10 N or 5 N·m from zero then.
    tuple of Note
        ``plate_samples_zero`` where samples of a loaded plate are exactly zero;
        ``plates_apart`` where the plates cover less than 0.9 of the markers' time.
    """
    time, weight_n = recording.markers.time, mass_kg * GRAVITY_MPS2
    rest_n, others, zeros = dict[str, float](), list[str](), list[str]()
    for plate, wrench in zip(recording.plates, wrenches, strict=True):
        name = f"plate {plate.number}"
        usual = zero_of(shift_wrench(wrench, plate.center), time, weight_n)
        if usual is not None:
            rest_n[name] = usual[2]
            far = np.flatnonzero(np.abs(usual) > MAX_REST)
            others += [f"{name} {WRENCH_COMPONENTS[k]} {written(usual[k], '+.0f')}" for k in far]
            zero = rotate_wrench(usual, plate.rotation.T)
            zeros += [
                f"{plate.number}: zero {component} {reads:.1f}"
                for component, reads, least in zip(WRENCH_COMPONENTS, zero, MIN_ZERO, strict=True)
                if abs(reads) > least
            ]
    wrong_zeros = None
    largest_n, total_n = max(map(abs, rest_n.values()), default=0), sum(rest_n.values())
    if others or largest_n > MAX_REST_N or abs(total_n) > MAX_TOTAL_REST_N:
        wrong_zeros = WrongZeros(rest_n, tuple(others), tuple(zeros))
    lost = _zero_samples(recording, rest_n, MIN_LOADED * weight_n)
    return wrong_zeros, (*lost, *_apart(recording))


def _zero_samples(
    recording: Recording, rest_n: Mapping[str, float], loaded_n: float
) -> tuple[Note, ...]:
    """Name plates of which single samples are exactly zero between loaded ones."""
    notes = []
    for plate in recording.plates:
        at_rest = abs(rest_n.get(f"plate {plate.number}", 0.0))
        load = np.abs(np.abs(plate.wrench_in_plate[:, 2]) - at_rest)
        zero = np.zeros(len(plate.time), bool)
        longest = round(MAX_HELD_S / float(np.median(np.diff(plate.time))))
        for component in plate.wrench_in_plate.T:
            least = MIN_BESIDE * np.nanmax(np.abs(component), initial=0.0)
            least = max(least, BEYOND_NOISE * float(np.nanmedian(np.abs(np.diff(component)))))
            runs = stretches(component == 0)
            brief = (runs[:, 0] > 0) & (runs[:, 1] < len(component))
            runs = runs[brief & (np.diff(runs)[:, 0] <= longest)]
            beside = runs - (1, 0)  # samples before and after
            held = (np.abs(component[beside]) > least).all(axis=1)
            held &= (load[beside] > loaded_n).all(axis=1)
            held &= component[beside].prod(axis=1) > 0  # else it passes zero
            for start, stop in runs[held]:
                zero[start:stop] = True
        if zero.any():
            size = {"samples": zero.sum(), "first_s": plate.time[np.argmax(zero)]}
            notes.append(Note.of("plate_samples_zero", plate=plate.number, **size))
    return tuple(notes)


def _apart(recording: Recording) -> tuple[Note, ...]:
    """Say where plates and markers were recorded, if not at the same time."""
    start_s, stop_s = recording.markers.time[[0, -1]]
    first_s = max(plate.time[0] for plate in recording.plates)
    last_s = min(plate.time[-1] for plate in recording.plates)
    if min(last_s, stop_s) - max(first_s, start_s) >= MIN_SHARED_TIME * (stop_s - start_s):
        return ()
    times = {"first_s": first_s, "last_s": last_s, "start_s": start_s, "stop_s": stop_s}
    return (Note.of("plates_apart", **times),)


def zero_of(wrench: Array, time: Array, weight_n: float) -> Array | None:
    """Give what a plate reads when nobody is on it, (6,), of its wrench about its centre, (T, 6).

    None where it is always loaded; the other components are zero where they are not known.
    """
    level = rest_level(wrench[:, 2], time, weight_n)
    if level is None:
        return None
    means = tenths(wrench, time, *common_tenths(time))
    at_rest = np.abs(means[:, 2] - level) <= REST_SPREAD_N / 2
    zero = np.median(means[at_rest], axis=0) if at_rest.any() else np.zeros(6)
    zero[2] = level
    return zero


def rest_level(vertical: Array, time: Array, weight_n: float) -> float | None:
    """Give what a plate reads when nobody is on it.

    Parameters
    ----------
    vertical
        Vertical force, (T,) [N].
    time
        (T,) [s].
    weight_n
        Body weight.

    Returns
    -------
    float or None
        The level, below a tenth of the body weight, at which the plate is most often [N]: the mean
        over those tenths of a second that lie closest together. None where the plate is never
        at rest for 0.3 s in all: somebody stands on it throughout.
    """
    means = tenths(vertical, time, *common_tenths(time))
    low = np.sort(means[means < MAX_REST_SHARE * weight_n])
    within = np.searchsorted(low, low + REST_SPREAD_N, side="right") - np.arange(len(low))
    if TENTH_S * max(within, default=0) < MIN_REST_S:
        return None
    start = int(np.argmax(within))
    return float(low[start : start + within[start]].mean())
