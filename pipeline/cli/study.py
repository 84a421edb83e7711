"""A study on the command line: check, run with progress, report."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from hbm.kernels.native import kernels
from pipeline.config.study import read_study
from pipeline.io.write import remove_leftovers, require_writable
from pipeline.run.check import check_study
from pipeline.run.failures import gather_failures, note_failure
from pipeline.run.job import Job, Outcome
from pipeline.run.load import collect
from pipeline.run.run import plan, run_jobs
from pipeline.run.store import remember_study


def check(folder: Path) -> int:
    """Print everything that is wrong or remarkable about a study.

    Parameters
    ----------
    folder
        The study.

    Returns
    -------
    int
        Exit code: 0 if a run would process everything, 2 if not.

    Raises
    ------
    StudyFaults
        If the TOML files are at fault.
    """
    console = Console(highlight=False, markup=False)
    study = read_study(folder)
    findings = check_study(study)
    for remark in findings.remarks:
        console.print(f"- {remark}", soft_wrap=True)
    for fault in findings.faults:
        console.print(f"FAULT {fault}", soft_wrap=True)
    trials = sum(t.exclude is None for s in study.subjects.values() for t in s.trials.values())
    console.print(
        f"{len(study.subjects)} subjects, {trials} trials, {len(findings.faults)} faults"
        + ("" if findings.faults else f"; next: hbm run {folder}"),
        soft_wrap=True,
    )
    return 2 if findings.faults else 0


def run(
    folder: Path,
    out: Path,
    *,
    subjects: Sequence[str] = (),
    conditions: Sequence[str] = (),
    jobs: int = 1,
    scheduler: str | None = None,
) -> int:
    """Process a study's trials with progress; say what was done, kept and failed.

    Parameters
    ----------
    folder
        The study.
    out
        Folder for results.
    subjects, conditions
        Which; all if empty.
    jobs
        Trials side by side.
    scheduler
        Address of a Dask scheduler.

    Returns
    -------
    int
        Exit code: 0, or 1 if some trials failed.

    Raises
    ------
    StudyFaults, ValueError
        If the study or a name is at fault, or there is nothing to process.
    """
    console = Console(highlight=False, markup=False)
    study = read_study(folder)
    start = time.monotonic()
    planned = plan(study, out, subjects=subjects, conditions=conditions)
    if not planned:
        raise ValueError(
            f"{folder}: nothing to process: all trials of these subjects and conditions are "
            "excluded, or there are none"
        )
    require_writable(out / "trials")
    remove_leftovers(out / "trials")
    remember_study(out, study.folder)
    kernels(lambda sentence: console.print(sentence, style="dim"))
    outcomes: list[Outcome] = []
    show = _Shown(console, planned)
    with show.bar:
        for outcome in run_jobs(planned, workers=jobs, scheduler=scheduler):
            outcomes.append(outcome)
            show(outcome)
            reason = outcome.reason if outcome.state == "failed" else None
            with _told(console):
                note_failure(outcome.job.target, _named(outcome), reason)
    everything = [
        f"{subject} {condition}"
        for subject, person in study.subjects.items()
        for condition, trial in person.trials.items()
        if trial.exclude is None
    ]
    with _told(console):
        gather_failures(out, everything)
    counts = {s: sum(o.state == s for o in outcomes) for s in ("done", "kept", "failed")}
    console.print(
        f"{counts['done']} trials processed, {counts['kept']} were there already, "
        f"{counts['failed']} failed, in {time.monotonic() - start:.1f} s; next: hbm report {out}",
        soft_wrap=True,
    )
    return 1 if counts["failed"] else 0


class _Shown:
    """Progress by size of the recordings: a bar in a terminal, a line per trial elsewhere."""

    def __init__(self, console: Console, planned: Sequence[Job]) -> None:
        self.console, self.trials, self.finished = console, len(planned), 0
        self.bar = Progress(
            TextColumn("{task.description}"), BarColumn(), console=console, transient=True
        )
        self.size = {job.target: max(job.size, 1) for job in planned}
        self.total, self.done, self.start = sum(self.size.values()), 0, time.monotonic()
        self.task = self.bar.add_task(f"0 of {self.trials} trials", total=self.total)

    def __call__(self, outcome: Outcome) -> None:
        self.finished += 1
        size = self.size[outcome.job.target]
        if outcome.state == "kept":
            self.total -= size
        else:
            self.done += size
        said = f"{self.finished} of {self.trials} trials{self._left()}"
        self.bar.update(self.task, total=self.total, completed=self.done, description=said)
        if outcome.state == "failed":
            line = f"FAILED {_named(outcome)}: {outcome.reason}"
            self.bar.console.print(line, soft_wrap=True)
        elif not self.console.is_terminal:
            self.console.print(f"{outcome.state} {_named(outcome)}; {said}", soft_wrap=True)

    def _left(self) -> str:
        if not self.done or self.done == self.total:
            return ""
        seconds = (time.monotonic() - self.start) * (self.total / self.done - 1)
        return f", {seconds / 60:.0f} min left" if seconds > 90 else f", {seconds:.0f} s left"


@contextmanager
def _told(console: Console) -> Iterator[None]:
    """Say that something could not be written, and go on."""
    try:
        yield
    except OSError as error:
        console.print(f"{error.filename or 'results'}: {error.strerror}", soft_wrap=True)


def _named(outcome: Outcome) -> str:
    return f"{outcome.job.subject} {outcome.job.condition}"


def print_residuals(folder: Path) -> None:
    """Print a study's residual table: RMS, mean ± SD over subjects.

    Parameters
    ----------
    folder
        Results folder.
    """
    residuals = collect(folder).residuals
    view = Table(
        title="Pelvis residuals, RMS, mean ± SD over subjects",
        caption="x forward, y right, z up; IC: with inertia compensation",
        box=box.SIMPLE_HEAD,
        padding=(0, 0),
    )
    columns = residuals[["condition", "compensated"]].drop_duplicates()
    view.add_column("axis")
    for condition, compensated in columns.itertuples(index=False):
        plates = "IC" if compensated else "no IC"
        view.add_column(f"{condition}\n{plates}", justify="right", no_wrap=True)
    cells = residuals.groupby(["axis", "condition", "compensated"])["rms"]
    mean, sd = cells.mean(), cells.std(ddof=1)
    for axis, unit in residuals[["axis", "unit"]].drop_duplicates().itertuples(index=False):
        keys = [(axis, *column) for column in columns.itertuples(index=False)]
        view.add_row(f"{axis}, {unit}", *(_cell(mean.get(k), sd.get(k)) for k in keys))
    Console(highlight=False, markup=False).print(view)


def _cell(mean: float | None, sd: float | None) -> str:
    if mean is None:
        return "–"
    return f"{mean:.1f}" if sd is None or np.isnan(sd) else f"{mean:.1f} ± {sd:.1f}"
