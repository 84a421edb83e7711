"""A whole study: every trial once, side by side, resumable, nothing half-written."""

import hashlib
import json
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from pipeline.study import Study

PACKAGES = ("hbm", "compensation", "pipeline")
LOOK_S = 10.0
UNMANNED_S = 300.0
DIED = "the process that worked on it died; too little memory?"


@dataclass(frozen=True, slots=True)
class Job:
    """One trial of a study, where its result goes, and the digest of all that goes into it."""

    study: Study
    subject: str
    condition: str
    target: Path
    key: str

    @property
    def size(self) -> int:
        """Size of the recording [bytes]; 0 where there is none."""
        name = self.study.subjects[self.subject].trials[self.condition].file
        try:
            return self.study.path(name).stat().st_size if name else 0
        except OSError:
            return 0


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
    subjects: Sequence[str] | None = None,
    conditions: Sequence[str] | None = None,
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
    planned = plan(study, out, subjects=subjects, conditions=conditions)
    yield from run_jobs(planned, workers=jobs, scheduler=scheduler)


def plan(
    study: Study,
    out: Path,
    *,
    subjects: Sequence[str] | None = None,
    conditions: Sequence[str] | None = None,
) -> list[Job]:
    """List the trials of a study that have a recording, with the key of what goes into each.

    Paths are made absolute, for a worker may run in another folder.
    """
    study, out = replace(study, folder=study.folder.resolve()), out.resolve()
    wanted = [study.subject(s).id for s in dict.fromkeys(subjects or study.subjects)]
    for condition in conditions or ():
        study.condition(condition)
    jobs = []
    for subject in wanted:
        for condition, trial in study.subjects[subject].trials.items():
            if trial.exclude is None and (not conditions or condition in conditions):
                target = out / "trials" / f"{subject}_{condition}.parquet"
                key = trial_key(study, subject, condition)
                jobs.append(Job(study, subject, condition, target, key))
    return jobs


def run_jobs(
    planned: Iterable[Job], *, workers: int = 1, scheduler: str | None = None
) -> Iterator[Outcome]:
    """Process planned trials; parameters and outcomes as for `run_study`."""
    todo = []
    for job in planned:
        if stored_key(job.target) == job.key:
            yield Outcome(job, "kept")
        else:
            todo.append(job)
    todo.sort(key=lambda job: job.size, reverse=True)
    if scheduler is not None and todo:
        yield from _on_cluster(todo, scheduler)
    elif min(workers, len(todo)) > 1:
        yield from _side_by_side(todo, min(workers, len(todo)))
    else:
        yield from map(process_job, todo)


def _side_by_side(todo: list[Job], workers: int) -> Iterator[Outcome]:
    """Process trials in processes of their own.

    The death of one, such as for want of memory, takes the others' work with it; what is left is
    then processed one by one, so that only the trial that cannot be done fails.
    """
    left = {job.target: job for job in todo}
    side_by_side = Parallel(
        workers,
        backend="loky",
        inner_max_num_threads=1,
        batch_size=1,
        return_as="generator_unordered",
    )
    try:
        for outcome in side_by_side(delayed(process_job)(job) for job in todo):
            del left[outcome.job.target]
            yield outcome
    except BrokenProcessPool:
        for job in left.values():
            yield _alone(job)


def _alone(job: Job) -> Outcome:
    try:
        alone = Parallel(2, backend="loky", inner_max_num_threads=1)
        outcome: Outcome = alone([delayed(process_job)(job)])[0]
    except BrokenProcessPool:
        return Outcome(job, "failed", DIED)
    return outcome


def _on_cluster(todo: list[Job], scheduler: str) -> Iterator[Outcome]:
    """Process trials on a Dask cluster, whose workers may come late and die early.

    No more are sent than the workers have threads: Dask blames the death of a worker on all that
    waits for it. A cluster that has no workers yet is waited for, one that lost all is given up.
    """
    try:
        dask: Any = import_module("dask.distributed")
    except ImportError as missing:
        raise ValueError(
            "--scheduler needs Dask: pip install 'hbm-residuals[cluster]'"
        ) from missing
    waiting, sent = todo[::-1], dict[Any, Job]()
    manned_at = float("inf")
    with dask.Client(scheduler, timeout="10s") as client:
        while waiting or sent:
            threads = sum(client.nthreads().values())
            manned_at = time.monotonic() if threads else manned_at
            if time.monotonic() - manned_at > UNMANNED_S:
                break
            while waiting and len(sent) < max(1, threads):
                job = waiting.pop()
                sent[client.submit(process_job, job, pure=False)] = job
            with suppress(TimeoutError, dask.CancelledError):
                dask.wait(list(sent), timeout=LOOK_S, return_when="FIRST_COMPLETED")
            for future in [future for future in sent if future.status != "pending"]:
                yield _gathered(future, sent.pop(future), dask)
    for job in [*sent.values(), *waiting]:
        yield Outcome(job, "failed", "the cluster has no workers any more; run it again")


def _gathered(future: Any, job: Job, dask: Any) -> Outcome:
    try:
        outcome: Outcome = future.result(timeout=LOOK_S)
    except dask.KilledWorker:
        return Outcome(job, "failed", DIED)
    except Exception as error:
        if stored_key(job.target) == job.key:
            return Outcome(job, "done")
        return Outcome(job, "failed", f"on the cluster: {said(error)}")
    return outcome


def process_job(job: Job) -> Outcome:
    """Process one trial and write its result whole or not at all; failures become outcomes."""
    from pipeline.process import process_trial
    from pipeline.trial_files import write_trial

    try:
        if stored_key(job.target) == job.key:
            return Outcome(job, "kept")
        result = process_trial(job.study, job.subject, job.condition)
        if trial_key(job.study, job.subject, job.condition) != job.key:
            raise ValueError(
                "a file of it, or this program, changed while it was being processed; run it again"
            )
        write_trial(result, job.condition, job.key, job.target)
    except Exception as error:
        return Outcome(job, "failed", said(error))
    return Outcome(job, "done")


def said(error: BaseException) -> str:
    """Say an error in one line; one that nobody foresaw with its type and where it arose."""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, ValueError) and text:
        return text
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    name = Path(trace.tb_frame.f_code.co_filename).name if trace is not None else ""
    where = f" ({name}, line {trace.tb_lineno})" if trace is not None else ""
    return f"{type(error).__name__}: {text}{where}"


def trial_key(study: Study, subject: str, condition: str) -> str:
    """Give a digest of all that a trial's result depends on: files, statements, program."""
    person = study.subject(subject)
    trial = person.trials[condition]
    treadmill = study.file.treadmill
    names = [trial.file, person.static, treadmill.calibration]
    names += [treadmill.belt.calibration] if treadmill.belt is not None else []
    stated = {
        "files": [file_digest(study.path(name)) if name else None for name in names],
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
        written = path.stat()
        return _digest(path, written.st_mtime_ns, written.st_size)
    except OSError as error:
        return f"unreadable: {error.strerror}"


@lru_cache(maxsize=4096)
def _digest(path: Path, mtime_ns: int, size: int) -> str:
    """Hash a file once, until it is written to again."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
