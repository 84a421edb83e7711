"""Where a study's numbers come from: trials, settings, inputs, program."""

import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Final, Literal, TypeVar

from pydantic import TypeAdapter

from hbm.engines.engine import EngineUsed
from pipeline.config.schema import Comparison, Condition, Plates, Settings, Treadmill, Trial
from pipeline.config.study import Study
from pipeline.run.job import file_digest, trial_key
from pipeline.run.load import Results
from pipeline.run.program import git_commit, program_digest
from pipeline.trial.result import PACKAGES, StoredNote

REPORT_PACKAGES: Final = (*PACKAGES, "pingouin", "matplotlib")

State = Literal["done", "outdated", "failed", "excluded", "missing"]
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class TrialState:
    """What became of a trial.

    Attributes
    ----------
    subject, condition
        The trial.
    state
        "done"; "outdated": done, but not as the study states it now; "failed"; "excluded";
        "missing": no result and no reason.
    reason
        Why it is not simply done.
    in_tables
        Whether the tables and figures include its result: not if the trial has failed since, is
        now excluded, or is no longer in the study.
    source, key
        Name of the recording's file and key of the result; None where there is no result.
    """

    subject: str
    condition: str
    state: State
    reason: str
    in_tables: bool
    source: str | None
    key: str | None


@dataclass(frozen=True, slots=True)
class Program:
    """The program that made a report: SHA-256 of its sources, and their commit if known."""

    sha256: str
    git_commit: str | None


@dataclass(frozen=True, slots=True)
class Provenance:
    """What a study's results were made from: the content of ``study.json``.

    Attributes
    ----------
    name
        The study's name; None, as `conditions`, `comparison`, `plates`, `treadmill` and `inputs`,
        without its folder.
    settings, versions
        Settings and package versions the trials were processed with, each once; more than one
        means that trials are not alike.
    engines
        Engines of the inverse dynamics, each once, with the number of frames that the other engine
        checked in all trials, and the largest difference.
    report
        Python's and the packages' versions that made the report.
    program
        The program that made the report.
    conditions, comparison, plates, treadmill
        As stated.
    calibration
        What is to be known of the treadmill's calibrations: above its limits, or not judged.
    inputs
        File of the study -> its SHA-256.
    trials
        What became of every trial.
    """

    name: str | None
    settings: tuple[Settings, ...]
    versions: tuple[Mapping[str, str], ...]
    engines: tuple[EngineUsed, ...]
    report: Mapping[str, str]
    program: Program
    conditions: Mapping[str, Condition] | None
    comparison: Comparison | None
    plates: Plates | None
    treadmill: Treadmill | None
    calibration: tuple[StoredNote, ...]
    inputs: Mapping[str, str] | None
    trials: tuple[TrialState, ...]

    def to_json(self) -> str:
        """Give ``study.json``."""
        return _JSON.dump_json(self, indent=1).decode()


_JSON: Final = TypeAdapter(Provenance)


def trial_states(
    results: Results, failures: Mapping[str, str], study: Study | None = None
) -> list[TrialState]:
    """Give the state of every trial of a study.

    Parameters
    ----------
    results
        What `hbm run` left.
    failures
        "subject condition" -> reason (`pipeline.run.failures.read_failures`).
    study
        What was to be done; without it, every subject is taken to have every condition.

    Returns
    -------
    list of TrialState
        In order of subject, conditions as the study has them.
    """
    planned: dict[tuple[str, str], tuple[State, str] | None] = {}
    if study is None:
        names = [tuple(name.split(" ", 1)) for name in failures]
        subjects = sorted({key[0] for key in (*results.trials, *names)})
        conditions = dict.fromkeys(key[1] for key in (*results.trials, *names))
        planned = {(s, c): None for s in subjects for c in conditions}
    else:
        for subject, person in study.subjects.items():
            for condition in study.file.conditions:
                planned[subject, condition] = _unplanned(person.trials.get(condition))
        planned |= {key: None for key in results.trials if key not in planned}
    return [_state(key, cause, results, failures, study) for key, cause in planned.items()]


