"""The calibration of the plates that a study or a command names, and the delays that it states."""

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from compensation.plate_calibration import PlateCalibrations, from_json, to_json
from pipeline.io.input_file import naming, read_text

SAME_DELAY_S: Final = 1e-4
"""Stated delays that differ by no more are equal: no plate's delay is known better."""


@dataclass(frozen=True, slots=True)
class PlateCorrection:
    """The corrections of a laboratory's plates, and the file that they are from.

    Attributes
    ----------
    name
        The file's name.
    sha256
        Of its corrections without their provenance: one made anew from the same is equal.
    calibrations
        The corrections.

    Examples
    --------
    >>> import numpy as np
    >>> from compensation import PlateCalibration
    >>> late = PlateCalibration(
    ...     1, np.eye(6), np.zeros(6), np.zeros((6, 6)), np.zeros(3), ("Fz",), delay_s=0.004
    ... )
    >>> correction = PlateCorrection("plates.json", "", PlateCalibrations((late,)))
    >>> correction.delay_s(1, stated_s=None), correction.delay_s(2, stated_s=0.002)
    (0.004, 0.002)
    """

    name: str
    sha256: str
    calibrations: PlateCalibrations = field(compare=False)

    def delay_s(self, plate: int, stated_s: float | None) -> float:
        """Give how much later a plate is than the cameras [s].

        Parameters
        ----------
        plate
            Its number.
        stated_s
            As it is stated of all plates; None where it is not.

        Raises
        ------
        ValueError
            Both the calibration and a person state a delay, and these differ.
        """
        one = self.calibrations.of(plate)
        measured_s = one.delay_s if one is not None else None
        if measured_s is None:
            return stated_s or 0.0
        if stated_s is not None and abs(stated_s - measured_s) > SAME_DELAY_S:
            raise ValueError(
                f"the plates' delay is given as {1000 * stated_s:g} ms, but {self.name} has "
                f"{1000 * measured_s:.1f} ms for plate {plate}; give one of them only "
                "(plate_delay_s in study.toml, --plate-delay-ms)"
            )
        return measured_s

    def require_delay(self, stated_s: float | None) -> None:
        """Refuse a stated delay that differs from that of a plate with a ValueError."""
        for one in self.calibrations.plates:
            self.delay_s(one.plate, stated_s)


def read_plate_correction(path: Path) -> PlateCorrection:
    """Read the file of a plate calibration.

    Parameters
    ----------
    path
        JSON that 'hbm plates' wrote.

    Returns
    -------
    PlateCorrection
        What it corrects.

    Raises
    ------
    ValueError, OSError
        It cannot be read, or is no plate calibration; one line that names it.
    """
    with naming(path):
        calibrations = from_json(read_text(path))
    corrections = to_json(PlateCalibrations(calibrations.plates)).encode()
    return PlateCorrection(path.name, hashlib.sha256(corrections).hexdigest(), calibrations)
