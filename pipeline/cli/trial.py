"""One trial on the command line: residuals, what they are made of, export to other programs."""

import json
import webbrowser
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Option

from hbm.notes import warnings_of
from hbm.spelling import counted, listed
from pipeline.cli.options import (
    RESULT,
    Jobs,
    Out,
    explain_command,
    require_folder,
    require_no_options,
    takes,
)
from pipeline.cli.output import OUTPUT, plain_notes
from pipeline.cli.request import TrialRequest, chain_of, process
from pipeline.cli.terminal import (
    PlainConsole,
    StepProgress,
    announcer,
    counts_of,
    follow_trials,
    note_line,
    outcome_record,
    print_block,
    print_table,
)

if TYPE_CHECKING:
    from pipeline.budgets.explanation import Explanation
    from pipeline.export.compensated_c3d import Written


Open = Annotated[
    bool, Option("--open", help="Open the page in the browser.", rich_help_panel="Output")
]
NO_RECORDINGS = (RESULT, ".toml", ".json", ".rrd", ".html")


@takes(TrialRequest)
def residuals(request: TrialRequest, out: Out = Path("results"), open_page: Open = False) -> None:
    """Pelvis residuals are printed; page, tables, frames and figures are written to --out."""
    from pipeline.cli.recognise import recognise
    from pipeline.report.trial_tables import result_tables, verdict_lines

    if request.trial.is_dir() or request.trial.suffix in NO_RECORDINGS:
        raise ValueError(f"{request.trial} is no recording, but {recognise(request.trial)}")
    console = PlainConsole()
    require_folder(out)
    chain = chain_of(request)
    result, name = process(request, chain, announcer(console)), request.trial.stem
    with suppress(BrokenPipeError):  # files are written though nobody reads the table
        console.say(result.title)
        for line in verdict_lines(result):
            console.print(line)
        for block in result_tables(result):
            print_block(block, console)
        console.say_notes(result.notes)

    # what files and figures need is loaded, and takes its time, when the answer is there
    from pipeline.figures.residuals import residual_figure
    from pipeline.figures.style import save_figure
    from pipeline.io.write import write_rows
    from pipeline.report.trial_page import write_trial_page
    from pipeline.run.store import write_trial
    from pipeline.trial import residuals as of_trial

    write_trial(replace(result, condition=name), out / f"{name}.parquet")
    rows = of_trial.residual_rows(result, name)
    write_rows(of_trial.Residual._fields, rows, out / f"{name}_residuals.csv")
    cycles = of_trial.cycle_rows(result, name)
    write_rows(of_trial.CYCLE_COLUMNS, cycles, out / f"{name}_cycles.csv")
    figure = save_figure(residual_figure(result), out / f"{name}_residuals")
    plates, command = chain.inputs.recording.plates, explain_command(request, out)
    page = write_trial_page(
        result, out / f"{name}.html", plates=plates, command=command, figure=figure
    )
    console.say(
        f"written to {out}: {page.name}; {name}.parquet (frames), {name}_residuals.csv, .png and "
        f".svg, {name}_cycles.csv (each gait cycle)"
    )
    OUTPUT.result.update(
        trial=request.trial.name,
        mass_kg=result.body.mass,
        height_m=result.body.height_m,
        plate_delay_ms=1000 * result.delay_s,
        plate_delay_interval_ms=1000 * result.delay_uncertainty_s,
        frames_used=int(result.counts.sum()),
        residuals=rows,
        thresholds=of_trial.threshold_rows(result),
        markers=of_trial.marker_rows(result),
        notes=plain_notes(result.notes),
        page=str(page),
    )
    if open_page:
        webbrowser.open(page.resolve().as_uri())
    if reason := result.shortage:
        raise ValueError(f"{request.trial.name}: there are no residuals: {reason}")


