"""Recordings in a folder without a study: whose they are, and which shows the calibration pose."""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from pipeline.io.read import file_format, read_recording
from pipeline.io.recording import Recording

SUBJECT: Final = re.compile(r"[A-Za-z]*[-_]?\d+")
"""How the names of a subject's recordings begin, such as S01 or HC030."""
FIRST: Final = "sub01"
"""The subject of recordings whose names begin otherwise."""
MIN_MARKERS: Final = 9
"""Fewer are on a treadmill, not on a body."""
MAX_STILL_M: Final = 0.3
"""Path of the marker that moves most while somebody stands: a step is longer, on belts too."""


class FoundSubject(NamedTuple):
    """A subject of whom there are recordings.

    Attributes
    ----------
    name
        How the names of the recordings begin.
    static
        File of the calibration pose; empty where every recording is a trial.
    trials
        Files of the others.
    """

    name: str
    static: str
    trials: tuple[str, ...]


def found_subjects(folder: Path) -> list[FoundSubject]:
    """Find the subjects whose recordings are in a folder, in the order of their names.

    A recording in which nobody makes a step is the calibration pose, the stillest one of several.
    """
    of_subject: dict[str, list[tuple[float, bool, str]]] = {}
    for path, recording in _recordings(folder):
        match = SUBJECT.match(path.stem)
        name = match[0] if match else FIRST
        found = _moved_m(recording), bool(recording.plates), path.name
        of_subject.setdefault(name, []).append(found)
    subjects = []
    for name, files in sorted(of_subject.items()):
        moved_m, _, static = min(files)
        if len(files) == 1 or moved_m > MAX_STILL_M:
            static = ""
        trials = tuple(file for _, plates, file in sorted(files, key=lambda f: f[2]) if plates)
        trials = tuple(file for file in trials if file != static)
        if trials:
            subjects.append(FoundSubject(name, static, trials))
    return subjects


def _recordings(folder: Path) -> Iterator[tuple[Path, Recording]]:
    """Give the recordings of people; a file that cannot be read is none."""
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        with suppress(ValueError, OSError):
            file_format(path)
            try:
                recording = read_recording(path)
            except ValueError:  # somebody who turns does not show the axes
                recording = read_recording(path, "forward,left,up")
            if len(recording.markers.names) >= MIN_MARKERS:
                yield path, recording


def _moved_m(recording: Recording) -> float:
    """Give how far the marker that moves most moves [m]; a tenth of them may be labelled wrong."""
    position = recording.markers.position
    seen = np.isfinite(position).all(axis=2).any(axis=0)
    if not seen.any():
        return np.inf
    span = np.nanmax(position[:, seen], axis=0) - np.nanmin(position[:, seen], axis=0)
    return float(np.percentile(np.linalg.norm(span, axis=1), 90))
