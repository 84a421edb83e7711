"""Whose foot is on which plate, frame by frame."""

import numpy as np

from hbm.spatial import Array
from pipeline.trial.gait.contact import pressure_beside


class LiveFeet:
    """The foot that each plate carried last.

    Parameters
    ----------
    plates
        How many there are.
    threshold_n
        Vertical force above which a plate is loaded [N].
    """

    def __init__(self, plates: int, threshold_n: float) -> None:
        self.threshold_n = threshold_n
        self.last: list[int | None] = [None] * plates

    def on_plates(self, wrenches: Array, feet: Array) -> tuple[Array, bool]:
        """Give the foot of each plate, 0 left and 1 right, (P,), and whether one is uncertain.

        Parameters
        ----------
        wrenches
            Of the plates, lab axes about the lab origin, (P, 6) [N, N·m].
        feet
            Middle of the left and the right foot in the lab, (2, 3) [m].
        """
        on = np.empty(len(wrenches), int)
        count = len(wrenches)
        pressure = pressure_beside(wrenches, np.broadcast_to(feet, (count, 2, 3)), self.threshold_n)
        for k in range(count):
            if pressure.decided[k]:
                self.last[k] = int(pressure.nearer[k])
            last = self.last[k]
            on[k] = pressure.nearer[k] if last is None else last
        return on, bool(pressure.uncertain.any())