@takes(TrialRequest)
def explain(
    request: TrialRequest,
    out: Annotated[Path | None, Option(help="For one trial; default: results.")] = None,
    jobs: Jobs = None,
    apply: Annotated[
        Path | None, Option(help="Folder for the study with what is certain corrected.")
    ] = None,
) -> int:
    """Of each pelvis residual: shares of its causes, and how sure they are.

    TRIAL may be a results folder of 'hbm run': all trials of the study are explained, from their
    recordings, and 'hbm report' shows it. With --apply, a study is written whose settings correct
    delay, zeros, gains and places of plates and masses; never the recordings.
    """
    if request.trial.is_dir():
        return _explain_results(request, out, jobs, apply)
    if apply:
        raise ValueError("--apply goes with the results of a study (hbm explain RESULTS --apply)")
    return _explain_trial(request, out or Path("results"))


def _explain_trial(request: TrialRequest, out: Path) -> int:
    from pipeline.budgets.explanation import BANDS, SUFFIX, explain, write_bands, write_explanation
    from pipeline.report.trial_page import write_trial_page
    from pipeline.run.store import write_trial

    if request.trial.suffix == RESULT:
        raise ValueError(
            f"{request.trial} is a result, and only the recording shows what its residuals are "
            "made of; give the recording, or the results folder of a study, whose report shows it"
        )
    console = PlainConsole()
    require_folder(out)
    chain = chain_of(request)
    result, recording = process(request, chain, announcer(console)), chain.inputs.recording
    explanation = explain(recording, chain.inputs.laboratory, result)
    name, bands = request.trial.stem, explanation.budget.bands
    write_explanation(explanation, out / f"{name}{SUFFIX}")
    assert bands is not None  # it was not read from a file
    write_bands(bands, out / f"{name}{BANDS}")
    write_trial(replace(result, condition=name), out / f"{name}{RESULT}")
    page = write_trial_page(
        result, out / f"{name}.html", plates=recording.plates, explanation=explanation
    )
    if warnings := warnings_of(result.notes):
        console.say("Warnings of the trial, to correct first:")
        console.say_notes(warnings)
    print_explanation(explanation, console)
    console.say(
        f"written to {out}: {page.name}; {name}{SUFFIX} (all numbers), {name}{RESULT} (frames) and "
        f"{name}{BANDS} (residuals over time)"
    )
    numbers = json.loads((out / f"{name}{SUFFIX}").read_text(encoding="utf-8"))
    OUTPUT.result.update(
        trial=request.trial.name,
        explanation=numbers,
        lines=[*explanation.lines()],
        notes=plain_notes(explanation.budget.notes),
        page=str(page),
    )
    return 0


def print_explanation(explanation: "Explanation", console: PlainConsole) -> None:
    """Print what a trial's residuals are made of: a row of shares per cause, and lines."""
    from rich.table import Table

    from pipeline.budgets.words import CAPTION, budget_table

    title, axes, rows = budget_table(explanation.budget)
    table = Table(title=title, caption=CAPTION, box=None, padding=(0, 1, 0, 0))
    table.add_column("", max_width=20)  # six residuals share the other 60 of 80 columns
    for axis in axes:
        table.add_column(axis.replace(", ", "\n"), justify="right", no_wrap=True)
    for head, cells in rows:
        table.add_row(head, *map(str, cells))
    print_table(table, console)
    for line in explanation.lines():
        console.print(line)
    console.say_notes(explanation.budget.notes)


