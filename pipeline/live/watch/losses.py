"""Samples that never arrived, by the time stamps of those that did."""

from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.live.stream import Samples, StreamDescription

MISSING: Final = 1.5
"""Sampling intervals between two samples of which one at least is missing between them."""


class Losses:
    """Counts samples that are missing in streams.

    Parameters
    ----------
    streams
        What is received.

    Attributes
    ----------
    lost
        Stream -> samples that are missing between those that arrived.

    Examples
    --------
    >>> heels = StreamDescription("Markers", "markers", ("LHEE",), ("m",), 100.0)
    >>> losses = Losses([heels])
    >>> losses.add(Samples("Markers", np.array([0.0, 0.01, 0.05]), np.ones((3, 3))))
    >>> dict(losses.lost)
    {'Markers': 3}
    """

    def __init__(self, streams: Sequence[StreamDescription]) -> None:
        self._rate_hz = {stream.name: stream.rate_hz for stream in streams}
        self._newest_s: dict[str, float] = {}
        self.lost: Counter[str] = Counter()

    def add(self, received: Samples) -> None:
        """Take samples with known times as they were received."""
        rate_hz = self._rate_hz.get(received.stream, 0.0)
        times: Array = np.sort(received.time)
        before_s = self._newest_s.get(received.stream, times[0])
        self._newest_s[received.stream] = max(before_s, float(times[-1]))
        intervals = np.diff(times, prepend=before_s) * rate_hz
        missing = int(np.sum(np.round(intervals[intervals > MISSING]) - 1))
        if missing:
            self.lost[received.stream] += missing
