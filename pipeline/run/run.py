"""A whole study: every trial once, in parallel, resumable, nothing half-written."""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Final

from joblib import delayed

from hbm.kernels.native import kernels
from pipeline.config.schema import TrialName
from pipeline.config.study import Study
from pipeline.io.write import require_writable
from pipeline.run.cluster import on_cluster
from pipeline.run.job import (
    OTHER_PROGRAM,
    WORKER_DIED,
    Job,
    Outcome,
    collect_failures,
    outdated,
    process_job,
    record_failure,
    stored_outcome,
    trial_key,
)
from pipeline.run.processes import in_processes, one_thread
from pipeline.run.store import record_run, recorded_speed
from pipeline.trial.study_files import read_study_laboratory

HASHED_AT_ONCE: Final = 2
"""Files; more are not read any faster."""
Announce = Callable[[str], None]
"""Called with a sentence when something takes long."""


def run_study(
    study: Study,
    out: str | Path,
    *,
    subjects: Sequence[str] | None = None,
    conditions: Sequence[str] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    overwrite: bool = False,
    announce: Announce = lambda sentence: None,
) -> Iterator[Outcome]:
    r"""Process the trials of a study whose results are not there yet.

    Parameters
    ----------
    study
        The study.
    out
        Folder for results; trials go to ``out/trials``.
    subjects, conditions
        Those to process; all by default.
    jobs
        How many trials at a time.
    scheduler
        Address of a Dask scheduler to run them on instead.
    overwrite
        Whether results that were made with other settings or files are replaced.
    announce
        Called with a sentence when something takes long.

    Returns
    -------
    iterator of Outcome
        As trials finish; first those whose results exist already. A failure stops no other trial;
        its reason is stored beside the results.

    Raises
    ------
    ValueError
        If a subject or condition is unknown, there is nothing to process, ``out`` cannot be
        written to, or results would be replaced that were made with other settings or files.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> _ = Path("study.toml").write_text("[conditions.level]")
    >>> trials = '[trials.level]\nfile = "walk.c3d"'
    >>> _ = Path("sub01.toml").write_text(f'id = "sub01"\nsex = "male"\n{trials}')
    >>> for outcome in pipeline.run_study(pipeline.read_study("."), "results"):
    ...     print(outcome)
    done sub01 level
    """
    out = Path(out)
    planned = plan(study, out, subjects=subjects, conditions=conditions)
    if not overwrite:
        require_nothing_replaced(planned, out)
    return run_planned(study, planned, out, jobs=jobs, scheduler=scheduler, announce=announce)


def plan(
    study: Study,
    out: Path,
    *,
    subjects: Sequence[str] | None = None,
    conditions: Sequence[str] | None = None,
) -> list[Job]:
    """List the trials of a study that have a recording, with the key of what goes into each.

    Paths are made absolute, for a worker may run in another folder. A ValueError says that a
    subject or condition is unknown, or that nothing is left to process.
    """
    folder, out = study.folder.resolve(), out.resolve()
    variants = {name: replace(own, folder=folder) for name, own in study.variants.items()}
    absolute = replace(study, folder=folder, variants=variants)
    trials = study.to_process(subjects or (), conditions or ())
    with ThreadPoolExecutor(HASHED_AT_ONCE) as pool:
        keys = [*pool.map(lambda name: trial_key(absolute, name), trials)]

    def job(own: Study, name: TrialName, folder: Path, key: str) -> Job:
        return Job(own, name, folder / "trials" / f"{name.stem}.parquet", key)

    jobs = []
    for name, key in zip(trials, keys, strict=True):
        of_variants = {
            variant: job(own, name, variant_folder(out, variant), trial_key(own, name))
            for variant, own in absolute.variants.items()
        }
        jobs.append(replace(job(absolute, name, out, key), variants=of_variants))
    return jobs


def variant_folder(out: Path, variant: str) -> Path:
    """Give where the results of a variant are."""
    return out / "variants" / variant


def require_nothing_replaced(planned: Sequence[Job], out: Path) -> None:
    """Refuse to replace results that were made with other settings or files: ValueError."""
    every = [each for job in planned for each in (job, *job.variants.values())]
    reasons = Counter(filter(None, map(outdated, every)))
    del reasons[OTHER_PROGRAM]
    if reasons:
        why = "; ".join(
            f"{trials} of {len(every)} results: {reason}"
            for reason, trials in reasons.most_common()
        )
        raise ValueError(
            f"{out}: results there that were made otherwise would be replaced ({why}); --overwrite "
            "replaces them; to keep both, write the change as [variants.NAME] in study.toml"
        )


