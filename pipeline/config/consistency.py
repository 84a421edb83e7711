"""Whether the files of a study agree with each other and with the recordings in the folder."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Final

from hbm.spelling import Table, did_you_mean, listed, short
from pipeline.config.plate_correction import read_plate_correction
from pipeline.config.schema import StudyFile, SubjectFile
from pipeline.config.toml_file import read_segments
from pipeline.io.input_file import is_file

MIN_PLATFORM_MARKERS = 3
"""Fewer points do not determine the pose of a rigid body."""
MAX_FILE_NAME: Final = 100
"""Characters of a file's name in a message."""


def missing_file(folder: Path, where: str, name: str) -> list[str]:
    """Report a file that is not in the folder, with the nearest name that is.

    Parameters
    ----------
    folder
        Folder of the study.
    where
        File and key that name it; may be empty.
    name
        Its name, relative to the folder.

    Returns
    -------
    list of str
        One fault, or none.
    """
    if is_file(folder / name):
        return []
    near = did_you_mean(name, [p.name for p in folder.glob("*") if p.suffix != ".toml"])
    place = f"{where}: " if where else ""
    return [f"{place}no file {short(name, MAX_FILE_NAME)!r} in {folder}{near}"]


def treadmill_faults(folder: Path, file: StudyFile) -> list[str]:
    """Check the treadmill of ``study.toml`` against the folder and the conditions."""
    treadmill, platform, faults = file.treadmill, file.treadmill.platform, []
    for key, name in treadmill.files.items():
        faults += missing_file(folder, f"study.toml: treadmill.{key}", name)
    if platform is not None:
        where = "study.toml: treadmill.platform"
        markers = set(platform.markers)
        if markers and platform.channels:
            faults.append(f"{where}: give either markers or channels, not both")
        elif not markers and not platform.channels:
            faults.append(f"{where}: give its markers, or its sway_channel or pitch_channel")
        elif markers and len(markers) < MIN_PLATFORM_MARKERS:
            faults.append(
                f"{where}.markers: at least {MIN_PLATFORM_MARKERS} different markers are needed, "
                f"got {', '.join(platform.markers)}"
            )
    for name, condition in file.conditions.items():
        if condition.perturbed and condition.pulse_channel is None and platform is None:
            faults.append(
                f"study.toml: conditions.{name}: perturbed needs a pulse_channel, or "
                "treadmill.platform, from whose motion the perturbations are detected"
            )
    return faults


def plate_faults(folder: Path, file: StudyFile) -> list[str]:
    """Check the calibration of the plates that ``study.toml`` names, and the delay beside it."""
    name = file.plates.calibration
    if name is None:
        return []
    where = "study.toml: plates.calibration"
    if missing := missing_file(folder, where, name):
        return missing
    try:
        read_plate_correction(folder / name).require_delay(file.settings.plate_delay_s)
    except (ValueError, OSError) as error:
        return [f"{where}: {error}"]
    return []


def body_faults(folder: Path, name: str, subject: SubjectFile, file: StudyFile | None) -> list[str]:
    """Check what a subject's file states of the body against the settings and the folder."""
    faults = []
    if subject.segments and is_file(folder / subject.segments):
        try:
            read_segments(folder / subject.segments)
        except ValueError as error:
            faults.append(f"{name}: segments: {error}")
    if file is None:
        return faults
    functional = file.settings.hip == "functional"
    if functional and subject.hip_trial is None:
        faults.append(
            f'{name}: hip_trial: is missing; settings.hip = "functional" in study.toml needs a '
            "recording in which both thighs swing"
        )
    if not functional and subject.hip_trial is not None:
        faults.append(
            f'{name}: hip_trial: has no effect unless settings.hip = "functional" in study.toml'
        )
    return faults


def trial_faults(
    folder: Path,
    name: str,
    table: Table,
    conditions: Collection[str] | None,
    *,
    recordings: bool = True,
) -> list[str]:
    """Check a subject's trials against the conditions and the folder.

    Parameters
    ----------
    folder
        Folder of the study.
    name
        Name of the subject's file.
    table
        Its contents, unchecked: what else is wrong with it must not hide a missing recording.
    conditions
        Conditions of the study, if they are known.
    recordings
        Whether the files of subjects and trials have to be there.

    Returns
    -------
    list of str
        One line per fault.
    """
    faults = []
    trials = table.get("trials", {})
    for condition, trial in trials.items() if isinstance(trials, dict) else ():
        where = f"{name}: trials.{short(condition)}"
        if conditions is not None and condition not in conditions:
            hint = did_you_mean(condition, conditions) or f"; there are {listed(conditions)}"
            faults.append(f"{where}: no such condition in study.toml{hint}")
        if not isinstance(trial, dict) or "exclude" in trial:
            continue
        if "file" not in trial:
            faults.append(f'{where}: needs a file, or exclude = "the reason why there is none"')
        for key in ("file", "forces", "record"):
            if recordings and isinstance(trial.get(key), str) and trial[key]:
                faults += missing_file(folder, f"{where}.{key}", trial[key])
    for key in ("static", "hip_trial", "segments"):
        if recordings and isinstance(table.get(key), str) and table[key]:
            faults += missing_file(folder, f"{name}: {key}", table[key])
    return faults


def result_name_faults(subjects: Mapping[str, SubjectFile]) -> list[str]:
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
