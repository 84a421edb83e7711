"""Where a study's numbers come from: trials, settings, inputs, program."""

import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Final, Literal, TypeVar

from pydantic import TypeAdapter

from pipeline.config.schema import Comparison, Condition, Plates, Settings, Treadmill, TrialName
from pipeline.config.study import Study
from pipeline.io.input_file import file_digest
from pipeline.io.qualisys import plate_files
from pipeline.run.job import trial_key
from pipeline.run.load import Results
from pipeline.run.program import git_commit, program_digest
from pipeline.trial.result import PACKAGES, StoredNote, TrialResult

State = Literal["done", "outdated", "failed", "excluded", "missing"]
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class TrialState:
    """What became of a trial.

    Attributes
    ----------
    subject, condition, recording
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
    recording: str
    state: State
    reason: str
    in_tables: bool
    source: str | None
    key: str | None

    @property
    def name(self) -> TrialName:
        """The trial."""
        return TrialName(self.subject, self.condition, self.recording)


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
        Engines of the inverse dynamics with their versions, each once.
    report
        Python's and the packages' versions that made the report.
    program
        The program that made the report: SHA-256 of its sources, and their commit.
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
    engines: tuple[str, ...]
    report: Mapping[str, str]
    program: Mapping[str, str]
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
        "subject condition recording" -> reason (`pipeline.run.job.read_failures`).
    study
        What was to be done; without it, every subject is taken to have every condition.

    Returns
    -------
    list of TrialState
        In order of subject, conditions as the study has them.
    """
    present = [*results.trials, *(TrialName(*name.split(" ")) for name in failures)]
    planned, conditions = present, [name.condition for name in present]
    subjects = sorted({name.subject for name in present})
    if study is not None:
        planned, conditions = [*study.trials], [*study.file.conditions]
        subjects = [*study.subjects]
    recorded: dict[tuple[str, ...], list[TrialName]] = {}
    for name in planned:
        recorded.setdefault(name[:2], []).append(name)
    names: dict[TrialName, None] = {}
    for subject in subjects:
        for condition in conditions:
            nothing = [TrialName(subject, condition)]
            names |= dict.fromkeys(recorded.get((subject, condition), nothing))
    return [
        _state(name, results.trials.get(name), failures, study)
        for name in dict.fromkeys([*names, *results.trials])
    ]


def _state(
    key: TrialName, trial: TrialResult | None, failures: Mapping[str, str], study: Study | None
) -> TrialState:
    """Give what became of a trial, from its result, its failure, and what was to be done."""
    identity = (trial.source.name, trial.key) if trial is not None else (None, None)

    if absent := left_out(key, trial, failures, study):
        state, reason = absent
        if trial is not None and not trial.shortage and state != "outdated":
            reason += "; an older result is not in the tables"
        return TrialState(*key, state, reason, False, *identity)
    assert trial is not None
    changed = ""
    if study is not None and trial.settings != study.file.settings:
        changed = "processed with other settings than the study has now; run it again"
    elif study is not None and trial.key != trial_key(study, key):
        changed = "the program, its files or its settings have changed; run it again"
    return TrialState(*key, "outdated" if changed else "done", changed, True, *identity)


def left_out(
    name: TrialName, trial: TrialResult | None, failures: Mapping[str, str], study: Study | None
) -> tuple[State, str] | None:
    """Say what became of a trial that tables and figures do not include, and why; else None."""
    if failure := failures.get(str(name)) or (trial.shortage if trial is not None else ""):
        return "failed", failure
    in_study = study is None or name in study
    if study is not None and in_study and (reason := study.trial(name).exclude) is not None:
        return "excluded", reason
    if trial is None:
        missing = "no result: hbm run has not done it"
        return "missing", missing if in_study else "not in the subject's file"
    if not in_study:
        return "outdated", "no longer in the study; its result is not in the tables"
    return None


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
        engines=_each_once(trial.engine for trial in trials),
        report={
            "python": platform.python_version(),
            **{name: version(name) for name in (*PACKAGES, "pingouin", "matplotlib")},
        },
        program={"sha256": program_digest(), "git_commit": git_commit() or "not in a repository"},
        conditions=study.file.conditions if study else None,
        comparison=study.file.comparison if study else None,
        plates=study.file.plates if study else None,
        treadmill=study.file.treadmill if study else None,
        calibration=_each_once(note for trial in trials for note in trial.of_calibration),
        inputs=input_digests(study) if study else None,
        trials=tuple(states),
    )


def _each_once(values: Iterable[Item]) -> tuple[Item, ...]:
    """Give values without repetition, in order of their first occurrence."""
    return tuple({repr(value): value for value in values}.values())


def input_digests(study: Study) -> dict[str, str]:
    """Give the SHA-256 of every file that a study is made of, in order of their names."""
    names = {path.name for path in study.folder.glob("*.toml")} | {*study.files}
    plate_files_of = [(name, file.name) for name in names for file in plate_files(study.path(name))]
    names |= {Path(name).with_name(file).as_posix() for name, file in plate_files_of}
    return {name: file_digest(study.path(name)) for name in sorted(names)}
