"""A study on the command line: init, check, run, and its results: report, view."""

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import RESULT, USAGE, Jobs, Out, ResultsFolder, StudyFolder

if TYPE_CHECKING:
    from hbm.notes import Note


def init(folder: Annotated[Path, typer.Argument(help="Folder for the new study.")]) -> None:
    """Write a commented study.toml and a subject file to start from."""
    from pipeline.cli.terminal import PlainConsole
    from pipeline.config.templates import write_template

    study, subject = write_template(folder)
    PlainConsole().say(f"written: {study}, {subject}; next: edit them, then hbm check {folder}")


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
    from pipeline.cli.terminal import PlainConsole, StepProgress, counted, note_line
    from pipeline.config.comparison import study_design
    from pipeline.config.study import read_study
    from pipeline.run.check import check_study
    from pipeline.statistics.design import in_words

    console, loaded = PlainConsole(), read_study(study)
    findings = check_study(loaded)
    if second_reader:
        from pipeline.run.second_reader import read_study_twice

        with StepProgress(console, "reading twice", "files") as progress:
            findings.add(read_study_twice(loaded, progress.show))
    for place in dict.fromkeys(remark.place for remark in findings.remarks):
        console.say(place)
        for remark in findings.remarks:
            if remark.place == place:
                console.say(note_line(remark.note))
    for fault in findings.faults:
        console.say(f"FAULT {fault}")
    if not findings.faults:
        stated = "" if loaded.file.comparison else "no [comparison] is stated: "
        console.say(f"{stated}{in_words(study_design(loaded.file))}")
    trials = sum(t.exclude is None for s in loaded.subjects.values() for t in s.trials.values())
    console.say(
        f"{counted(len(loaded.subjects), 'subject')}, {counted(trials, 'trial')}, "
        f"{counted(len(findings.faults), 'fault')}"
        + ("" if findings.faults else f"; next: hbm run {study}")
    )
    return USAGE if findings.faults else 0


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
    from pipeline.cli.terminal import PlainConsole, StepProgress, announcer, counted
    from pipeline.config.study import read_study
    from pipeline.config.toml_file import StudyFaults
    from pipeline.run.processes import keep_freed_memory
    from pipeline.run.run import plan, require_nothing_replaced, run_planned
    from pipeline.trial.study_files import read_study_laboratory

    console, start = PlainConsole(), time.monotonic()
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
        console.say_notes(read_study_laboratory(loaded).notes)
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
    console.say_notes(of_calibration)
    console.say(
        f"{counted(counts['done'], 'trial')} processed, {counts['kept']} were there already, "
        f"{counts['failed']} failed, in {time.monotonic() - start:.1f} s; next: hbm report {out}"
    )
    return 1 if counts["failed"] else 0


ResultsToView = Annotated[
    Path, typer.Argument(help="Folder that hbm run wrote, or a single result (.parquet).")
]


def report(
    folder: ResultsFolder = Path("results"),
    covariate: Annotated[
        list[str] | None,
        typer.Option(
            help="height_m, mass_kg, sex or age_years, in place of the study's; repeatable."
        ),
    ] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Print how many subjects the study needs (plan.md).")
    ] = False,
) -> None:
    """Write tables, statistics, figures and report.html from the results of hbm run."""
    from rich.text import Text

    from pipeline.cli.terminal import PlainConsole
    from pipeline.report.write import write_report
    from pipeline.run.store import recorded_study_folder

    console = PlainConsole()
    with console.status("report") as status:
        page = write_report(
            folder,
            recorded_study_folder(folder),
            lambda step: status.update(Text(step)),
            covariates=covariate or (),
        )
    if plan:
        console.say((page.parent / "plan.md").read_text(encoding="utf-8"))
    console.say(f"report: {page}")


