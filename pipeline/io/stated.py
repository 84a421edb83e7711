"""What a person states about files; it is used instead of what a file says or leaves out."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from hbm.markers import MarkerSet
from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.units import (
    STATE_PLATE_UNITS,
    STATE_UNITS,
    check_span,
    force_in_n,
    length_in_m,
    length_of_moment,
    moment_in_nm,
)

EXAMPLE: Final = "N,Nmm"


@dataclass(frozen=True, slots=True)
class PlateUnits:
    """Units of the plates' channels as a person states them.

    Attributes
    ----------
    force, moment
        Such as "N" and "Nmm".
    pressure
        Of centres of pressure, where they are stored; None to take what the file says, or where it
        says nothing the moment's unit of length.
    """

    force: str
    moment: str
    pressure: str | None = None

    def __str__(self) -> str:
        return ",".join(filter(None, (self.force, self.moment, self.pressure)))

    @classmethod
    def parse(cls, text: str) -> "PlateUnits":
        """Parse "N,Nmm", or "N,Nmm,mm" with the unit of centres of pressure.

        Raises
        ------
        ValueError
            There are not two or three units, or one of them is unknown.
        """
        units = [unit.strip() for unit in text.split(",")]
        if len(units) not in (2, 3):
            raise ValueError(
                f"units of force and moment are needed, such as {EXAMPLE}, got {short(text)!r}"
            )
        for unit, convert in zip(units, (force_in_n, moment_in_nm, length_in_m), strict=False):
            convert(unit)
        return cls(*units)


@dataclass(frozen=True, slots=True)
class Stated:
    """How files are to be read; by default as they say themselves.

    Attributes
    ----------
    axes
        Lab directions of the files' x, y and z axis, such as "left,back,up".
    rename
        Label in the files, without subject prefix -> label wanted. A label that a file does not
        have is a note.
    label_prefix
        Prefix of the subject wanted, or its number, where several carry the same labels.
    units
        Unit of the markers' positions, such as "mm".
    plate_units
        Units of the plates' forces and moments, such as "N,Nmm", and of centres of pressure as a
        third one.
    marker_set
        The set whose landmarks show how the subject stands.
    marker_stream
        Name of the stream that holds the markers, where several of an XDF file do.

    Examples
    --------
    >>> import pipeline
    >>> stated = pipeline.Stated(units="mm", rename={"LASI": "LASIS"})
    >>> metre, notes = stated.marker_unit("")
    >>> metre
    0.001
    >>> print(*notes)
    unit of the markers: mm, as stated; the file says nothing
    """

    axes: str | None = None
    rename: Mapping[str, str] = field(default_factory=dict, hash=False)
    label_prefix: str | None = None
    units: str | None = None
    plate_units: str | None = None
    marker_set: MarkerSet | None = field(default=None, hash=False)
    marker_stream: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "rename", MappingProxyType(dict(self.rename)))
        if self.units is not None:
            length_in_m(self.units)
        if self.plate_units is not None:
            PlateUnits.parse(self.plate_units)

    def marker_unit(self, unit: str) -> tuple[float, tuple[Note, ...]]:
        """Give the unit of marker positions in metres, and what is to be said about it.

        Parameters
        ----------
        unit
            As the file states it; empty where it does not.

        Returns
        -------
        metre
            One of the stated unit, else of the file's [m].
        notes
            ``units_stated`` or ``units_overruled`` where a stated unit is not the file's.

        Raises
        ------
        ValueError
            None is stated and the file's is unknown; the message says how to state it.
        """
        if self.units is not None:
            written = [(self.units, unit, length_in_m)]
            return length_in_m(self.units), _stated_notes("markers", self.units, written)
        try:
            return length_in_m(unit), ()
        except ValueError as error:
            raise ValueError(f"{error}; {STATE_UNITS}") from error

    def check_span(self, position: Array, unit: str) -> None:
        """Refuse positions, (T, M, 3) [m], whose extent contradicts their unit.

        Parameters and errors are those of `pipeline.io.units.check_span`; ``unit`` is the file's.
        """
        check_span(position, self.units or unit, stated=self.units is not None)

    def force_unit(self, unit: str) -> float:
        """Give the unit of a plate's force, which the file states as `unit`, in newtons.

        Raises
        ------
        ValueError
            None is stated and the file's is unknown; the message says how to state it. The same
            holds of `moment_unit` and `pressure_unit`.
        """
        return _convert(force_in_n, self._plates.force if self._plates else unit)

    def moment_unit(self, unit: str) -> float:
        """Give the unit of a plate's moment in newton metres."""
        return _convert(moment_in_nm, self._plates.moment if self._plates else unit)

    def pressure_unit(self, unit: str) -> float:
        """Give the unit of a plate's centre of pressure in metres."""
        return _convert(length_in_m, self._pressure(unit))

    def plate_notes(
        self, forces: Iterable[str], moments: Iterable[str] = (), pressures: Iterable[str] = ()
    ) -> tuple[Note, ...]:
        """Give notes on the units of plates as `marker_unit` does, from those that files state."""
        plates = self._plates
        if plates is None:
            return ()
        written = [
            *((plates.force, unit, force_in_n) for unit in forces),
            *((plates.moment, unit, moment_in_nm) for unit in moments),
            *((self._pressure(unit), unit, length_in_m) for unit in pressures),
        ]
        return _stated_notes("plates", str(plates), written)

    @property
    def _plates(self) -> PlateUnits | None:
        return PlateUnits.parse(self.plate_units) if self.plate_units is not None else None

    def _pressure(self, unit: str) -> str:
        plates = self._plates
        if plates is None or (plates.pressure is None and _is_length(unit)):
            return unit
        return plates.pressure or length_of_moment(plates.moment)


def as_stated(stated: Stated | str | None) -> Stated:
    """Give what is stated about a file; a text states its axes alone."""
    return stated if isinstance(stated, Stated) else Stated(axes=stated)


def _convert(convert: Callable[[str], float], unit: str) -> float:
    try:
        return convert(unit)
    except ValueError as error:
        raise ValueError(f"{error}; {STATE_PLATE_UNITS}") from error


def _is_length(unit: str) -> bool:
    try:
        length_in_m(unit)
    except ValueError:
        return False
    return True


def _stated_notes(
    quantity: str, stated: str, units: Iterable[tuple[str, str, Callable[[str], float]]]
) -> tuple[Note, ...]:
    """Note the units of a file in whose place others are stated.

    Parameters
    ----------
    quantity, stated
        What has the stated units, and those.
    units
        Stated unit, unit in the file, and what converts either to SI.
    """
    other, unknown = [], []
    for used, written, convert in units:
        try:
            if convert(written) != convert(used):
                other.append(written)
        except ValueError:
            unknown.append(written or "nothing")
    if not other and not unknown:
        return ()
    code = "units_overruled" if other else "units_stated"
    written = listed(dict.fromkeys([*other, *unknown]))
    return (Note.of(code, quantity=quantity, stated=stated, written=written),)
