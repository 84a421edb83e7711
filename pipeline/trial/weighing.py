"""Body mass and stature: as stated, weighed by the plates, or from the file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.config.schema import Subject
from pipeline.io.recording import Recording
from pipeline.trial.standing import (
    MAX_STILL_EXTENT_M,
    TENTH_S,
    common_tenths,
    median_extent,
    tenths,
)

WEIGHING_TENTHS: Final = 10
"""One second: quiet standing before a trial rarely lasts longer."""
MAX_WEIGHT_VARIATION: Final = 0.02
"""Standard deviation by mean of tenths of that second; quiet standing sways by less."""
MIN_MASS_KG: Final = 10.0
"""Below it nobody is on the plates."""
LONG_TENTHS: Final = 20
"""Two seconds: however a person moves in them, the mean vertical force is about the weight."""
MIN_WHOLE_SHARE: Final = 0.9
"""Of that mean, or of the mass in a file: plates that carry less do not carry the whole subject."""
MAX_MASS_DIFFERENCE: Final = 0.03
"""Of the smallest: more than clothes, shoes, a meal and a plate's gain error together."""
ON_PLATES: Final = "on the plates over gait cycles"
MIN_HEIGHT_M: Final = 0.5
MAX_HEIGHT_M: Final = 2.6
"""Bounds of stature that the body builder takes; a file that says otherwise has another unit."""


@dataclass(frozen=True, slots=True)
class BodyMass:
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


@dataclass(frozen=True, slots=True)
class _Weighing:
    """What the plates of a file carry in a second in which the subject stands still on them."""

    mass_kg: float
    start_s: float
    file: str

    @property
    def note(self) -> Note:
        """``mass_weighed``."""
        stop_s = self.start_s + WEIGHING_TENTHS * TENTH_S
        extent = {"start_s": self.start_s, "stop_s": stop_s}
        return Note.of("mass_weighed", mass_kg=self.mass_kg, **extent, file=self.file)


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
    ValueError
        If it is neither stated nor in a file, and there is no such second.

    Notes
    -----
    In that second the means of the vertical force over tenths of it vary by no more than 2 % (SD;
    noise does not count), and half of the markers stay within 2 cm. A second does not count in
    which the plates carry less than nine tenths of what they carry over two other seconds, or of
    the mass in the file: a foot is beside them, or one of them does not measure yet.
    """
    recordings = (pose,) if trial is None or trial is pose else (pose, trial)
    stating = [r for r in recordings if r.metadata.mass_kg is not None]
    file_kg = stating[0].metadata.mass_kg if stating else None
    weighings = [w for r in recordings if (w := _weigh(r, file_kg)) is not None]
    whole = [w for w in weighings if file_kg is None or w.mass_kg >= MIN_WHOLE_SHARE * file_kg]
    weighed = next(iter(whole or weighings), None)

    stated, by_plates, by_file = [], [], []
    if subject.mass_kg is not None:
        stated = [("stated", subject.mass_kg, Note.of("mass_stated", mass_kg=subject.mass_kg))]
    if weighed is not None:
        by_plates = [("standing on the plates", weighed.mass_kg, weighed.note)]
    if file_kg is not None:
        note = Note.of("mass_of_file", mass_kg=file_kg, file=stating[0].source.name)
        by_file = [("in the file", file_kg, note)]
    found = [*stated, *by_plates, *by_file] if whole else [*stated, *by_file, *by_plates]
    if not found:
        raise ValueError(_nothing_known(recordings))
    _, mass_kg, note = found[0]
    return BodyMass(mass_kg, {source: mass for source, mass, _ in found}, note)


def differing_masses(known_kg: Mapping[str, float], carried_kg: float | None) -> tuple[Note, ...]:
    """Compare all that is known of the body mass.

    Parameters
    ----------
    known_kg
        Where a mass comes from -> that mass; the one that is used is the first.
    carried_kg
        What the plates carry over gait cycles, as `carried_mass` gives it.

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
    every = dict(known_kg)
    if carried_kg is not None:
        every[ON_PLATES] = carried_kg
    difference = max(every.values()) / min(every.values()) - 1
    if difference <= MAX_MASS_DIFFERENCE:
        return ()
    return (Note.of("mass_differs", difference=difference, known_kg=every),)


