"""One trial on the command line: read, process, print, write."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from hbm.markers import MarkerSet, read_marker_set
from hbm.native import kernels
from pipeline.calibration_commands import laboratory
from pipeline.figures import residual_figure, save_figure
from pipeline.files import read_recording
from pipeline.laboratory import Laboratory
from pipeline.process import process_recording
from pipeline.recording import Recording
from pipeline.residuals import hicks_table, marker_table, residual_table
from pipeline.study import Platform, Settings, Subject, Treadmill
from pipeline.study_faults import check_options
from pipeline.subject_body import read_segments
from pipeline.trial_files import write_csv, write_trial
from pipeline.trial_result import TrialResult

WARNING: Final = "warning:"


@dataclass(frozen=True, slots=True)
class Request:
    """What a person asked for, as typed."""

    trial: Path
    static: Path | None = None
    forces: Path | None = None
    record: Path | None = None
    mass_kg: float | None = None
    sex: str = "unspecified"
    height_m: float | None = None
    axes: str | None = None
    marker_set: str | None = None
    hip: str = "harrington"
    hip_trial: Path | None = None
    segments: Path | None = None
    filter: str = "zero_phase"
    cutoff_hz: float = 6.0
    plate_delay_s: float = 0.0
    calibration: Path | None = None
    platform_markers: tuple[str, ...] = ()


def run(request: Request, out: Path) -> TrialResult:
    """Process one trial, print what came out, write table, frames and figure.

    Parameters
    ----------
    request
        What to do.
    out
        Folder for what it writes.

    Returns
    -------
    TrialResult
        The processed trial.

    Raises
    ------
    ValueError, OSError
        If the input cannot be used; one line that says why and what next.
    """
    console = Console(highlight=False, markup=False)
    _require_folder(out)
    result, _ = process(request, lambda sentence: console.print(sentence, style="dim"))
    print_result(result, console.print)
    stem = out / request.trial.stem
    write_trial(result, request.trial.stem, "", Path(f"{stem}.parquet"))
    write_csv(residual_table(result, request.trial.stem), Path(f"{stem}_residuals.csv"))
    save_figure(residual_figure(result), Path(f"{stem}_residuals"))
    console.print(
        f"written to {out}: {stem.name}.parquet (frames), {stem.name}_residuals.csv, .png and .svg",
        soft_wrap=True,
    )
    return result


def process(
    request: Request, announce: Callable[[str], None] | None = None
) -> tuple[TrialResult, Recording]:
    """Read and process one trial as asked for; raises as `run` does.

    Parameters
    ----------
    request
        What to do.
    announce
        Told, in a sentence, when something takes long.

    Returns
    -------
    tuple
        The processed trial, and its recording.
    """
    settings, subject, own_set = _stated(request)
    recording = read_asked(request)
    static = read_recording(request.static, request.axes) if request.static else None
    kernels(announce)
    try:
        result = process_recording(
            recording,
            subject,
            settings,
            static=static,
            hip_trial=read_recording(request.hip_trial, request.axes)
            if request.hip_trial
            else None,
            segments=read_segments(request.segments) if request.segments else None,
            marker_set=own_set,
            laboratory=_laboratory(request),
        )
    except ValueError as error:
        if request.trial.name not in str(error):
            error.add_note(f"while processing {request.trial.name}")
        raise
    return result, recording


def read_asked(request: Request) -> Recording:
    """Read the trial that a request names, with what goes beside it."""
    return read_recording(request.trial, request.axes, request.forces, record=request.record)


def _laboratory(request: Request) -> Laboratory:
    if request.calibration is not None:
        return laboratory(request.calibration, request.platform_markers, request.axes)
    markers = request.platform_markers
    return Laboratory(Treadmill(platform=Platform(markers=markers) if markers else None))


def _stated(request: Request) -> tuple[Settings, Subject, MarkerSet | None]:
    """Check what was typed."""
    own_set, name = None, request.marker_set
    if name is not None and (name.endswith(".toml") or Path(name).is_file()):
        own_set = read_marker_set(Path(name).read_text(encoding="utf-8-sig"), Path(name).stem)
        name = None
    settings = check_options(
        Settings,
        {
            "marker_set": name,
            "hip": request.hip,
            "filter": request.filter,
            "cutoff_hz": request.cutoff_hz,
            "plate_delay_s": request.plate_delay_s,
        },
    )
    subject = check_options(
        Subject, {"sex": request.sex, "mass_kg": request.mass_kg, "height_m": request.height_m}
    )
    return settings, subject, own_set


def _require_folder(out: Path) -> None:
    """Refuse a folder that cannot be written to before minutes are spent on what goes into it."""
    nearest = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise ValueError(f"--out {out}: {nearest} is a file, not a folder")
    if not os.access(nearest, os.W_OK):
        raise ValueError(f"--out {out}: no permission to write into {nearest}")


def print_result(result: TrialResult, show: Callable[..., None]) -> None:
    """Print a trial's residuals, thresholds, marker errors and notes.

    Parameters
    ----------
    result
        The trial.
    show
        A rich console's ``print``.
    """
    table = residual_table(result, result.source.stem)
    count = table["n_cycles"].iloc[0]
    cycles = f"{count} gait cycle{'' if count == 1 else 's'}"
    view = Table(
        title=f"Pelvis residuals, {result.source.name}, {cycles} "
        f"({result.settings.filter} {result.settings.cutoff_hz:g} Hz)",
        caption="x forward, y right, z up; moments about mid-hip; % of body weight, or of body "
        "weight × stature",
    )
    for name in ("plates", "axis", "RMS", "mean", "SD", "peak", "", "RMS %"):
        view.add_column(name, justify="left" if name in ("plates", "axis", "") else "right")
    for row in table.to_dict("records"):
        numbers = [f"{row[name]:.1f}" for name in ("rms", "mean", "sd", "peak")]
        percent = f"{row['rms_percent']:.2f}"
        view.add_row(_plates(row["compensated"]), row["axis"], *numbers, row["unit"], percent)
    show(view)
    for row in hicks_table(result).to_dict("records"):
        verdict = "passes" if row["passed"] else "FAILS"
        show(
            f"{verdict} Hicks (2015): peak residual {row['quantity']} {row['peak']:.1f} "
            f"{row['unit']}, limit {row['limit']:.1f} {row['unit']} ({_plates(row['compensated'])})"
        )
    markers = marker_table(result)
    every, single = markers["rms_mm"].iloc[-1], markers.iloc[:-1]
    ordered = single.sort_values("rms_mm", ascending=False).to_dict("records")
    listed = ", ".join(f"{row['marker']} {row['rms_mm']:.1f}" for row in ordered)
    show(f"marker error {every:.1f} mm RMS over {len(ordered)} markers: {listed}")
    for note in sorted(result.notes, key=lambda note: not note.startswith(WARNING)):
        show(f"- {note}", soft_wrap=True, style="bold" if note.startswith(WARNING) else None)


def _plates(compensated: bool) -> str:
    return "compensated" if compensated else "measured"
