"""How much later a trial's force plates are than its markers."""

from dataclasses import dataclass

import numpy as np

from compensation import marker_plate_delay
from hbm.notes import Note
from hbm.spatial import Array


@dataclass(frozen=True, slots=True)
class PlateDelay:
    """How much later a trial's plates are than its markers.

    Attributes
    ----------
    delay_s, uncertainty_s
        Estimate and half of its 95 % interval; NaN where it is not determined.
    note
        ``plate_delay``, or ``plate_delay_unknown`` with the reason.
    """

    delay_s: float
    uncertainty_s: float
    note: Note


def plate_delay(
    plate_force: Array, residual_force: Array, time: Array, motion_lag_s: float = 0.0
) -> PlateDelay:
    """Estimate the delay from a trial's inverse dynamics, if that is possible.

    Parameters
    ----------
    plate_force
        Sum of the plates' forces on the subject, lab axes, (T, 3) [N].
    residual_force
        Residual forces with these plates, lab axes, (T, 3) [N]; the sum of both is the force that
        the motion needs.
    time
        (T,) [s].
    motion_lag_s
        By how much the filter makes the force that the motion needs later than the plates' [s]; see
        `hbm.signals.filtering.acceleration_lag_s`.

    Returns
    -------
    PlateDelay
        As `compensation.marker_plate_delay` estimates it; not determined where that refuses.
    """
    try:
        found = marker_plate_delay(plate_force, residual_force + plate_force, time)
    except ValueError as error:
        return PlateDelay(np.nan, np.nan, Note.of("plate_delay_unknown", reason=str(error)))
    delay_s = found.seconds + motion_lag_s
    note = Note.of("plate_delay", delay_s=delay_s, uncertainty_s=found.uncertainty)
    return PlateDelay(delay_s, found.uncertainty, note)