def _explain_results(
    request: TrialRequest, out: Path | None, jobs: int | None, corrected: Path | None
) -> int:
    from rich.text import Text

    from pipeline.budgets.corrections import write_corrected
    from pipeline.budgets.explanation import (
        explain_planned,
        explain_study,
        plan_explanations,
        study_of,
    )
    from pipeline.budgets.words import NOTHING_CERTAIN
    from pipeline.run.store import read_trial

    folder = request.trial
    require_no_options(request, "the results of a study, whose files have all settings")
    if out is not None:
        raise ValueError(f"leave out --out: explanations of a study go to {folder / 'explained'}")
    console = PlainConsole()
    study = study_of(folder)
    planned = plan_explanations(study, folder)
    outcomes = explain_planned(planned, folder, jobs=jobs, announce=announcer(console))
    finished = follow_trials(outcomes, len(planned), "explaining", "explained", console)
    if finished and all(outcome.failure is not None for outcome in finished):
        raise ValueError(f"{folder}: no trial was explained: {finished[0].reason}")
    with console.status(Text("all trials together")):
        together = explain_study(folder, planned)
    for line in together.lines or (NOTHING_CERTAIN,):
        console.say(line)
    console.say(f"{counts_of(finished, 'explained')}; next: hbm report {quote(str(folder))}")
    if corrected:
        results = [read_trial(p, frames=False) for p in (folder / "trials").glob(f"*{RESULT}")]
        mass_kg = {result.subject.id: result.body.mass for result in results}
        written, left_out = write_corrected(study, together, mass_kg, folder, corrected)
        for correction in written:
            console.say(f"corrected: {correction.cause}: {correction.setting}")
        for name in left_out:
            console.say(f"not corrected: {name}")
        count = counted(len(written), "correction")
        next_step = f"hbm run {corrected} --out {corrected}/results"
        console.say(f"{corrected}: study with {count}; next: {next_step}")
    OUTPUT.result.update(
        trials=[outcome_record(outcome) for outcome in finished], lines=[*together.lines]
    )
    return int(any(outcome.failure is not None for outcome in finished))


FORMATS = ("osim", "urdf", "tables", "bids", "c3d")


class ExportRequest(TrialRequest):
    """One trial to export, and how, as typed."""

    ankle_zero: Literal["right_angle", "in_line"] = "right_angle"
    """right_angle, or in_line: as in the HBM."""
    subject: str | None = None
    """BIDS label, default: 01."""
    task: str | None = None
    """BIDS label, default: walk."""
    frame: Literal["plate", "lab"] | None = None
    """Of c3d on a moving platform: corners in its mean pose (plate), or wrenches in the lab frame
    (lab); default: only the plates' samples change."""


@takes(ExportRequest)
def export(
    request: ExportRequest,
    form: Annotated[
        list[str] | None, Option("--format", help=f"{', '.join(FORMATS)}; repeatable.")
    ] = None,
    out: Out = Path("export"),
) -> int:
    """Write osim and urdf (the body), tables (.mot, .sto, .trc, .csv), bids or c3d.

    TRIAL may be a result, RESULTS/trials/*.parquet: it is exported as it is, not processed again.
    For tables, TRIAL may be the RESULTS of a study: its tables are written as CSV and workbook.
    For c3d, the original recording is written with compensated plates, for bids with gait events;
    TRIAL may be a study's folder: the recordings of all its trials are written.
    """
    chosen, trial = {*(form or ())}, request.trial
    if not chosen or chosen - {*FORMATS}:
        unknown = listed(sorted(chosen - {*FORMATS})) if chosen else "none given"
        raise ValueError(f"--format {unknown}: expected {listed(FORMATS)}, and --out FOLDER")
    if request.frame and "c3d" not in chosen:
        raise ValueError("--frame goes with --format c3d")
    require_folder(out)
    if trial.is_dir():
        return _export_folder(request, chosen, out)
    if trial.suffix == RESULT:
        require_no_options(request, "a result that has been processed already")
        if recorded := " and ".join(sorted(chosen & {"bids", "c3d"})):
            raise ValueError(
                f"{trial.name} is a result; {recorded}: give the recording, which they hold"
            )
    console, written = PlainConsole(), list[Path]()
    if "c3d" in chosen:
        written.append(_export_trial(request, out, console))
    if others := chosen - {"c3d"}:
        written += _export_processed(request, others, out, console)
    console.say("written: " + ", ".join(map(str, written)))
    return 0


