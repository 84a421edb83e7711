"""Analog channels of live streams: found by their labels, in SI units."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, Indices
from hbm.spelling import listed, short
from pipeline.live.arrival import known
from pipeline.live.frames.buffer import SampleBuffer
from pipeline.live.stream import Samples, StreamDescription

HISTORY_S: Final = 2.0
"""Of samples that are kept: markers are never so much later than analog channels."""


@dataclass(frozen=True, slots=True)
class Channels:
    """Some channels of one stream.

    Attributes
    ----------
    buffer
        Samples of all its channels.
    columns
        Which of them, (K,).
    factor
        What brings each to SI units, (K,).
    rate_hz
        Nominal sampling rate [Hz].
    """

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
    """All analog streams.

    Parameters
    ----------
    streams
        Their descriptions.

    Attributes
    ----------
    used
        The newest samples of the streams of which channels were found.
    """

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
            self.used[samples.stream].append(samples.time, known(samples.values))

    def find(
        self, labels: Sequence[str], unit_in_si: Callable[[str], float], unit: str | None = None
    ) -> Channels:
        """Find channels of one stream.

        Parameters
        ----------
        labels
            Theirs, (K,).
        unit_in_si
            Gives one of a unit in SI, such as `pipeline.io.units.length_in_m`.
        unit
            Of all of them; by default as the stream states it.

        Returns
        -------
        Channels
            In this order.

        Raises
        ------
        ValueError
            No stream has all of them, several have, or a unit is unknown.
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
            factor = [unit_in_si(unit or stream.units[column]) for column in columns]
        except ValueError as error:
            raise ValueError(f"stream {short(stream.name)!r}: {error}") from error
        buffer = self.used[stream.name] = self.buffers[stream.name]
        return Channels(buffer, np.array(columns), np.array(factor), stream.rate_hz)