def _unplanned(trial: Trial | None) -> tuple[State, str] | None:
    """Give state and reason of a trial that was not to be processed; None if it was."""
    if trial is None:
        return "missing", "not in the subject's file"
    return None if trial.exclude is None else ("excluded", trial.exclude)


def _state(
    key: tuple[str, str],
    cause: tuple[State, str] | None,
    results: Results,
    failures: Mapping[str, str],
    study: Study | None,
) -> TrialState:
    trial = results.trials.get(key)
    identity = (trial.source.name, trial.key) if trial is not None else (None, None)
    failure = failures.get(" ".join(key))
    if failure is not None:
        cause = "failed", failure
    elif trial is not None and trial.shortage:
        cause = "failed", trial.shortage
    if cause is not None:
        state, reason = cause
        older = ""
        if trial is not None and not trial.shortage:
            older = "; an older result is left out of the tables"
        return TrialState(*key, state, reason + older, False, *identity)
    if trial is None:
        return TrialState(*key, "missing", "no result: hbm run has not done it", False, *identity)
    if study is not None:
        if key[0] not in study.subjects or key[1] not in study.file.conditions:
            reason = "no longer in the study; its result is left out of the tables"
            return TrialState(*key, "outdated", reason, False, *identity)
        if trial.settings != study.file.settings:
            reason = "processed with other settings than the study states now; run it again"
            return TrialState(*key, "outdated", reason, True, *identity)
        if trial.key != trial_key(study, *key):
            reason = "the program, its files or what is stated has changed since; run it again"
            return TrialState(*key, "outdated", reason, True, *identity)
    return TrialState(*key, "done", "", True, *identity)


def provenance(results: Results, states: Sequence[TrialState], study: Study | None) -> Provenance:
    """Gather what a study's results were made from.

    Parameters
    ----------
    results, states
        The trials and what became of them.
    study
        The study, if its folder is at hand: what it states, and the hashes of its files.

    Returns
    -------
    Provenance
        The content of ``study.json``.
    """
    trials = results.trials.values()
    return Provenance(
        name=study.file.name if study else None,
        settings=_each_once(trial.settings for trial in trials),
        versions=_each_once(trial.versions for trial in trials),
        engines=engines_of([trial.engine for trial in trials]),
        report={
            "python": platform.python_version(),
            **{name: version(name) for name in REPORT_PACKAGES},
        },
        program=Program(program_digest(), git_commit()),
        conditions=study.file.conditions if study else None,
        comparison=study.file.comparison if study else None,
        plates=study.file.plates if study else None,
        treadmill=study.file.treadmill if study else None,
        calibration=_each_once(note for trial in trials for note in trial.of_calibration),
        inputs=input_digests(study) if study else None,
        trials=tuple(states),
    )


def engines_of(used: Sequence[EngineUsed]) -> tuple[EngineUsed, ...]:
    """Give every engine once, with all frames that were checked and the largest difference."""
    alike: dict[EngineUsed, list[EngineUsed]] = {}
    for one in used:
        alike.setdefault(replace(one, frames=0, difference=0.0), []).append(one)
    return tuple(
        replace(
            engine,
            frames=sum(one.frames for one in trials),
            difference=max(one.difference for one in trials),
        )
        for engine, trials in alike.items()
    )


def _each_once(values: Iterable[Item]) -> tuple[Item, ...]:
    """Give values without repetition, in order of their first occurrence."""
    different: list[Item] = []
    for value in values:
        if value not in different:
            different.append(value)
    return tuple(different)


def input_digests(study: Study) -> dict[str, str]:
    """Give the SHA-256 of every file that a study is made of, in order of their names."""
    names = {path.name for path in study.folder.glob("*.toml")}
    names |= {name for person in study.subjects.values() for name in person.files}
    names |= {
        name
        for person in study.subjects.values()
        for trial in person.trials.values()
        if trial.exclude is None
        for name in trial.files
    }
    names |= {*study.file.treadmill.files.values()}
    if study.file.plates.calibration:
        names.add(study.file.plates.calibration)
    return {name: file_digest(study.path(name)) for name in sorted(names)}
