"""Recordings as streams: as a source that needs no network, and played by Lab Streaming Layer."""

import threading
import time as clock
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from hbm.spatial import Array
from pipeline.config.live import LOOPBACK, Live
from pipeline.io.recording import Plate, Recording
from pipeline.live.output import Outlet, describe_stream, load_lsl
from pipeline.live.stream import DescribedPlate, Samples, StreamDescription

MARKERS: Final = "Markers"
PLATES: Final = "Plates"
ANALOG: Final = "Analog"
"""Names of the streams of a recording."""


class RecordedStream(NamedTuple):
    """One stream of a recording: its samples on the recording's clock, (N,) [s] and (N, K).

    The plates are those of its channels.
    """

    description: StreamDescription
    plates: tuple[Plate, ...]
    time: Array
    values: Array


def recorded_streams(recording: Recording) -> tuple[RecordedStream, ...]:
    """Give a recording of any format as streams.

    "Markers" at the cameras' rate. "Plates": Fx Fy Fz Mx My Mz of each in its own axes about the
    centre of its surface, called FP1.Fx and so on. "Analog": the other channels. Streams that the
    recording does not have are absent; plates of several rates are streams of their own, "Plates",
    "Plates 2" and so on.
    """
    markers, names = recording.markers, recording.markers.names
    of_markers = StreamDescription(MARKERS, "markers", names, ("m",) * len(names), markers.rate_hz)
    positions = np.reshape(markers.position, (len(markers.time), -1))
    streams = [RecordedStream(of_markers, (), markers.time, positions)]
    # plates of one clock are one stream
    groups = dict[bytes, list[Plate]]()
    for plate in recording.plates:
        groups.setdefault(plate.time.tobytes(), []).append(plate)
    for number, group in enumerate(groups.values(), start=1):
        name = PLATES if number == 1 else f"{PLATES} {number}"
        labels = tuple(label for plate in group for label in Live().channels_of(plate.number))
        units = (*("N",) * 3, *("N·m",) * 3) * len(group)
        loads = StreamDescription(name, "analog", labels, units, group[0].rate_hz)
        values = np.hstack([plate.wrench_in_plate for plate in group])
        streams.append(RecordedStream(loads, tuple(group), group[0].time, values))
    if (analog := recording.analog) is not None and len(analog.time) > 1:
        read = StreamDescription(ANALOG, "analog", analog.names, analog.units, analog.rate_hz)
        streams.append(RecordedStream(read, (), analog.time, analog.values))
    return tuple(streams)