def view(
    results: ResultsToView = Path("results"),
    subject: Annotated[str | None, typer.Option(help="Default: the first.")] = None,
    condition: Annotated[str | None, typer.Option(help="Default: the first.")] = None,
    web: Annotated[bool, typer.Option("--web", help="In a browser on this machine.")] = False,
    save: Annotated[
        Path | None, typer.Option(help="Write the Rerun recording to this file instead.")
    ] = None,
) -> None:
    """Open a trial in the Rerun viewer: markers, body, plates, forces, residuals over time."""
    from rich.text import Text

    from pipeline.budgets.study import bands_of
    from pipeline.cli.terminal import PlainConsole
    from pipeline.io.write import write_text
    from pipeline.run.program import program_digest
    from pipeline.run.store import read_trial
    from pipeline.viewer.serve import view as show
    from pipeline.viewer.trial import write_cycles, write_recording

    console = PlainConsole()
    result = results if results.suffix == RESULT else _result_of(results, subject, condition)
    if save is not None:
        with console.status(Text(f"preparing {result.stem}")):
            save.parent.mkdir(parents=True, exist_ok=True)
            trial = read_trial(result)
            write_recording(trial, save, bands=bands_of(result, trial))
        console.say(f"recording: {save}")
        return
    folder = result.parent.parent if result.parent.name == "trials" else result.parent
    stem = folder / "viewer" / result.stem
    recording, cycles, shown = (Path(f"{stem}{end}") for end in (".rrd", "_cycles.rrd", ".key"))
    summary = read_trial(result, frames=False)
    key, bands = summary.key, bands_of(result, summary)
    known = "" if bands is None else " with bands"
    made = f"{key} {program_digest()}{known}"  # a key does not cover the viewer
    fresh = (
        recording.is_file() and cycles.is_file() and shown.is_file() and shown.read_text() == made
    )
    if not (key and fresh):
        with console.status(Text(f"preparing {result.stem}")):
            stem.parent.mkdir(parents=True, exist_ok=True)
            stored = read_trial(result)
            write_recording(stored, recording, bands=bands)
            write_cycles(stored, cycles)
        write_text(made, shown)
    show([recording, cycles], web=web, announce=lambda line: console.say(line))


def _result_of(folder: Path, subject: str | None, condition: str | None) -> Path:
    """Find the result of a trial; of the first where subject or condition are not given."""
    from pipeline.run.store import read_trial

    if folder.is_file():
        raise ValueError(f"{folder}: is neither a results folder nor a result ({RESULT})")
    names = []
    for path in sorted((folder / "trials").glob(f"*{RESULT}")):
        trial = read_trial(path, frames=False)
        if subject in (None, trial.subject.id) and condition in (None, trial.condition):
            return path
        names.append(f"{trial.subject.id} {trial.condition}")
    if not names:
        raise ValueError(f"{folder}: no results of trials here; run 'hbm run STUDY --out {folder}'")
    raise ValueError(f"{folder}: no such trial; there are: {', '.join(names)}")


def print_study_residuals(folder: Path) -> None:
    """Print a study's residual table: RMS, mean ± SD over subjects.

    Parameters
    ----------
    folder
        Results folder.
    """
    from rich import box
    from rich.table import Table

    from pipeline.cli.terminal import PlainConsole, print_table
    from pipeline.report.tables import windows_sentence
    from pipeline.run.load import collect
    from pipeline.statistics.design import unstated_design

    residuals = collect(folder).residuals
    residuals = residuals[residuals["headline"].astype(bool)]
    table = Table(
        title="Pelvis residuals, RMS, mean ± SD over subjects",
        caption="x forward, y right, z up; IC: with inertia compensation\n"
        f"{windows_sentence(residuals)}",
        box=box.SIMPLE_HEAD,
        padding=(0, 0),
    )
    found = set(residuals[["condition", "compensated"]].itertuples(index=False, name=None))
    order = unstated_design({name for name, _ in found}, compensated=True).in_order
    columns = [(name, ic) for name in order(residuals["condition"]) for ic in (False, True)]
    columns = [column for column in columns if column in found]
    table.add_column("axis")
    for condition, compensated in columns:
        plates = "IC" if compensated else "no IC"
        table.add_column(f"{condition}\n{plates}", justify="right", no_wrap=True)
    cells = residuals.groupby(["axis", "condition", "compensated"])["rms"]
    mean, sd = cells.mean(), cells.std(ddof=1)
    for axis, unit in residuals[["axis", "unit"]].drop_duplicates().itertuples(index=False):
        keys = [(axis, *column) for column in columns]
        table.add_row(f"{axis}, {unit}", *(_cell(mean.get(k), sd.get(k)) for k in keys))
    print_table(table, PlainConsole())


def _cell(mean: float | None, sd: float | None) -> str:
    if mean is None:
        return "–"
    return f"{mean:.1f}" if sd is None or math.isnan(sd) else f"{mean:.1f} ± {sd:.1f}"
