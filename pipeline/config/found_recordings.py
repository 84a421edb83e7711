"""Recordings in a folder without a study: whose they are, and which shows the calibration pose.

Their names say so (`pipeline.config.recording_names`). Of names that can be read in several ways
all readings are given, and none is taken.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from hbm.spelling import listed, without_accents
from pipeline.config.input_model import RESERVED
from pipeline.config.recording_names import RecordingName, condition, usual
from pipeline.config.schema import COVARIATES
from pipeline.config.toml_file import StudyFaults
from pipeline.io.read import is_recording, read_with_any_axes
from pipeline.io.recording import Recording

INITIALS: Final = re.compile(r"(?:(?:[A-Z]{2,3}|[A-Z]{2,4}\d{2,}) ){3,}")
"""Of three people or more, such as AB and KO03; fewer may be conditions."""
FIRST: Final = "sub01"
"""The subject where names do not say whose recordings they are."""
CONDITION: Final = "walking"
"""Of trials where names do not say theirs."""
REMEDY: Final = (
    "the names can be read in these ways; nothing was written; choose one with --reading, or begin "
    "every name with S and the person's number, as in S01_slow_1.c3d"
)
TAKEN: Final = (*RESERVED, *COVARIATES, "group", "study")
"""Names that mean something else to a study or to the file system."""
MAX_LETTERS: Final = 40
UNFINISHED: Final = (".part", ".partial", ".filepart", ".crdownload", ".download", ".tmp")
"""Suffixes of files that are being copied."""
MIN_MARKERS: Final = 9
"""Fewer are on a treadmill, not on a body."""
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
        Condition -> files of the others.
    forces
        File of a trial -> the one beside it with its forces.
    """

    name: str
    static: str
    trials: dict[str, list[str]]
    forces: dict[str, str]


class _Found(NamedTuple):
    """A recording of a person: a trial, or a pose."""

    file: str
    name: RecordingName
    pose: bool
    moved_m: float
    forces: str


Reading = dict[str, tuple[str, str]]
"""File -> whose it is, and of what condition."""


def found_subjects(
    folder: Path, chosen: int | None = None
) -> tuple[list[FoundSubject], dict[str, str]]:
    """Find the subjects whose recordings are in a folder and its subfolders.

    The calibration pose is the recording with such a name, else the stillest one in which nobody
    makes a step.

    Parameters
    ----------
    folder
        The folder.
    chosen
        Which reading of the names is right, from 1, where there are several.

    Returns
    -------
    subjects
        Those who have a trial on plates, in the order of their names.
    unused
        File of each recording that is not used -> why.

    Raises
    ------
    StudyFaults
        If the names can be read in several ways and none is chosen: one line for each.
    """
    recorded, unused = _people_in(folder)
    reading = _reading(recorded, chosen)
    people = {person.casefold(): person for person, _ in reading.values()}
    names = _valid(people.values(), FIRST)
    conditions = _valid((said for _, said in reading.values()), CONDITION)
    of_person: dict[str, list[_Found]] = {key: [] for key in sorted(people)}
    for one in recorded:
        key, who = _whose(one, reading, people), [one.name.fields[k] for k in one.name.candidates]
        if key is not None:
            of_person[key].append(one)
        elif one.pose and who and not any(who[0].casefold() in key.split("-") for key in people):
            unused[one.file] = f"there is no trial of {who[0]} on plates"
        else:
            unused[one.file] = "its name does not say whose it is"
    subjects = []
    for key, recordings in of_person.items():
        static, trials = _pose(people[key], recordings, unused), dict[str, list[str]]()
        for one in recordings:
            if not one.pose and one.file != static:
                trials.setdefault(conditions[reading[one.file][1]], []).append(one.file)
        forces = {one.file: one.forces for one in recordings if one.forces}
        subjects.append(FoundSubject(names[people[key]], static, trials, forces))
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


def _reading(recorded: Sequence[_Found], chosen: int | None) -> Reading:
    """Give the one way in which the names of trials can be read, or the one that is chosen."""
    names = {one.file: one.name for one in recorded if not one.pose}
    poses, most = [one.name for one in recorded if one.pose], 0
    ways = [{file: name.read(name.candidates[0]) for file, name in names.items() if name.sure}]
    sure = all(name.sure or not name.candidates for name in names.values()) and ways[0]
    if not sure or not all(_follows(pose, names, sure) for pose in poses if pose.sure):
        most = max((len(name.candidates) for name in names.values()), default=0)
        ways = [
            {f: n.read(n.candidates[k]) for f, n in names.items() if len(n.candidates) > k}
            for k in range(most)
        ]
        ways.append({file: (FIRST, condition(name.fields)) for file, name in names.items()})
        groups = {f: n.read(n.candidates[0], True) for f, n in names.items() if n.candidates}
        first, grouped = (dict(way.values()) for way in (ways[0], groups))
        same = len(first) == len(grouped) and [*first.values()] != [*grouped.values()]
        if groups:  # first where people are the same, and a number is no longer a condition
            ways.insert(0 if same else most, groups)
    different: dict[tuple[int, ...], Reading] = {}
    for way in ways:
        people = [way.get(file, ("", ""))[0].casefold() for file in names]
        different.setdefault(tuple(map(people.index, people)), way)  # by who is the same person
    readings = [*different.values()]
    persons = [f"{person} " for person, said in ways[0].values() if said]
    initials = INITIALS.fullmatch("".join({*persons})) and len(persons) == len(names)
    if initials and most == 1 and len(readings) == 2 and all(pose.candidates for pose in poses):
        readings = readings[:1]
    if chosen is None and len(readings) > 1:
        raise StudyFaults([_described(k, way) for k, way in enumerate(readings, 1)] + [REMEDY])
    if not 1 <= (chosen or 1) <= len(readings):
        raise ValueError(f"--reading {chosen}: names can be read in {len(readings)} ways")
    return readings[(chosen or 1) - 1]


def _follows(pose: RecordingName, names: Mapping[str, RecordingName], way: Reading) -> bool:
    """Tell whether no word of a pose that may be a person sets it apart from its trials."""
    person = pose.read(pose.candidates[0])[0]
    trials = [names[f] for f, (who, _) in way.items() if who.casefold() == person.casefold()]
    return all(map(usual, pose.apart(trials, person)))


def _described(number: int, reading: Reading) -> str:
    """Describe a reading of names by its people and an example."""
    people = {person.casefold(): person for person, _ in reading.values()}
    file, (person, said) = next(iter(reading.items()))
    example = f"{file} is of {person}, {said or CONDITION}"
    return f"reading {number}: people {listed(people.values())}; {example}"


def _whose(one: _Found, reading: Reading, people: Mapping[str, str]) -> str | None:
    """Give whose a recording is; a pose is of whom its name says, or of the only one."""
    if not one.pose:
        return reading[one.file][0].casefold() if one.file in reading else None
    fields = {field.casefold() for field in one.name.fields}
    whose = [person for person in people if fields.issuperset(person.split("-"))]
    if not whose and not one.name.candidates:  # its number may be that of another person
        whose = [] if fields and "".join(people)[:1].isdecimal() else [*people]
    return whose[0] if len(whose) == 1 else None


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
