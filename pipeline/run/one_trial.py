"""One trial without a study: the request checked, the files read, the trial processed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hbm.kernels.native import kernels
from hbm.markers import MarkerSet, marker_sets, read_marker_set
from pipeline.config.plate_correction import read_plate_correction
from pipeline.config.schema import Platform, RecordingRules, Settings, Subject, Treadmill
from pipeline.config.toml_file import read_segments
from pipeline.io.input_file import is_file, read_text
from pipeline.io.read import read_recording
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.run.request import TrialRequest
from pipeline.trial.ground.accelerometers import stated_accelerometers
from pipeline.trial.ground.calibrations import read_laboratory
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.result import TrialResult
from pipeline.trial.study_files import saying_what_was_read, with_unused_renames


@dataclass(frozen=True, slots=True)
class ProcessedTrial:
    """A trial with everything that it was made from.

    Attributes
    ----------
    recording
        As read.
    laboratory
        The treadmill and its calibrations.
    result
        The processed trial.
    """

    recording: Recording
    laboratory: Laboratory
    result: TrialResult


def process_request(
    request: TrialRequest, announce: Callable[[str], None] | None = None
) -> ProcessedTrial:
    """Read and process one trial, and keep what it was made from.

    Parameters
    ----------
    request
        The trial, and how to process it.
    announce
        Called with a sentence when something takes long.

    Returns
    -------
    ProcessedTrial
        The trial, its recording and its laboratory.

    Raises
    ------
    ValueError, OSError
        If an option or a file cannot be used; the message says why and what next.
    """
    marker_set = _own_marker_set(request.marker_set)
    shipped = request.marker_set if marker_set is None else None
    settings = request.part(Settings, marker_set=shipped, plate_delay_s=request.plate_delay)
    stated, condition = _stated(request), request.condition
    recording = read_requested(request)
    static, hip_trial = (
        read_recording(path, stated) if path else None
        for path in (request.static, request.hip_trial)
    )
    recording = with_unused_renames(recording, static, hip_trial)
    kernels(announce)
    try:
        laboratory = requested_laboratory(request)
        with saying_what_was_read(recording, static, hip_trial):
            result = process_recording(
                recording,
                request.part(Subject),
                settings,
                static=static,
                hip_trial=hip_trial,
                segments=read_segments(request.segments) if request.segments else None,
                marker_set=marker_set,
                laboratory=laboratory,
                condition=condition,
            )
    except ValueError as error:
        if request.trial.name not in str(error):
            error.add_note(f"while processing {request.trial.name}")
        paths = (path for _, path in request if isinstance(path, Path))
        file = next((p for p in paths if str(error).startswith(f"{p.name}: ")), request.trial)
        vars(error).setdefault("filename", str(file))
        raise
    return ProcessedTrial(recording, laboratory, result)


def read_requested(request: TrialRequest) -> Recording:
    """Read the trial that a request names, with its forces or its record."""
    return read_recording(
        request.trial,
        _stated(request),
        request.forces,
        record=request.record,
        static=request.static,
    )


def _stated(request: TrialRequest) -> Stated:
    """Give what a request states about its files."""
    own = _own_marker_set(request.marker_set)
    return request.part(RecordingRules).stated(own or marker_sets().get(request.marker_set or ""))


def _own_marker_set(name: str | None) -> MarkerSet | None:
    """Read a marker set that is a file; None for a shipped one."""
    if name is None or not (name.endswith(".toml") or is_file(Path(name))):
        return None
    return read_marker_set(read_text(Path(name)), Path(name).stem)


def requested_laboratory(request: TrialRequest) -> Laboratory:
    """Read the treadmill that a request describes: calibrations and platform markers."""
    markers = tuple(filter(None, map(str.strip, request.platform_markers.split(","))))
    file = request.plate_calibration
    plates = read_plate_correction(file) if file is not None else None
    if request.calibration is not None:
        stated = stated_accelerometers(request.accelerometer)
        return read_laboratory(request.calibration, markers, stated, plates)
    if request.accelerometer:
        raise ValueError("--accelerometer has no effect without --calibration")
    platform = Platform(markers=markers) if markers else None
    return Laboratory(Treadmill(platform=platform), plates=plates)
