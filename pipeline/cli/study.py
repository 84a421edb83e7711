"""A study on the command line: init, check, run."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import USAGE, Jobs, Out, StudyFolder

if TYPE_CHECKING:
    from rich.console import Console

    from hbm.notes import Note
    from pipeline.config.study import Study
    from pipeline.run.check import Findings


def init(folder: Annotated[Path, typer.Argument(help="Folder for the new study.")]) -> None:
    """Write a commented study.toml and a subject file to start from."""
    from pipeline.cli.terminal import plain_console
    from pipeline.config.templates import write_template

    study, subject = write_template(folder)
    plain_console().print(
        f"written: {study}, {subject}; next: edit them, then hbm check {folder}", soft_wrap=True
    )


def check(
    study: StudyFolder,
    second_reader: Annotated[
        bool,
        typer.Option(
            "--second-reader", help="Read every C3D file also with ezc3d and list what differs."
        ),
    ] = False,
) -> int:
    """Read every TOML and every recording of a study, list all problems, compute nothing."""
    from pipeline.cli.terminal import counted, note_line, plain_console
    from pipeline.config.comparison import study_design
    from pipeline.config.study import read_study
    from pipeline.run.check import check_study, joined
    from pipeline.statistics.design import in_words

    console, loaded = plain_console(), read_study(study)
    findings = check_study(loaded)
    if second_reader:
        findings = joined([findings, *_read_twice(loaded, console)])
    for place in dict.fromkeys(remark.place for remark in findings.remarks):
        console.print(place, soft_wrap=True)
        for remark in findings.remarks:
            if remark.place == place:
                console.print(note_line(remark.note), soft_wrap=True)
    for fault in findings.faults:
        console.print(f"FAULT {fault}", soft_wrap=True)
    if not findings.faults:
        stated = "" if loaded.file.comparison else "no [comparison] is stated: "
        console.print(f"{stated}{in_words(study_design(loaded.file))}", soft_wrap=True)
    trials = sum(t.exclude is None for s in loaded.subjects.values() for t in s.trials.values())
    console.print(
        f"{counted(len(loaded.subjects), 'subject')}, {counted(trials, 'trial')}, "
        f"{counted(len(findings.faults), 'fault')}"
        + ("" if findings.faults else f"; next: hbm run {study}"),
        soft_wrap=True,
    )
    return USAGE if findings.faults else 0


def _read_twice(study: "Study", console: "Console") -> "list[Findings]":
    from pipeline.cli.terminal import StepProgress
    from pipeline.run.second_reader import read_twice, study_recordings, summarise

    found, paths = [], study_recordings(study)
    with StepProgress(console, "reading twice", "files") as progress:
        for path in paths:
            found.append(read_twice(path))
            progress.show(path.name, len(found), len(paths))
    return [*found, summarise(found)]


def run(
    study: StudyFolder,
    subject: Annotated[list[str] | None, typer.Option(help="Only this one; repeatable.")] = None,
    condition: Annotated[list[str] | None, typer.Option(help="Only this one; repeatable.")] = None,
    jobs: Jobs = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler to run the trials on, e.g. tcp://host:8786.")
    ] = None,
    out: Out = Path("results"),
    overwrite: Annotated[
        bool,
        typer.Option("--overwrite", help="Replace results made with other settings or files."),
    ] = False,
) -> int:
    """Process a study; finished trials are skipped, failed ones listed with reasons."""
    from pipeline.cli.stopping import stoppable
    from pipeline.cli.terminal import StepProgress, announcer, counted, note_line, plain_console
    from pipeline.config.study import read_study
    from pipeline.config.toml_file import StudyFaults
    from pipeline.run.processes import keep_freed_memory
    from pipeline.run.run import plan, require_nothing_replaced, run_planned
    from pipeline.trial.study_files import read_study_laboratory

    console, start = plain_console(), time.monotonic()
    keep_freed_memory()
    try:
        loaded = read_study(study, recordings=False)  # a trial whose file is missing fails alone
    except StudyFaults:
        loaded = read_study(study)  # what stops the run, and whatever else is missing
    planned = plan(loaded, out, subjects=subject, conditions=condition)
    if not any(job.size for job in planned):
        read_study(study)  # says what is missing
    if not overwrite:
        require_nothing_replaced(planned, out)
    if loaded.file.treadmill.check:
        for note in read_study_laboratory(loaded).notes:
            console.print(note_line(note), soft_wrap=True)
    counts = {"done": 0, "kept": 0, "failed": 0}
    of_calibration: dict[Note, None] = {}
    size = {job.target: max(job.size, 1) for job in planned}  # before a file may go
    size_done, to_do = 0, sum(size.values())
    outcomes = run_planned(
        loaded, planned, out, jobs=jobs, scheduler=scheduler, announce=announcer(console)
    )

    def kept() -> str:
        done = counts["done"] + counts["kept"]
        trials = counted(len(planned), "trial")
        return f"done and kept are {done} of {trials}; the same command goes on"

    with stoppable(kept), StepProgress(console, "processing", "trials") as progress:
        for finished, outcome in enumerate(outcomes, 1):
            counts[outcome.state] += 1
            of_calibration |= dict.fromkeys(outcome.of_calibration)
            if outcome.state == "kept":
                to_do -= size[outcome.job.target]
            else:
                size_done += size[outcome.job.target]
            progress.show(
                str(outcome),
                finished,
                len(planned),
                size_done=size_done,
                size=to_do,
                always=outcome.failure is not None,
            )
    for note in of_calibration:
        console.print(note_line(note), soft_wrap=True)
    console.print(
        f"{counted(counts['done'], 'trial')} processed, {counts['kept']} were there already, "
        f"{counts['failed']} failed, in {time.monotonic() - start:.1f} s; next: hbm report {out}",
        soft_wrap=True,
    )
    return 1 if counts["failed"] else 0
