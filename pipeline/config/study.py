"""A study as people state it: one TOML for the study, one per subject; all faults found at once.

``study.toml`` names the laboratory, the settings and the conditions; every other TOML in the folder
is a subject. File names in them are relative to the folder.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hbm.coordinates import MOVING
from hbm.markers import MarkerSet, did_you_mean, marker_sets, read_marker_set
from hbm.overrides import SegmentOverride, read_overrides
from pipeline.config.schema import (
    Condition,
    StudyFile,
    SubjectFile,
)
from pipeline.config.validation import StudyFaults, describe_faults


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
    if folder.is_file():
        raise StudyFaults([f"{folder}: is a file; a study is a folder with study.toml in it"])
    if not (folder / "study.toml").is_file():
        raise StudyFaults([f"{folder}: no study.toml here; write one with 'hbm init {folder}'"])
    faults: list[str] = []
    stated = _load(folder / "study.toml", faults)
    file = _checked("study.toml", stated, StudyFile, faults)
    conditions = stated.get("conditions") if stated is not None else None
    subjects: dict[str, SubjectFile] = {}
    for path in _subject_paths(folder):
        table = _load(path, faults)
        if table is None or _no_subject(table):
            continue
        subject = _checked(path.name, table, SubjectFile, faults)
        faults += _trial_faults(folder, path.name, table, conditions)
        if subject is not None:
            faults += _body_faults(folder, path.name, subject, file)
            if subject.id in subjects:
                faults.append(f"{path.name}: id: {subject.id!r} is already taken by another file")
            subjects[subject.id] = subject
    if not subjects and not faults:
        faults.append(f"{folder}: no subject files (one TOML per subject beside study.toml)")
    elif not faults and not any(person.trials for person in subjects.values()):
        faults.append(f"{folder}: no subject has a trial; state them as [trials.CONDITION]")
    faults += _same_names(subjects)
    own_set = None
    if file is not None:
        own_set = _own_marker_set(folder, file, faults)
        faults += _treadmill_faults(folder, file)
    if faults or file is None:
        raise StudyFaults(faults)
    return Study(folder, file, subjects, own_set)


def _subject_paths(folder: Path) -> list[Path]:
    paths = sorted(folder.glob("*.toml"))
    return [path for path in paths if path.name != "study.toml" and path.name[0] != "."]


def _no_subject(table: dict[str, Any]) -> bool:
    """Tell a marker set or a table of segments beside the subjects."""
    return "trials" not in table and not table.keys().isdisjoint(("markers", *MOVING))


def _body_faults(
    folder: Path, name: str, subject: SubjectFile, file: StudyFile | None
) -> list[str]:
    """Hold what is stated of a subject's body against the settings and the folder."""
    faults = []
    if subject.segments and (folder / subject.segments).is_file():
        try:
            read_segments(folder / subject.segments)
        except ValueError as error:
            faults.append(f"{name}: segments: {error}")
    functional = file is not None and file.settings.hip == "functional"
    if functional and subject.hip_trial is None:
        faults.append(
            f'{name}: hip_trial: is missing; study.toml says settings.hip = "functional", which '
            "needs a recording in which the thighs swing"
        )
    if file is not None and not functional and subject.hip_trial is not None:
        faults.append(
            f'{name}: hip_trial: is of no use unless study.toml says settings.hip = "functional"'
        )
    return faults


def _load(path: Path, faults: list[str]) -> dict[str, Any] | None:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        faults.append(f"{path.name}: not valid TOML: {error}")
    except UnicodeDecodeError as error:
        faults.append(f"{path.name}: is not saved as UTF-8: {error.reason} at {error.start}")
    except OSError as error:
        faults.append(f"{path.name}: cannot be read: {error.strerror}")
    return None


def _checked(name: str, table: dict[str, Any] | None, kind: type[Any], faults: list[str]) -> Any:
    if table is None:
        return None
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        faults += [f"{name}: {fault}" for fault in describe_faults(error, kind)]
        return None


def _same_names(subjects: Mapping[str, SubjectFile]) -> list[str]:
    """Find trials whose results would be written to the same file."""
    taken: dict[str, str] = {}
    faults = []
    for subject, person in subjects.items():
        for condition in person.trials:
            name = f"{subject}_{condition}"
            other = taken.setdefault(name.casefold(), f"{subject} {condition}")
            if other != f"{subject} {condition}":
                faults.append(
                    f"the results of {subject} {condition} and of {other} would both be called "
                    f"{name}; rename the subject or the condition"
                )
    return faults


def _treadmill_faults(folder: Path, file: StudyFile) -> list[str]:
    """Hold the treadmill against the folder and the conditions."""
    treadmill, platform, faults = file.treadmill, file.treadmill.platform, []
    if treadmill.calibration:
        faults += _missing(folder, "study.toml: treadmill.calibration", treadmill.calibration)
    if treadmill.belt is not None:
        where = "study.toml: treadmill.belt.calibration"
        faults += _missing(folder, where, treadmill.belt.calibration)
    if platform is not None:
        where = "study.toml: treadmill.platform"
        if platform.markers and platform.channels:
            faults.append(f"{where}: give either markers or channels, not both")
        elif not platform.markers and not platform.channels:
            faults.append(f"{where}: give its markers, or its sway_channel or pitch_channel")
        elif 0 < len(set(platform.markers)) < 3:
            said = ", ".join(platform.markers)
            faults.append(f"{where}.markers: three different ones at least, got {said}")
    for name, condition in file.conditions.items():
        if condition.perturbed and condition.pulse_channel is None and platform is None:
            faults.append(
                f"study.toml: conditions.{name}: perturbed needs a pulse_channel, or "
                "treadmill.platform to tell when the perturbations were"
            )
    return faults


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
            hint = did_you_mean(condition, known) or f"; there are {', '.join(known)}"
            faults.append(f"{where}: no such condition in study.toml{hint}")
        if not isinstance(trial, dict) or "exclude" in trial:
            continue
        if "file" not in trial:
            faults.append(f'{where}: needs a file, or exclude = "the reason why there is none"')
        for key in ("file", "forces", "record"):
            if trial.get(key) and isinstance(trial[key], str):
                faults += _missing(folder, f"{where}.{key}", trial[key])
    for key in ("static", "hip_trial", "segments"):
        if table.get(key) and isinstance(table[key], str):
            faults += _missing(folder, f"{name}: {key}", table[key])
    return faults


def _missing(folder: Path, where: str, name: str) -> list[str]:
    if (folder / name).is_file():
        return []
    near = did_you_mean(name, [p.name for p in folder.glob("*") if p.suffix != ".toml"])
    return [f"{where}: no file {name!r} in {folder}{near}"]


def read_segments(path: Path) -> dict[str, SegmentOverride]:
    """Read what is known of single segments from a TOML file; raises as `read_overrides`."""
    return read_overrides(path.read_text(encoding="utf-8-sig"), path.name)
