"""A whole study: every trial once, side by side, resumable, nothing half-written."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed, parallel_config

from pipeline.study import Study, read_study

PACKAGES = ("hbm", "compensation", "pipeline")


@dataclass(frozen=True, slots=True)
class Job:
    """One trial of a study and where its result goes."""

    folder: Path
    subject: str
    condition: str
    target: Path
    key: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a trial: ``state`` is "done", "kept" (was there already) or "failed"."""

    job: Job
    state: str
    reason: str = ""


def run_study(
    study: Study,
    out: Path,
    *,
    subjects: list[str] | None = None,
    conditions: list[str] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
) -> Iterator[Outcome]:
    """Process the trials of a study whose results are not there yet.

    Parameters
    ----------
    study
        The study.
    out
        Folder for results; trials go to ``out/trials``.
    subjects, conditions
        Which; all by default.
    jobs
        Trials side by side.
    scheduler
        Address of a Dask scheduler to run them on instead.

    Yields
    ------
    Outcome
        As trials finish, those that are there already first. A failing trial stops no other.

    Raises
    ------
    ValueError
        If a subject or condition is unknown.
    """
    todo = []
    for job in plan(study, out, subjects=subjects, conditions=conditions):
        if stored_key(job.target) == job.key:
            yield Outcome(job, "kept")
        else:
            todo.append(job)
    if not todo:
        return
    with _backend(scheduler):
        parallel = Parallel(
            n_jobs=-1 if scheduler else min(jobs, len(todo)), return_as="generator_unordered"
        )
        yield from parallel(delayed(process_job)(job) for job in todo)


def _backend(scheduler: str | None) -> Any:
    if scheduler is None:
        return parallel_config(backend="loky", inner_max_num_threads=1)
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise ValueError("--scheduler needs Dask: pip install 'hbm-residuals[cluster]'") from error
    client: Any = Client(scheduler, timeout="10s")  # type: ignore[no-untyped-call]
    return parallel_config(backend="dask", client=client)


def plan(
    study: Study,
    out: Path,
    *,
    subjects: list[str] | None = None,
    conditions: list[str] | None = None,
) -> list[Job]:
    """List the trials of a study that have a recording, with the key of what goes into each."""
    wanted_subjects = [study.subject(s).id for s in subjects] if subjects else list(study.subjects)
    for condition in conditions or ():
        study.condition(condition)
    jobs = []
    for subject in wanted_subjects:
        for condition, trial in study.subjects[subject].trials.items():
            if trial.exclude is None and (not conditions or condition in conditions):
                target = out / "trials" / f"{subject}_{condition}.parquet"
                key = trial_key(study, subject, condition)
                jobs.append(Job(study.folder, subject, condition, target, key))
    return jobs


def process_job(job: Job) -> Outcome:
    """Process one trial and write its result whole or not at all; failures become outcomes."""
    from pipeline.process import process_trial
    from pipeline.trial_files import write_trial

    try:
        study = read_study(job.folder)
        result = process_trial(study, job.subject, job.condition)
        write_trial(result, job.condition, job.key, job.target)
    except (ValueError, OSError, KeyError, ArithmeticError, MemoryError) as error:
        return Outcome(job, "failed", " ".join(str(error).split()) or type(error).__name__)
    return Outcome(job, "done")


def trial_key(study: Study, subject: str, condition: str) -> str:
    """Give a digest of all that a trial's result depends on: files, statements, program."""
    person = study.subject(subject)
    trial = person.trials[condition]
    names = [trial.file, person.static, study.file.treadmill.calibration]
    stated = {
        "files": [file_digest(study.path(name)) for name in names if name],
        "study": study.file.model_dump(exclude={"name", "conditions"}),
        "condition": study.condition(condition).model_dump(),
        "subject": person.person.model_dump(),
        "marker_set": str(study.marker_set),
        "program": program_digest(),
    }
    return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()


def file_digest(path: Path) -> str:
    """Give a file's SHA-256; a file that is gone has none, and the trial will say so."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return f"unreadable: {error.strerror}"


@cache
def program_digest() -> str:
    """Give a digest of this program's own sources and its numerical libraries' versions."""
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.suffix in {".py", ".csv", ".toml"}:
                digest.update(path.relative_to(root).as_posix().encode())
                digest.update(path.read_bytes())
    for name in ("numpy", "scipy", "casadi"):
        digest.update(f"{name} {version(name)}".encode())
    return digest.hexdigest()


def stored_key(path: Path) -> str | None:
    """Give the key a trial's result was written with; None where there is no sound result."""
    from pipeline.trial_files import read_facts

    try:
        return str(read_facts(path)["key"])
    except (OSError, ValueError, KeyError):
        return None
