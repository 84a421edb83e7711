"""One trial on the command line: residuals, export."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from pipeline.cli.options import (
    RESULT,
    Out,
    require_folder,
    require_no_options,
    takes_trial_request,
)
from pipeline.run.request import TrialRequest

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from pipeline.trial.result import TrialResult


@takes_trial_request
def residuals(request: TrialRequest, out: Out = Path("results")) -> None:
    """Process one trial: print its pelvis residuals, write table, frames and figure."""
    from pipeline.cli.terminal import announcer, plain_console
    from pipeline.figures.residuals import residual_figure
    from pipeline.figures.style import save_figure
    from pipeline.io.write import write_csv
    from pipeline.run.one_trial import process_request
    from pipeline.run.store import write_trial
    from pipeline.trial.residuals import cycles_of, residual_table

    if request.trial.suffix == RESULT:
        raise ValueError(
            f"{request.trial} is a result already; 'hbm view' shows it, 'hbm export' exports it"
        )
    console = plain_console()
    require_folder(out)
    result = process_request(request, announcer(console)).result
    name = request.trial.stem
    write_trial(replace(result, condition=name), out / f"{name}.parquet")
    write_csv(residual_table(result, name), out / f"{name}_residuals.csv")
    write_csv(cycles_of(result, name), out / f"{name}_cycles.csv")
    save_figure(residual_figure(result), out / f"{name}_residuals")
    print_result(result, console)
    console.print(
        f"written to {out}: {name}.parquet (frames), {name}_residuals.csv, .png and .svg, "
        f"{name}_cycles.csv (each gait cycle)",
        soft_wrap=True,
    )
    if reason := result.shortage:
        raise ValueError(f"{request.trial.name}: there are no residuals: {reason}")


@takes_trial_request
def export(
    request: TrialRequest,
    osim: Annotated[Path | None, typer.Option(help="Write the body for OpenSim 4.")] = None,
    urdf: Annotated[
        Path | None, typer.Option(help="Write the body for Pinocchio, MuJoCo, ROS.")
    ] = None,
    tables: Annotated[
        Path | None,
        typer.Option(help="Folder for the trial's .mot, .sto and .trc tables, and angles as .csv."),
    ] = None,
    ankle_zero: Annotated[
        Literal["right_angle", "in_line"],
        typer.Option(help="Zero of the ankle angle: right_angle, or in_line as in the HBM."),
    ] = "right_angle",
    bids: Annotated[
        Path | None, typer.Option(help="BIDS data set to add the recording to.")
    ] = None,
    subject: Annotated[str, typer.Option(help="BIDS label of the subject.")] = "01",
    task: Annotated[str, typer.Option(help="BIDS label of the task.")] = "walk",
    c3d: Annotated[
        bool,
        typer.Option("--c3d", help="Write the C3D file again with compensated plates, to --out."),
    ] = False,
    frame: Annotated[
        Literal["plate", "lab"] | None,
        typer.Option(
            help="Of --c3d on a moving platform: corners in its mean pose (plate), or wrenches "
            "in the lab frame (lab); default: only the plates' samples change."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the files of --c3d.")] = None,
) -> int:
    """Write the body as OpenSim or URDF model, results as OpenSim tables, a trial as BIDS or C3D.

    TRIAL may be a result, RESULTS/trials/*.parquet: it is exported as it is, not processed again.
    With --c3d, TRIAL may be a study's folder: the recordings of all its trials are written.
    """
    from hbm.notes import warnings_first
    from pipeline.cli.compensated import export_study, export_trial
    from pipeline.cli.terminal import note_line, plain_console
    from pipeline.export.bids import write_bids
    from pipeline.export.models import write_osim, write_urdf
    from pipeline.export.tables import write_tables
    from pipeline.run.one_trial import process_request, read_requested
    from pipeline.run.store import read_trial

    models = osim or urdf or tables
    if not (models or bids or c3d):
        raise ValueError(
            "nothing to export; name --osim FILE, --urdf FILE, --tables DIR, --bids DIR or "
            "--c3d --out DIR"
        )
    folder = _folder_of_c3d(c3d, out, frame)
    if folder and request.trial.is_dir():
        require_no_options(request, "a study, whose files state everything")
        if models or bids:
            raise ValueError("of a whole study only --c3d is exported; leave the others out")
        return export_study(request.trial, folder, frame)
    processed = request.trial.suffix == RESULT
    if processed:
        require_no_options(request, "a result that has been processed already")
    if processed and (bids or c3d):
        raise ValueError(
            f"{request.trial.name} is a result; {'BIDS' if bids else 'C3D'} holds what was "
            "recorded: give the recording instead"
        )
    console, written = plain_console(), []
    if folder:
        written.append(export_trial(request, folder, frame))
    if bids:
        written += write_bids(read_requested(request), bids, subject, task)
    if models:
        result = read_trial(request.trial) if processed else process_request(request).result
        for path, write in ((osim, write_osim), (urdf, write_urdf)):
            if path:
                write(result.body, path)
                written.append(path)
        if tables:
            written += write_tables(result, tables, request.trial.stem, ankle_zero)
            plates = _plates(result.compensated is not None)
            console.print(f"forces and loads are from the {plates} plate forces")
        for note in warnings_first(result.notes):
            console.print(note_line(note), soft_wrap=True)
    console.print("written: " + ", ".join(map(str, written)), soft_wrap=True)
    return 0


def _folder_of_c3d(c3d: bool, out: Path | None, frame: str | None) -> Path | None:
    """Give the folder for C3D files; None where none are wanted."""
    if not c3d:
        if out or frame:
            raise ValueError(f"{'--out' if out else '--frame'} goes with --c3d")
        return None
    if out is None:
        raise ValueError("--c3d needs a folder for its files: name --out DIR")
    require_folder(out)
    return out


def print_result(result: "TrialResult", console: "Console") -> None:
    """Print a trial's residuals, thresholds, marker errors and notes.

    Parameters
    ----------
    result
        The trial.
    console
        Where.
    """
    from rich.table import Table

    from hbm.notes import warnings_first
    from pipeline.cli.terminal import counted, note_line, print_table
    from pipeline.trial.residuals import marker_table, residual_table, rows_of, threshold_table

    rows = rows_of(residual_table(result, result.source.stem))
    if result.span:
        counts = f"{result.span[0]:.2f} to {result.span[1]:.2f} s"
    else:
        used = sum(map(len, result.cycles.values()))
        feet = f"the {next(iter(result.cycles))} foot" if len(result.cycles) == 1 else "both feet"
        counts = f"{used} of {counted(result.found_cycles, 'gait cycle')} of {feet}"
    if rows and rows[0].valid_share < 1:
        counts += f", {100 * rows[0].valid_share:.0f} % of their frames"
    table = Table(
        title=f"Pelvis residuals, {result.source.name}, {counts} "
        f"({result.settings.filter} {result.settings.cutoff_hz:g} Hz)",
        caption="x forward, y right, z up; moments about mid-hip; % of body weight, or of body "
        "weight × stature",
    )
    for name in ("plates", "axis", "RMS", "mean", "SD", "peak", "", "RMS %"):
        table.add_column(name, justify="left" if name in ("plates", "axis", "") else "right")
    for row in rows:
        numbers = [f"{value:.1f}" for value in (row.rms, row.mean, row.sd, row.peak)]
        percent = f"{row.rms_percent:.2f}"
        table.add_row(_plates(row.compensated), row.axis, *numbers, row.unit, percent)
    if rows:
        print_table(table, console)
    for threshold in rows_of(threshold_table(result)):
        verdict = "passes" if threshold.passed else "FAILS"
        console.print(
            f"{verdict} Hicks (2015): peak residual {threshold.quantity} {threshold.peak:.1f} "
            f"{threshold.unit}, limit {threshold.limit:.1f} {threshold.unit} "
            f"({_plates(threshold.compensated)})"
        )
    console.print(_marker_errors(marker_table(result)))
    for note in warnings_first(result.notes):
        console.print(note_line(note), soft_wrap=True)


def _marker_errors(table: "pd.DataFrame") -> str:
    """Say how far the markers are from the model, the farthest first; the last row is of all."""
    rms_mm = table.set_index("marker")["rms_mm"]
    single, overall_mm = rms_mm[:-1], rms_mm.iloc[-1]
    seen = single.dropna().sort_values(ascending=False, kind="stable")
    unseen = ", ".join(single.index[single.isna()])
    errors = ", ".join(f"{marker} {error:.1f}" for marker, error in seen.items())
    never = f"never seen: {unseen}"
    if seen.empty:
        return f"marker error unknown; {never}"
    text = f"marker error {overall_mm:.1f} mm RMS over {len(seen)} markers: {errors}"
    return f"{text}; {never}" if unseen else text


def _plates(compensated: bool) -> str:
    return "compensated" if compensated else "measured"
