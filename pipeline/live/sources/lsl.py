"""Streams of Lab Streaming Layer."""

import socket
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from hbm.spelling import listed, printable, short
from pipeline.io.stated import Stated
from pipeline.io.xdf.channels import parse_channels
from pipeline.io.xdf.clock import find_clock
from pipeline.live.network import LOOPBACK, load_lsl
from pipeline.live.sources.clock_offset import ClockOffset
from pipeline.live.sources.description import describe_markers, describe_signals
from pipeline.live.stream import Samples, StreamDescription

MAX_SAMPLES: Final = 1024
"""Taken from a stream at once; what else has arrived follows with the next call."""
BUFFER_S: Final = 10
"""Kept by the library for a receiver that is busy."""
WAIT_S: Final = 0.001
"""Between looks at the streams; the fastest is waited for."""
ANSWER_S: Final = 10.0
"""Left to a stream that was found to describe itself, to compare clocks and to send."""
SAME_CLOCK_S: Final = 0.05
"""Offsets of one clock differ by less; those of computers of the same name, by hours."""
SETTLE_S: Final = 0.75
"""Within it every stream answers, also others of the same names: the library asks twice."""
RATE_S: Final = 1.0
"""Time whose samples show the rate of a stream that does not state it."""
RATE_TIMEOUT_S: Final = 3.0
POLL_S: Final = 0.02
"""Between looks at what is there, while streams are searched for."""


class LslSource:
    """Receives one stream of markers and any of other signals, found by their names.

    Parameters
    ----------
    markers
        Name of the stream of markers.
    analog
        Names of the others.
    stated
        What a person states about the streams: axes, units, labels to rename.
    listen
        Address of this computer at which streams are searched for.
    timeout_s
        How long they are searched for.

    Raises
    ------
    ValueError
        The extra is missing, a stream's description lacks something or contradicts itself, or
        several streams have one name. One line.
    ConnectionError
        A stream is not there within the timeout, or does not answer.

    Notes
    -----
    Time stamps are the senders', brought onto this computer's clock by the offset that the library
    measures every two seconds (`ClockOffset`). Streams of one computer share one offset, so that
    its scatter of some 10 µs shifts all of them alike; those of this computer need none. The
    library's own removal of jitter is not used: it assumes the nominal rate, needs minutes to
    settle, and moves samples around lost ones. Positions are in lab axes and m, forces in N,
    moments in N·m. A stream that states no rate, as that of Qualisys' own bridge, has the rate of
    its first second.

    A stream that goes away is searched for in the background and taken up again when it is back
    under the same name with the same channels; until then it sends nothing.
    """

    def __init__(
        self,
        markers: str,
        analog: Sequence[str] = (),
        *,
        stated: Stated | None = None,
        listen: str = LOOPBACK,
        timeout_s: float = 5.0,
    ) -> None:
        names = (markers, *analog)
        if len(set(names)) < len(names):
            raise ValueError(f"streams are named more than once: {listed(map(repr, names))}")
        lsl = load_lsl(listen)
        self._resolver = lsl.ContinuousResolver()
        self._sought_s = 0.0
        found = _find(self._resolver, names, timeout_s)
        stated = stated or Stated()
        first = _Inlet(lsl, found[0], stated, is_markers=True)
        known = replace(stated, axes=first.axes)
        self._inlets = [first, *(_Inlet(lsl, info, known) for info in found[1:])]
        _await_clocks(self._inlets)
        share_clocks(self._inlets)
        for inlet in self._inlets:
            inlet.open()
        for inlet in self._inlets:
            inlet.find_rate()
        self._fastest = max(self._inlets, key=lambda inlet: inlet.description.rate_hz)

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """What is received: markers first."""
        return tuple(inlet.description for inlet in self._inlets)

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give whatever has arrived; an empty list if nothing does within the timeout [s]."""
        deadline = time.monotonic() + timeout_s
        wait = 0.0
        while True:
            self._seek_lost()
            found = [
                samples
                for inlet in self._inlets
                if (samples := inlet.pull(wait if inlet is self._fastest else 0.0)) is not None
            ]
            remaining = deadline - time.monotonic()
            if found or remaining <= 0:
                return found
            wait = min(WAIT_S, remaining)

    def _seek_lost(self) -> None:
        """Take up again what is lost and cannot return by itself, if it is there."""
        if not any(inlet.lost for inlet in self._inlets) or time.monotonic() < self._sought_s:
            return
        self._sought_s = time.monotonic() + POLL_S
        there = self._resolver.results()
        for inlet in self._inlets:
            if inlet.lost:
                inlet.reconnect(there)

    def close(self) -> None:
        """Stop receiving."""
        for inlet in self._inlets:
            inlet.close()


class _Inlet:
    """One stream, with memory for what arrives."""

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
        except ValueError as error:
            raise ValueError(f"stream {short(self.name)!r}: {error}") from error
        self._channels = described.channel_count()
        self._buffer = np.empty((MAX_SAMPLES, self._channels), self._inlet.np_dtype)

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
        if self.description.rate_hz > 0:
            return
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
        self.description = replace(self.description, rate_hz=find_clock(stamps, 0.0).rate_hz)

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
                wait_s, MAX_SAMPLES, self._buffer, min_samples=1, as_numpy=True
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
        if self._inlet is not None:
            self._inlet.close_stream()
            self._inlet = None


def _find(resolver: Any, names: Sequence[str], timeout_s: float) -> list[Any]:
    """Give the streams of these names, once all are there and others had time to answer."""
    deadline = time.monotonic() + timeout_s
    settled = time.monotonic() + SETTLE_S
    while True:
        there: dict[str, list[Any]] = {}
        for info in resolver.results():
            there.setdefault(info.name(), []).append(info)
        if absent := [name for name in names if name not in there]:
            if time.monotonic() > deadline:
                raise ConnectionError(
                    f"no stream is called {listed(map(repr, absent))} within {timeout_s:g} s; "
                    f"streams there: {listed(map(repr, map(printable, there)))}"
                )
            time.sleep(POLL_S)
            continue
        if time.monotonic() < settled:
            time.sleep(POLL_S)
            continue
        if several := [name for name in names if len(there[name]) > 1]:
            raise ValueError(
                f"{len(there[several[0]])} streams are called {short(several[0])!r}; give each a "
                "name of its own"
            )
        return [there[name][0] for name in names]


def _await_clocks(inlets: Sequence[_Inlet]) -> None:
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


def share_clocks(inlets: Sequence[_Inlet]) -> None:
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
