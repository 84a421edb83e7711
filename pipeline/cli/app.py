"""The command line, ``hbm``: arguments in, sentences out, no science.

Whatever is heavy is imported inside the command that needs it, so that ``--help`` answers at once.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer.exceptions import TyperException

from pipeline.cli.options import (
    Axes,
    CalibrationFile,
    CutoffHz,
    FilterMethod,
    Forces,
    HeightM,
    Hip,
    HipTrial,
    MarkerSetName,
    MassKg,
    Out,
    PlateDelayMs,
    PlatformMarkers,
    Record,
    ResultsFolder,
    Segments,
    Sex,
    Static,
    StudyFolder,
    TrialFile,
    listed,
)
from pipeline.cli.simulate_options import simulate
from pipeline.cli.treadmill import calibration_app, plates

USAGE = 2
"""Exit code for wrong usage or input."""

app = typer.Typer(
    help="Pelvis residuals of a full-body gait model on instrumented treadmills that move.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; an error is one line, or a traceback with ``--debug``.

    Parameters
    ----------
    arguments
        What follows ``hbm``; by default what was typed.

    Returns
    -------
    int
        0 fine; 1 some trials failed, the rest is done; 2 wrong usage or input; 130 interrupted.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    typed = [argument for argument in given if argument != "--debug"]
    try:
        code = app(args=typed or ["--help"], prog_name="hbm", standalone_mode=False)
    except (TyperException, ValueError, OSError, KeyError) as error:
        if "--debug" in given:
            raise
        for line in getattr(error, "faults", None) or [one_line(error)]:
            typer.echo(f"hbm: error: {line}", err=True)
        return USAGE
    return int(code or 0)


def one_line(error: BaseException) -> str:
    """Say an error in one line, with the notes that were added on its way up."""
    if isinstance(error, TyperException):
        text = f"{error.format_message().rstrip('.')}; see 'hbm --help'"
    elif isinstance(error, FileExistsError | NotADirectoryError) and error.filename:
        text = f"{error.filename}: a file stands where a folder should be"
    elif isinstance(error, OSError) and error.strerror and error.filename:
        text = f"{error.filename}: {error.strerror.lower()}"
    elif isinstance(error, KeyError):
        text = str(error.args[0])
    else:
        text = str(error)
    parts = [text, *getattr(error, "__notes__", [])]
    return "; ".join(" ".join(part.split()) for part in parts)


@app.callback()
def common(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Take the options that every command has."""
    del debug  # taken from the arguments by main


@app.command()
def residuals(
    trial: TrialFile,
    static: Static = None,
    forces: Forces = None,
    record: Record = None,
    mass_kg: MassKg = None,
    sex: Sex = "unspecified",
    height_m: HeightM = None,
    axes: Axes = None,
    marker_set: MarkerSetName = None,
    hip: Hip = "harrington",
    hip_trial: HipTrial = None,
    segments: Segments = None,
    filter_method: FilterMethod = "zero_phase",
    cutoff_hz: CutoffHz = 6.0,
    plate_delay_ms: PlateDelayMs = 0.0,
    calibration: CalibrationFile = None,
    platform_markers: PlatformMarkers = "",
    out: Out = Path("results"),
) -> None:
    """Process one trial: print its pelvis residuals, write table, frames and figure."""
    from pipeline.cli import one_trial
    from pipeline.run.one_trial import Request

    one_trial.run(
        Request(
            trial=trial,
            static=static,
            forces=forces,
            record=record,
            mass_kg=mass_kg,
            sex=sex,
            height_m=height_m,
            axes=axes,
            marker_set=marker_set,
            hip=hip,
            hip_trial=hip_trial,
            segments=segments,
            filter=filter_method,
            cutoff_hz=cutoff_hz,
            plate_delay_s=plate_delay_ms / 1000,
            calibration=calibration,
            platform_markers=listed(platform_markers),
        ),
        out,
    )


