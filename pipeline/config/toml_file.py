"""TOML files that a person wrote: read, checked, and what is wrong said as how to correct it."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from hbm.segments import SegmentOverride, read_overrides
from hbm.spelling import Table, did_you_mean, parse_toml, short, shown
from pipeline.io.input_file import fault_line, is_file, naming, read_text

SIMULATED: Final = "truth/setting.toml"
"""Where a simulated study states what was simulated, relative to its folder."""
MAX_FILE_NAME: Final = 100
"""Characters of a file's name in a message."""
MAX_TYPED: Final = 1e9
"""In any unit; beyond it a number is no quantity in another unit."""
Model = TypeVar("Model", bound=BaseModel)
Option = str | float | bool | None | Path | Sequence[str] | Mapping[str, str | tuple[str, str, str]]
"""Value of an option of the command line."""
UNIT_NAMES: Final = {"_kg": "kilograms", "_m": "metres", "_s": "seconds"}
SMALLER_UNITS: Final = {
    "_kg": {1000: "grams"},
    "_m": {100: "centimetres", 1000: "millimetres"},
    "_s": {1000: "milliseconds"},
}
"""Suffix of a key -> how many of a smaller unit make one, and the unit's name."""


class StudyFaults(ValueError):
    """Everything that is wrong with a study's files; ``faults`` holds one line each."""

    def __init__(self, faults: list[str]) -> None:
        self.faults = tuple(map(fault_line, faults))
        super().__init__("; ".join(self.faults))


def read_table(path: Path) -> Table:
    """Read a TOML file; StudyFaults if it cannot be read, is not UTF-8 or not TOML."""
    try:
        return parse_toml(read_text(path))
    except UnicodeDecodeError as error:
        fault = f"is not saved as UTF-8: {error.reason} at byte {error.start}"
    except ValueError as error:
        fault = f"not valid TOML: {error}"
    except OSError as error:
        fault = f"cannot be read: {error.strerror}"
    raise StudyFaults([f"{path.name}: {fault}"])


def check_table(name: str, table: Table, kind: type[Model]) -> Model:
    """Check the contents of the file `name` against a type; StudyFaults holds all findings."""
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        raise StudyFaults([f"{name}: {fault}" for fault in describe_faults(error, kind)]) from error


def read_segments(path: Path) -> dict[str, SegmentOverride]:
    """Read segment overrides from a TOML file; raises as `read_overrides`."""
    with naming(path):
        return read_overrides(read_text(path), path.name)


def missing_file(folder: Path, where: str, name: str) -> list[str]:
    """Report a file that is not in the folder, with the nearest name that is, as faults.

    ``where`` is the file and the key that name it; it may be empty.
    """
    if is_file(folder / name):
        return []
    near = did_you_mean(name, [p.name for p in folder.glob("*") if p.suffix != ".toml"])
    place = f"{where}: " if where else ""
    return [f"{place}no file {short(name, MAX_FILE_NAME)!r} in {folder}{near}"]


def describe_faults(error: ValidationError, kind: type[BaseModel]) -> list[str]:
    """Describe pydantic's findings on a model, each as "key: what is wrong, nearest known word"."""
    return [_line(fault, kind) for fault in error.errors()]


def check_options(kind: type[Model], options: Mapping[str, Option]) -> Model:
    """Check what was typed as options of the command line: ``--cutoff-hz`` is ``cutoff_hz``.

    A ValueError names every option at fault, and why.
    """
    try:
        return kind.model_validate(options)
    except ValidationError as error:
        faults = [fault.partition(":") for fault in describe_faults(error, kind)]
        lines = [f"--{key.replace('_', '-')}:{fault}" for key, _, fault in faults]
        raise ValueError("; ".join(lines)) from error


def _line(fault: ErrorDetails, kind: type[BaseModel]) -> str:
    place = [part for part in fault["loc"] if part != "[key]"]
    key = ".".join(short(part) for part in place)
    value = fault["input"]
    if fault["type"] == "extra_forbidden":
        known = _known_keys(kind, fault["loc"][:-1])
        hint = did_you_mean(place[-1], known) or f"; known: {', '.join(known)}"
        return f"{key}: unknown key{hint}"
    if fault["type"] == "missing":
        return f"{key}: is missing"
    if fault["type"] == "value_error":
        text = fault["msg"].removeprefix("Value error, ")
        return f"{key}: {text}" if key else text
    if fault["type"] == "string_pattern_mismatch":
        return f"{key}: must be letters, digits, '_', '-' and '.', got {shown(value)}"
    text = fault["msg"][0].lower() + fault["msg"][1:].replace("valid tuple", "list")
    name = next(part for part in reversed(place) if isinstance(part, str))
    return f"{key}: {text}, got {shown(value)}{_hint(fault, name)}"


def _hint(fault: ErrorDetails, key: str) -> str:
    """Give the nearest allowed word, or the unit in which a number would be within its bounds."""
    allowed, value = fault.get("ctx", {}), fault["input"]
    if fault["type"] == "literal_error" and isinstance(value, str):
        return did_you_mean(value, re.findall(r"'(.*?)'", allowed["expected"]))
    if isinstance(value, int | float) and value < 0 <= allowed.get("ge", -1):
        return ""
    bound = abs(allowed.get("le", allowed.get("ge", 0)))
    suffix = next((s for s in SMALLER_UNITS if key.endswith(s)), None)
    if suffix is None or not isinstance(value, int | float):
        return ""
    if not bound < abs(value) < MAX_TYPED:
        return ""
    for scale, unit in SMALLER_UNITS[suffix].items():
        if abs(value) / scale <= bound:
            return f" (that looks like {unit}; give {UNIT_NAMES[suffix]})"
    return ""


def _known_keys(kind: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Find the keys that are allowed at a place in a model."""
    for part in location:
        if part in kind.model_fields:
            kind = next(iter(models_in(kind.model_fields[str(part)].annotation)), kind)
    return list(kind.model_fields)


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Find the models inside an annotation such as ``dict[str, Trial]`` or ``Platform | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for inner in getattr(annotation, "__args__", ()) for m in models_in(inner)]
