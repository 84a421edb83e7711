"""TOML files that a person wrote: read, checked, and what is wrong said as how to correct it."""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

from pydantic import AfterValidator, BaseModel, Field, ValidationError, ValidationInfo
from pydantic_core import ErrorDetails

from hbm.segments import SegmentOverride, read_overrides
from hbm.spelling import Table, did_you_mean, listed, parse_toml, short, shown
from pipeline.io.input_file import fault_line, is_file, naming, read_text

SIMULATED: Final = "truth/setting.toml"
"""Where a simulated study states what was simulated, relative to its folder."""
Model = TypeVar("Model", bound=BaseModel)
Option = str | float | bool | None | Path | Sequence[str] | Mapping[str, str | tuple[str, str, str]]
"""Value of an option of the command line."""
NO_LONGER_NEEDED: Final = {"engine": "there is one engine of the inverse dynamics"}
"""Keys of older studies that state nothing now -> what is done instead."""


class StudyFaults(ValueError):
    """Everything that is wrong with a study's files; ``faults`` holds one line each.

    ``filename`` is the file in the folder that all of them are about, else the folder.
    """

    def __init__(self, faults: list[str], folder: Path | None = None) -> None:
        self.faults = tuple(map(fault_line, faults))
        names = {fault.partition(": ")[0] for fault in faults}
        path = folder / names.pop() if folder and len(names) == 1 else None
        self.filename = path if path and is_file(path) else folder
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
    raise StudyFaults([f"{path.name}: {fault}"], path.parent)


@dataclass(frozen=True, slots=True)
class Around:
    """What a file of a study stands among, against which it is checked.

    Attributes
    ----------
    folder
        Where the files are that it names.
    recordings
        Whether those of subjects and trials have to be there.
    conditions, hips
        Names of the study's conditions; None where unknown. Its rules for hips, and those of its
        variants.
    """

    folder: Path
    recordings: bool = True
    conditions: Collection[str] | None = None
    hips: Collection[str] = ()


def check_table(
    name: str, table: Table, kind: type[Model], faults: list[str], around: Around
) -> Model | None:
    """Check the contents of the file `name`; what is wrong is added to the faults.

    None where it is wrong by itself, whatever it stands among.
    """
    faults_of_table, model = dict[str, None](), None
    for context in (around, None):
        try:
            model = model or kind.model_validate(table, context=context)
        except ValidationError as error:
            faults_of_table |= dict.fromkeys(describe_faults(error, kind, table))
    faults += [f"{name}: {fault}" for fault in faults_of_table]
    return model


def read_segments(path: Path) -> dict[str, SegmentOverride]:
    """Read segment overrides from a TOML file; raises as `read_overrides`."""
    with naming(path):
        return read_overrides(read_text(path), path.name)


def nearest(name: object, names: Iterable[str]) -> str:
    """Give the known name that is nearest to another, or else all, as the end of a message."""
    names = [*names]
    return did_you_mean(name, names) or f"; there are {listed(names)}"


def require_file(folder: Path, name: str) -> None:
    """Refuse the name of a file that is not in the folder, with the nearest that is: ValueError."""
    if not is_file(folder / name):
        near = did_you_mean(name, [p.name for p in folder.glob("*") if p.suffix != ".toml"])
        raise ValueError(f"no file {short(name, 100)!r} in {folder}{near}")


def _among(check: Callable[[str, Around, Mapping[str, Any]], None]) -> AfterValidator:
    """Check a text against what its file stands among, and the keys that are stated before it."""

    def validate(text: str, info: ValidationInfo) -> str:
        if info.context is not None:
            check(text, info.context, info.data)
        return text

    return AfterValidator(validate)


def _recorded(name: str, around: Around, keys: Mapping[str, Any]) -> None:
    if around.recordings and not keys.get("exclude"):
        require_file(around.folder, name)


def _readable(name: str, around: Around, keys: Mapping[str, Any]) -> None:
    if is_file(around.folder / name):
        read_segments(around.folder / name)


def _known(name: str, around: Around, keys: Mapping[str, Any]) -> None:
    conditions = around.conditions
    if conditions is not None and name not in conditions:
        raise ValueError(f"no such condition in study.toml{nearest(name, conditions)}")


