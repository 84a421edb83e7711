"""Markers that are not seen for a while."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array

GONE_S: Final = 0.4
"""A marker that a hand or a rail hides is back sooner."""


class MarkerGaps:
    """Notes each marker that is gone for 0.4 s, once for each time that it is gone.

    Parameters
    ----------
    names
        The markers, M.

    Attributes
    ----------
    missing
        Frames in which each marker was not seen, (M,).
    frames
        Frames so far.

    Examples
    --------
    >>> gaps = MarkerGaps(["LASIS"])
    >>> gaps.add(np.array([0.0, 0.2, 0.4, 0.6]), np.full((4, 1, 3), np.nan))
    (Note(code='live_marker_gone', values=mappingproxy({'marker': 'LASIS', 'gone_s': 0.4})),)
    >>> gaps.add(np.array([0.8]), np.full((1, 1, 3), np.nan))
    ()
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._seen_s = np.full(len(names), np.nan)
        self._noted = np.zeros(len(names), bool)
        self.missing = np.zeros(len(names), int)
        self.frames = 0

    def add(self, time: Array, position: Array) -> tuple[Note, ...]:
        """Take frames, (N,) [s] and (N, M, 3); give what they show."""
        notes = []
        self.frames += len(time)
        seen = np.asarray(np.isfinite(position).all(axis=2))
        for now, visible in zip(time.tolist(), seen, strict=True):
            if np.isnan(self._seen_s[0]):
                self._seen_s[:] = now
            self.missing += ~visible
            self._seen_s[visible], self._noted[visible] = now, False
            gone = ~self._noted & (now - self._seen_s >= GONE_S)
            for k in np.flatnonzero(gone):
                gone_s = now - float(self._seen_s[k])
                notes.append(Note.of("live_marker_gone", marker=self._names[k], gone_s=gone_s))
            self._noted |= gone
        return tuple(notes)
