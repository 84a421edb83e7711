"""A study on the command line: check, run with progress, report."""

import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from hbm.native import kernels
from pipeline.check import check_study
from pipeline.collect import collect
from pipeline.result_commands import remember_study
from pipeline.run import Outcome, plan, run_study
from pipeline.study import read_study
from pipeline.trial_files import whole_file

FAILURES = "failures.json"


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
        If the study or a name is at fault.
    """
    console = Console(highlight=False, markup=False)
    study = read_study(folder)
    start = time.monotonic()
    chosen = {"subjects": list(subjects) or None, "conditions": list(conditions) or None}
    total = len(plan(study, out, **chosen))
    kernels(lambda sentence: console.print(sentence, style="dim"))
    outcomes: list[Outcome] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task("trials", total=total)
        for outcome in run_study(study, out, jobs=jobs, scheduler=scheduler, **chosen):
            outcomes.append(outcome)
            progress.advance(task)
            if outcome.state == "failed":
                progress.console.print(
                    f"FAILED {_named(outcome)}: {outcome.reason}", soft_wrap=True
                )
    failed = {_named(o): o.reason for o in outcomes if o.state == "failed"}
    _note_failures(out / FAILURES, failed, {_named(o) for o in outcomes})
    remember_study(out, study.folder)
    counts = {s: sum(o.state == s for o in outcomes) for s in ("done", "kept", "failed")}
    console.print(
        f"{counts['done']} trials processed, {counts['kept']} were there already, "
        f"{counts['failed']} failed, in {time.monotonic() - start:.1f} s; next: hbm report {out}",
        soft_wrap=True,
    )
    return 1 if failed else 0


def _note_failures(path: Path, failed: dict[str, str], tried: set[str]) -> None:
    """Keep the reasons of failed trials for the report, those of trials not tried now too."""
    try:
        before = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        before = {}
    kept = {name: reason for name, reason in before.items() if name not in tried}
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(kept | failed, indent=1, ensure_ascii=False), "utf-8")


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
    view = Table(title="Pelvis residuals, RMS, mean ± SD over subjects (x forward, y right, z up)")
    columns = residuals[["condition", "compensated"]].drop_duplicates()
    view.add_column("axis")
    for condition, compensated in columns.itertuples(index=False):
        plates = "compensated" if compensated else "as measured"
        view.add_column(f"{condition}, {plates}", justify="right")
    cells = residuals.groupby(["axis", "condition", "compensated"])["rms"]
    mean, sd = cells.mean(), cells.std(ddof=1)
    for axis, unit in residuals[["axis", "unit"]].drop_duplicates().itertuples(index=False):
        keys = [(axis, *column) for column in columns.itertuples(index=False)]
        view.add_row(f"{axis} {unit}", *(_cell(mean.get(k), sd.get(k)) for k in keys))
    Console(highlight=False, markup=False).print(view)


def _cell(mean: float | None, sd: float | None) -> str:
    if mean is None:
        return "–"
    return f"{mean:.1f}" if sd is None or np.isnan(sd) else f"{mean:.1f} ± {sd:.1f}"
