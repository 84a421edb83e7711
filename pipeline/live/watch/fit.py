"""Markers that do not fit the body, and plates that are not where the feet are."""

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.notes import Note
from pipeline.live.frames.frame import LiveFrame, Quality

JUDGED_S: Final = 2.0
"""Frames that are judged together."""
MIN_FRAMES: Final = 20
MAX_ERROR_M: Final = 0.02
"""RMS: twice what soft tissue and sparse marker sets leave in walking."""
MOST: Final = 0.5
"""Share of the frames."""


class FitWatch:
    """Notes markers that do not fit the body, and pressure under neither foot, once each time.

    Parameters
    ----------
    markers
        The body's that are received, M.
    columns
        Where each is in a frame's markers, (M,).
    """

    def __init__(self, markers: Sequence[str], columns: Sequence[int]) -> None:
        self._names, self._columns = tuple(markers), list(columns)
        self._frames: deque[LiveFrame] = deque()
        self._told: frozenset[str] = frozenset()

    def add(self, frame: LiveFrame) -> tuple[Note, ...]:
        """Take a frame; give what it and those of the two seconds before show."""
        self._frames.append(frame)
        if frame.time - self._frames[0].time < JUDGED_S:
            return ()
        notes = self._judge() if len(self._frames) >= MIN_FRAMES else ()
        self._frames.clear()
        new = tuple(note for note in notes if note.code not in self._told)
        self._told = frozenset(note.code for note in notes)
        return new

    def _judge(self) -> tuple[Note, ...]:
        notes = []
        error = np.array([frame.marker_error for frame in self._frames])
        squared_m2 = error[np.isfinite(error)] ** 2
        rms_m = float(np.sqrt(squared_m2.mean())) if len(squared_m2) else 0.0
        left_out = self._left_out()
        if rms_m > MAX_ERROR_M or left_out:
            names = ", ".join(left_out) or "none"
            notes.append(Note.of("live_markers_misfit", error_m=rms_m, left_out=names))
        uncertain = [Quality.FOOT_UNCERTAIN in frame.quality for frame in self._frames]
        if np.mean(uncertain) > MOST:
            notes.append(Note.of("live_foot_uncertain", share=float(np.mean(uncertain))))
        return tuple(notes)

    def _left_out(self) -> list[str]:
        """Name markers that were seen, and not used, in most frames."""
        lost = np.zeros(len(self._names))
        for frame in self._frames:
            if Quality.MARKERS_LEFT_OUT in frame.quality and len(frame.markers):
                seen = np.isfinite(frame.markers[self._columns]).all(axis=1)
                lost += seen & np.isnan(frame.marker_error)
        often = lost > MOST * len(self._frames)
        return [name for name, each in zip(self._names, often, strict=True) if each]
