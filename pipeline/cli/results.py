"""Results on the command line: report, view."""

import math
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import ResultsFolder


def report(folder: ResultsFolder = Path("results")) -> None:
    """Write tables, statistics, figures and report.html from what run left."""
    from pipeline.cli.terminal import plain_console
    from pipeline.report.write import write_report
    from pipeline.run.store import recall_study

    console = plain_console()
    with console.status("report") as status:
        page = write_report(folder, recall_study(folder), status.update)
    console.print(f"report: {page}", soft_wrap=True)


def view(
    folder: ResultsFolder = Path("results"),
    subject: Annotated[str | None, typer.Option(help="Default: the first.")] = None,
    condition: Annotated[str | None, typer.Option(help="Default: the first.")] = None,
    web: Annotated[bool, typer.Option("--web", help="In a browser on this machine.")] = False,
    save: Annotated[Path | None, typer.Option(help="Write the recording here instead.")] = None,
) -> None:
    """Open a trial in the Rerun viewer: markers, body, plates, forces, residuals over time."""
    from pipeline.cli.terminal import plain_console
    from pipeline.run.store import read_summary
    from pipeline.viewer.serve import view as show

    console = plain_console()
    subject, condition = _chosen(folder, subject, condition)
    result = folder / "trials" / f"{subject}_{condition}.parquet"
    stem = folder / "viewer" / f"{subject}_{condition}"
    trial, cycles, marker = (Path(f"{stem}{end}") for end in (".rrd", "_cycles.rrd", ".key"))
    if save is not None:
        with console.status(f"preparing {subject} {condition}"):
            _write_view(result, save, None)
        console.print(f"recording: {save}", soft_wrap=True)
        return
    key = read_summary(result).key
    fresh = trial.is_file() and cycles.is_file() and marker.is_file() and marker.read_text() == key
    if not fresh:
        with console.status(f"preparing {subject} {condition}"):
            _write_view(result, trial, cycles)
        marker.write_text(key)
    show([trial, cycles], web=web, tell=lambda line: console.print(line, soft_wrap=True))


def _write_view(result: Path, trial: Path, cycles: Path | None) -> None:
    """Write a stored trial for the viewer, and its mean gait cycle."""
    from pipeline.run.store import read_trial
    from pipeline.viewer.trial import write_cycles, write_recording

    stored = read_trial(result)
    trial.parent.mkdir(parents=True, exist_ok=True)
    write_recording(stored, trial)
    if cycles is not None:
        write_cycles(stored, cycles)


def _chosen(folder: Path, subject: str | None, condition: str | None) -> tuple[str, str]:
    """Find the trial asked for among the results."""
    from pipeline.run.store import read_summary

    there = []
    for path in sorted((folder / "trials").glob("*.parquet")):
        trial = read_summary(path)
        there.append((trial.subject.id, trial.condition))
    for found in there:
        if subject in (None, found[0]) and condition in (None, found[1]):
            return found
    if not there:
        raise ValueError(f"{folder}: no results of trials here; run 'hbm run STUDY --out {folder}'")
    known = ", ".join(" ".join(found) for found in there)
    raise ValueError(f"{folder}: no such trial; there are: {known}")


def print_study_residuals(folder: Path) -> None:
    """Print a study's residual table: RMS, mean ± SD over subjects.

    Parameters
    ----------
    folder
        Results folder.
    """
    from rich import box
    from rich.table import Table

    from pipeline.cli.terminal import plain_console
    from pipeline.run.load import collect

    residuals = collect(folder).residuals
    table = Table(
        title="Pelvis residuals, RMS, mean ± SD over subjects",
        caption="x forward, y right, z up; IC: with inertia compensation",
        box=box.SIMPLE_HEAD,
        padding=(0, 0),
    )
    columns = residuals[["condition", "compensated"]].drop_duplicates()
    table.add_column("axis")
    for condition, compensated in columns.itertuples(index=False):
        plates = "IC" if compensated else "no IC"
        table.add_column(f"{condition}\n{plates}", justify="right", no_wrap=True)
    cells = residuals.groupby(["axis", "condition", "compensated"])["rms"]
    mean, sd = cells.mean(), cells.std(ddof=1)
    for axis, unit in residuals[["axis", "unit"]].drop_duplicates().itertuples(index=False):
        keys = [(axis, *column) for column in columns.itertuples(index=False)]
        table.add_row(f"{axis}, {unit}", *(_cell(mean.get(k), sd.get(k)) for k in keys))
    plain_console().print(table)


def _cell(mean: float | None, sd: float | None) -> str:
    if mean is None:
        return "–"
    return f"{mean:.1f}" if sd is None or math.isnan(sd) else f"{mean:.1f} ± {sd:.1f}"
