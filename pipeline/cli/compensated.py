"""Compensated C3D files on the command line: of one trial, or of a whole study."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from pipeline.export.compensated_c3d import Frame, Written
    from pipeline.run.request import TrialRequest


def export_trial(request: "TrialRequest", out: Path, frame: "Frame | None") -> Path:
    """Write a trial's C3D file again with compensated plates, and say what has checked it.

    Parameters
    ----------
    request
        The trial, with a calibration of treadmill or plates.
    out
        Folder for the file, which keeps its name.
    frame
        As for `pipeline.export.compensated_c3d.write_compensated`.

    Returns
    -------
    Path
        The file.
    """
    from pipeline.cli.terminal import plain_console
    from pipeline.export.compensated_c3d import Calibrations, require_c3d, write_compensated
    from pipeline.run.one_trial import read_requested, requested_laboratory

    if request.calibration is None and request.plate_calibration is None:
        raise ValueError(
            "--c3d compensates the plates: name the --calibration of the treadmill, or the "
            "--plate-calibration"
        )
    require_c3d(request.trial)
    calibrations = Calibrations(requested_laboratory(request), request.calibration)
    written = write_compensated(
        read_requested(request),
        calibrations,
        out / request.trial.name,
        frame=frame,
        plate_delay_s=request.plate_delay,
    )
    console = plain_console()
    _print_notes(written, console)
    console.print(f"{written.path}: {_checked_by(written)}", soft_wrap=True)
    return written.path


def export_study(folder: Path, out: Path, frame: "Frame | None") -> int:
    """Write all recordings of a study's trials again with compensated plates.

    Parameters
    ----------
    folder
        The study.
    out
        Folder for the files, which keep their names relative to the study.
    frame
        As for `export_trial`.

    Returns
    -------
    int
        0; 1 where some of them failed and the others are written.
    """
    from pipeline.cli.terminal import StepProgress, counted, plain_console
    from pipeline.config.study import read_study
    from pipeline.export.compensated_c3d import recordings_of, write_compensated_study

    console, study = plain_console(), read_study(folder)
    total, failed = len(recordings_of(study)), 0
    with StepProgress(console, "compensating", "recordings") as progress:
        for done, (name, written) in enumerate(write_compensated_study(study, out, frame), 1):
            if isinstance(written, str):
                failed += 1
                line = f"FAILED {name}: {written.removeprefix(f'{name}: ')}"
            else:
                _print_notes(written, console, f"{name}: ")
                line = f"{name}: {_checked_by(written)}"
            progress.show(line, done, total, always=True)
    console.print(
        f"{counted(total - failed, 'recording')} with compensated plates in {out}, {failed} failed",
        soft_wrap=True,
    )
    return 1 if failed else 0


def _checked_by(written: "Written") -> str:
    """Say which readers found that only the plates differ from the original."""
    second = written.verification
    said = f" and {second.reader}" if not second.refusal else ""
    why = f"; {second.reader}: {second.refusal}" if second.refusal else ""
    return f"only the plates differ from the original, as read by this program{said}{why}"


def _print_notes(written: "Written", console: "Console", name: str = "") -> None:
    from hbm.notes import warnings_first
    from pipeline.cli.terminal import note_line

    for note in warnings_first(written.notes):
        if note.level == "warning" or not name:
            console.print(name, note_line(note), sep="", soft_wrap=True)
