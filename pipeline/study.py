"""A study as people state it: one TOML for the study, one per subject; all faults found at once.

``study.toml`` names the laboratory, the settings and the conditions; every other TOML in the folder
is a subject. File names in them are relative to the folder.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hbm.filtering import Method
from hbm.markers import MarkerSet, did_you_mean, marker_sets, read_marker_set
from hbm.segments import Sex

Name = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
Point = tuple[float, float, float]


class Stated(BaseModel):
    """Base of everything a person types: immutable, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Settings(Stated):
    """How trials are processed; printed with every result."""

    cutoff_hz: Annotated[float, Field(gt=0, le=50)] = 6.0
    filter: Method = "zero_phase"
    marker_set: str | None = None
    hip: Literal["harrington", "bell"] = "harrington"
    marker_offset_m: Annotated[float, Field(ge=0, le=0.05)] = 0.009
    plate_delay_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    contact_threshold_n: Annotated[float, Field(gt=0, le=200)] = 30.0


class Subject(Stated):
    """Who walked."""

    id: Name = "subject"
    sex: Sex = "unspecified"
    mass_kg: Annotated[float, Field(ge=10, le=400)] | None = None
    height_m: Annotated[float, Field(ge=0.5, le=2.6)] | None = None
    age_years: Annotated[float, Field(ge=0, le=120)] | None = None


class Platform(Stated):
    """How the platform's pose is known: by markers on it, or by its commanded motion."""

    markers: tuple[str, ...] = ()
    sway_channel: str | None = None
    pitch_channel: str | None = None
    pivot_m: Point = (0.0, 0.0, 0.0)
    delay_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0


class Treadmill(Stated):
    """The machine: its accelerometers, its calibration, its platform."""

    calibration: str | None = None
    accelerometers: dict[Name, tuple[str, str, str]] = Field(default_factory=dict)
    accelerometer_unit: str | None = None
    accelerometer_delay_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    cutoff_hz: Annotated[float, Field(gt=0, le=100)] = 20.0
    platform: Platform | None = None


class Condition(Stated):
    """Which gait cycles of a condition count."""

    cycles: Annotated[int, Field(ge=1)] | None = None
    perturbed: bool = False
    pulse_channel: str | None = None
    skip_s: Annotated[float, Field(ge=0)] = 0.0


class Trial(Stated):
    """One recording, or the reason why there is none."""

    file: str | None = None
    exclude: str | None = None


class StudyFile(Stated):
    """What ``study.toml`` says."""

    name: str = "study"
    axes: str | None = None
    rename: dict[str, str] = Field(default_factory=dict)
    settings: Settings = Settings()
    treadmill: Treadmill = Treadmill()
    conditions: dict[Name, Condition]


class SubjectFile(Subject):
    """What a subject's file says."""

    static: str | None = None
    trials: dict[str, Trial]

    @property
    def person(self) -> Subject:
        """The subject alone, without files."""
        return Subject.model_validate({name: getattr(self, name) for name in Subject.model_fields})


class StudyFaults(ValueError):
    """Everything that is wrong with a study's files; ``faults`` holds one line each."""

    def __init__(self, faults: list[str]) -> None:
        self.faults = tuple(faults)
        super().__init__("; ".join(faults))


@dataclass(frozen=True, slots=True)
class Study:
    """A whole study, checked.

    Attributes
    ----------
    folder
        Where its files are.
    file
        What ``study.toml`` says.
    subjects
        Subject id -> what its file says, in order of the file names.
    marker_set
        A marker set of one's own; None for a shipped one.
    """

    folder: Path
    file: StudyFile
    subjects: Mapping[str, SubjectFile]
    marker_set: MarkerSet | None

    def path(self, name: str) -> Path:
        """Give a file of the study."""
        return self.folder / name

    def subject(self, subject: str) -> SubjectFile:
        """Give a subject; a ValueError names those that exist."""
        if subject not in self.subjects:
            hint = did_you_mean(subject, self.subjects)
            raise ValueError(f"no subject {subject!r}{hint}; there are {', '.join(self.subjects)}")
        return self.subjects[subject]

    def condition(self, condition: str) -> Condition:
        """Give a condition; a ValueError names those that exist."""
        known = self.file.conditions
        if condition not in known:
            hint = did_you_mean(condition, known)
            raise ValueError(f"no condition {condition!r}{hint}; there are {', '.join(known)}")
        return known[condition]


