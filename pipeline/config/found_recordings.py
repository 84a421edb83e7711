"""Recordings in a folder without a study: whose they are, and which shows the calibration pose."""

import re
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from pipeline.io.read import file_format, read_recording
from pipeline.io.recording import Recording

POSE: Final = re.compile(r"static|t-?pose|calib", re.IGNORECASE)
"""In the name of a recording of the calibration pose."""
SUBJECT: Final = re.compile(r"[A-Za-z]*[-_]?\d+")
"""How the names of a subject's recordings begin, such as S01 or HC030."""
FIRST: Final = "sub01"
"""The subject of recordings whose names begin otherwise."""
CONDITION: Final = "walking"
"""Of all trials, where names do not say theirs."""
MIN_LETTERS: Final = 3
MIN_MARKERS: Final = 9
"""Fewer are on a treadmill, not on a body."""
MAX_STILL_M: Final = 0.3
"""Path of the marker that moves most while somebody stands: a step is longer, on belts too."""


class FoundSubject(NamedTuple):
    """A subject of whom there are recordings.

    Attributes
    ----------
    name
        How the names of the recordings begin.
    static
        File of the calibration pose; empty where every recording is a trial.
    trials
        Condition -> files of the others.
    """

    name: str
    static: str
    trials: dict[str, list[str]]


def found_subjects(folder: Path) -> tuple[list[FoundSubject], dict[str, str]]:
    """Find the subjects whose recordings are in a folder, in the order of their names.

    The calibration pose is the recording with such a name, else the stillest one in which nobody
    makes a step. Conditions are the words between subject and number (``S01_shoes_2.c3d``) where
    every trial has one.

    Returns
    -------
    subjects
        Those who have a trial on plates.
    unused
        File of each recording that is not used -> why.
    """
    unused, of_subject = dict[str, str](), dict[str, list[tuple[bool, float, bool, str]]]()
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        try:
            recording = _read_person(path)
        except (ValueError, OSError) as error:
            if path.suffix.lower() == ".c3d" or is_recording(path):
                unused[path.name] = str(error)
            continue
        match, moved_m = SUBJECT.match(path.stem), _moved_m(recording)
        no_pose = not POSE.search(path.stem)  # False comes first
        found = no_pose, moved_m, bool(recording.plates), path.name
        of_subject.setdefault(match[0] if match else FIRST, []).append(found)
    statics, trials = dict[str, str](), dict[str, list[str]]()
    for name, files in sorted(of_subject.items()):
        no_pose, moved_m, _, static = min(files)
        if no_pose and (len(files) == 1 or moved_m > MAX_STILL_M):
            static = ""
        others = {file: plates for *_, plates, file in files if file != static}
        unused |= {file: "it has no force plates" for file, plates in others.items() if not plates}
        statics[name], trials[name] = static, sorted(file for file in others if others[file])
        if static and not trials[name]:
            unused[static] = f"there is no trial of {name} on plates"
    named = all(_condition(name, file) for name, files in trials.items() for file in files)
    subjects = []
    for name, walks in trials.items():
        of_condition: dict[str, list[str]] = {}
        for file in walks:
            of_condition.setdefault(_condition(name, file) if named else CONDITION, []).append(file)
        if walks:
            subjects.append(FoundSubject(name, statics[name], of_condition))
    return subjects, unused


def _read_person(path: Path) -> Recording:
    """Read a recording of a person; a ValueError where it is none."""
    file_format(path)
    recording = read_with_any_axes(path)
    if len(recording.markers.names) < MIN_MARKERS:
        raise ValueError(f"it has {len(recording.markers.names)} markers, too few for a body")
    return recording


def read_with_any_axes(path: Path) -> Recording:
    """Read a recording whose axes may be unknown: of an empty treadmill, or somebody who turns."""
    try:
        return read_recording(path)
    except ValueError:
        return read_recording(path, "forward,left,up")


def is_recording(path: Path) -> bool:
    """Whether the beginning of a file is that of a recording."""
    with suppress(ValueError, OSError):
        return bool(file_format(path))
    return False


def _condition(subject: str, file: str) -> str:
    """Give the word between subject and number of a file's name; empty where there is none."""
    word = re.sub(r"\d+$", "", Path(file).stem.removeprefix(subject)).strip("_- ").lower()
    return word if len(word) >= MIN_LETTERS else ""


def _moved_m(recording: Recording) -> float:
    """Give how far the marker that moves most moves [m]; a tenth of them may be labelled wrong."""
    position = recording.markers.position
    seen = np.isfinite(position).all(axis=2).any(axis=0)
    if not seen.any():
        return np.inf
    span = np.nanmax(position[:, seen], axis=0) - np.nanmin(position[:, seen], axis=0)
    return float(np.percentile(np.linalg.norm(span, axis=1), 90))
