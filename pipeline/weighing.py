"""Body mass and stature: as stated, or as the plates weigh the subject and the file says."""

from typing import Final

import numpy as np

from hbm.skeleton import GRAVITY
from pipeline.recording import Recording
from pipeline.study import Subject

WEIGHING_FRAMES: Final = 100
STEADY_SHARE: Final = 0.02


def body_mass(subject: Subject, pose: Recording) -> tuple[float, str]:
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
    said
        Where it comes from, as a sentence.

    Raises
    ------
    ValueError
        If it is not stated and nobody stands still on the plates at the start: their vertical force
        has gaps, or its means over tenths of that time vary by more than 2 % (SD); noise does not.
    """
    if subject.mass_kg is not None:
        return subject.mass_kg, f"body mass {subject.mass_kg:.1f} kg as given"
    name = pose.source.name
    if not pose.plates:
        raise ValueError(f"{name}: mass missing, and there are no plates to weigh by; state it")
    total = np.sum([plate.wrench[:, 2] for plate in pose.plates], axis=0)
    first = pose.plates[0].time < pose.markers.time[0] + WEIGHING_FRAMES / pose.markers.rate_hz
    weight, mean = total[first], float(np.nanmean(total)) / GRAVITY
    tenths = [np.mean(tenth) for tenth in np.array_split(weight, 10)]
    steady = np.std(tenths) <= STEADY_SHARE * np.mean(weight)
    if not steady or np.mean(weight) < 10 * GRAVITY:
        hint = f"; the mean vertical force of the whole file would be {mean:.1f} kg" * (mean > 10)
        raise ValueError(
            f"{name}: mass missing: nobody stands still on the plates in the first "
            f"{WEIGHING_FRAMES} frames to be weighed; state the mass{hint}"
        )
    mass = float(np.mean(weight)) / GRAVITY
    return mass, f"body mass {mass:.1f} kg by the plates, first {WEIGHING_FRAMES} frames of {name}"


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
    recorded = pose.metadata.get("height_m")
    if subject.height_m is None and isinstance(recorded, float) and 0.5 <= recorded <= 2.6:
        return recorded
    return subject.height_m