class RecordedSource:
    """Gives the samples of a recording in chunks, as fast as they are asked for.

    Parameters
    ----------
    recording
        The recording.
    chunk_s
        Time that each chunk spans [s].

    Attributes
    ----------
    streams
        What it gives: markers first.
    plates
        The recording's, each with its channels.

    Examples
    --------
    >>> import hbm, numpy as np
    >>> time = np.arange(50) / 100
    >>> heel = hbm.Markers(time, ("LHEE",), np.ones((50, 1, 3)))
    >>> source = RecordedSource(Recording("heel.c3d", heel), chunk_s=0.1)
    >>> [len(samples.time) for samples in source.receive(0.0)]
    [10]
    >>> while source.receive(0.0):
    ...     pass
    >>> source.ended
    True
    """

    def __init__(self, recording: Recording, chunk_s: float = 0.01) -> None:
        self._streams = recorded_streams(recording)
        self.streams = tuple(stream.description for stream in self._streams)
        self.plates = tuple(
            DescribedPlate(str(plate.number), Live().channels_of(plate.number), plate.place)
            for plate in recording.plates
        )
        self._sent = [0] * len(self._streams)
        self._chunk_s = chunk_s
        self.first_s = self._until_s = min(float(stream.time[0]) for stream in self._streams)

    @property
    def ended(self) -> bool:
        """Whether all samples were given."""
        return self._sent == [len(stream.time) for stream in self._streams]

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give the next samples; an empty list at the end. It never waits."""
        samples: list[Samples] = []
        while not samples and not self.ended:
            self._until_s += self._chunk_s
            samples = self.until(self._until_s)
        return samples

    def until(self, time_s: float) -> list[Samples]:
        """Give the next samples before a time of the recording [s]."""
        samples = []
        for k, (description, _, time, values) in enumerate(self._streams):
            # a sample at the end of a chunk belongs to the next one, however it is rounded
            part = slice(self._sent[k], int(np.searchsorted(time, time_s - 1e-9)))
            if part.stop > part.start:
                samples.append(Samples(description.name, time[part], values[part]))
                self._sent[k] = part.stop
        return samples

    def close(self) -> None:
        """Give nothing more."""
        self._sent = [len(stream.time) for stream in self._streams]


TICK_S: Final = 0.001
"""Between looks at what is due."""
MAX_SPEED: Final = 20.0
"""Beyond it the library loses samples; `RecordedSource` needs no network and loses none."""


class Replay:
    """Plays a recording by Lab Streaming Layer, on a thread of its own.

    Parameters
    ----------
    recording
        The recording.
    speed
        How many times faster than it was recorded, at most 20. Time stamps keep the recording's own
        intervals whatever the speed.
    prefix
        Before the names of its streams, so that several replays can be told apart.
    listen
        As for `pipeline.live.output.load_lsl`, with its errors.

    Attributes
    ----------
    names
        Names of the streams that are sent: markers first.
    start_s
        Time of the recording's zero on the clock of Lab Streaming Layer [s]; NaN before it plays.

    Raises
    ------
    ValueError
        The speed is not above 0 and at most 20.
    """

    def __init__(
        self, recording: Recording, speed: float = 1.0, *, prefix: str = "", listen: str = LOOPBACK
    ) -> None:
        if not 0 < speed <= MAX_SPEED:
            raise ValueError(f"speed must be above 0 and at most {MAX_SPEED:g}, got {speed:g}")
        self._now: Callable[[], float] = load_lsl(listen).local_clock
        self._speed, self._source = speed, RecordedSource(recording)
        self._outlets = {
            stream.name: Outlet(describe_stream(stream, Live(), plates, prefix), listen=listen)
            for stream, plates, *_ in recorded_streams(recording)
        }
        self.names = tuple(prefix + name for name in self._outlets)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._play, name="replay", daemon=True)
        self.start_s = float("nan")

    @property
    def without_receiver(self) -> tuple[str, ...]:
        """Names of the streams that nobody receives now."""
        outlets = self._outlets.values()
        return tuple(n for n, o in zip(self.names, outlets, strict=True) if not o.has_receivers)

    @property
    def ended(self) -> bool:
        """Whether the last sample was sent and receivers had time to take it."""
        return self._thread.ident is not None and not self._thread.is_alive()

    def start(self, timeout_s: float = 0.0) -> bool:
        """Begin to play once every stream has a receiver, or after the timeout.

        Streams that nobody has taken a second after the markers are not waited for. Gives whether
        every stream had one.
        """
        deadline = clock.monotonic() + timeout_s
        is_received = False
        while (absent := self.without_receiver) and clock.monotonic() < deadline:
            # not everybody wants all streams: a second more once the markers have a receiver
            if not is_received and self.names[0] not in absent:
                is_received, deadline = True, min(deadline, clock.monotonic() + 1.0)
            clock.sleep(TICK_S * 5)
        self._thread.start()
        return not absent

    def close(self) -> None:
        """Stop playing and sending."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        for outlet in self._outlets.values():
            outlet.close()

    def _play(self) -> None:
        first_s, begun = self._source.first_s, clock.monotonic()
        self.start_s = self._now() - first_s
        while not self._stop.wait(TICK_S):
            until_s = first_s + (clock.monotonic() - begun) * self._speed
            for samples in self._source.until(until_s):
                self._outlets[samples.stream].push(samples.time + self.start_s, samples.values)
            if self._source.ended:
                self._stop.wait(0.5)  # receivers take the last samples
                return