def _export_processed(
    request: ExportRequest, chosen: set[str], out: Path, console: PlainConsole
) -> list[Path]:
    """Write the body of a trial, processed or to be processed, its tables, and what BIDS holds."""
    from pipeline.export.bids import write_bids
    from pipeline.export.models import write_osim, write_urdf
    from pipeline.export.tables import write_tables
    from pipeline.run.store import read_trial

    stem, written = request.trial.stem, list[Path]()
    labels = request.subject or "01", request.task or "walk"
    if request.trial.suffix == RESULT:
        result = read_trial(request.trial)
    else:
        chain = chain_of(request)
        try:
            result = process(request, chain)
        except ValueError as error:
            if chosen != {"bids"}:
                raise
            console.say(f"events, mass and stature are those of the file alone: {error}")
            return write_bids(chain.inputs.recording, out, *labels)
    for form, write in (("osim", write_osim), ("urdf", write_urdf)):
        if form in chosen:
            written.append(out / f"{stem}.{form}")
            write(result.body, written[-1])
    if "tables" in chosen:
        written += write_tables(result, out, stem, request.ankle_zero)
        plates = "measured" if result.compensated is None else "compensated"
        console.print(f"forces and loads are from the {plates} plate forces")
    if "bids" in chosen:
        written += write_bids(chain.inputs.recording, out, *labels, result=result)
    console.say_notes(result.notes)
    return written


def _export_trial(request: ExportRequest, out: Path, console: PlainConsole) -> Path:
    """Write a trial's C3D file again with compensated plates, and say what has checked it."""
    from pipeline.export.compensated_c3d import write_compensated

    if request.calibration is None and request.plate_calibration is None:
        raise ValueError(
            "c3d has compensated plates: name the --calibration of the treadmill, or the "
            "--plate-calibration"
        )
    chain = chain_of(request)
    written = write_compensated(
        chain.inputs.recording,
        chain.inputs.laboratory,
        out / request.trial.name,
        calibration=request.calibration,
        frame=request.frame,
        plate_delay_s=chain.settings.plate_delay_s,
    )
    console.say_notes(written.notes)
    console.say(f"{written.path}: {_checked_by(written)}")
    return written.path


def _export_folder(request: ExportRequest, chosen: set[str], out: Path) -> int:
    """Write tables of a study, or its recordings again; exit code 1 where some of them failed."""
    from pipeline.config.study import read_study
    from pipeline.export.bids import write_bids_study
    from pipeline.export.compensated_c3d import Written, recordings_of, write_compensated_study
    from pipeline.report.workbook import write_workbook

    require_no_options(request, "a study or its results, whose files have all settings")
    if request.subject or request.task:
        raise ValueError("--subject and --task go with one recording; a study has its names")
    console, folder, failed = PlainConsole(), request.trial, 0
    exported: Iterator[tuple[object, Written | list[Path] | str]]
    if chosen == {"tables"}:
        *tables, workbook = write_workbook(folder, out)
        tables_as_csv = f"{counted(len(tables), 'table')} as CSV"
        console.say(f"{tables_as_csv}, and all of them in {workbook}")
        return 0
    if chosen not in ({"c3d"}, {"bids"}):
        raise ValueError("of a study c3d or bids is exported, of its results tables; one at once")
    study = read_study(folder)
    if chosen == {"bids"}:
        used = [trial for trial in study.trials.values() if trial.file and trial.exclude is None]
        how, total, exported = "as BIDS", len(used), write_bids_study(study, out)
    else:
        how, total = "with compensated plates", len(recordings_of(study))
        exported = write_compensated_study(study, out, request.frame)
    with StepProgress(console, "writing", "recordings") as progress:
        for done, (name, written) in enumerate(exported, 1):
            if isinstance(written, str):
                failed += 1
                line = f"FAILED {name}: {written.removeprefix(f'{name}: ')}"
            elif isinstance(written, list):
                line = f"{name}: {written[-1].name}"
            else:
                for note in warnings_of(written.notes):
                    console.say(f"{name}: ", note_line(note))
                line = f"{name}: {_checked_by(written)}"
            progress.show(line, done, total, failed=isinstance(written, str))
    console.say(f"{counted(total - failed, 'recording')} {how} in {out}, {failed} failed")
    return 1 if failed else 0


def _checked_by(written: "Written") -> str:
    """Say which readers found that only the plates differ from the original."""
    second = written.verification
    second_reader = f" and {second.reader}" if not second.refusal else ""
    why = f"; {second.reader}: {second.refusal}" if second.refusal else ""
    return f"only the plates differ from the original, as read by this program{second_reader}{why}"