def _weigh(recording: Recording, expected_kg: float | None) -> _Weighing | None:
    """Weigh the subject in the steadiest second of standing still, near an expected mass if any."""
    if not recording.plates:
        return None
    markers, plates = recording.markers, recording.plates
    begin_s, count = common_tenths(markers.time, *(plate.time for plate in plates))
    if count < WEIGHING_TENTHS:
        return None
    loads = [
        tenths(plate.wrench_in_plate[:, :3] @ plate.rotation[2], plate.time, begin_s, count)
        for plate in plates
    ]
    mass = np.sum(loads, axis=0) / GRAVITY_MPS2
    long = sliding_window_view(mass, min(LONG_TENTHS, count)).mean(axis=1)
    least = max(MIN_MASS_KG, MIN_WHOLE_SHARE * np.max(long[np.isfinite(long)], initial=0.0))
    seconds = sliding_window_view(mass, WEIGHING_TENTHS)
    mean, variation = seconds.mean(axis=1), seconds.std(axis=1)
    even = np.flatnonzero((mean >= least) & (variation <= MAX_WEIGHT_VARIATION * mean))
    wanted = int(even.max(initial=-WEIGHING_TENTHS)) + WEIGHING_TENTHS
    place = tenths(markers.position, markers.time, begin_s, wanted)
    steady = [k for k in even if median_extent(place[k : k + WEIGHING_TENTHS]) < MAX_STILL_EXTENT_M]
    if expected_kg is not None:
        as_expected = [k for k in steady if abs(mean[k] / expected_kg - 1) <= 1 - MIN_WHOLE_SHARE]
        steady = as_expected or steady
    if not steady:
        return None
    best = min(steady, key=lambda k: variation[k] / mean[k])
    return _Weighing(float(mean[best]), begin_s + TENTH_S * best, recording.source.name)


STATE: Final = "(--mass-kg, mass_kg of the subject)"


def _nothing_known(recordings: tuple[Recording, ...]) -> str:
    """Say that the body mass is not known, and what to do."""
    name = recordings[0].source.name
    plates = next((r.plates for r in recordings if r.plates), ())
    if not plates:
        why = recordings[0].why_no_plates
        return f"{name}: mass missing, and no plates to weigh on: {why}; state it {STATE}"
    force = sum(float(np.nanmean(plate.wrench[:, 2])) for plate in plates)
    mean_kg = force / GRAVITY_MPS2
    hint = f"; the mean vertical force of the whole file would be {mean_kg:.1f} kg"
    return (
        f"{name}: mass missing: nobody stands still on the plates for a second to be weighed, and "
        f"no file states it; state the mass {STATE}{hint if mean_kg > MIN_MASS_KG else ''}"
    )


def carried_mass(
    time: Array, vertical: Array, cycles: Mapping[str, Array], valid: Mask
) -> float | None:
    """Give the mass that the plates carry over whole gait cycles, to compare a stated one with.

    Parameters
    ----------
    time
        (T,) [s].
    vertical
        Vertical force of all plates on the subject, filtered, (T,) [N].
    cycles
        Side -> start and stop of each gait cycle, (C, 2) [s].
    valid
        Frames in which the plates carry the subject, (T,).

    Returns
    -------
    float or None
        Mean vertical force by gravity, over those cycles of either side in which the plates carry
        the subject throughout: over whole cycles a body gains no vertical speed. None without any.
    """
    edges = [np.searchsorted(time, span) for spans in cycles.values() for span in spans]
    carried = [vertical[a:b] for a, b in edges if a < b and valid[a:b].all()]
    return float(np.concatenate(carried).mean()) / GRAVITY_MPS2 if carried else None


def stature(subject: Subject, pose: Recording) -> float | None:
    """Give stature as stated, else as in the recording where that is plausible.

    Parameters
    ----------
    subject
        Who.
    pose
        Recording of the calibration pose.

    Returns
    -------
    float or None
        Stature [m]; None where unknown.
    """
    recorded = pose.metadata.height_m
    if subject.height_m is not None:
        return subject.height_m
    plausible = recorded is not None and MIN_HEIGHT_M <= recorded <= MAX_HEIGHT_M
    return recorded if plausible else None
