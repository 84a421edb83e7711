"""What is wrong with what a person typed, in sentences that say how to correct it."""

import re
from collections.abc import Mapping
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from hbm.spelling import did_you_mean, short, shown
from pipeline.io.input_file import fault_line

MAX_TYPED: Final = 1e9
"""In any unit; beyond it a number is no quantity in another unit."""
Model = TypeVar("Model", bound=BaseModel)
Option = str | float | bool | None | Mapping[str, str | tuple[str, str, str]]
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


def describe_faults(error: ValidationError, kind: type[BaseModel]) -> list[str]:
    """Describe pydantic's findings, one line each.

    Parameters
    ----------
    error
        What pydantic raised.
    kind
        The model that was validated, for the words that it knows.

    Returns
    -------
    list of str
        "key: what is wrong", with the value and the nearest known word where there is one.
    """
    return [_line(fault, kind) for fault in error.errors()]


def check_options(kind: type[Model], options: Mapping[str, Option]) -> Model:
    """Check what was typed as options of the command line.

    Parameters
    ----------
    kind
        The model that they state.
    options
        Its keys and values; an option is named after its key, ``--cutoff-hz`` for ``cutoff_hz``.

    Returns
    -------
    Model
        The model.

    Raises
    ------
    ValueError
        If anything is wrong: all of it, with the options' names.
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
            kind = next(iter(_models(kind.model_fields[str(part)].annotation)), kind)
    return list(kind.model_fields)


def _models(annotation: Any) -> list[type[BaseModel]]:
    """Find the models inside an annotation such as ``dict[str, Trial]`` or ``Platform | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for inner in getattr(annotation, "__args__", ()) for m in _models(inner)]
