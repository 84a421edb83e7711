"""One trial without a study: the request checked, the files read, the trial processed."""

from collections.abc import Callable
from pathlib import Path

from hbm.kernels.native import kernels
from hbm.markers import MarkerSet, read_marker_set
from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.config.toml_file import read_segments
from pipeline.config.validation import Model, check_options
from pipeline.io.read import read_recording
from pipeline.io.recording import Recording
from pipeline.run.request import TrialRequest
from pipeline.trial.ground.laboratory import Laboratory, read_laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.result import TrialResult


def process_request(
    request: TrialRequest, announce: Callable[[str], None] | None = None
) -> TrialResult:
    """Read and process one trial.

    Parameters
    ----------
    request
        The trial, and how to process it.
    announce
        Called with a sentence when something takes long.

    Returns
    -------
    TrialResult
        The processed trial.

    Raises
    ------
    ValueError, OSError
        If an option or a file cannot be used; the message says why and what next.
    """
    marker_set = _own_marker_set(request.marker_set)
    shipped = request.marker_set if marker_set is None else None
    faults: list[str] = []
    settings = _checked(Settings, request, faults, marker_set=shipped)
    subject = _checked(Subject, request, faults)
    if settings is None or subject is None:
        raise ValueError("; ".join(faults))
    recording = read_requested(request)
    kernels(announce)
    try:
        return process_recording(
            recording,
            subject,
            settings,
            static=_read(request, request.static),
            hip_trial=_read(request, request.hip_trial),
            segments=read_segments(request.segments) if request.segments else None,
            marker_set=marker_set,
            laboratory=requested_laboratory(request),
        )
    except ValueError as error:
        if request.trial.name not in str(error):
            error.add_note(f"while processing {request.trial.name}")
        raise


def read_requested(request: TrialRequest) -> Recording:
    """Read the trial that a request names, with its forces or its record."""
    return read_recording(request.trial, request.axes, request.forces, record=request.record)


def _read(request: TrialRequest, path: Path | None) -> Recording | None:
    return read_recording(path, request.axes) if path else None


def _own_marker_set(name: str | None) -> MarkerSet | None:
    """Read a marker set that is a file; None for a shipped one."""
    if name is None or not (name.endswith(".toml") or Path(name).is_file()):
        return None
    return read_marker_set(Path(name).read_text(encoding="utf-8-sig"), Path(name).stem)


def requested_laboratory(request: TrialRequest) -> Laboratory:
    """Read the treadmill that a request describes: its calibration and platform markers."""
    markers = tuple(filter(None, map(str.strip, request.platform_markers.split(","))))
    if request.calibration is not None:
        return read_laboratory(request.calibration, markers, request.axes)
    return Laboratory(Treadmill(platform=Platform(markers=markers) if markers else None))


def _checked(
    kind: type[Model], request: TrialRequest, faults: list[str], **other: str | None
) -> Model | None:
    """Check those fields of a request that a model has too, ``other`` in their place."""
    stated = {name: getattr(request, name) for name in kind.model_fields if hasattr(request, name)}
    try:
        return check_options(kind, stated | other)
    except ValueError as error:
        faults.append(str(error))
        return None
