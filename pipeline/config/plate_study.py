"""Experiment 1 as people state it: ``plates.toml`` names recordings of known weights."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, field_validator

from hbm.markers import did_you_mean
from pipeline.config.schema import Stated, Text
from pipeline.config.validation import StudyFaults, describe_faults
from pipeline.io.axes import parse_axes

FILE = "plates.toml"
Belt = Literal["left", "right"]


class Weight(Stated):
    """One recording of a known weight that the belt carries to and fro."""

    file: Text
    mass_kg: Annotated[float, Field(gt=0, le=500)]
    speed_mps: Annotated[float, Field(ge=0, le=5)]
    profile: Literal["constant", "sine", "square"]
    position_m: Annotated[float, Field(ge=-2, le=2)]
    belt: Belt
    supports: bool = True


class Static(Stated):
    """A weight put down at many places, one after the other."""

    file: Text
    belt: Belt


class Hammer(Stated):
    """Blows with a hammer that carries a marker."""

    file: Text
    belt: Belt


class Limits(Stated):
    """What plates for inverse dynamics may be off by."""

    cop_m: Annotated[float, Field(gt=0, le=0.1)] = 0.005
    force_n: Annotated[float, Field(gt=0, le=100)] = 7.5
    nonlinearity_percent: Annotated[float, Field(gt=0, le=20)] = 1.0
    delay_s: Annotated[float, Field(gt=0, le=0.1)] = 0.005
    angle_deg: Annotated[float, Field(gt=0, le=10)] = 0.5
    offset_m: Annotated[float, Field(gt=0, le=0.1)] = 0.003


def _numbers() -> dict[Belt, int]:
    return {"left": 1, "right": 2}


class PlatesFile(Stated):
    """What ``plates.toml`` says."""

    name: str = "plates"
    axes: Text
    marker: Text = "WEIGHT"
    hammer_marker: Text = "HAMMER"
    plate_numbers: dict[Belt, int] = Field(default_factory=_numbers)
    cutoff_hz: Annotated[float, Field(gt=0, le=100)] = 20.0
    full_scale_n: Annotated[float, Field(gt=0)] = 510.0
    center_height_m: Annotated[float, Field(ge=0, le=2)] = 0.0
    limits: Limits = Limits()
    static: Annotated[tuple[Static, ...], Field(strict=False)] = ()
    hammer: Annotated[tuple[Hammer, ...], Field(strict=False)] = ()
    weights: Annotated[tuple[Weight, ...], Field(strict=False, min_length=1)]

    @field_validator("axes")
    @classmethod
    def _right_handed(cls, axes: str) -> str:
        parse_axes(axes)
        return axes


@dataclass(frozen=True, slots=True)
class PlatesStudy:
    """Experiment 1, checked: its folder and what its file says."""

    folder: Path
    file: PlatesFile


def read_plates_study(folder: str | Path) -> PlatesStudy:
    """Read ``plates.toml``.

    Parameters
    ----------
    folder
        Folder with ``plates.toml``, or the file itself.

    Returns
    -------
    PlatesStudy
        Everything that was stated, checked.

    Raises
    ------
    StudyFaults
        If anything is wrong: all faults, one line each.
    """
    folder = Path(folder)
    folder = folder.parent if folder.suffix == ".toml" else folder
    path = folder / FILE
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        raise StudyFaults([f"{FILE}: not valid TOML: {error}"]) from error
    except UnicodeDecodeError as error:
        raise StudyFaults([f"{FILE}: is not saved as UTF-8: {error.reason}"]) from error
    except OSError as error:
        why = "" if isinstance(error, FileNotFoundError) else f" that can be read: {error.strerror}"
        raise StudyFaults([f"{folder}: no {FILE} here{why}"]) from error
    faults, file = [], None
    try:
        file = PlatesFile.model_validate(table)
    except ValidationError as error:
        faults = [f"{FILE}: {fault}" for fault in describe_faults(error, PlatesFile)]
    faults += _missing_files(folder, table)
    if faults or file is None:
        raise StudyFaults(faults)
    return PlatesStudy(folder, file)


def _missing_files(folder: Path, table: dict[str, object]) -> list[str]:
    faults = []
    there = [path.name for path in folder.glob("*") if path.suffix != ".toml"]
    for part in ("static", "hammer", "weights"):
        entries = table.get(part, [])
        for n, entry in enumerate(entries if isinstance(entries, list) else []):
            name = entry.get("file") if isinstance(entry, dict) else None
            if isinstance(name, str) and name and not (folder / name).is_file():
                near = did_you_mean(name, there)
                faults.append(f"{FILE}: {part}.{n}.file: no file {name!r} in {folder}{near}")
    return faults