@dataclass(frozen=True, slots=True)
class Forecast:
    """What a run is going to do.

    Attributes
    ----------
    new, kept
        Trials without a result, and those whose result is up to date.
    outdated
        Why results are not up to date -> how many trials.
    seconds
        How long it will take by the last run into the same folder; None without one.
    """

    new: int
    kept: int
    outdated: Mapping[str, int]
    seconds: float | None

    def __str__(self) -> str:
        parts = [f"{self.new} new"] * bool(self.new)
        parts += [f"{count} outdated ({reason})" for reason, count in self.outdated.items()]
        parts += [f"{self.kept} up to date"] * bool(self.kept)
        time_s = "" if self.seconds is None else f"; about {timedelta(seconds=round(self.seconds))}"
        return f"trials: {', '.join(parts)}{time_s}"


def forecast(planned: Sequence[Job], out: Path, workers: int = 1) -> Forecast:
    """Say what a run of planned trials into a folder is going to do, and how long it will take."""
    kept = [job for job in planned if stored_outcome(job) is not None]
    todo = [job for job in planned if job not in kept]
    reasons = Counter[str]()
    for job in todo:
        of_each = map(outdated, (job, *job.variants.values()))
        reasons.update([*filter(None, of_each)][:1])
    count = sum(job.size * (1 + len(job.variants)) for job in todo)
    speed = recorded_speed(out)
    seconds = count / speed / max(1, min(workers, len(todo))) if todo and speed else None
    return Forecast(len(todo) - reasons.total(), len(kept), dict(reasons), seconds)


def run_planned(
    study: Study,
    planned: Iterable[Job],
    out: Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    announce: Announce = lambda sentence: None,
) -> Iterator[Outcome]:
    """Process planned trials and leave in ``out`` why trials failed and where the study is.

    Parameters, outcomes and errors as for `run_study`.
    """
    folders = [out, *(variant_folder(out, variant) for variant in study.variants)]
    for folder in folders:
        require_writable(folder / "trials")
    record_run(out, study.folder)
    kernels(announce)
    trials = [str(name) for name, trial in study.trials.items() if trial.exclude is None]
    start, done, workers = time.monotonic(), 0, 1 if scheduler else jobs
    try:
        for outcome in run_jobs(planned, workers=jobs, scheduler=scheduler):
            if outcome.state == "done":
                done += outcome.job.size * (1 + len(outcome.job.variants))
            with suppress(OSError):  # of a full disk the outcome tells too
                record_failure(outcome.job.target, outcome.job.name, outcome.failure)
            yield outcome
    finally:
        with suppress(OSError):
            for folder in folders:
                collect_failures(folder, trials)
            if done:
                record_run(out, study.folder, done / (time.monotonic() - start) / workers)


def run_jobs(
    planned: Iterable[Job], *, workers: int = 1, scheduler: str | None = None
) -> Iterator[Outcome]:
    """Process planned trials, and nothing besides; outcomes as for `run_study`."""
    todo = []
    for job in planned:
        there = stored_outcome(job)
        if there is not None:
            yield there
        else:
            todo.append(job)
    if scheduler is not None and todo:
        todo.sort(key=lambda job: job.size, reverse=True)
        yield from on_cluster(todo, scheduler)
    elif todo:
        workers, laboratory = min(workers, len(todo)), None
        with suppress(Exception), one_thread():  # what fails here fails again with each trial
            laboratory = read_study_laboratory(todo[0].study)
        yield from work_on(todo, partial(process_job, laboratory=laboratory), workers)


def work_on(
    todo: Iterable[Job], work: Callable[[Job], Outcome], workers: int = 1
) -> Iterator[Outcome]:
    """Do something with every trial, the longest first; outcomes as trials finish.

    Parameters
    ----------
    todo
        The trials.
    work
        What to do with one, in a process of its own where there are several workers.
    workers
        How many trials at a time.

    Notes
    -----
    When a process dies, for example for lack of memory, the pool ends all others. What is left is
    then done one by one, so that only the trial that cannot be done fails.
    """
    left = {job.target: job for job in sorted(todo, key=lambda job: job.size, reverse=True)}
    try:
        tasks = [delayed(work)(job) for job in left.values()]
        written = {j.target.parent for job in left.values() for j in (job, *job.variants.values())}
        for outcome in in_processes(tasks, max(1, min(workers, len(tasks))), written):
            del left[outcome.job.target]
            yield outcome
    except BrokenProcessPool:
        for job in left.values():
            try:
                # with one worker, it would be done in this process
                yield from in_processes([delayed(work)(job)], 2)
            except BrokenProcessPool:
                yield Outcome(job, "failed", WORKER_DIED)
