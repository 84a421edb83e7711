"""Analog channels of live streams: their newest samples in order, in SI units."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, Indices, Mask
from hbm.spelling import listed, short
from pipeline.live.stream import Samples, StreamDescription


class SampleBuffer:
    """The newest samples of one stream, at least so many, in memory that does not grow.

    Samples that are no later than one before them are left out and counted.

    Examples
    --------
    >>> buffer = SampleBuffer(columns=1, length=3)
    >>> buffer.append(np.array([0.0, 0.1, 0.1, 0.2]), np.ones((4, 1))).tolist()
    [True, True, False, True]
    >>> buffer.newest_s, buffer.left_out
    (0.2, 1)
    """

    def __init__(self, columns: int, length: int) -> None:
        self.length = length
        self._time, self._values = np.empty(2 * length), np.empty((2 * length, columns))
        self._stop = 0
        self.newest_s = -np.inf
        self.left_out = 0

    @property
    def time(self) -> Array:
        """Times of the samples that are kept, (N,) [s]; valid until the next are appended."""
        return self._time[: self._stop]

    @property
    def values(self) -> Array:
        """The samples, (N, K); valid until the next are appended."""
        return self._values[: self._stop]

    def append(self, time: Array, values: Array) -> Mask:
        """Take samples, (N,) [s] and (N, K), that follow the last one; give which do, (N,)."""
        before = np.maximum.accumulate(np.concatenate([[self.newest_s], time]))
        taken = np.asarray(time > before[:-1])
        if not taken.all():
            self.left_out += int(np.count_nonzero(~taken))
            time, values = time[taken], values[taken]
        time, values = time[-self.length :], values[-self.length :]
        if self._stop + len(time) > len(self._time):
            kept_before = slice(max(0, self._stop - self.length + len(time)), self._stop)
            moved = kept_before.stop - kept_before.start
            self._time[:moved] = self._time[kept_before].copy()
            self._values[:moved] = self._values[kept_before].copy()
            self._stop = moved
        place = slice(self._stop, self._stop + len(time))
        self._time[place], self._values[place] = time, values
        self._stop = place.stop
        if len(time):
            self.newest_s = float(time[-1])
        return taken


HISTORY_S: Final = 2.0
"""Of samples that are kept: markers are never so much later than analog channels."""


@dataclass(frozen=True, slots=True)
class Channels:
    """Some channels of one stream: which, and what brings each to SI units, (K,)."""

    buffer: SampleBuffer
    columns: Indices
    factor: Array
    rate_hz: float

    def samples(self, start_s: float, stop_s: float) -> tuple[Array, Array]:
        """Give the samples from one time to another: (N,) [s] and (N, K) in SI units."""
        time = self.buffer.time
        first, last = np.searchsorted(time, (start_s, stop_s))
        part = slice(max(int(first) - 1, 0), int(last) + 1)
        return time[part], self.buffer.values[part][:, self.columns] * self.factor


class AnalogStreams:
    """All analog streams; ``used`` has the newest samples of those of which channels were found."""

    def __init__(self, streams: Sequence[StreamDescription]) -> None:
        self.streams = {stream.name: stream for stream in streams}
        self.used: dict[str, SampleBuffer] = {}

    def append(self, samples: Samples) -> None:
        """Take what arrived, if it is of a stream of which channels are used."""
        if samples.stream in self.used:
            self.used[samples.stream].append(samples.time, samples.values)

    def find(
        self,
        labels: Sequence[str],
        unit_in_si: Sequence[Callable[[str], float]],
        unit: str | None = None,
    ) -> Channels:
        """Find channels of one stream, in this order.

        Of each, ``unit_in_si`` gives one of a unit in SI, such as `pipeline.io.units.length_in_m`;
        the unit is as stated, else as the stream has it. A ValueError says that no stream has all
        of them, that several have, or that a unit is unknown.
        """
        having = [s for s in self.streams.values() if set(labels) <= set(s.labels)]
        if len(having) > 1:
            names = listed(repr(short(stream.name)) for stream in having)
            raise ValueError(
                f"live channels {listed(labels)}: several streams have them ({names}); name one "
                "of these streams in [live] analog"
            )
        if not having:
            there = [label for stream in self.streams.values() for label in stream.labels]
            missing = [label for label in labels if label not in there]
            raise ValueError(
                f"live channels {listed(missing or labels)} are in no stream"
                f"{'' if missing else ' together'}; channels there: {listed(there)}"
            )
        stream = having[0]
        columns = [stream.labels.index(label) for label in labels]
        try:
            units = [unit or stream.units[column] for column in columns]
            factor = [in_si(each) for in_si, each in zip(unit_in_si, units, strict=True)]
        except ValueError as error:
            raise ValueError(f"stream {short(stream.name)!r}: {error}") from error
        if stream.name not in self.used:
            length = round(HISTORY_S * stream.rate_hz)
            self.used[stream.name] = SampleBuffer(len(stream.labels), length)
        buffer = self.used[stream.name]
        return Channels(buffer, np.array(columns), np.array(factor), stream.rate_hz)
