"""Body mass and stature: as stated, or as the plates weigh the subject and the file says."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.config.schema import Subject
from pipeline.io.recording import Recording

WEIGHING_FRAMES: Final = 100
STEADY_SHARE: Final = 0.02
LEAST_SHARE: Final = 0.3


def body_mass(subject: Subject, pose: Recording) -> tuple[float, Note]:
    """Give body mass as stated, or weighed over the first frames of the calibration pose.

    Parameters
    ----------
    subject
        Who; ``mass_kg`` counts if it is stated.
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
        raise ValueError(f"{name}: mass missing, and there are no plates to weigh by; state it")
    total = np.sum([plate.wrench[:, 2] for plate in pose.plates], axis=0)
    first = pose.plates[0].time < pose.markers.time[0] + WEIGHING_FRAMES / pose.markers.rate_hz
    weight, mean = total[first], float(np.nanmean(total)) / GRAVITY_MPS2
    tenths = [np.mean(tenth) for tenth in np.array_split(weight, 10)]
    steady = np.std(tenths) <= STEADY_SHARE * np.mean(weight)
    if not steady or np.mean(weight) < 10 * GRAVITY_MPS2:
        hint = f"; the mean vertical force of the whole file would be {mean:.1f} kg" * (mean > 10)
        raise ValueError(
            f"{name}: mass missing: nobody stands still on the plates in the first "
            f"{WEIGHING_FRAMES} frames to be weighed; state the mass{hint}"
        )
    mass = float(np.mean(weight)) / GRAVITY_MPS2
    return mass, Note.of("mass_weighed", mass_kg=mass, frames=WEIGHING_FRAMES, file=name)


def joint_widths(subject: Subject, pose: Recording) -> tuple[float | None, float | None]:
    """Give the widths that stand in for medial markers at knee and ankle.

    Parameters
    ----------
    subject
        Who.
    pose
        Recording of the calibration pose.

    Returns
    -------
    knee, ankle
        As stated, else the mean of both sides as the recording says; None where nobody says [m].
    """
    recorded = pose.metadata
    knee, ankle = subject.knee_width_m, subject.ankle_width_m
    if knee is None:
        knee = _mean_of_known(recorded.left_knee_width_m, recorded.right_knee_width_m)
    if ankle is None:
        ankle = _mean_of_known(recorded.left_ankle_width_m, recorded.right_ankle_width_m)
    return knee, ankle


def _mean_of_known(*values: float | None) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def carried_kg(time: Array, vertical: Array, cycles: Mapping[str, Array]) -> float | None:
    """Give the mass that the plates carry over whole gait cycles, to hold a stated one against.

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
    float or None
        Mean vertical force over the cycles by gravity [kg], for over whole cycles a body gains no
        vertical speed. None where the plates do not carry the subject throughout: without cycles,
        in running, or where a foot lands beside them (less than 0.3 of that mean at some instant).
    """
    inside = np.zeros(len(time), bool)
    for start, stop in max(cycles.values(), key=len, default=np.empty((0, 2))):
        inside |= (time >= start) & (time < stop)
    carried = vertical[inside & np.isfinite(vertical)]
    if not len(carried) or carried.min() < LEAST_SHARE * carried.mean():
        return None
    return float(carried.mean()) / GRAVITY_MPS2


def stature(subject: Subject, pose: Recording) -> float | None:
    """Give stature as stated, else as the recording says where that is plausible.

    Parameters
    ----------
    subject
        Who.
    pose
        Recording of the calibration pose.

    Returns
    -------
    float or None
        Stature [m]; None where nobody says.
    """
    recorded = pose.metadata.height_m
    if subject.height_m is None and recorded is not None and 0.5 <= recorded <= 2.6:
        return recorded
    return subject.height_m
