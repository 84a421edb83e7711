"""A whole study: every trial once, in parallel, resumable, nothing half-written."""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

from joblib import Parallel, delayed

from hbm.engines.choice import choose_engine
from pipeline.config.study import Study
from pipeline.run.cluster import on_cluster
from pipeline.run.job import WORKER_DIED, Job, Outcome, process_job, stored_key, trial_key


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
        Those to process; all by default.
    jobs
        How many trials at a time.
    scheduler
        Address of a Dask scheduler to run them on instead.

    Yields
    ------
    Outcome
        As trials finish; first those whose results exist already. A failure stops no other trial.

    Raises
    ------
    ValueError
        If a subject or condition is unknown, or the study states an engine that cannot be imported.
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

    Paths are made absolute, for a worker may run in another folder. An engine that is stated but
    cannot be imported is a ValueError.
    """
    choose_engine(study.file.settings.engine)
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
        yield from on_cluster(todo, scheduler)
    elif min(workers, len(todo)) > 1:
        yield from _in_parallel(todo, min(workers, len(todo)))
    else:
        yield from map(process_job, todo)


def _in_parallel(todo: list[Job], workers: int) -> Iterator[Outcome]:
    """Process trials in processes of their own.

    When one of them dies, for example for lack of memory, the pool ends all others. What is left is
    then processed one by one, so that only the trial that cannot be processed fails.
    """
    left = {job.target: job for job in todo}
    parallel = Parallel(
        workers,
        backend="loky",
        inner_max_num_threads=1,
        batch_size=1,
        return_as="generator_unordered",
    )
    try:
        for outcome in parallel(delayed(process_job)(job) for job in todo):
            del left[outcome.job.target]
            yield outcome
    except BrokenProcessPool:
        for job in left.values():
            yield _in_own_process(job)


def _in_own_process(job: Job) -> Outcome:
    try:
        # with one worker, joblib would process it in this process
        parallel = Parallel(2, backend="loky", inner_max_num_threads=1)
        outcome: Outcome = parallel([delayed(process_job)(job)])[0]
    except BrokenProcessPool:
        return Outcome(job, "failed", WORKER_DIED)
    return outcome