Named = Annotated[str, Field(min_length=1)]
FileName = Annotated[Named, _among(lambda name, around, _: require_file(around.folder, name))]
"""Of a file of the laboratory, in the study's folder."""
RecordingName = Annotated[Named, _among(_recorded)]
"""Of a file about a subject, in the study's folder, unless the trial is excluded."""
SegmentsName = Annotated[RecordingName, _among(_readable)]
ConditionName = Annotated[str, _among(_known)]


def describe_faults(error: ValidationError, kind: type[BaseModel], table: object) -> list[str]:
    """Describe pydantic's findings on a model, each as "key: what is wrong, nearest known word"."""
    return [_line(fault, kind, _place(fault["loc"], table)) for fault in error.errors()]


def check_options(kind: type[Model], options: Mapping[str, Option]) -> Model:
    """Check what was typed as options of the command line: ``--cutoff-hz`` is ``cutoff_hz``.

    A ValueError names every option at fault, and why.
    """
    try:
        return kind.model_validate(options)
    except ValidationError as error:
        faults = [fault.partition(":") for fault in describe_faults(error, kind, options)]
        lines = [f"--{key.replace('_', '-')}:{fault}" for key, _, fault in faults]
        raise ValueError("; ".join(lines)) from error


def _place(location: tuple[int | str, ...], table: object) -> list[str]:
    """Give the keys that lead to a place as they are stated, and numbers in lists from 1."""
    place, inner = [], table
    for part in location:
        if isinstance(part, int) and isinstance(inner, Mapping):
            continue  # one table, where a list of tables is possible
        if part != "[key]":
            place.append(str(part + 1) if isinstance(part, int) else part)
        if isinstance(inner, Mapping):
            inner = inner.get(part)
        elif isinstance(inner, list) and isinstance(part, int):
            inner = inner[part] if part < len(inner) else None
    return place


def _line(fault: ErrorDetails, kind: type[BaseModel], place: Sequence[str]) -> str:
    key = ".".join(short(part) for part in place)
    value = fault["input"]
    if fault["type"] == "extra_forbidden" and place[-1] in NO_LONGER_NEEDED:
        return f"{key}: no longer needed: {NO_LONGER_NEEDED[place[-1]]}; remove it"
    if fault["type"] == "extra_forbidden":
        keys = _known_keys(kind, fault["loc"][:-1])
        elsewhere = _place_of(place[-1], kind)
        hint = elsewhere or did_you_mean(place[-1], keys) or f"; known: {', '.join(keys)}"
        return f"{key}: unknown key{hint}"
    if fault["type"] == "missing":
        return f"{key}: is missing"
    if fault["type"] == "value_error":
        text = fault["msg"].removeprefix("Value error, ")
        return f"{key}: {text}" if key else text
    if fault["type"] == "string_pattern_mismatch":
        return f"{key}: must be letters, digits, '_', '-' and '.', got {shown(value)}"
    if fault["type"] == "float_parsing":
        return f"{key}: expected a number such as 45.8, got {shown(value)}"
    text = fault["msg"][0].lower() + fault["msg"][1:].replace("valid tuple", "list")
    name = next(part for part in reversed(place) if not part.isdecimal())
    return f"{key}: {text}, got {shown(value)}{_hint(fault, name)}"


def _hint(fault: ErrorDetails, key: str) -> str:
    """Give the nearest allowed word, or the unit of a number that is beyond its bounds."""
    if fault["type"] == "literal_error" and isinstance(fault["input"], str):
        return did_you_mean(fault["input"], re.findall(r"'(.*?)'", fault["ctx"]["expected"]))
    units = {"_kg": "kilograms", "_m": "metres", "_s": "seconds"}
    unit = next((unit for suffix, unit in units.items() if key.endswith(suffix)), None)
    beyond = fault["type"] in ("less_than_equal", "greater_than_equal")
    return f" (it is in {unit})" if beyond and unit else ""


def _place_of(key: str, kind: type[BaseModel]) -> str:
    """Say where in a file a key belongs, as the end of a message; empty if nowhere."""
    if key in kind.model_fields:
        return "; it belongs above the first [table]"
    inner = ((name, models_in(field.annotation)) for name, field in kind.model_fields.items())
    tables = [name for name, models in inner for model in models if key in model.model_fields]
    return f"; it belongs in [{tables[0]}]" if tables else ""


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
