"""Results on the command line: report, view."""

import math
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import RESULT, ResultsFolder

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

    from pipeline.budgets.study import stale_sentence
    from pipeline.cli.terminal import plain_console
    from pipeline.report.write import write_report
    from pipeline.run.store import recorded_study_folder

    console = plain_console()
    with console.status("report") as status:
        page = write_report(
            folder,
            recorded_study_folder(folder),
            lambda step: status.update(Text(step)),
            covariates=covariate or (),
        )
    if plan:
        console.print((page.parent / "plan.md").read_text(encoding="utf-8"), soft_wrap=True)
    if stale := stale_sentence(folder, str(folder)):
        console.print(stale, soft_wrap=True)
    console.print(f"report: {page}", soft_wrap=True)


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
    from pipeline.cli.terminal import plain_console
    from pipeline.io.write import write_text
    from pipeline.run.program import program_digest
    from pipeline.run.store import read_trial
    from pipeline.viewer.serve import view as show
    from pipeline.viewer.trial import write_cycles, write_recording

    console = plain_console()
    result = results if results.suffix == RESULT else _result_of(results, subject, condition)
    if save is not None:
        with console.status(Text(f"preparing {result.stem}")):
            save.parent.mkdir(parents=True, exist_ok=True)
            trial = read_trial(result)
            write_recording(trial, save, bands=bands_of(result, trial))
        console.print(f"recording: {save}", soft_wrap=True)
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
    show([recording, cycles], web=web, announce=lambda line: console.print(line, soft_wrap=True))


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

    from pipeline.cli.terminal import plain_console, print_table
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
    print_table(table, plain_console())


def _cell(mean: float | None, sd: float | None) -> str:
    if mean is None:
        return "–"
    return f"{mean:.1f}" if sd is None or math.isnan(sd) else f"{mean:.1f} ± {sd:.1f}"
