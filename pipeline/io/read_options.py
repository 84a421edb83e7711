"""What a person states about files; it is used instead of what a file says or leaves out."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final, Literal

import numpy as np

from hbm.markers import MarkerSet
from hbm.notes import Note
from hbm.spatial import Array, Indices
from hbm.spelling import listed, short
from pipeline.io.units import MAX_VALUE, force_in_n, length_in_m, length_unit, moment_in_nm

Quantity = Literal["force", "moment", "pressure"]
"""What a channel of a plate holds."""
CONVERT: Final[dict[Quantity, Callable[[str], float]]] = {
    "force": force_in_n,
    "moment": moment_in_nm,
    "pressure": length_in_m,
}
RAW_SIGNALS: Final = dict.fromkeys(("v", "mv", "uv", "volt", "volts"), "volts") | dict.fromkeys(
    ("adc", "adu", "bit", "bits", "count", "counts"), "numbers of the converter"
)
"""Unit of a plate's channel before its calibration, in lower case -> what the channel holds."""


def parse_mending(text: str) -> tuple[int, str, str]:
    """Parse what is done to one plate: its number, the deed, and with what.

    Examples
    --------
    >>> parse_mending("2: turn 90")
    (2, 'turn', '90')
    """
    pattern = (
        r"\s*(\d{1,2})\s*:\s*(?:(reverse)\s+([FM][xyz]|all)|(turn)\s+(90|180|270)"
        r"|(exchange)\s+(\d{1,2})|(unwrap)\s+([FM][xyz])|(drift)()"
        r"|(gain|zero)\s+([FM][xyz]\s+[-+]?\d+(?:\.\d+)?)"
        r"|(move)\s+([xyz]\s+[-+]?\d+(?:\.\d+)?))\s*"
    )
    match = re.fullmatch(pattern, text, re.ASCII)
    if match is None:
        raise ValueError(
            "give a correction of a plate such as 3: reverse Fx, 2: turn 90, 1: exchange 2, "
            "2: unwrap Mz, 1: gain Fz 0.97, 1: zero Fx 2.5, 1: drift or 1: move x -0.008; got "
            f"{short(text)!r}"
        )
    number, deed, what = (part for part in match.groups() if part is not None)
    return int(number), deed, what


def correction(*mendings: str) -> str:
    """Give what to set above the tables of ``study.toml``, and the options for one trial.

    Examples
    --------
    >>> correction("2: turn 90")
    'mend_plates = ["2: turn 90"] above the tables of study.toml (--mend-plates "2: turn 90")'
    """
    quoted = [f'"{mending}"' for mending in mendings]
    options = " ".join(f"--mend-plates {mending}" for mending in quoted)
    return f"mend_plates = [{', '.join(quoted)}] above the tables of study.toml ({options})"


