"""The calibration that corrects what a plate reports."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from compensation import Delay, PlateCalibration, agreed_delay
from compensation.hammer import AgreedDelay
from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.plate_accuracy.faults import FaultEstimate
from pipeline.plate_accuracy.response import PlateResponse, standard_error

DELAY_FAULTS: Final = {"motion": "delay in motion", "hammer": "delay"}
DELAY_METHODS: Final = {"motion": "in motion", "hammer": "by the hammer"}


def plate_calibration(
    number: int, center: Array, response: PlateResponse, faults: Sequence[FaultEstimate]
) -> PlateCalibration | None:
    """Give the correction of a plate: the inverse of its response, with the jackknife's error.

    Parameters
    ----------
    number
        Of the plate in its files.
    center
        Of its surface in the lab, (3,) [m].
    response
        What the plate reports.
    faults
        Of the plate: a zero or a delay is corrected where it differs significantly from none.

    Returns
    -------
    PlateCalibration or None
        A lateral force, which no weight exerts, is only turned and shifted with the plate. What
        grows with the squared load, time or at random is left. None where no calibration turns
        what the plate reports into the true wrench: a channel is dead, or the axes are wrong.
    """
    found = {fault.fault for fault in faults if fault.significant}
    zero = np.where(
        [f"zero of {name}" in found for name in WRENCH_COMPONENTS], response.zero[0], 0.0
    )
    late = chosen_delay(faults)
    corrected = late is not None and DELAY_FAULTS[late.method] in found
    try:
        inverse: Array = np.asarray(np.linalg.inv(response.matrix), float)
        return PlateCalibration(
            number,
            inverse[0],
            zero,
            standard_error(inverse),
            center,
            tuple(WRENCH_COMPONENTS[c] for c in response.examined),
            late.delay.seconds if late is not None and corrected else 0.0,
        )
    except ValueError:  # singular, or nothing that a plate can be
        return None


def chosen_delay(faults: Sequence[FaultEstimate]) -> AgreedDelay | None:
    """Choose between the delays of a plate by a hammer and in motion."""
    delays = {
        fault.fault: Delay(
            fault.value, fault.standard_error, degrees_of_freedom=fault.degrees_of_freedom
        )
        for fault in faults
        if fault.fault in DELAY_FAULTS.values()
    }
    return agreed_delay(delays.get("delay"), delays.get("delay in motion"))


def delay_notes(faults: Sequence[FaultEstimate]) -> tuple[Note, ...]:
    """Warn where the delays of a plate by a hammer and in motion contradict each other."""
    late, named = chosen_delay(faults), {fault.fault: fault for fault in faults}
    if late is None or not late.disagree:
        return ()
    hammer, motion = named["delay"], named["delay in motion"]
    note = Note.of(
        "plate_delays_disagree",
        belt=hammer.belt,
        hammer_s=hammer.value,
        hammer_uncertainty_s=hammer.uncertainty,
        motion_s=motion.value,
        motion_uncertainty_s=motion.uncertainty,
        method=DELAY_METHODS[late.method],
    )
    return (note,)
