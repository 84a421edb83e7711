"""Plates corrected by their calibration, before anything else is computed from them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from compensation import PlateCalibration
from hbm.notes import Note
from pipeline.config.plate_correction import PlateCorrection
from pipeline.io.recording import Plate, Recording

MAX_SHIFT_M: Final = 0.1
"""Between a plate's centre in a file and in its calibration: cameras set up anew move it by
millimetres, the plate beside it is half a metre away."""


def with_corrected_plates(recording: Recording, correction: PlateCorrection | None) -> Recording:
    """Correct the plates of a recording of any kind; without a correction it stays as it is.

    Each wrench stays in its plate's own axes, samples keep their times (`plate_delays_s` gives
    their delays), and a note says what was corrected. A ValueError where the file's plates are
    corrected or compensated already, or a plate is not where its calibration has it.

    A plate that moves is corrected in its own frame, as it stands with the platform in neutral:
    cells, amplifiers and their calibration move with it. The inertia of its belt assembly is a load
    on the cells like any other, so that it is subtracted afterwards, by a model that was fitted to
    equally corrected plates.
    """
    if correction is None or not recording.plates:
        return recording
    file, done = recording.source.name, recording.compensation
    if done is not None:
        raise ValueError(
            f"{file}: its plates are compensated or corrected already, by {done.software}; leave "
            f"{correction.name} out, or give the original recording"
        )
    plates = []
    for plate in recording.plates:
        one = correction.calibrations.of(plate.number)
        if one is None:
            plates.append(plate)
            continue
        apart_m = float(np.linalg.norm(plate.center - one.center))
        if np.isfinite(plate.corners).all() and apart_m > MAX_SHIFT_M:
            raise ValueError(
                f"{file}: plate {plate.number} lies {apart_m:.2f} m from where {correction.name} "
                "has it; are its plates numbered as in the recordings of the weights, and is the "
                "lab's origin the same?"
            )
        wrench = one.correct_in_plate(plate.wrench_in_plate, plate.rotation, plate.center)
        plates.append(replace(plate, wrench_in_plate=wrench))
    notes = _notes(recording.plates, correction)
    return replace(recording, plates=tuple(plates), notes=(*recording.notes, *notes))


def plate_delays_s(
    plates: Sequence[Plate], correction: PlateCorrection | None, stated_s: float | None
) -> list[float]:
    """Give how much later each plate is than the cameras, by its calibration or as stated [s].

    A ValueError where both are stated and differ.
    """
    if correction is None:
        return [stated_s or 0.0 for _ in plates]
    return [correction.delay_s(plate.number, stated_s) for plate in plates]


def relative_delays_s(plates: Sequence[Plate], correction: PlateCorrection | None) -> list[float]:
    """Give how much later each plate is than the first, as their calibration states it [s].

    A plate whose delay it does not state is as late as the cameras. What is stated beside it, of
    all plates alike, does not count here: a calibration of accelerometers and the trials that use
    it have to be timed alike.
    """
    first, *others = plate_delays_s(plates, correction, None)
    return [0.0, *(delay - first for delay in others)]


def corrections_used(
    plates: Sequence[Plate], correction: PlateCorrection | None
) -> list[PlateCalibration]:
    """Give the calibrations of those plates that have one."""
    if correction is None:
        return []
    known = (correction.calibrations.of(plate.number) for plate in plates)
    return [one for one in known if one is not None]


def _notes(plates: Sequence[Plate], correction: PlateCorrection) -> list[Note]:
    notes = []
    if found := corrections_used(plates, correction):
        unexamined = [f"{c} of plate {one.plate}" for one in found for c in one.unexamined]
        note = Note.of(
            "plates_corrected",
            plates=[str(one.plate) for one in found],
            calibration=correction.name,
            delays_s={f"plate {one.plate}": one.delay_s or 0.0 for one in found},
            unexamined=unexamined or ["nothing"],
        )
        notes.append(note)
    numbers = {one.plate for one in found}
    if missing := [str(plate.number) for plate in plates if plate.number not in numbers]:
        notes.append(Note.of("plates_not_corrected", plates=missing, calibration=correction.name))
    return notes
