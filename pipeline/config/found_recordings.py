"""Recordings in a folder without a study: whose they are, and which shows the calibration pose.

Their names say so (`pipeline.config.recording_names`). Where they can be read in several ways, the
ways are given and none is taken unless a pattern is stated.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from anyascii import anyascii

from hbm.numbers import read_numbers
from hbm.spelling import shown
from pipeline.config.input_model import RESERVED
from pipeline.config.recording_names import DIGITS, WITHOUT, RecordingName, Said, said_by, usual
from pipeline.config.schema import COVARIATES
from pipeline.io.read import is_recording, read_with_any_axes
from pipeline.io.recording import MIN_MARKERS, Recording

LIMITS: Final = read_numbers("pipeline.config", "thresholds.toml", "recordings")
NO_RECORDING: Final = "no recording"


class FoundSubject(NamedTuple):
    """A subject of whom there are recordings.

    Attributes
    ----------
    name
        As the names of the recordings say it, as far as a study can.
    static, hip_trial
        Files of the calibration pose and of the joints' motion; empty where there is none.
    trials
        Condition -> of each of the others its file and, where there are some, that of its forces
        and its day, as a study states them.
    """

    name: str
    static: str
    hip_trial: str
    trials: dict[str, list[dict[str, str]]]

    @property
    def files(self) -> list[str]:
        """All of its recordings."""
        trials = [trial["file"] for trials in self.trials.values() for trial in trials]
        return [*filter(None, (self.static, self.hip_trial)), *trials]


class FoundStudy(NamedTuple):
    """What the recordings in a folder are.

    Attributes
    ----------
    subjects
        Those who have a trial on plates, in the order of their names; none where names can be read
        in several ways.
    empty
        Recordings of plates and other signals with nobody on them.
    unused
        File of each recording that is not used -> why.
    readings
        Pattern -> the subjects by it, where names can be read in several ways; the likeliest first.
    """

    subjects: list[FoundSubject]
    empty: list[str]
    unused: dict[str, str]
    readings: dict[str, list[FoundSubject]]


class _Found(NamedTuple):
    """A recording of a person: a trial, or a pose or motion of joints."""

    file: str
    name: RecordingName
    pose: bool
    moved_m: float
    forces: str


def found_subjects(folder: Path, pattern: str = "") -> FoundStudy:
    """Find the subjects whose recordings are in a folder and its subfolders.

    The calibration pose is the recording with such a name, else the stillest one in which nobody
    makes a step.

    Parameters
    ----------
    folder
        The folder.
    pattern
        How names are to be read, as `said_by` does; by default by the numbers of persons, such as
        S01.

    Raises
    ------
    ValueError
        If no name fits the pattern, or two persons may be one.
    """
    recorded, empty, unused = _people_in(folder)
    if not pattern and (doubtful := _doubtful(recorded)):
        unclear = {name.stem: "its name does not say surely whose it is" for name in doubtful}
        if readings := _readings(recorded):
            return FoundStudy([], [], unclear, readings)
        raise ValueError(f"{doubtful[0].stem} does not say surely whose it is; state a --pattern")
    by_file = said_by(pattern, [one.file for one in recorded]) if pattern else _said(recorded)
    subjects = _subjects(recorded, by_file, unused)
    if pattern and recorded and not subjects:
        file = next((one.file for one in recorded if not one.pose), recorded[0].file)
        raise ValueError(
            f"--pattern {shown(pattern)}: no trial has such a name, as {file}; {WITHOUT}"
        )
    return FoundStudy(subjects, empty, unused, {})


def _subjects(
    recorded: Sequence[_Found], by_file: Mapping[str, Said], unused: dict[str, str]
) -> list[FoundSubject]:
    """Group recordings by what their names say; those that are not used, and why."""
    of_trials = [by_file[one.file] for one in recorded if not one.pose and one.file in by_file]
    people = {name.person.casefold(): name.person for name in of_trials}
    # where names do not say whose recordings they are, or of what
    names = valid_names(people.values(), "sub01")
    conditions = valid_names((name.condition for name in of_trials), "walking")
    of_person: dict[str, list[_Found]] = {key: [] for key in sorted(people)}
    for one in recorded:
        person = by_file[one.file].person.casefold() if one.file in by_file else None
        if person not in people and one.pose:
            named = [key for key in people if key and one.name.names(key)]
            alone = [*people] if not one.name.candidates and one.file not in by_file else []
            alone = [a for a in alone if not (a.replace("-", "").isdecimal() and one.name.fields)]
            (person,) = named or alone if len(named or alone) == 1 else [person]
        if person in people:
            of_person[str(person)].append(one)
        elif person and one.pose:
            unused[one.file] = f"there is no trial of {by_file[one.file].person} on plates"
        else:
            unused[one.file] = "its name does not say whose it is"
    subjects = []
    for key, recordings in of_person.items():
        static, hip_trial = (_pose(hips, people[key], recordings, unused) for hips in (False, True))
        days = {by_file[one.file].session for one in recordings if not one.pose}
        trials = dict[str, list[dict[str, str]]]()
        for one in recordings:
            if not one.pose and one.file != static:
                of_day = by_file[one.file].session if len(days) > 1 else ""
                texts = {"file": one.file, "forces": one.forces, "session": of_day}
                table = {name: text for name, text in texts.items() if text}
                trials.setdefault(conditions[by_file[one.file].condition], []).append(table)
        subjects.append(FoundSubject(names[people[key]], static, hip_trial, trials))
    return subjects


def _people_in(folder: Path) -> tuple[list[_Found], list[str], dict[str, str]]:
    """Read the recordings of people in a folder, and of nobody; what cannot be used, and why."""
    recorded, empty, unused = list[_Found](), list[str](), dict[str, str]()
    copied = (".part", ".partial", ".filepart", ".crdownload", ".download", ".tmp")
    studies = {path.parent for path in folder.rglob("study.toml")} - {folder}
    for path in sorted(folder.rglob("*")):
        file = path.relative_to(folder).as_posix()
        if path.is_dir() or "/." in f"/{file}":
            continue
        try:
            if not studies.isdisjoint(path.parents):
                raise ValueError("its folder has a study of its own")
            if path.suffix.lower() in copied:
                raise ValueError("a part of a file; end its copying or delete it")
            recording = read_with_any_axes(path)
            if (markers := len(recording.markers.names)) < MIN_MARKERS:
                if recording.plates and recording.analog:
                    empty.append(file)
                raise ValueError(f"it has {markers} markers, too few for a body")
            name, moved_m = RecordingName.of(file), _moved_m(recording)
            forces_file = recording.forces_beside
            forces = forces_file.relative_to(folder).as_posix() if forces_file else ""
            on_plates = bool(recording.plates or forces)
            if not (on_plates or name.kind or moved_m <= LIMITS.still_path):
                raise ValueError(recording.why_no_plates)
            pose = bool(name.kind) or not on_plates
            recorded.append(_Found(file, name, pose, moved_m, forces))
        except (ValueError, OSError) as error:
            recording_like = path.suffix.lower() == ".c3d" or is_recording(path)
            unused[file] = str(error) if recording_like else NO_RECORDING
    for one in recorded:
        unused.pop(one.forces, None)
    return recorded, empty, unused


def _said(recorded: Sequence[_Found]) -> dict[str, Said]:
    """Read names by the numbers of persons; where there are none, all are of one person."""
    if not any(one.name.candidates for one in recorded if not one.pose):
        return {one.file: one.name.read([]) for one in recorded if not one.name.candidates}
    sure = [one for one in recorded if one.name.sure]
    by_file = {one.file: one.name.read(one.name.candidates[:1]) for one in sure}
    spelt = dict[tuple[str, int], str]()
    for person in sorted({words.person for words in by_file.values()}):
        letters = person.rstrip(DIGITS)
        key = letters[0].casefold(), int(person.removeprefix(letters))
        if (other := spelt.setdefault(key, person)).casefold() != person.casefold():
            raise ValueError(
                f"{other} and {person} may be one person; nothing was written; rename recordings, "
                'or tell them apart by a --pattern such as "{subject}_{condition}_{recording}"'
            )
    return by_file


def _doubtful(recorded: Sequence[_Found]) -> list[RecordingName]:
    """Give the names that do not say surely whose they are, though others do."""
    trials = [one.name for one in recorded if not one.pose]
    if not any(name.candidates for name in trials):
        poses, numbers = [one for one in recorded if one.pose], {name.number for name in trials}
        # the numbers may be those of persons, unless one pose serves all
        several = len(numbers) > 1 and [one.name.number for one in poses] != [""]
        return [name for name in trials if name.number and several]
    doubtful = [name for name in trials if name.candidates and not name.sure]
    sure = [name for name in trials if name.sure]
    for one in recorded:
        if one.pose and one.name.sure:
            person = one.name.read(one.name.candidates[:1]).person
            others = [name for name in sure if person.casefold() in map(str.casefold, name.fields)]
            if not all(map(usual, one.name.apart(others, person))):  # a word may be another person
                doubtful.append(one.name)
    # S1 may be a session, where different words follow
    short = [n for n in sure if re.fullmatch("[A-Za-z][0-9]", n.fields[n.candidates[0]])]
    words = {tuple(name.fields[k] for k in name.candidates[1:]) for name in short}
    return doubtful + (short if len(words) > 1 else [])


def _readings(recorded: Sequence[_Found]) -> dict[str, list[FoundSubject]]:
    """Give the ways to read names, by the places that may say whose they are; the likeliest first.

    Likely are several subjects and conditions, in all combinations, of every name, and no subject
    that is a number at the end; else the subject of the fewest places, and the first of them.
    """
    names = [one.name for one in recorded if not one.pose]
    patterns = Counter(way for name in names for way in name.patterns())
    commonest = {places: pattern for (places, pattern), _ in reversed(patterns.most_common())}
    files, ways = [one.file for one in recorded], list[tuple[float, str, list[FoundSubject]]]()
    for pattern in dict.fromkeys(commonest.values()):
        try:
            by_file = said_by(pattern, files)
        except ValueError:  # folders that it leaves out tell recordings apart
            continue
        subjects = _subjects(recorded, by_file, {})
        read = sum(one.file in by_file for one in recorded if not one.pose) / len(names)
        cells = sum(len(subject.trials) for subject in subjects)
        conditions = len({condition for subject in subjects for condition in subject.trials})
        crossed = cells / max(1, len(subjects) * conditions)
        several = (len(subjects) > 1) * 1.1 + (conditions > 1)
        repeated = pattern.endswith("{subject}") and all(one.name.isdecimal() for one in subjects)
        likely = read * several * crossed**2 * (0.5 if repeated else 1.0)
        ways.append((likely, pattern, subjects))
    ways.sort(key=lambda way: (-way[0], way[1].count("{subject}"), way[1].find("{subject}")))
    ways = [way for way in ways if way[2]]
    people = [{frozenset(subject.files) for subject in subjects} for *_, subjects in ways]
    different = [way for k, way in enumerate(ways) if people[k] not in people[:k]]
    return {way[1]: way[2] for way in (different if different[1:] else ways)[:4]}


def _pose(hips: bool, name: str, recordings: Sequence[_Found], unused: dict[str, str]) -> str:
    """Give the file of a subject's pose or hip trial, if any; others so named are not used."""
    trials = [one for one in recordings if not one.pose]
    poses = [one for one in recordings if one.pose and hips is (one.name.kind == "functional")]
    # of several trials, one in which nobody makes a step may be the pose
    still = [one for one in trials if one.moved_m <= LIMITS.still_path]
    still = still if trials[1:] and not hips else []
    hold = [one for one in poses or still if not one.name.apart([t.name for t in trials], name)]
    pose = min(hold, key=lambda one: one.moved_m).file if hold else ""
    what = "hip trial" if hips else "pose"
    why = f"{pose} is the {what} of {name}" if hold else f"its name contradicts trials of {name}"
    if len({one.name.day for one in recordings if one.name.day}) > 1:
        pose, why = "", f"{name} was recorded on several days; a {what} holds for one"
    unused |= {one.file: why for one in poses if one.file != pose}
    return pose


def valid_names(texts: Iterable[str], otherwise: str) -> dict[str, str]:
    """Give names that a study can have, in Latin letters; different ones of different texts."""
    # names that mean something else to a study or to the file system
    names, taken = dict[str, str](), {*RESERVED, *COVARIATES, "group", "study"}
    for text in dict.fromkeys(texts):
        letters = re.sub("[^A-Za-z0-9]+", "-", re.sub("['’]", "", anyascii(text)))
        base = letters[:40].strip("-") or otherwise
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
