"""Markers that do not fit the body, and plates that are not where the feet are."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.notes import Note
from pipeline.live.frames.frame import LiveFrame
from pipeline.trial.quality import Quality

JUDGED_S: Final = 0.5
"""Frames whose markers are judged together: where none fits, they are computed slowly."""
WALKED_S: Final = 2.0
"""Frames in which each foot stands and swings."""
MIN_FRAMES: Final = 20
MAX_ERROR_M: Final = 0.02
"""RMS: twice what soft tissue and sparse marker sets leave in walking."""
MOST: Final = 0.5
"""Share of the frames."""


class FitWatch:
    """Notes markers that do not fit the body, once each time.

    Parameters
    ----------
    markers
        The body's that are received, M.
    columns
        Where each is in a frame's markers, (M,).
    """

    def __init__(self, markers: Sequence[str], columns: Sequence[int]) -> None:
        self._names, self._columns = tuple(markers), list(columns)
        self._frames: list[LiveFrame] = []
        self._told = False

    def add(self, frame: LiveFrame) -> tuple[Note, ...]:
        """Take a frame; give what it and those of the half second before show."""
        self._frames.append(frame)
        if not _are_enough(self._frames, JUDGED_S):
            return ()
        error = np.array([frame.marker_error for frame in self._frames])
        squared_m2 = error[np.isfinite(error)] ** 2
        rms_m = float(np.sqrt(squared_m2.mean())) if len(squared_m2) else 0.0
        left_out = self._left_out()
        self._frames.clear()
        told, self._told = self._told, bool(rms_m > MAX_ERROR_M or left_out)
        if told or not self._told:
            return ()
        names = ", ".join(left_out) or "none"
        return (Note.of("live_markers_misfit", error_m=rms_m, left_out=names),)

    def _left_out(self) -> list[str]:
        """Name markers that were seen, and not used, in most frames."""
        lost = np.zeros(len(self._names))
        for frame in self._frames:
            if Quality.MARKERS_LEFT_OUT in frame.quality and len(frame.markers):
                seen = np.isfinite(frame.markers[self._columns]).all(axis=1)
                lost += seen & np.isnan(frame.marker_error)
        often = lost > MOST * len(self._frames)
        return [name for name, each in zip(self._names, often, strict=True) if each]


class FootWatch:
    """Notes pressure that is mostly under neither foot, or between both, once each time."""

    def __init__(self) -> None:
        self._frames: list[LiveFrame] = []
        self._told = False

    def add(self, frame: LiveFrame) -> tuple[Note, ...]:
        """Take a frame; give what it and those of the two seconds before show."""
        self._frames.append(frame)
        if not _are_enough(self._frames, WALKED_S):
            return ()
        share = float(np.mean([Quality.FOOT_UNCERTAIN in each.quality for each in self._frames]))
        self._frames.clear()
        told, self._told = self._told, share > MOST
        return (Note.of("live_foot_uncertain", share=share),) if self._told and not told else ()


def _are_enough(frames: Sequence[LiveFrame], span_s: float) -> bool:
    return len(frames) >= MIN_FRAMES and frames[-1].time - frames[0].time >= span_s
