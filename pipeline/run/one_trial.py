"""One trial on the command line: read, process, print, write."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hbm.kernels.native import kernels
from hbm.markers import MarkerSet, read_marker_set
from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.config.toml_file import read_segments
from pipeline.config.validation import check_options
from pipeline.io.read import read_recording
from pipeline.io.recording import Recording
from pipeline.trial.ground.laboratory import Laboratory, read_laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.result import TrialResult


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
        return read_laboratory(request.calibration, request.platform_markers, request.axes)
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
