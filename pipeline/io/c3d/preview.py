"""A C3D file at a glance: its beginning, its length, and how often its markers are missing."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from pipeline.io.c3d.data import count_frames, missing_share
from pipeline.io.c3d.header import read_header
from pipeline.io.c3d.labels import sort_labels
from pipeline.io.c3d.read import read_c3d
from pipeline.io.recording import Preview

BEGINNING_FRAMES: Final = 1000
"""Ten seconds at 100 Hz: enough gait to infer axes, weigh the subject and find events."""
SAMPLED_FRAMES: Final = 500
"""Frames in which missing markers are counted: shares are known to 2 % (one SD of 0.5 at most)."""


def preview_c3d(
    path: Path, axes: str | None = None, *, rename: Mapping[str, str] | None = None
) -> Preview:
    """Preview a C3D file without reading all of it; parameters and errors are `read_c3d`'s."""
    beginning = read_c3d(path, axes, rename=rename, max_frames=BEGINNING_FRAMES)
    header, parameters = read_header(path)
    share = missing_share(path, header, parameters, SAMPLED_FRAMES)
    markers = sort_labels(parameters, header.n_points, rename=rename).markers
    missing = {name: float(share[k]) for name, k in markers.items()}
    return Preview(beginning, count_frames(path, header, parameters), missing)