def parse_plate_units(text: str) -> tuple[str, ...]:
    """Parse units of force and moment, "N,Nmm", or "N,Nmm,mm" with that of centres of pressure.

    A ValueError where there are not two or three units, or one of them is unknown.
    """
    units = tuple(unit.strip() for unit in text.split(","))
    if len(units) not in (2, 3):
        raise ValueError(f"units of force and moment are needed, as in N,Nmm, got {short(text)!r}")
    for unit, convert in zip(units, CONVERT.values(), strict=False):
        convert(unit)
    return units


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How files are to be read; by default as they say themselves.

    Attributes
    ----------
    axes
        Lab directions of the files' x, y and z axis, such as "left,back,up".
    axes_by
        Why these, in words; empty for axes that are tried and not to be noted.
    rename
        Label in the files, without subject prefix -> label wanted. A file may lack it
        (`Recording.labels_absent`). "static.c3d:LASI" is a label of that file alone, and "L*" ->
        "R*" all labels that begin with L where there is one that begins with R instead.
    mend_plates
        What is done to single plates, such as "2: turn 90" (`pipeline.io.mended_plates`).
    label_prefix
        Prefix of the subject wanted, or its number, where several carry the same labels.
    units
        Unit of the markers' positions, such as "mm".
    plate_units
        Units of the plates' forces and moments, such as "N,Nmm", and of centres of pressure as a
        third one; by default what the file says of these, or the moment's unit of length.
    marker_set
        The set whose landmarks show how the subject stands.
    marker_stream
        Name of the stream that holds the markers, where several of an XDF file do.

    Examples
    --------
    >>> import pipeline
    >>> stated = pipeline.ReadOptions(units="mm", rename={"LASI": "LASIS"})
    >>> stated.metre("")
    0.001
    """

    axes: str | None = None
    axes_by: str = field(default="as given", kw_only=True)
    rename: Mapping[str, str] = field(default_factory=dict, hash=False)
    label_prefix: str | None = None
    units: str | None = None
    plate_units: str | None = None
    marker_set: MarkerSet | None = field(default=None, hash=False)
    marker_stream: str | None = None
    mend_plates: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "rename", MappingProxyType(dict(self.rename)))
        if self.units is not None:
            length_in_m(self.units)
        if self.plate_units is not None:
            parse_plate_units(self.plate_units)

    def of_file(self, name: str) -> "ReadOptions":
        """Give the same for one file: with the labels to rename of that file and of all."""
        split = {key: key.rpartition(":") for key in self.rename}
        of_all = {key: new for key, new in self.rename.items() if not split[key][1]}
        alone = {split[k][2]: new for k, new in self.rename.items() if split[k][0] == name}
        return replace(self, rename=of_all | alone)

    def metre(self, unit: str) -> float:
        """Give one of the stated unit of markers, else of the file's, in metres.

        A ValueError where none is stated and the file's is unknown; it says how to state it.
        """
        try:
            return length_in_m(self.units or unit)
        except ValueError as error:
            raise ValueError(f"{error}; give it: --units, or units in study.toml") from error

    def used_unit(self, quantity: Quantity, unit: str) -> str:
        """Give the stated unit of a plate's quantity, else that of the file."""
        if self.plate_units is None:
            return unit
        force, moment, *pressure = parse_plate_units(self.plate_units)
        length = [*pressure, length_unit(unit, moment)][0]
        return {"force": force, "moment": moment, "pressure": length}[quantity]

    def plate_unit(self, quantity: Quantity, unit: str) -> float:
        """Give one of the stated unit of a plate's quantity, else of the file's, in SI units.

        A ValueError where none is stated and the file's is unknown; it says how to state it.
        """
        unit = self.used_unit(quantity, unit)
        if raw := RAW_SIGNALS.get(unit.strip().lower()):
            raise ValueError(
                f"it holds {raw} ({short(unit)}), not a {quantity}; export forces and moments, or "
                "ask the laboratory for the plate's calibration matrix and gains "
                "(FORCE_PLATFORM:CAL_MATRIX, TYPE 4); if the numbers are forces, give "
                "--plate-units N,Nmm"
            )
        try:
            return CONVERT[quantity](unit)
        except ValueError as error:
            stating = '--plate-units N,Nmm, or plate_units = "N,Nmm" in study.toml'
            raise ValueError(f"{error}; give them: {stating}") from error

    def unit_notes(self, markers: Iterable[str], plates: Iterable[str]) -> list[Note]:
        """Note stated units with what the file states in their place."""
        units = (("markers", self.units, markers), ("plates", self.plate_units, plates))
        return [
            Note.of(
                "units_stated",
                quantity=quantity,
                stated=given,
                written=listed(dict.fromkeys(unit or "nothing" for unit in written)),
            )
            for quantity, given, written in units
            if given is not None
        ]


def without_impossible(values: Array) -> Indices:
    """Make gaps of samples, (K, …), that cannot have been measured; give their numbers, (K,)."""
    impossible = np.abs(values) > MAX_VALUE
    values[impossible] = np.nan
    return np.asarray(impossible.sum(axis=tuple(range(1, values.ndim))))


def as_stated(options: ReadOptions | str | None) -> ReadOptions:
    """Give what is stated about a file; a text states its axes alone."""
    return options if isinstance(options, ReadOptions) else ReadOptions(axes=options)
