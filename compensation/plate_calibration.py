"""What a force plate measures, corrected: a 6×6 matrix and an offset per plate, and their text."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.documents import damaged, read_document, write_document
from hbm.numbers import read_numbers
from hbm.spatial import WRENCH_COMPONENTS, Array, read_only, rotate_wrench, shift_wrench
from hbm.spelling import listed, printable, shown

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "plate_calibration")

OF: Final = "plate"
AGAIN: Final = "make it again with 'hbm plates'"
VERSION: Final = 1


@dataclass(frozen=True, slots=True)
class PlateCalibration:
    """The correction of one plate: ``matrix @ (measured - offset)``.

    Wrenches are the action on the subject in lab axes (x forward, y left, z up) about ``center``,
    with the platform in neutral; a plate that moves takes them with it.

    Attributes
    ----------
    plate
        The plate's number in its files, from 1.
    matrix
        From measured to true wrench, (6, 6) [1, 1/m, m].
    offset
        What the unloaded plate measures, (6,) [N, N·m].
    standard_error
        Of the matrix, (6, 6).
    center
        Centre of the plate's surface in the lab, as the calibration's recordings give it, (3,) [m].
    examined
        Components of the true wrench that varied in those recordings, of `WRENCH_COMPONENTS`: how
        the plate responds to the others is unknown, and taken as right.
    delay_s
        How much later the plate is than the cameras [s]; None where it was not measured.

    Examples
    --------
    A plate that shows 10 % too much in the vertical:

    >>> tenth = np.diag([1, 1, 1 / 1.1, 1, 1, 1])
    >>> plate = PlateCalibration(1, tenth, np.zeros(6), np.zeros((6, 6)), np.zeros(3), ("Fz",))
    >>> print(plate.correct([[0, 0, 880, 0, 0, 0]])[0].round(6))
    [  0.   0. 800.   0.   0.   0.]
    """

    plate: int
    matrix: Array
    offset: Array
    standard_error: Array
    center: Array
    examined: tuple[str, ...]
    delay_s: float | None = None

    def __post_init__(self) -> None:
        where = f"plate {shown(self.plate)}"
        if type(self.plate) is not int or not 1 <= self.plate <= LIMITS.highest_number:
            raise ValueError(
                f"plates are numbered from 1 to {LIMITS.highest_number}, got {shown(self.plate)}"
            )
        bounds = {
            "matrix": ((6, 6), LIMITS.largest_entry),
            "offset": ((6,), LIMITS.largest_offset),
            "standard_error": ((6, 6), np.inf),
            "center": ((3,), LIMITS.farthest),
        }
        for name, (shape, largest) in bounds.items():
            value = read_only(getattr(self, name))
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"{where}: {name} must be numbers of shape {shape}")
            if (size := float(np.abs(value).max())) > largest:
                raise ValueError(f"{where}: {name} holds {size:.3g}, expected {largest:g} at most")
            object.__setattr__(self, name, value)
        if not np.linalg.cond(self.matrix) < LIMITS.largest_condition:
            raise ValueError(
                f"{where}: matrix is singular or nearly so: different loads would be corrected to "
                "the same"
            )
        object.__setattr__(self, "examined", tuple(self.examined))
        if not {*self.examined} <= {*WRENCH_COMPONENTS}:
            raise ValueError(
                f"{where}: examined must be of {', '.join(WRENCH_COMPONENTS)}, "
                f"got {listed(self.examined)}"
            )
        if self.delay_s is not None and not abs(self.delay_s) <= LIMITS.longest_delay:
            raise ValueError(
                f"{where}: delay_s must be within ±{LIMITS.longest_delay} s, "
                f"got {shown(self.delay_s)}"
            )

    @property
    def unexamined(self) -> tuple[str, ...]:
        """Components of the wrench that nothing excited."""
        return tuple(name for name in WRENCH_COMPONENTS if name not in self.examined)

    def correct(self, wrench: ArrayLike) -> Array:
        """Correct wrenches in lab axes about `center`, (..., 6) [N, N·m]; gaps stay gaps."""
        measured = np.asarray(wrench, float)
        return np.asarray(measured + self._change(measured))

    def correct_in_plate(self, wrench: ArrayLike, rotation: ArrayLike, center: ArrayLike) -> Array:
        """Correct wrenches that are in the axes of a plate.

        Parameters
        ----------
        wrench
            Action on the subject in the plate's own axes about its origin, (..., 6) [N, N·m].
        rotation
            Orientation of the plate in the lab with the platform in neutral (columns: its axes),
            (3, 3).
        center
            The plate's origin in the lab with the platform in neutral, (3,) [m]. Where it is not
            the calibration's, wrenches are corrected about the calibration's.

        Returns
        -------
        Array
            The corrected wrenches in the same axes about the same point, (..., 6). A calibration
            that changes nothing leaves every bit as it is.

        Examples
        --------
        The same plate, whose own z points down:

        >>> tenth = np.diag([1, 1, 1 / 1.1, 1, 1, 1])
        >>> plate = PlateCalibration(1, tenth, np.zeros(6), np.zeros((6, 6)), np.zeros(3), ("Fz",))
        >>> down = np.diag([1.0, -1.0, -1.0])
        >>> print(plate.correct_in_plate([[0, 0, -880, 0, 0, 0]], down, np.zeros(3))[0].round(6))
        [   0.    0. -800.    0.    0.    0.]
        """
        measured, rotation = np.asarray(wrench, float), np.asarray(rotation, float)
        # to lab axes about the calibration's point, and the change back
        to_center = self.center - np.asarray(center, float)
        change = self._change(shift_wrench(rotate_wrench(measured, rotation), to_center))
        return np.asarray(measured + rotate_wrench(shift_wrench(change, -to_center), rotation.T))

    def _change(self, measured: Array) -> Array:
        """Give what the correction adds to wrenches; exactly zero where it changes nothing."""
        change: Array = measured @ (self.matrix - np.eye(6)).T - self.matrix @ self.offset
        return change


@dataclass(frozen=True, slots=True)
class PlateCalibrations:
    """The corrections of a laboratory's plates.

    Attributes
    ----------
    plates
        One per plate, each of another number.
    provenance
        Origin, for people: study, its hash, date, program version, …

    Examples
    --------
    >>> plate = PlateCalibration(
    ...     2, np.eye(6), np.zeros(6), np.zeros((6, 6)), np.zeros(3), ("Fz",), delay_s=0.004
    ... )
    >>> read = from_json(to_json(PlateCalibrations((plate,), {"study": "plates"})))
    >>> read.of(2).delay_s, read.of(1), read.provenance["study"]
    (0.004, None, 'plates')
    """

    plates: tuple[PlateCalibration, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "plates", tuple(self.plates))
        if not self.plates:
            raise ValueError("it corrects no plate")
        numbers = [one.plate for one in self.plates]
        if twice := sorted({n for n in numbers if numbers.count(n) > 1}):
            raise ValueError(f"plate {twice[0]} is there more than once")
        texts = {printable(str(k)): printable(str(v)) for k, v in self.provenance.items()}
        object.__setattr__(self, "provenance", MappingProxyType(texts))

    def of(self, plate: int) -> PlateCalibration | None:
        """Give the correction of a plate by its number, None where there is none."""
        return next((one for one in self.plates if one.plate == plate), None)


def to_json(calibrations: PlateCalibrations) -> str:
    """Write corrections as JSON text, from which `from_json` reads equal numbers.

    Examples
    --------
    >>> plate = PlateCalibration(
    ...     1, np.eye(6), np.zeros(6), np.zeros((6, 6)), np.zeros(3), ("Fz",)
    ... )
    >>> to_json(PlateCalibrations((plate,))).splitlines()[1]
    ' "format": "hbm-residuals plate calibration",'
    """
    return write_document(
        OF,
        VERSION,
        provenance=dict(calibrations.provenance),
        plates=[asdict(one) for one in calibrations.plates],
    )


def from_json(text: str) -> PlateCalibrations:
    """Read corrections from JSON text.

    Parameters
    ----------
    text
        Output of `to_json`.

    Returns
    -------
    PlateCalibrations
        The corrections and their provenance.

    Raises
    ------
    ValueError
        Not JSON, not a plate calibration, of another version, or damaged: one line.

    Examples
    --------
    >>> from_json("{}")
    Traceback (most recent call last):
        ...
    ValueError: the text is no plate calibration: its format should be 'hbm-residuals plate \
calibration'; make it again with 'hbm plates'
    """
    document = read_document(text, OF, (VERSION,), AGAIN)
    try:
        plates = tuple(PlateCalibration(**plain) for plain in document["plates"])
        return PlateCalibrations(plates, document["provenance"])
    except (KeyError, TypeError, AttributeError, OverflowError, ValueError) as error:
        raise damaged(OF, error, AGAIN) from error
