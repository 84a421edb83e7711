"""Export on the command line: models, tables, BIDS, and compensated C3D files."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Option

from pipeline.cli.options import (
    RESULT,
    require_folder,
    require_no_options,
    takes_trial_request,
)
from pipeline.cli.terminal import PlainConsole, StepProgress, counted
from pipeline.run.request import TrialRequest

if TYPE_CHECKING:
    from pipeline.export.compensated_c3d import Frame, Written

AnkleZero = Literal["right_angle", "in_line"]


@takes_trial_request
def export(
    request: TrialRequest,
    osim: Annotated[Path | None, Option(help="Write the body for OpenSim 4.")] = None,
    urdf: Annotated[Path | None, Option(help="Write the body as URDF.")] = None,
    tables: Annotated[Path | None, Option(help="Folder for .mot, .sto, .trc and .csv.")] = None,
    ankle_zero: Annotated[AnkleZero, Option(help="in_line: as in the HBM.")] = "right_angle",
    bids: Annotated[Path | None, Option(help="BIDS data set to add the recording to.")] = None,
    subject: Annotated[str, Option(help="BIDS label of the subject.")] = "01",
    task: Annotated[str, Option(help="BIDS label of the task.")] = "walk",
    c3d: Annotated[bool, Option("--c3d", help="Write the C3D with compensated plates.")] = False,
    frame: Annotated[
        Literal["plate", "lab"] | None,
        Option(
            help="Of --c3d on a moving platform: corners in its mean pose (plate), or wrenches "
            "in the lab frame (lab); default: only the plates' samples change."
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for the files of --c3d.")] = None,
) -> int:
    """Write the body as OpenSim or URDF model, results as OpenSim tables, a trial as BIDS or C3D.

    TRIAL may be a result, RESULTS/trials/*.parquet: it is exported as it is, not processed again.
    With --c3d, TRIAL may be a study's folder: the recordings of all its trials are written.
    """
    models = osim or urdf or tables
    if not (models or bids or c3d):
        raise ValueError(
            "nothing to export; name --osim FILE, --urdf FILE, --tables DIR, --bids DIR or "
            "--c3d --out DIR"
        )
    if not c3d and (out or frame):
        raise ValueError(f"{'--out' if out else '--frame'} goes with --c3d")
    if c3d:
        if out is None:
            raise ValueError("--c3d needs a folder for its files: name --out DIR")
        require_folder(out)
        if request.trial.is_dir():
            require_no_options(request, "a study, whose files state everything")
            if models or bids:
                raise ValueError("of a whole study only --c3d is exported; leave the others out")
            return _export_study(request.trial, out, frame)
    processed = request.trial.suffix == RESULT
    if processed:
        require_no_options(request, "a result that has been processed already")
    if processed and (bids or c3d):
        raise ValueError(
            f"{request.trial.name} is a result; {'BIDS' if bids else 'C3D'} holds what was "
            "recorded: give the recording instead"
        )
    console, written = PlainConsole(), list[Path]()
    if c3d and out:
        written.append(_export_trial(request, out, frame, console))
    if bids:
        from pipeline.export.bids import write_bids
        from pipeline.run.one_trial import read_requested

        written += write_bids(read_requested(request), bids, subject, task)
    if models:
        written += _export_models(request, osim, urdf, tables, ankle_zero, console)
    console.say("written: " + ", ".join(map(str, written)))
    return 0


def _export_models(
    request: TrialRequest,
    osim: Path | None,
    urdf: Path | None,
    tables: Path | None,
    ankle_zero: AnkleZero,
    console: PlainConsole,
) -> list[Path]:
    """Write the body of a trial, processed or to be processed, and its tables."""
    from pipeline.export.models import write_osim, write_urdf
    from pipeline.export.tables import write_tables
    from pipeline.run.one_trial import process_request
    from pipeline.run.store import read_trial

    processed = request.trial.suffix == RESULT
    result = read_trial(request.trial) if processed else process_request(request).result
    written = [path for path in (osim, urdf) if path]
    if osim:
        write_osim(result.body, osim)
    if urdf:
        write_urdf(result.body, urdf)
    if tables:
        written += write_tables(result, tables, request.trial.stem, ankle_zero)
        plates = "measured" if result.compensated is None else "compensated"
        console.print(f"forces and loads are from the {plates} plate forces")
    console.say_notes(result.notes)
    return written


def _export_trial(
    request: TrialRequest, out: Path, frame: "Frame | None", console: PlainConsole
) -> Path:
    """Write a trial's C3D file again with compensated plates, and say what has checked it."""
    from pipeline.export.compensated_c3d import Calibrations, require_c3d, write_compensated
    from pipeline.run.one_trial import read_requested, requested_laboratory

    if request.calibration is None and request.plate_calibration is None:
        raise ValueError(
            "--c3d compensates the plates: name the --calibration of the treadmill, or the "
            "--plate-calibration"
        )
    require_c3d(request.trial)
    written = write_compensated(
        read_requested(request),
        Calibrations(requested_laboratory(request), request.calibration),
        out / request.trial.name,
        frame=frame,
        plate_delay_s=request.plate_delay,
    )
    console.say_notes(written.notes)
    console.say(f"{written.path}: {_checked_by(written)}")
    return written.path


def _export_study(folder: Path, out: Path, frame: "Frame | None") -> int:
    """Write all recordings of a study's trials again; exit code 1 where some of them failed."""
    from pipeline.cli.terminal import note_line
    from pipeline.config.study import read_study
    from pipeline.export.compensated_c3d import recordings_of, write_compensated_study

    console, study = PlainConsole(), read_study(folder)
    total, failed = len(recordings_of(study)), 0
    with StepProgress(console, "compensating", "recordings") as progress:
        for done, (name, written) in enumerate(write_compensated_study(study, out, frame), 1):
            if isinstance(written, str):
                failed += 1
                line = f"FAILED {name}: {written.removeprefix(f'{name}: ')}"
            else:
                for note in written.notes:
                    if note.level == "warning":
                        console.say(f"{name}: ", note_line(note))
                line = f"{name}: {_checked_by(written)}"
            progress.show(line, done, total, always=True)
    console.say(
        f"{counted(total - failed, 'recording')} with compensated plates in {out}, {failed} failed"
    )
    return 1 if failed else 0


def _checked_by(written: "Written") -> str:
    """Say which readers found that only the plates differ from the original."""
    second = written.verification
    said = f" and {second.reader}" if not second.refusal else ""
    why = f"; {second.reader}: {second.refusal}" if second.refusal else ""
    return f"only the plates differ from the original, as read by this program{said}{why}"
