"""Any recording at a glance, before all of it is read."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.io.c3d.preview import preview_c3d
from pipeline.io.read import file_format, read_recording
from pipeline.io.recording import Preview


def preview_recording(
    path: Path,
    axes: str | None = None,
    forces: Path | None = None,
    *,
    record: Path | None = None,
    rename: Mapping[str, str] | None = None,
) -> Preview:
    """Preview a recording of any format, a C3D file without reading all of it.

    Parameters and errors are those of `read_recording`.
    """
    if file_format(path) == "C3D" and forces is None and record is None:
        return preview_c3d(path, axes, rename=rename)
    recording = read_recording(path, axes, forces, record=record, rename=rename)
    share = np.isnan(recording.markers.position[..., 0]).mean(axis=0)
    missing = {m: float(s) for m, s in zip(recording.markers.names, share, strict=True)}
    return Preview(recording, len(recording.markers.time), missing)
