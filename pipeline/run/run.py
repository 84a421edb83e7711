"""A whole study: every trial once, in parallel, resumable, nothing half-written."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from hbm.kernels.native import kernels
from hbm.spelling import shown
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
from pipeline.run.store import record_run, recorded_study_folder
from pipeline.trial.study_files import read_study_laboratory

Announce = Callable[[str], None]
"""Called with a sentence when something takes long."""


def run_study(
    study: Study,
    out: str | Path,
    *,
    subjects: Sequence[str] | None = None,
    conditions: Sequence[str] | None = None,
    jobs: int | None = 1,
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
        How many trials at a time; None: all processors, with 5 trials or more for each.
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
    TypeError
        If the study has not been read.
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
    if not isinstance(study, Study):
        expected = f"study: expected a study, got {shown(study)}"
        raise TypeError(f"{expected}; read it first: hr.read_study(FOLDER)")
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

    def job(way: Study, name: TrialName, results: Path) -> Job:
        way = replace(way.alone(name.subject), folder=folder)
        return Job(way, name, results / "trials" / f"{name.stem}.parquet", trial_key(way, name))

    jobs = []
    for name in study.to_process(subjects or (), conditions or ()):
        variants = study.variants.items()
        of_variants = {v: job(way, name, variant_folder(out, v)) for v, way in variants}
        jobs.append(replace(job(study, name, out), variants=of_variants))
    return jobs


def variant_folder(out: Path, variant: str) -> Path:
    """Give where the results of a variant are."""
    return out / "variants" / variant


def require_nothing_replaced(planned: Sequence[Job], out: Path) -> None:
    """Refuse to replace results of other settings or files, or to join those of another study.

    A ValueError says what was found, and what to do.
    """
    before = recorded_study_folder(out)
    if before is not None and planned and not before.samefile(planned[0].study.folder):
        raise ValueError(
            f"{out}: has the results of the study in {before}; choose another folder with --out, "
            "or --overwrite"
        )
    with_variants = [one for job in planned for one in (job, *job.variants.values())]
    reasons = Counter(filter(None, map(outdated, with_variants)))
    del reasons[OTHER_PROGRAM]
    if reasons:
        why = "; ".join(
            f"{trials} of {len(with_variants)} results: {reason}"
            for reason, trials in reasons.most_common()
        )
        raise ValueError(
            f"{out}: results there that were made otherwise would be replaced ({why}); --overwrite "
            "replaces them; to keep both, write the change as [variants.NAME] in study.toml"
        )


def forecast(planned: Sequence[Job]) -> str:
    """Say how many planned trials are new, outdated, and why, and up to date."""
    todo = [job for job in planned if stored_outcome(job) is None]
    reasons = Counter[str]()
    for job in todo:
        of_each = map(outdated, (job, *job.variants.values()))
        reasons.update([*filter(None, of_each)][:1])
    states = {"new": len(todo) - reasons.total()}
    states |= {f"outdated ({reason})": count for reason, count in reasons.items()}
    states["up to date"] = len(planned) - len(todo)
    return f"trials: {', '.join(f'{count} {state}' for state, count in states.items() if count)}"


def run_planned(
    study: Study,
    planned: Iterable[Job],
    out: Path,
    *,
    jobs: int | None = 1,
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
    try:
        for outcome in run_jobs(planned, workers=jobs, scheduler=scheduler):
            with suppress(OSError):  # of a full disk the outcome tells too
                record_failure(outcome.job.target, outcome.job.name, outcome.failure)
            yield outcome
    finally:
        with suppress(OSError):
            for folder in folders:
                collect_failures(folder, trials)


def run_jobs(
    planned: Iterable[Job], *, workers: int | None = 1, scheduler: str | None = None
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
        laboratory = None
        with suppress(Exception), one_thread():  # what fails here fails again with each trial
            laboratory = read_study_laboratory(todo[0].study)
        yield from work_on(todo, partial(process_job, laboratory=laboratory), workers)


def work_on(
    todo: Iterable[Job], work: Callable[[Job], Outcome], workers: int | None = 1
) -> Iterator[Outcome]:
    """Do something with every trial, the longest first; outcomes as trials finish.

    Parameters
    ----------
    todo
        The trials.
    work
        What to do with one, in a process of its own where there are several workers.
    workers
        How many trials at a time; None: as `in_processes` chooses.

    Notes
    -----
    When a process dies, for example for lack of memory, the pool ends all others. What is left is
    then done one by one, so that only the trial that cannot be done fails.
    """
    from joblib import delayed  # of one trial it is not needed

    waiting = {job.target: job for job in sorted(todo, key=lambda job: job.size, reverse=True)}
    try:
        tasks = [delayed(work)(job) for job in waiting.values()]
        written = {
            j.target.parent for job in waiting.values() for j in (job, *job.variants.values())
        }
        workers = workers and max(1, min(workers, len(tasks)))
        for outcome in in_processes(tasks, workers, written):
            yield replace(outcome, job=waiting.pop(outcome.job.target))  # not its copy
    except BrokenProcessPool:
        for job in waiting.values():
            try:
                # with one worker, it would be done in this process
                (outcome,) = in_processes([delayed(work)(job)], 2)
                kept = outcome.state == "kept"  # done just before its process ended
                yield replace(outcome, job=job, state="done" if kept else outcome.state)
            except BrokenProcessPool:
                yield Outcome(job, "failed", WORKER_DIED)
