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

    Samples that are left out since one that is later, or as late, was there already are counted.

    Examples
    --------
    >>> buffer = SampleBuffer(columns=1, length=3)
    >>> buffer.append(np.array([0.0, 0.1, 0.1, 0.2]), np.ones((4, 1))).tolist()
    [True, True, False, True]
    >>> buffer.newest_s, buffer.doubled
    (0.2, 1)
    """

    def __init__(self, columns: int, length: int) -> None:
        self.length = length
        self._time, self._values = np.empty(2 * length), np.empty((2 * length, columns))
        self._stop = 0
        self.newest_s = -np.inf
        self.out_of_order = self.doubled = 0

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
        taken = np.ones(len(time), bool) if self._follow(time) else self._in_order(time)
        if not taken.all():
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

    def _follow(self, time: Array) -> bool:
        if not len(time):
            return True
        ends = time[0] > self.newest_s and time[-1] < np.inf
        return bool(ends and (len(time) == 1 or (time[1:] > time[:-1]).all()))

    def _in_order(self, time: Array) -> Mask:
        """Give which samples are later than all before them, (N,), and count the others."""
        later = np.where(np.isfinite(time), time, -np.inf)
        before = np.maximum.accumulate(np.concatenate([[self.newest_s], later]))
        kept = later > before[:-1]
        doubled = int(np.count_nonzero(time == before[:-1]))
        self.doubled += doubled
        self.out_of_order += int(np.count_nonzero(~kept)) - doubled
        return np.asarray(kept)


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
        self.buffers = {
            stream.name: SampleBuffer(len(stream.labels), round(HISTORY_S * stream.rate_hz))
            for stream in streams
        }
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
        if len(having) != 1:
            labels_there = [label for stream in self.streams.values() for label in stream.labels]
            missing = [label for label in labels if label not in labels_there]
            names = listed(repr(short(s.name)) for s in having)
            raise ValueError(
                f"live channels {listed(labels)}: several streams have them ({names}); name one "
                "of these streams in [live] analog"
                if having
                else f"live channels {listed(missing or labels)} are in no stream"
                f"{'' if missing else ' together'}; channels there: {listed(labels_there)}"
            )
        stream = having[0]
        columns = [stream.labels.index(label) for label in labels]
        try:
            units = [unit or stream.units[column] for column in columns]
            factor = [in_si(each) for in_si, each in zip(unit_in_si, units, strict=True)]
        except ValueError as error:
            raise ValueError(f"stream {short(stream.name)!r}: {error}") from error
        buffer = self.used[stream.name] = self.buffers[stream.name]
        return Channels(buffer, np.array(columns), np.array(factor), stream.rate_hz)
