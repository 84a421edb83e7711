"""One stream of Lab Streaming Layer as it is received."""

import socket
import time
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any, Final

import numpy as np

from hbm.spelling import short
from pipeline.io.stated import Stated
from pipeline.io.xdf.clock import find_clock
from pipeline.live.arrival import known
from pipeline.live.sources.changes import came_back
from pipeline.live.sources.clock_offset import ClockOffset
from pipeline.live.sources.lsl_description import read_description
from pipeline.live.stream import Samples

CHUNK_S: Final = 0.05
"""Time whose samples are taken from a stream at once: after a pause, no stream runs ahead."""
MAX_SAMPLES: Final = 1024
"""Taken at once of a stream whose rate is not known yet."""
BUFFER_S: Final = 10
"""Kept by the library for a receiver that is busy."""
ANSWER_S: Final = 10.0
"""Left to a stream that was found to describe itself, to compare clocks and to send."""
RETURN_S: Final = 2.0
"""The same for one that is back, after which it is tried anew."""
SILENT_S: Final = 1.0
"""After it, a sender that is gone may be replaced though its connection has not ended."""
SAME_CLOCK_S: Final = 0.05
"""Offsets of one clock differ by less; those of computers of the same name, by hours."""
RATE_S: Final = 1.0
"""Time whose samples show the rate of a stream that does not state it."""
RATE_TIMEOUT_S: Final = 3.0
POLL_S: Final = 0.02
"""Between looks at what is there, while streams are searched for."""


