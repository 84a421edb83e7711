"""A C3D file at a glance: its beginning, how long it is, and how often its markers are missing."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pipeline.io.c3d.data import count_frames, missing_share
from pipeline.io.c3d.header import read_header
from pipeline.io.c3d.read import read_c3d
from pipeline.io.labels import sort_labels
from pipeline.io.read import file_format, read_recording
from pipeline.io.recording import Recording

BEGINNING_FRAMES: Final = 1000
LOOKS: Final = 500


@dataclass(frozen=True, slots=True)
class Preview:
    """What a look at a file tells.

    Attributes
    ----------
    beginning
        The first frames, at most `BEGINNING_FRAMES`.
    frames
        Number of frames in the file.
    missing
        Marker -> share of frames in which it is missing, judged by `LOOKS` frames.
    """

    beginning: Recording
    frames: int
    missing: dict[str, float]


def preview_recording(
    path: Path,
    axes: str | None = None,
    forces: Path | None = None,
    *,
    record: Path | None = None,
    rename: Mapping[str, str] | None = None,
) -> Preview:
    """Look at a recording of any format, a C3D file without reading all; as `read_recording`."""
    if file_format(path) == "C3D" and forces is None and record is None:
        return preview_c3d(path, axes, rename=rename)
    recording = read_recording(path, axes, forces, record=record, rename=rename)
    share = np.isnan(recording.markers.position[..., 0]).mean(axis=0)
    missing = {m: float(s) for m, s in zip(recording.markers.names, share, strict=True)}
    return Preview(recording, len(recording.markers.time), missing)


def preview_c3d(
    path: Path, axes: str | None = None, *, rename: Mapping[str, str] | None = None
) -> Preview:
    """Look at a C3D file without reading all of it; parameters and errors as `read_c3d`."""
    beginning = read_c3d(path, axes, rename=rename, most_frames=BEGINNING_FRAMES)
    header, parameters = read_header(path)
    share = missing_share(path, header, parameters, LOOKS)
    markers = sort_labels(parameters, header.n_points, rename=rename).markers
    missing = {name: float(share[k]) for name, k in markers.items()}
    return Preview(beginning, count_frames(path, header, parameters), missing)
