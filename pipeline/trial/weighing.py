"""Body mass and stature: as stated, weighed by the plates, or from the file."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.config.schema import Subject
from pipeline.io.recording import Recording

WEIGHING_FRAMES: Final = 100
"""One second at 100 Hz: quiet standing at the start of a trial rarely lasts longer."""
MAX_WEIGHT_VARIATION: Final = 0.02
"""Standard deviation by mean of tenths of that second; quiet standing sways by less."""
MIN_MASS_KG: Final = 10.0
"""Below it nobody is on the plates."""
MIN_CARRIED_SHARE: Final = 0.3
"""Of the mean vertical force: in walking it never falls below about half of it."""
MIN_HEIGHT_M: Final = 0.5
MAX_HEIGHT_M: Final = 2.6
"""Bounds of stature that the body builder takes; a file that says otherwise has another unit."""


def body_mass(subject: Subject, pose: Recording) -> tuple[float, Note]:
    """Give body mass as stated, or weighed over the first frames of the calibration pose.

    Parameters
    ----------
    subject
        Who; a stated ``mass_kg`` is taken as it is.
    pose
        Recording of the calibration pose.

    Returns
    -------
    mass
        Body mass [kg].
    note
        Where it comes from.

    Raises
    ------
    ValueError
        If it is not stated and nobody stands still on the plates at the start: their vertical force
        has gaps, or its means over tenths of that time vary by more than 2 % (SD); noise does not.
    """
    if subject.mass_kg is not None:
        return subject.mass_kg, Note.of("mass_stated", mass_kg=subject.mass_kg)
    name = pose.source.name
    if not pose.plates:
        raise ValueError(f"{name}: mass missing, and there are no plates to weigh on; state it")
    total = np.sum([plate.wrench[:, 2] for plate in pose.plates], axis=0)
    first = pose.plates[0].time < pose.markers.time[0] + WEIGHING_FRAMES / pose.markers.rate_hz
    weight, mean = total[first], float(np.nanmean(total)) / GRAVITY_MPS2
    tenths = [np.mean(tenth) for tenth in np.array_split(weight, 10)]
    steady = np.std(tenths) <= MAX_WEIGHT_VARIATION * np.mean(weight)
    if not steady or np.mean(weight) < MIN_MASS_KG * GRAVITY_MPS2:
        hint = f"; the mean vertical force of the whole file would be {mean:.1f} kg"
        hint = hint if mean > MIN_MASS_KG else ""
        raise ValueError(
            f"{name}: mass missing: nobody stands still on the plates in the first "
            f"{WEIGHING_FRAMES} frames to be weighed; state the mass{hint}"
        )
    mass = float(np.mean(weight)) / GRAVITY_MPS2
    return mass, Note.of("mass_weighed", mass_kg=mass, frames=WEIGHING_FRAMES, file=name)


def carried_mass(
    time: Array, vertical: Array, cycles: Mapping[str, Array]
) -> tuple[float | None, tuple[Note, ...]]:
    """Give the mass that the plates carry over whole gait cycles, to compare a stated one with.

    Parameters
    ----------
    time
        (T,) [s].
    vertical
        Vertical force of all plates on the subject, filtered, (T,) [N].
    cycles
        Side -> start and stop of each gait cycle, (C, 2) [s].

    Returns
    -------
    mass_kg
        Mean vertical force over the cycles by gravity, for over whole cycles a body gains no
        vertical speed. None where the plates do not carry the subject throughout: without cycles,
        in running, or where a foot lands beside them (less than 0.3 of that mean at some instant).
    notes
        ``subject_not_carried`` where there are cycles but no mass.
    """
    inside = np.zeros(len(time), bool)
    for start, stop in max(cycles.values(), key=len, default=np.empty((0, 2))):
        inside |= (time >= start) & (time < stop)
    carried = vertical[inside & np.isfinite(vertical)]
    if not len(carried) or carried.min() < MIN_CARRIED_SHARE * carried.mean():
        walked = any(map(len, cycles.values()))
        return None, (Note.of("subject_not_carried"),) if walked else ()
    return float(carried.mean()) / GRAVITY_MPS2, ()


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