class Inlet:
    """One stream, with memory for what arrives.

    Parameters
    ----------
    lsl
        The library, ``pylsl``.
    info
        The stream as it was found.
    stated
        What a person states about it.
    is_markers
        Whether it holds the markers.

    Raises
    ------
    ValueError
        Its description lacks something or contradicts itself.
    ConnectionError
        It does not send its description.

    Notes
    -----
    A connection that is lost stays lost: the library's own recovery takes a sender that comes back
    for the same, whatever it sends, so that samples of other channels would arrive unnoticed.
    `take_up` connects anew, and takes no sample before the description is known to be the same.
    """

    def __init__(self, lsl: Any, info: Any, stated: Stated, *, is_markers: bool = False) -> None:
        self._lsl = lsl
        self.name: str = info.name()
        self.host: str = info.hostname()
        self.offset = ClockOffset()
        self.measures = True
        self._uid: str = info.uid()
        self._inlet: Any = self._connected(info)
        try:
            described = self._inlet.info(ANSWER_S)
        except (lsl.util.TimeoutError, lsl.util.LostError) as error:
            raise ConnectionError(f"stream {self.name!r} does not send its description") from error
        self._stated, self._is_markers = stated, is_markers
        self._described = read_description(described, stated, is_markers=is_markers)
        self.axes, self.plates = self._described.axes, self._described.plates
        self.description = self._described.stream
        self._returning: Future[tuple[Any, str, float] | None] | None = None
        self._heard_s = time.monotonic()
        self._take(MAX_SAMPLES)

    def _take(self, count: int) -> None:
        """Take so many samples at once."""
        self._most = count
        shape = count, len(self._described.channels)
        self._buffer = np.empty(shape, self._inlet.np_dtype)

    def _connected(self, info: Any) -> Any:
        return self._lsl.StreamInlet(info, max_buflen=BUFFER_S, recover=False)

    def open(self) -> None:
        """Begin to receive."""
        try:
            self._inlet.open_stream(ANSWER_S)
        except (self._lsl.util.TimeoutError, self._lsl.util.LostError) as error:
            raise ConnectionError(f"stream {self.name!r} sends nothing") from error
        self._heard_s = time.monotonic()

    def find_rate(self) -> None:
        """Find the sampling rate from time stamps where the sender does not state it."""
        if self.description.rate_hz <= 0:
            self.description = replace(self.description, rate_hz=self._measured_rate())
        if self._inlet is not None:
            self._take(self._chunk)

    @property
    def _chunk(self) -> int:
        return max(1, round(CHUNK_S * self.description.rate_hz))

    def _measured_rate(self) -> float:
        stamps = np.empty(0)
        deadline = time.monotonic() + RATE_TIMEOUT_S
        while len(stamps) < 2 or np.ptp(stamps) < RATE_S:
            samples = self.pull(POLL_S)
            stamps = np.append(stamps, samples.time) if samples else stamps
            if time.monotonic() > deadline:
                raise ConnectionError(
                    f"stream {self.name!r} states no sampling rate, and sends too little within "
                    f"{RATE_TIMEOUT_S:g} s to find it"
                )
        return find_clock(stamps, 0.0).rate_hz

    def measure(self) -> None:
        """Compare the sender's clock with this computer's, if that is possible now."""
        try:
            offset = self._inlet.time_correction(0.0)
        except (self._lsl.util.TimeoutError, self._lsl.util.LostError):
            return
        self.offset.measure(self._lsl.local_clock(), offset)

    def pull(self, wait_s: float) -> Samples | None:
        """Give what has arrived; wait for the first sample if nothing has."""
        if self._inlet is None:
            time.sleep(wait_s)
            return None
        if self.measures and self.offset.due(self._lsl.local_clock()):
            self.measure()
        try:
            values, stamps = self._inlet.pull_chunk(
                wait_s, self._most, self._buffer, min_samples=1, as_numpy=True
            )
        except self._lsl.util.LostError:
            self._inlet = None
            return None
        if not len(stamps):
            return None
        self._heard_s = time.monotonic()
        return Samples(self.name, self.offset.local(stamps), self._described.convert(known(values)))

    @property
    def away(self) -> bool:
        """Whether its connection is lost, or nothing has arrived for a second."""
        return self._inlet is None or time.monotonic() - self._heard_s > SILENT_S

    def take_up(self, there: Sequence[Any], workers: Executor) -> None:
        """Connect anew while it is away; a worker waits for answers.

        Parameters
        ----------
        there
            The streams of its name that can be found now.
        workers
            Where to wait.

        Raises
        ------
        ValueError
            It is back with another description.
        """
        if self._returning is not None:
            if self._returning.done():
                returning, self._returning = self._returning, None
                self._resume(returning.result())
            return
        others = [info for info in there if info.uid() != self._uid]
        if self._inlet is not None:
            if not others or len(others) < len(there):
                return  # the sender is there and sends nothing
            ended, self._inlet = [self._inlet], None
            workers.submit(ended.clear)  # to end it takes the library half a second
        if there:
            newest = max(others or there, key=lambda info: info.created_at())
            self._returning = workers.submit(self._confirmed, newest)

    def _confirmed(self, info: Any) -> tuple[Any, str, float] | None:
        """Connect to a stream that is described as before.

        Gives the connection, the sender's identity and its clock's offset; None if it does not
        answer. A ValueError says what is described otherwise.
        """
        try:
            inlet = self._connected(info)
            self._require_same(inlet.info(RETURN_S))
            offset = inlet.time_correction(RETURN_S)
            inlet.open_stream(RETURN_S)
        except RuntimeError:  # of the library, whatever is wrong
            return None
        return inlet, info.uid(), offset

    def _require_same(self, info: Any) -> None:
        try:
            described = read_description(info, self._stated, is_markers=self._is_markers)
            change = described.change_from(self._described)
        except ValueError as error:
            change = f"a description that cannot be used ({error})"
        if change:
            raise came_back(f"stream {short(self.name)!r}", change)

    def _resume(self, returned: tuple[Any, str, float] | None) -> None:
        """Receive from the sender that is back, unless it is gone again."""
        if returned is None:
            return
        self._inlet, self._uid, offset = returned
        if abs(offset - self.offset.value_s) > SAME_CLOCK_S:  # its computer was started anew
            self.offset, self.measures = ClockOffset(), True
            self.offset.measure(self._lsl.local_clock(), offset)
        self._heard_s = time.monotonic()
        self._take(self._chunk)

    def close(self) -> None:
        """Stop receiving."""
        if self._inlet is not None:
            self._inlet.close_stream()
            self._inlet = None


def await_clocks(inlets: Sequence[Inlet]) -> None:
    """Wait until all senders' clocks are known."""
    deadline = time.monotonic() + ANSWER_S
    while unknown := [inlet for inlet in inlets if not inlet.offset.known]:
        if time.monotonic() > deadline:
            raise ConnectionError(
                f"stream {unknown[0].name!r}: its clock does not answer within {ANSWER_S:g} s; "
                "are its UDP ports, 16572 to 16604, open?"
            )
        for inlet in unknown:
            inlet.measure()
        time.sleep(POLL_S / 4)


def share_clocks(inlets: Sequence[Inlet]) -> None:
    """Let streams of one computer have one offset, and those of this computer none."""
    own = ClockOffset()
    clocks = [(socket.gethostname(), own)]
    for inlet in inlets:
        for host, offset in clocks:
            if host == inlet.host and abs(offset.value_s - inlet.offset.value_s) < SAME_CLOCK_S:
                inlet.offset, inlet.measures = offset, False
                break
        else:
            clocks.append((inlet.host, inlet.offset))