def read_study(folder: str | Path) -> Study:
    """Read a study's TOML files.

    Parameters
    ----------
    folder
        Folder with ``study.toml`` and one TOML per subject, or ``study.toml`` itself.

    Returns
    -------
    Study
        Everything that was stated, checked.

    Raises
    ------
    StudyFaults
        If anything is wrong: all faults of all files, one line each with file, key, value, what is
        allowed and, for a misspelt word, the nearest known one.
    """
    folder = Path(folder)
    if folder.name == "study.toml":
        folder = folder.parent
    if not (folder / "study.toml").is_file():
        raise StudyFaults([f"{folder}: no study.toml here; write one with 'hbm init {folder}'"])
    faults: list[str] = []
    stated = _load(folder / "study.toml", faults)
    file = _checked(folder / "study.toml", stated, StudyFile, faults)
    subjects: dict[str, SubjectFile] = {}
    paths = [path for path in sorted(folder.glob("*.toml")) if path.name != "study.toml"]
    tables = {path: _load(path, faults) for path in paths}
    tables = {path: table for path, table in tables.items() if "markers" not in table}
    for path, table in tables.items():
        subject = _checked(path, table, SubjectFile, faults)
        faults += _trial_faults(folder, path.name, table, stated.get("conditions"))
        if subject is None:
            continue
        if subject.id in subjects:
            faults.append(f"{path.name}: id: {subject.id!r} is already taken by another file")
        subjects[subject.id] = subject
    if not tables:
        faults.append(f"{folder}: no subject files (one TOML per subject beside study.toml)")
    own_set = _own_marker_set(folder, file, faults) if file is not None else None
    if file is not None and file.treadmill.calibration:
        faults += _missing(folder, "study.toml: treadmill.calibration", file.treadmill.calibration)
    if faults or file is None:
        raise StudyFaults(faults)
    return Study(folder, file, subjects, own_set)


def _load(path: Path, faults: list[str]) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        faults.append(f"{path.name}: not valid TOML: {error}")
    except (OSError, UnicodeDecodeError) as error:
        faults.append(f"{path.name}: cannot be read: {error}")
    return {}


def _checked(path: Path, table: dict[str, Any], kind: type[Any], faults: list[str]) -> Any:
    if not table:
        return None
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        faults += [f"{path.name}: {fault}" for fault in describe_faults(error, kind)]
        return None


def describe_faults(error: ValidationError, kind: type[BaseModel]) -> list[str]:
    """Say pydantic's findings, one line each.

    Parameters
    ----------
    error
        What pydantic raised.
    kind
        The model that was validated, for the words that it knows.

    Returns
    -------
    list[str]
        "key: what is wrong", with the value and the nearest known word where there is one.
    """
    said = []
    for fault in error.errors():
        key = ".".join(str(part) for part in fault["loc"])
        value = fault["input"]
        if fault["type"] == "extra_forbidden":
            known = _known_keys(kind, fault["loc"][:-1])
            hint = did_you_mean(str(fault["loc"][-1]), known) or f"; known: {', '.join(known)}"
            said.append(f"{key}: unknown key{hint}")
        elif fault["type"] == "missing":
            said.append(f"{key}: is missing")
        else:
            text = fault["msg"][0].lower() + fault["msg"][1:]
            said.append(f"{key}: {text}, got {value!r}{_unit_hint(key, value)}")
    return said


def _unit_hint(key: str, value: Any) -> str:
    if not isinstance(value, int | float):
        return ""
    if key.endswith("mass_kg") and value > 1000:
        return " (that looks like grams; give kilograms)"
    if key.endswith("height_m") and value > 50:
        return f" (that looks like {'millimetres' if value > 500 else 'centimetres'}; give metres)"
    return ""


def _known_keys(kind: Any, location: tuple[int | str, ...]) -> list[str]:
    """Find the keys that are allowed at a place in a model."""
    for part in location:
        fields = getattr(kind, "model_fields", {})
        if part not in fields:
            continue
        kind = next((t for t in _models(fields[str(part)].annotation)), kind)
    return list(getattr(kind, "model_fields", {}))


def _models(annotation: Any) -> list[type[BaseModel]]:
    """Find the models inside an annotation such as ``dict[str, Trial]`` or ``Platform | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for inner in getattr(annotation, "__args__", ()) for m in _models(inner)]


def _own_marker_set(folder: Path, file: StudyFile, faults: list[str]) -> MarkerSet | None:
    name = file.settings.marker_set
    if name is None or name in marker_sets():
        return None
    path = folder / name
    if not path.is_file():
        known = ", ".join(marker_sets())
        faults.append(
            f"study.toml: settings.marker_set: {name!r} is neither a file here nor one of {known}"
        )
        return None
    try:
        return read_marker_set(path.read_text(encoding="utf-8-sig"), path.stem)
    except ValueError as error:
        faults.append(f"{path.name}: {error}")
        return None


def _trial_faults(folder: Path, name: str, table: dict[str, Any], known: Any) -> list[str]:
    """Hold a subject's table against the conditions and the folder, whatever else is wrong."""
    faults = []
    trials = table.get("trials", {})
    for condition, trial in trials.items() if isinstance(trials, dict) else ():
        where = f"{name}: trials.{condition}"
        if isinstance(known, dict) and condition not in known:
            hint = did_you_mean(condition, known)
            faults.append(f"{where}: no such condition in study.toml{hint}")
        if not isinstance(trial, dict):
            continue
        if not trial.get("file") and not trial.get("exclude"):
            faults.append(f'{where}: needs a file, or exclude = "the reason why there is none"')
        elif not trial.get("exclude"):
            faults += _missing(folder, f"{where}.file", str(trial["file"]))
    if isinstance(table.get("static"), str):
        faults += _missing(folder, f"{name}: static", table["static"])
    return faults


def _missing(folder: Path, where: str, name: str) -> list[str]:
    if (folder / name).is_file():
        return []
    near = did_you_mean(name, [p.name for p in folder.glob("*")])
    return [f"{where}: no file {name!r} in {folder}{near}"]
