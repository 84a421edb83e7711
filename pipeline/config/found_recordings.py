"""Recordings in a folder without a study: whose they are, and which shows the calibration pose.

Their names say so (`pipeline.config.recording_names`). Where one can be read in several ways, none
is taken unless it is stated which of its fields say whose it is.
"""

import re
from collections.abc import Iterable, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from hbm.spelling import listed, without_accents
from pipeline.config.input_model import RESERVED
from pipeline.config.recording_names import RecordingName, usual
from pipeline.config.schema import COVARIATES
from pipeline.config.toml_file import StudyFaults
from pipeline.io.read import is_recording, read_with_any_axes
from pipeline.io.recording import MIN_MARKERS, Recording

FIRST: Final = "sub01"
"""The subject where names do not say whose recordings they are."""
CONDITION: Final = "walking"
"""Of trials where names do not say theirs."""
REMEDY: Final = (
    "nothing was written; state the field that says it, such as --field 1, several where a group "
    "belongs to it, or --field 0 where all are of one person; or begin every name with S and the "
    "person's number, as in S01_slow_1.c3d"
)
TAKEN: Final = (*RESERVED, *COVARIATES, "group", "study")
"""Names that mean something else to a study or to the file system."""
MAX_LETTERS: Final = 40
UNFINISHED: Final = (".part", ".partial", ".filepart", ".crdownload", ".download", ".tmp")
"""Suffixes of files that are being copied."""
MAX_STILL_M: Final = 0.3
"""Path of the marker that moves most while somebody stands: a step is longer, on belts too."""


class FoundSubject(NamedTuple):
    """A subject of whom there are recordings.

    Attributes
    ----------
    name
        As the names of the recordings say it, as far as a study can.
    static
        File of the calibration pose; empty where every recording is a trial.
    trials
        Condition -> of each of the others its file and, where there is one, that of its forces, as
        a study states them.
    """

    name: str
    static: str
    trials: dict[str, list[dict[str, str]]]


class _Found(NamedTuple):
    """A recording of a person: a trial, or a pose."""

    file: str
    name: RecordingName
    pose: bool
    moved_m: float
    forces: str


def found_subjects(
    folder: Path, fields: Sequence[int] = ()
) -> tuple[list[FoundSubject], dict[str, str]]:
    """Find the subjects whose recordings are in a folder and its subfolders.

    The calibration pose is the recording with such a name, else the stillest one in which nobody
    makes a step.

    Parameters
    ----------
    folder
        The folder.
    fields
        Which fields of the names, from 1, say whose recordings they are; 0 where all are of one
        person. By default the numbers of persons, such as S01.

    Returns
    -------
    subjects
        Those who have a trial on plates, in the order of their names.
    unused
        File of each recording that is not used -> why.

    Raises
    ------
    StudyFaults
        If a name can be read in several ways and the fields are not stated.
    """
    recorded, unused = _people_in(folder)
    places = _places(recorded, fields)
    said = {one.file: one.name.read(places[one.file]) for one in recorded if one.file in places}
    of_trials = [said[one.file] for one in recorded if not one.pose and one.file in said]
    people = {person.casefold(): person for person, _ in of_trials}
    names = _valid(people.values(), FIRST)
    conditions = _valid((condition for _, condition in of_trials), CONDITION)
    of_person: dict[str, list[_Found]] = {key: [] for key in sorted(people)}
    for one in recorded:
        person, _ = said.get(one.file, (None, ""))
        if person is None and one.pose and not one.name.candidates and len(people) == 1:
            (person,) = people.values()
        if person is not None and person.casefold() in people:
            of_person[person.casefold()].append(one)
        elif one.pose and person:
            unused[one.file] = f"there is no trial of {person} on plates"
        else:
            unused[one.file] = "its name does not say whose it is"
    subjects = []
    for key, recordings in of_person.items():
        static = _pose(people[key], recordings, unused)
        trials = dict[str, list[dict[str, str]]]()
        for one in recordings:
            if not one.pose and one.file != static:
                stated = {"file": one.file} | ({"forces": one.forces} if one.forces else {})
                trials.setdefault(conditions[said[one.file][1]], []).append(stated)
        subjects.append(FoundSubject(names[people[key]], static, trials))
    return subjects, unused


