"""Plates with known errors, and the calibration that corrects them."""

from dataclasses import replace

import numpy as np

from compensation import PlateCalibration, PlateCalibrations
from compensation.plate_calibration import to_json
from hbm.spatial import rotate_wrench
from pipeline.config.plate_correction import PlateCorrection

RNG = np.random.default_rng(4)
RESPONSES = {number: np.eye(6) + 0.04 * RNG.normal(size=(6, 6)) for number in (1, 2)}
OFFSETS = {number: RNG.normal(size=6) * [3, 3, 10, 2, 2, 1] for number in (1, 2)}


def correction_of(recording, numbers=(1, 2), *, delays=(None, None), change=True, name="lab.json"):
    """The calibration that undoes `wrongly_measured` (or changes nothing)."""
    plates = {plate.number: plate for plate in recording.plates}
    one_each = tuple(
        PlateCalibration(
            plate=number,
            matrix=np.linalg.inv(RESPONSES[number]) if change else np.eye(6),
            offset=OFFSETS[number] if change else np.zeros(6),
            standard_error=np.zeros((6, 6)),
            center=plates[number].center,
            examined=("Fx", "Fz", "Mx", "My", "Mz"),
            delay_s=delay,
        )
        for number, delay in zip(numbers, delays, strict=True)
    )
    return PlateCorrection(name, f"sha256 of {name}", PlateCalibrations(one_each))


def wrongly_measured(recording):
    """The same recording by plates with gains, cross-talk and offsets in lab axes."""
    plates = []
    for plate in recording.plates:
        in_lab = rotate_wrench(plate.wrench_in_plate, plate.rotation)
        seen = in_lab @ RESPONSES[plate.number].T + OFFSETS[plate.number]
        plates.append(replace(plate, wrench_in_plate=rotate_wrench(seen, plate.rotation.T)))
    return replace(recording, plates=tuple(plates))


def write_correction(path, recording, *numbers, **changes):
    """Write the calibration of `correction_of` as a file."""
    correction = correction_of(recording, *numbers, **changes)
    path.write_text(to_json(correction.calibrations), encoding="utf-8")
    return path
