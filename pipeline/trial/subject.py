"""A subject's mass, stature and body, from what is stated, recorded and weighed."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hbm.body import MAX_STATURE_M, MIN_STATURE_M, Body, ImplausibleLegs, build_body
from hbm.calibration_pose.anatomy import HipRule, LimbMeasures
from hbm.calibration_pose.functional import functional_hips
from hbm.coordinates import SIDES
from hbm.markers import MarkerSet, marker_sets, recognise_marker_set
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.plausibility.labels import sides_exchanged
from hbm.segments import SegmentOverride
from hbm.spatial import GRAVITY_MPS2, Array, Indices, Mask
from pipeline.config.schema import Settings, Subject
from pipeline.io.recording import Plate, Recording

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "subject")

TENTH_S: Final = 0.1
"""Noise of plates and markers averages out in it, and a subject who stands hardly moves."""


def common_tenths(*times: Array) -> tuple[float, int]:
    """Give when signals have all begun, and for how many tenths of a second they all last.

    Parameters
    ----------
    times
        Sample times of each signal, (N,) [s]; a sample stands for one time step, a single one for
        no time.

    Returns
    -------
    begin_s, count
        Start [s], and number of complete tenths from there on.
    """
    begin_s = max(float(time[0]) for time in times)
    if min(map(len, times)) < 2:
        return begin_s, 0
    end_s = min(float(time[-1]) + _step_s(time) for time in times)
    # a thousandth of a tenth more: times may be stored in single precision
    return begin_s, max(0, int((end_s - begin_s) / TENTH_S + 1e-3))


def tenths(values: Array, time: Array, begin_s: float, count: int) -> Array:
    """Give the means of a signal over successive tenths of a second.

    Parameters
    ----------
    values
        Samples, (N, ...); those that are missing (NaN) do not count.
    time
        (N,) [s], increasing.
    begin_s, count
        When the first tenth begins [s], and how many there are.

    Returns
    -------
    Array
        (count, ...); NaN where no sample is known.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(7) / 20
    >>> tenths(np.arange(7.0), time, *common_tenths(time)).tolist()
    [0.5, 2.5, 4.5]
    """
    # a sample stands for half a step before and after it
    edges = np.searchsorted(time, begin_s - _step_s(time) / 2 + TENTH_S * np.arange(count + 1))
    values = values[: edges[-1]]
    is_known = np.isfinite(values)
    number = np.diff(edges).reshape(-1, *(1,) * (values.ndim - 1))
    if not is_known.all():
        values, number = np.where(is_known, values, 0.0), _sums_between(edges, is_known)
    return np.where(number > 0, _sums_between(edges, values) / np.maximum(number, 1), np.nan)


def median_extent(position: Array) -> float:
    """Give how far the median marker moves.

    Parameters
    ----------
    position
        Markers, (B, K, 3) [m]; gaps are NaN.

    Returns
    -------
    float
        Diagonal of the box that its path fills [m]; NaN where no marker is known.
    """
    # extent of each marker's path along each axis, without gaps
    box = np.fmax.reduce(position, axis=0) - np.fmin.reduce(position, axis=0)
    extent = np.linalg.norm(box, axis=-1)
    extent = extent[np.isfinite(extent)]
    return float(np.median(extent)) if len(extent) else np.nan


def _step_s(time: Array) -> float:
    return float(time[-1] - time[0]) / (len(time) - 1)


def _sums_between(edges: Indices, values: Array | Mask) -> Array:
    """Give the sums of samples from each edge, (E,), to the next, (E − 1, ...).

    The samples, (N, ...), end at the last edge.
    """
    sums, filled = np.zeros((len(edges) - 1, *values.shape[1:])), np.diff(edges) > 0
    sums[filled] = np.add.reduceat(values, edges[:-1][filled], axis=0, dtype=float)
    return sums


ON_PLATES: Final = "on the plates over steps"
STATED: Final = "stated"


class MassUnknownError(ValueError):
    """Body mass is neither stated nor in a file, and nobody stands still on the plates."""


class BodyMass(NamedTuple):
    """A subject's body mass.

    Attributes
    ----------
    mass_kg
        The one that is used.
    known_kg
        Where a mass comes from -> that mass; the one that is used is the first.
    note
        ``mass_stated``, ``mass_weighed`` or ``mass_of_file``.
    """

    mass_kg: float
    known_kg: Mapping[str, float]
    note: Note

    @property
    def is_stated(self) -> bool:
        """Whether somebody stated it, so that the plates did not weigh it."""
        return STATED in self.known_kg

    @property
    def source(self) -> str:
        """Where the one that is used comes from."""
        return next(iter(self.known_kg))

    @classmethod
    def rough(cls, mass_kg: float) -> "BodyMass":
        """Give one with which steps can be found that weigh better."""
        return cls(mass_kg, {ON_PLATES: mass_kg}, Note.of("mass_by_steps", mass_kg=mass_kg))

    @classmethod
    def by_steps(cls, mass_kg: float | None, unknown: MassUnknownError) -> "BodyMass":
        """Give the mass that steps show; where they show none the error says what is missing."""
        if mass_kg is None:
            raise unknown
        return cls.rough(mass_kg)


def body_mass(subject: Subject, pose: Recording, trial: Recording | None = None) -> BodyMass:
    """Give body mass as stated, else as weighed by the plates, else as the file states it.

    Parameters
    ----------
    subject
        Who; a stated ``mass_kg`` is taken as it is.
    pose
        Recording of the calibration pose.
    trial
        The trial, where it is another recording: the subject may stand still there too.

    Returns
    -------
    BodyMass
        Weighed in the steadiest second in which the subject stands still on the plates, of the
        pose or, where there is none, of the trial.

    Raises
    ------
    MassUnknownError
        If it is neither stated nor in a file, and there is no such second.

    Notes
    -----
    In that second the means of the vertical force over tenths of it vary by no more than 2 % (SD;
    noise does not count), and half of the markers stay within 2 cm. A second does not count in
    which the plates carry less than nine tenths of what they carry over two other seconds, or of
    the mass in the file: a foot is beside them, or one of them does not measure yet.
    """
    recordings = (pose,) if trial is None or trial is pose else (pose, trial)
    file_kg, file = next(
        ((r.metadata.mass_kg, r.source.name) for r in recordings if r.metadata.mass_kg), (None, "")
    )
    weighings = [w for r in recordings if (w := _weigh(r, file_kg)) is not None]
    # a weighing below the mass of the file is of a person with one foot beside the plates
    whole = [w for w in weighings if file_kg is None or w[0] >= LIMITS.whole_fraction * file_kg]
    # in order of trust: stated, weighed as a whole, of the file, weighed in part
    masses: dict[str, tuple[float, Note]] = {}
    if subject.mass_kg is not None:
        masses[STATED] = subject.mass_kg, Note.of("mass_stated", mass_kg=subject.mass_kg)
    if whole:
        masses["standing on the plates"] = whole[0]
    if file_kg is not None:
        masses["in the file"] = file_kg, Note.of("mass_of_file", mass_kg=file_kg, file=file)
    if weighings and not whole:
        masses["standing on the plates"] = weighings[0]
    trial_kg = recordings[-1].metadata.mass_kg
    if trial_kg and file_kg and trial_kg != file_kg:
        note = Note.of("mass_of_file", mass_kg=trial_kg, file=recordings[-1].source.name)
        masses["in the trial's file"] = trial_kg, note
    if not masses:
        raise MassUnknownError(_nothing_known(pose.source.name, recordings))
    mass_kg, note = next(iter(masses.values()))
    return BodyMass(mass_kg, {source: mass for source, (mass, _) in masses.items()}, note)


def differing_masses(known_kg: Mapping[str, float], carried_kg: float | None) -> tuple[Note, ...]:
    """Compare all that is known of the body mass.

    Parameters
    ----------
    known_kg
        Where a mass comes from -> that mass; the one that is used is the first.
    carried_kg
        What the plates carry over steps, as
        `pipeline.trial.findings.evidence.weight_of_steps` gives it.

    Returns
    -------
    tuple of Note
        ``mass_differs``, which names all, where the largest exceeds the smallest by more than 3 %.

    Examples
    --------
    >>> for note in differing_masses({"stated": 74.6, "in the file": 80.0}, 76.0):
    ...     print(note.code, f"{note.values['difference']:.3f}")
    mass_differs 0.072
    """
    masses_kg = dict(known_kg)
    if carried_kg is not None:
        masses_kg[ON_PLATES] = carried_kg
    difference = max(masses_kg.values()) / min(masses_kg.values()) - 1
    if difference <= LIMITS.largest_mass_difference:
        return ()
    return (Note.of("mass_differs", difference=difference, known_kg=masses_kg),)


def _weigh(recording: Recording, expected_kg: float | None) -> tuple[float, Note] | None:
    """Weigh the subject in the steadiest second of standing still, near an expected mass if any."""
    if not recording.plates:
        return None
    markers, plates = recording.markers, recording.plates
    begin_s, count = common_tenths(markers.time, *(plate.time for plate in plates))
    if count < LIMITS.weighing_tenths:
        return None
    # load of all plates as a mass, over tenths of a second
    mass = _carried_kg(plates, begin_s, count)
    long = sliding_window_view(mass, min(LIMITS.long_tenths, count)).mean(axis=1)
    least = max(
        LIMITS.least_mass, LIMITS.whole_fraction * np.max(long[np.isfinite(long)], initial=0.0)
    )
    # every second of the recording: its mean load and how it varies
    seconds = sliding_window_view(mass, LIMITS.weighing_tenths)
    mean, variation = seconds.mean(axis=1), seconds.std(axis=1)
    even = np.flatnonzero((mean >= least) & (variation <= LIMITS.weight_variation * mean))
    needed = int(even.max(initial=-LIMITS.weighing_tenths)) + LIMITS.weighing_tenths
    # markers are averaged over tenths too, since their noise is no motion
    place = tenths(markers.position, markers.time, begin_s, needed)
    steady = [
        k
        for k in even
        if median_extent(place[k : k + LIMITS.weighing_tenths]) < LIMITS.still_extent
    ]
    if expected_kg is not None:
        as_expected = [
            k for k in steady if abs(mean[k] / expected_kg - 1) <= 1 - LIMITS.whole_fraction
        ]
        steady = as_expected or steady
    if not steady:
        return None
    # the steadiest second, by the coefficient of variation of its load
    best = min(steady, key=lambda k: variation[k] / mean[k])
    start_s, mass_kg = begin_s + TENTH_S * best, float(mean[best])
    times = {"start_s": start_s, "stop_s": start_s + TENTH_S * LIMITS.weighing_tenths}
    return mass_kg, Note.of("mass_weighed", mass_kg=mass_kg, **times, file=recording.source.name)


def roughly_weighed(recording: Recording, unknown: MassUnknownError) -> float:
    """Guess the body mass by the load of all plates while they carry most [kg].

    It is within a tenth for somebody who walks over them, near enough to find the steps that weigh
    better (`pipeline.trial.findings.evidence.weight_of_steps`). Where nobody is on them, the
    error is raised that says that the mass is unknown.
    """
    markers, plates = recording.markers, recording.plates
    span = common_tenths(markers.time, *(plate.time for plate in plates))
    mass = np.nan_to_num(_carried_kg(plates, *span))
    if mass.max(initial=0.0) < LIMITS.least_mass:
        raise unknown
    # without tenths in which a foot is beside the plates
    return float(mass[mass > LIMITS.load_fraction * mass.max()].mean())


def _carried_kg(plates: Sequence[Plate], begin_s: float, count: int) -> Array:
    """Give the mass that the plates carry together over successive tenths of a second, (count,)."""
    # vertical force: the third row of a rotation is the vertical, as the plate sees it
    loads = [
        tenths(plate.wrench_in_plate[:, :3] @ plate.rotation[2], plate.time, begin_s, count)
        for plate in plates
    ]
    return np.asarray(np.sum(loads, axis=0) / GRAVITY_MPS2)


def _nothing_known(name: str, recordings: tuple[Recording, ...]) -> str:
    """Say that the body mass is not known, and what to do."""
    plates = next((r.plates for r in recordings if r.plates), ())
    why = "nobody stands still on the plates for a second to be weighed, and no file has it"
    if len(recordings[0].markers.time) == 1:
        why = "it is one frame, a second of quiet standing is needed to weigh, and no file has it"
    if not plates:
        why = f"no plates to weigh on: {recordings[0].why_no_plates}"
    mean_kg = sum(np.nanmean(plate.wrench[:, 2]) for plate in plates) / GRAVITY_MPS2
    hint = f"; the mean vertical force of the whole file would be {mean_kg:.1f} kg"
    return (
        f"{name}: mass missing: {why}; give the mass (--mass-kg, mass_kg of the subject)"
        f"{hint if mean_kg > LIMITS.least_mass else ''}"
    )


def subject_body(
    pose: Recording,
    subject: Subject,
    settings: Settings,
    mass: float,
    *,
    window_s: tuple[float, float] | None = None,
    marker_set: MarkerSet | None = None,
    hip_trial: Recording | None = None,
    segments: Mapping[str, SegmentOverride] | None = None,
) -> Body:
    """Build a subject's body.

    Parameters
    ----------
    pose
        Recording of the calibration pose.
    subject, settings
        Who, and by which rules.
    mass
        Body mass [kg].
    window_s
        Where the pose is in its recording [s]; by default its quietest second.
    marker_set
        A marker set of one's own; by default the stated one, or recognised from the labels.
    hip_trial
        Recording in which the thighs swing, where ``settings.hip`` is "functional".
    segments
        Segment -> what is known better than the table of inertias.

    Returns
    -------
    Body
        See `hbm.body.build_body`.

    Raises
    ------
    ValueError
        As `build_body` and `functional_hips`; if functional hips have no recording or are too far
        from the regression's, or if there is a recording for them that is not used.
    """
    stature = pose.metadata.height_m
    if stature is not None and not MIN_STATURE_M <= stature <= MAX_STATURE_M:
        stature = None  # a file that says so has another unit
    widths = {k: w for k in ("knee_width_m", "ankle_width_m") if (w := getattr(subject, k))}
    recorded = pose.metadata.limbs
    limbs = {side: replace(recorded.get(side, LimbMeasures()), **widths) for side in SIDES}
    named = marker_sets().get(settings.marker_set or "")

    def built(hip: HipRule | dict[str, Array]) -> Body:
        try:
            return build_body(
                pose.markers,
                mass=mass,
                sex=subject.sex,
                height_m=subject.height_m or stature,
                marker_set=marker_set or settings.marker_set,
                window_s=window_s,
                hip=hip,
                limbs=limbs,
                marker_offset_m=settings.marker_offset_m,
                overrides=segments,
                shoe_mass_kg=subject.shoe_mass_kg,
                sole_height_m=subject.sole_height_m,
            )
        except ImplausibleLegs as error:
            remedy = "correct the unit in the file, or give it: --units, or units in study.toml"
            raise ValueError(f"{pose.source.name}: {error}; {remedy}") from error
        except ValueError as error:
            with suppress(ValueError):  # of labels of no set
                chosen = marker_set or named or recognise_marker_set(pose.markers.names)
                if sides := sides_exchanged(chosen, pose.markers, pose.source.name):
                    error.add_note(f"{sides.note}; exchange them: {sides.rename}")
            raise

    if settings.hip != "functional":
        if hip_trial is not None:
            raise ValueError('a recording for functional hips is not used without "functional"')
        return built(settings.hip)
    if hip_trial is None:
        raise ValueError("functional hips need a recording in which the thighs swing (hip_trial)")
    body = built(functional_hips(hip_trial.markers, marker_set or named))
    note = _beside_regression(body, built("harrington"), hip_trial.source.name)
    return replace(body, notes=(*body.notes, note))


def _beside_regression(body: Body, by_regression: Body, file: str) -> Note:
    """Give how far functional hips are from the regression's; refuse more than pelvises differ."""
    distance_m = {}
    for side in ("right", "left"):
        # in the frame of the pelvis, from the middle of its markers
        hips = [one.offsets[f"{side}_thigh"] - _pelvis(one) for one in (body, by_regression)]
        distance_m[side] = float(np.linalg.norm(hips[0] - hips[1]))
    largest_m = max(distance_m.values())
    if largest_m > LIMITS.largest_hip_distance:
        off = ", ".join(f"{side} {1000 * far_m:.0f} mm" for side, far_m in distance_m.items())
        raise ValueError(
            f"{file}: the functional hips are {off} from Harrington's regression, more than"
            " pelvises differ: swing both thighs forward, back and sideways by 30° and more"
        )
    code = "functional_hips" if largest_m <= LIMITS.expected_hip_distance else "functional_hips_far"
    return Note.of(code, file=file, distance_m=distance_m)


def _pelvis(body: Body) -> Array:
    """Give the middle of the pelvis' markers in its own frame, (3,) [m]."""
    of_pelvis = [segment == "pelvis" for segment in body.marker_segment]
    return np.asarray(body.marker_position[of_pelvis].mean(axis=0))