def _people_in(folder: Path) -> tuple[list[_Found], dict[str, str]]:
    """Read the recordings of people in a folder; those that cannot be used, and why."""
    recorded, unused = list[_Found](), dict[str, str]()
    studies = {path.parent for path in folder.rglob("study.toml")} - {folder}
    for path in sorted(folder.rglob("*")):
        file = path.relative_to(folder).as_posix()
        if path.is_dir() or "/." in f"/{file}":
            continue
        try:
            if not studies.isdisjoint(path.parents):
                raise ValueError("its folder has a study of its own")
            if path.suffix.lower() in UNFINISHED:
                raise ValueError("a part of a file; end its copying or delete it")
            recording = read_with_any_axes(path)
            if (markers := len(recording.markers.names)) < MIN_MARKERS:
                raise ValueError(f"it has {markers} markers, too few for a body")
            name, moved_m = RecordingName.of(file), _moved_m(recording)
            if name.kind == "functional":
                raise ValueError("it is no trial; for functional hips, state it as hip_trial")
            beside = recording.forces_beside
            forces = beside.relative_to(folder).as_posix() if beside else ""
            on_plates = bool(recording.plates or forces)
            if not (on_plates or name.kind or moved_m <= MAX_STILL_M):
                raise ValueError(recording.why_no_plates)
            pose = bool(name.kind) or not on_plates
            recorded.append(_Found(file, name, pose, moved_m, forces))
        except (ValueError, OSError) as error:
            if path.suffix.lower() == ".c3d" or is_recording(path):
                unused[file] = str(error)
    return recorded, unused


def _places(recorded: Sequence[_Found], fields: Sequence[int]) -> dict[str, list[int]]:
    """Give the places of the fields that say whose recordings are, of those that say it."""
    if fields:
        stated = [number - 1 for number in fields if number]
        most = max(stated, default=-1)
        return {one.file: stated for one in recorded if len(one.name.fields) > most}
    trials = [one for one in recorded if not one.pose]
    if not any(one.name.candidates for one in trials):  # all are of one person
        return {one.file: [] for one in recorded if not one.name.candidates}
    sure = {one.file: one.name.candidates[:1] for one in recorded if one.name.sure}
    doubtful = [one for one in trials if one.name.candidates and not one.name.sure]
    for pose in (one for one in recorded if one.pose and one.file in sure):
        person, _ = pose.name.read(sure[pose.file])
        others = [one.name for one in trials if one.file in sure]
        others = [name for name in others if person.casefold() in map(str.casefold, name.fields)]
        if not all(map(usual, pose.name.apart(others, person))):  # a word may be another person
            doubtful.append(pose)
    if doubtful:
        file, name = doubtful[0][:2]
        numbered = listed(f"{k} {field}" for k, field in enumerate(name.fields, 1))
        ways = f"its name does not say surely whose it is; its fields are {numbered}"
        raise StudyFaults([f"{file}: {ways}; {REMEDY}"])
    return sure


def _pose(name: str, recordings: Sequence[_Found], unused: dict[str, str]) -> str:
    """Give the file of a subject's calibration pose, if any; others so named are not used."""
    poses, trials = ([one for one in recordings if one.pose is pose] for pose in (True, False))
    still = [one for one in trials if one.moved_m <= MAX_STILL_M] if trials[1:] else []
    hold = [one for one in poses or still if not one.name.apart([t.name for t in trials], name)]
    static = min(hold, key=lambda one: one.moved_m).file if hold else ""
    why = f"{static} is the pose of {name}" if hold else f"its name contradicts trials of {name}"
    if len({one.name.day for one in recordings if one.name.day}) > 1:
        static, why = "", f"{name} was recorded on several days; a pose holds for one"
    unused |= {one.file: why for one in poses if one.file != static}
    return static


def _valid(texts: Iterable[str], otherwise: str) -> dict[str, str]:
    """Give names that a study can have, different ones of different texts."""
    names, taken = dict[str, str](), {*TAKEN}
    for text in dict.fromkeys(texts):
        letters = re.sub("[^A-Za-z0-9]+", "-", re.sub("['’]", "", without_accents(text)))
        base = letters[:MAX_LETTERS].strip("-") or otherwise
        numbered = (f"{base}-{number}" for number in count(2))
        names[text] = next(n for n in chain([base], numbered) if n.casefold() not in taken)
        taken.add(names[text].casefold())
    return names


def _moved_m(recording: Recording) -> float:
    """Give how far the marker that moves most moves [m]; a tenth of them may be labelled wrong."""
    position = recording.markers.position
    box = np.fmax.reduce(position, axis=0) - np.fmin.reduce(position, axis=0)
    moved = np.linalg.norm(box[np.isfinite(box).all(axis=1)], axis=1)
    return float(np.percentile(moved, 90)) if len(moved) else np.inf