@app.command()
def export(
    trial: TrialFile,
    static: Static = None,
    forces: Forces = None,
    record: Record = None,
    mass_kg: MassKg = None,
    sex: Sex = "unspecified",
    height_m: HeightM = None,
    axes: Axes = None,
    marker_set: MarkerSetName = None,
    hip: Hip = "harrington",
    hip_trial: HipTrial = None,
    segments: Segments = None,
    filter_method: FilterMethod = "zero_phase",
    cutoff_hz: CutoffHz = 6.0,
    plate_delay_ms: PlateDelayMs = 0.0,
    calibration: CalibrationFile = None,
    platform_markers: PlatformMarkers = "",
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
        typer.Option(help="Angles' neutral ankle: right_angle, or in_line as HBM has it."),
    ] = "right_angle",
    bids: Annotated[
        Path | None, typer.Option(help="BIDS data set to add the recording to.")
    ] = None,
    subject: Annotated[str, typer.Option(help="BIDS label of the person.")] = "01",
    task: Annotated[str, typer.Option(help="BIDS label of the task.")] = "walk",
) -> None:
    """Write the body as OpenSim or URDF model, results as OpenSim tables, a trial as BIDS."""
    from pipeline.export import trial as out
    from pipeline.run.one_trial import Request

    request = Request(
        trial=trial,
        static=static,
        forces=forces,
        record=record,
        mass_kg=mass_kg,
        sex=sex,
        height_m=height_m,
        axes=axes,
        marker_set=marker_set,
        hip=hip,
        hip_trial=hip_trial,
        segments=segments,
        filter=filter_method,
        cutoff_hz=cutoff_hz,
        plate_delay_s=plate_delay_ms / 1000,
        calibration=calibration,
        platform_markers=listed(platform_markers),
    )
    target = out.BidsTarget(bids, subject, task) if bids else None
    out.run(request, osim=osim, urdf=urdf, tables=tables, ankle_zero=ankle_zero, bids=target)


@app.command()
def demo(
    full: Annotated[
        bool, typer.Option("--full", help="All nine people and the thesis' protocol.")
    ] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Trials side by side.")] = 2,
    out: Out = Path("demo"),
) -> None:
    """Simulate a study in the virtual laboratory and run experiment 3 on it."""
    from pipeline.cli import demo as demonstration

    raise typer.Exit(demonstration.demo(out, full=full, jobs=jobs))


@app.command()
def init(folder: Annotated[Path, typer.Argument(help="Folder for the new study.")]) -> None:
    """Write a commented study.toml and a subject file to start from."""
    from pipeline.config.templates import write_template

    study, subject = write_template(folder)
    typer.echo(f"written: {study}, {subject}; next: edit them, then hbm check {folder}")


@app.command()
def check(study: StudyFolder) -> None:
    """Read every TOML and every recording of a study, list all problems, compute nothing."""
    from pipeline.cli import study as study_commands

    raise typer.Exit(study_commands.check(study))


@app.command()
def run(
    study: StudyFolder,
    subject: Annotated[list[str] | None, typer.Option(help="Only this one; repeatable.")] = None,
    condition: Annotated[list[str] | None, typer.Option(help="Only this one; repeatable.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Trials side by side.")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler to run the trials on, e.g. tcp://host:8786.")
    ] = None,
    out: Out = Path("results"),
) -> None:
    """Process a study; finished trials are skipped, failed ones listed with reasons."""
    from pipeline.cli import study as study_commands

    code = study_commands.run(
        study,
        out,
        subjects=subject or (),
        conditions=condition or (),
        jobs=jobs,
        scheduler=scheduler,
    )
    raise typer.Exit(code)


@app.command()
def report(folder: ResultsFolder = Path("results")) -> None:
    """Write tables, statistics, figures and report.html from what run left."""
    from pipeline.cli import results as result_commands

    result_commands.report(folder)


@app.command()
def view(
    folder: ResultsFolder = Path("results"),
    subject: Annotated[str | None, typer.Option(help="Default: the first.")] = None,
    condition: Annotated[str | None, typer.Option(help="Default: the first.")] = None,
    web: Annotated[bool, typer.Option("--web", help="In a browser on this machine.")] = False,
    save: Annotated[Path | None, typer.Option(help="Write the recording here instead.")] = None,
) -> None:
    """Open a trial in the Rerun viewer: markers, body, plates, forces, residuals over time."""
    from pipeline.cli import results as result_commands

    result_commands.view(folder, subject=subject, condition=condition, web=web, save=save)


app.add_typer(calibration_app, name="calibration", help="Calibrate a moving treadmill.")
app.command()(plates)
app.command()(simulate)


@app.command()
def doctor() -> None:
    """Print versions, how the kernels run here, and how fast."""
    from pipeline.cli import doctor as check

    check.run()
