"""One stream of Lab Streaming Layer as it is received."""

import socket
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from hbm.spelling import printable, short
from pipeline.io.stated import Stated
from pipeline.io.xdf.channels import parse_channels
from pipeline.io.xdf.clock import find_clock
from pipeline.live.sources.clock_offset import ClockOffset
from pipeline.live.sources.description import (
    describe_markers,
    describe_plates,
    describe_signals,
)
from pipeline.live.stream import Samples

CHUNK_S: Final = 0.05
"""Time whose samples are taken from a stream at once: after a pause, no stream runs ahead."""
MAX_SAMPLES: Final = 1024
"""Taken at once of a stream whose rate is not known yet."""
BUFFER_S: Final = 10
"""Kept by the library for a receiver that is busy."""
ANSWER_S: Final = 10.0
"""Left to a stream that was found to describe itself, to compare clocks and to send."""
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
    """

    def __init__(self, lsl: Any, info: Any, stated: Stated, *, is_markers: bool = False) -> None:
        self._lsl = lsl
        self.name: str = info.name()
        self.host: str = info.hostname()
        self.offset = ClockOffset()
        self.measures = True
        self._inlet: Any = self._connected(info)
        try:
            described = self._inlet.info(ANSWER_S)
        except (lsl.util.TimeoutError, lsl.util.LostError) as error:
            raise ConnectionError(f"stream {self.name!r} does not send its description") from error
        try:
            root = ElementTree.fromstring(described.as_xml())
            if (root.findtext("channel_format") or "") == "string":
                raise ValueError("it sends text, not numbers")
            written = printable((root.findtext("desc/axes") or "").strip())
            self.axes = stated.axes or written or None
            channels = parse_channels(root, described.channel_count())
            what = self.name, channels, float(described.nominal_srate())
            self.description, self._convert = (
                describe_markers(*what, stated, written)
                if is_markers
                else describe_signals(*what, stated.axes or "")
            )
            self.plates = () if is_markers else describe_plates(root, channels, stated.axes or "")
        except ValueError as error:
            raise ValueError(f"stream {short(self.name)!r}: {error}") from error
        self._channels = described.channel_count()
        self._take(MAX_SAMPLES)

    def _take(self, count: int) -> None:
        """Take so many samples at once."""
        self._most = count
        self._buffer = np.empty((count, self._channels), self._inlet.np_dtype)

    def _connected(self, info: Any) -> Any:
        self._uid: str = info.uid()
        return self._lsl.StreamInlet(info, max_buflen=BUFFER_S, recover=True)

    def open(self) -> None:
        """Begin to receive."""
        try:
            self._inlet.open_stream(ANSWER_S)
        except (self._lsl.util.TimeoutError, self._lsl.util.LostError) as error:
            raise ConnectionError(f"stream {self.name!r} sends nothing") from error

    def find_rate(self) -> None:
        """Find the sampling rate from time stamps where the sender does not state it."""
        if self.description.rate_hz <= 0:
            self.description = replace(self.description, rate_hz=self._measured_rate())
        self._take(max(1, round(CHUNK_S * self.description.rate_hz)))

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
        return Samples(self.name, self.offset.local(stamps), self._convert(values))

    @property
    def lost(self) -> bool:
        """Whether nothing can arrive until the stream is connected anew."""
        return self._inlet is None

    def reconnect(self, there: Sequence[Any]) -> None:
        """Connect to a stream of the same name and size, but not to the one that was lost."""
        for info in there:
            same = info.name() == self.name and info.channel_count() == self._channels
            if same and info.uid() != self._uid:
                self._inlet = self._connected(info)
                return

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
