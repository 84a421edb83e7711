"""Where a study's numbers come from: trials, settings, inputs, program."""

import json
import platform
import subprocess
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Literal

from pipeline.config.schema import Trial
from pipeline.config.study import Study
from pipeline.run.job import file_digest, program_digest, trial_key
from pipeline.run.load import Results
from pipeline.trial.summary import PACKAGES, TrialSummary

REPORT_PACKAGES: Final = (*PACKAGES, "pingouin", "matplotlib")
FAILURES: Final = "failures.json"

State = Literal["done", "outdated", "failed", "excluded", "missing"]


@dataclass(frozen=True, slots=True)
class TrialState:
    """What became of a trial.

    Attributes
    ----------
    subject, condition
        Which.
    state
        "done"; "outdated": done, but otherwise than the study says now; "failed"; "excluded";
        "missing": no result and no reason.
    reason
        Why it is not simply done.
    in_tables
        Whether there is a result that the tables and figures take: not that of a trial which
        failed since, is excluded by now, or is no longer in the study.
    """

    subject: str
    condition: str
    state: State
    reason: str
    in_tables: bool


def read_failures(folder: Path) -> dict[str, str]:
    """Read why trials failed, "subject condition" -> reason; nothing where none is stored."""
    try:
        found: dict[str, str] = json.loads((folder / FAILURES).read_text("utf-8"))
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise ValueError(
            f"{folder / FAILURES} is damaged ({error}); run 'hbm run' again"
        ) from error
    return found


def trial_states(
    results: Results, failures: dict[str, str], study: Study | None = None
) -> list[TrialState]:
    """Say of every trial of a study what became of it.

    Parameters
    ----------
    results
        What `hbm run` left.
    failures
        "subject condition" -> reason (`read_failures`).
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
        subjects = sorted({key[0] for key in (*results.summaries, *names)})
        conditions = dict.fromkeys(key[1] for key in (*results.summaries, *names))
        planned = {(s, c): None for s in subjects for c in conditions}
    else:
        for subject, person in study.subjects.items():
            for condition in study.file.conditions:
                planned[subject, condition] = _why_not(person.trials.get(condition))
        planned |= {key: None for key in results.summaries if key not in planned}
    return [_state(key, why, results, failures, study) for key, why in planned.items()]


def _why_not(trial: Trial | None) -> tuple[State, str] | None:
    """Say why a trial was not to be processed; None if it was."""
    if trial is None:
        return "missing", "not in the subject's file"
    return None if trial.exclude is None else ("excluded", trial.exclude)


def _state(
    key: tuple[str, str],
    why_not: tuple[State, str] | None,
    results: Results,
    failures: dict[str, str],
    study: Study | None,
) -> TrialState:
    trial = results.summaries.get(key)
    failure = failures.get(" ".join(key))
    if failure is not None:
        why_not = "failed", failure
    if why_not is not None:
        older = "; an older result is left out of the tables" if trial is not None else ""
        return TrialState(*key, why_not[0], why_not[1] + older, False)
    if trial is None:
        return TrialState(*key, "missing", "no result: hbm run has not done it", False)
    if study is not None:
        if key[0] not in study.subjects or key[1] not in study.file.conditions:
            said = "no longer in the study; its result is left out of the tables"
            return TrialState(*key, "outdated", said, False)
        if trial.settings != study.file.settings:
            said = "processed with other settings than the study states now; run it again"
            return TrialState(*key, "outdated", said, True)
        if trial.key != trial_key(study, *key):
            said = "the program, a file of it or what is stated has changed since; run it again"
            return TrialState(*key, "outdated", said, True)
    return TrialState(*key, "done", "", True)


def provenance(results: Results, states: list[TrialState], study: Study | None) -> dict[str, Any]:
    """Gather what ``study.json`` says.

    Parameters
    ----------
    results, states
        The trials and what became of them.
    study
        The study, if its folder is at hand: its statements and the hashes of its files.

    Returns
    -------
    dict
        Plain values, ready for JSON. ``settings`` and ``versions`` are those the trials were
        processed with, each once; more than one means that trials are not alike.
    """
    trials = results.summaries.values()
    return {
        "name": study.file.name if study else None,
        "settings": _each_once([trial.settings.model_dump() for trial in trials]),
        "versions": _each_once([dict(trial.versions) for trial in trials]),
        "report": {
            "python": platform.python_version(),
            **{name: version(name) for name in REPORT_PACKAGES},
        },
        "program": {"sha256": program_digest(), "git_commit": git_commit()},
        "conditions": _dumped(study.file.conditions) if study else None,
        "treadmill": study.file.treadmill.model_dump(mode="json") if study else None,
        "inputs": input_digests(study) if study else None,
        "trials": [
            asdict(state) | _identity(results.summaries.get((state.subject, state.condition)))
            for state in states
        ],
    }


def _identity(trial: TrialSummary | None) -> dict[str, str | None]:
    return {"source": trial.source, "key": trial.key} if trial else {"source": None, "key": None}


def _dumped(models: Any) -> dict[str, Any]:
    return {name: model.model_dump(mode="json") for name, model in models.items()}


def _each_once(values: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [value for k, value in enumerate(values) if value not in values[:k]]


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
    if study.file.treadmill.calibration:
        names.add(study.file.treadmill.calibration)
    if study.file.treadmill.belt is not None:
        names.add(study.file.treadmill.belt.calibration)
    return {name: file_digest(study.path(name)) for name in sorted(names)}


def git_commit() -> str | None:
    """Give the commit of the program's sources, "… with changes" if they differ from it.

    None where the program does not run from a repository of its own.
    """
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None

    def git(*words: str) -> str:
        command = ["git", "-C", str(root), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        commit = git("rev-parse", "HEAD")
        changed = git("status", "--porcelain", "--", "hbm", "compensation", "pipeline")
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{commit} with changes" if changed else commit
