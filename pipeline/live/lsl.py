"""Streams of Lab Streaming Layer."""

import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from hbm.spelling import listed, printable, short
from pipeline.config.live import LOOPBACK
from pipeline.io.read_options import ReadOptions
from pipeline.io.streams import Channel, find_clock, parse_channels, parse_xml, text_of
from pipeline.live.output import load_lsl
from pipeline.live.stream import (
    Convert,
    DescribedPlate,
    Samples,
    StreamDescription,
    describe_markers,
    describe_plates,
    describe_signals,
    require_same,
)


class ClockOffset:
    """How far this computer's clock is ahead of a sender's, from measurements that scatter.

    The median of the last five: two wrong ones, which a busy network makes by a millisecond and
    more, have no effect, a clock that drifts by 20 ppm is followed 0.2 ms late, and one that was
    set anew from the third measurement on.

    Examples
    --------
    >>> offset = ClockOffset()
    >>> offset.measure(100.0, 5.0)
    >>> offset.value_s, offset.due(101.0), offset.due(103.0)
    (5.0, False, True)
    """

    def __init__(self) -> None:
        self.value_s = 0.0
        self._measured = deque[float](maxlen=5)
        self._looked_s = -np.inf

    @property
    def known(self) -> bool:
        """Whether there was a measurement."""
        return bool(self._measured)

    def due(self, now: float) -> bool:
        """Whether it is time for a measurement."""
        # the library measures every two to three seconds, and each measurement counts once
        return not self.known or now - self._looked_s >= 3.0

    def measure(self, now: float, offset_s: float) -> None:
        """Take a measurement at a time [s] of this computer's clock."""
        self._looked_s = now
        self._measured.append(offset_s)
        self.value_s = float(np.median(self._measured))


class LslDescription(NamedTuple):
    """A stream as its sender and a person describe it.

    It has the channels as the sender describes them; the markers' axes, those that a person states,
    else the sender's, None where they are not known; what is received; and what turns samples as
    sent to those that are received.
    """

    channels: tuple[Channel, ...]
    axes: str | None
    stream: StreamDescription
    plates: tuple[DescribedPlate, ...]
    convert: Convert


def read_description(info: Any, options: ReadOptions, *, is_markers: bool) -> LslDescription:
    """Read the description of a stream, ``pylsl.StreamInfo``, as it is sent and as a person has it.

    A ValueError says that it lacks something or contradicts itself.
    """
    name = info.name()
    try:
        root = parse_xml(info.as_xml())
        if (root.findtext("channel_format") or "") == "string":
            raise ValueError("it sends text, not numbers")
        channels = parse_channels(root, info.channel_count())
        what = name, channels, float(info.nominal_srate())
        if not is_markers:
            stream, convert = describe_signals(*what, options.axes or "")
            plates = describe_plates(root, channels, options.axes or "")
            return LslDescription(channels, options.axes, stream, plates, convert)
        written = text_of(root, "desc/axes")
        stream, convert = describe_markers(*what, options, written)
        return LslDescription(channels, options.axes or written or None, stream, (), convert)
    except ValueError as error:
        raise ValueError(f"stream {short(name)!r}: {error}") from error


def require_like(before: LslDescription, after: LslDescription) -> None:
    """Refuse a sender that is back where what numbers depend on is not as before."""
    names = "description of its channels", "statement of its axes", "rate"
    parts = zip(*((d.channels, d.axes, d.stream.rate_hz) for d in (before, after)), strict=True)
    described = dict(zip(names, parts, strict=True))
    sender = f"stream {short(before.stream.name)!r}"
    require_same(sender, described, before.plates, after.plates)


SAME_CLOCK_S: Final = 0.05
"""Offsets of one clock differ by less; that of a computer that was started anew, by hours."""
POLL_S: Final = 0.02
"""Between looks at what is there, while streams are searched for."""


class Inlet:
    """One connection to a stream.

    A connection that is lost stays lost: the library's own recovery takes a sender that comes back
    for the same, whatever it sends, so that samples of other channels would arrive unnoticed. A
    ValueError says that a description lacks something or contradicts itself, a ConnectionError that
    the sender does not answer in time: describe itself, compare clocks and send.
    """

    def __init__(
        self, lsl: Any, info: Any, options: ReadOptions, is_markers: bool, answer_s: float = 10.0
    ) -> None:
        self._lsl, self._answer_s = lsl, answer_s
        self.options, self.is_markers = options, is_markers
        self.name: str = info.name()
        self.uid: str = info.uid()
        self.identity, self.offset = _identity(info), ClockOffset()
        self._is_here: bool = info.hostname() == socket.gethostname()
        # ten seconds are kept for a receiver that is busy
        self._inlet: Any = lsl.StreamInlet(info, max_buflen=10, recover=False)
        self.lost, self._heard_s = False, time.monotonic()
        self._refusals = lsl.util.TimeoutError, lsl.util.LostError
        try:
            described = self._inlet.info(answer_s)
        except self._refusals as error:
            raise ConnectionError(f"stream {self.name!r} does not send its description") from error
        self.described = read_description(described, options, is_markers=is_markers)
        self.description = replace(self.described.stream, sender=printable(info.hostname()))
        self.measure()

    def open(self) -> None:
        """Wait until the sender's clock is known, and begin to receive."""
        deadline = time.monotonic() + self._answer_s
        while not self.offset.known:
            if time.monotonic() > deadline:
                raise ConnectionError(
                    f"stream {self.name!r}: its clock does not answer within {self._answer_s:g} s; "
                    "are its UDP ports, 16572 to 16604, open?"
                )
            time.sleep(POLL_S / 4)
            self.measure()
        try:
            self._inlet.open_stream(self._answer_s)
        except self._refusals as error:
            raise ConnectionError(f"stream {self.name!r} sends nothing") from error
        self._heard_s = time.monotonic()

    def find_rate(self) -> None:
        """Find the sampling rate from time stamps where the sender does not state it."""
        timeout_s = 3.0
        stamps, deadline = np.empty(0), time.monotonic() + timeout_s
        while self.description.rate_hz <= 0:
            samples = self.pull(POLL_S)
            stamps = np.append(stamps, samples.time) if samples else stamps
            # over a second, jitter of stamps by milliseconds changes a rate by some per mille
            if len(stamps) > 1 and np.ptp(stamps) >= 1.0:
                rate_hz = find_clock(stamps, 0.0).rate_hz
                self.description = replace(self.description, rate_hz=rate_hz)
            elif time.monotonic() > deadline:
                raise ConnectionError(
                    f"stream {self.name!r} states no rate, and its time stamps of "
                    f"{timeout_s:g} s do not show it"
                )

    def measure(self) -> None:
        """Compare the sender's clock with this computer's, if that is possible now."""
        try:
            offset = self._inlet.time_correction(0.0)
        except self._refusals:
            return
        # streams of this computer have its clock: what is measured of them is jitter
        if self._is_here and abs(offset) < SAME_CLOCK_S:
            offset = 0.0
        self.offset.measure(self._lsl.local_clock(), offset)

    def pull(self, wait_s: float) -> Samples | None:
        """Give what has arrived; wait for the first sample if nothing has."""
        if self.lost:
            time.sleep(wait_s)
            return None
        if self.offset.due(self._lsl.local_clock()):
            self.measure()
        # samples of 50 ms at once: after a pause, no stream runs ahead of the others
        rate_hz = self.description.rate_hz
        most = max(1, round(0.05 * rate_hz)) if rate_hz > 0 else 1024
        try:
            values, stamps = self._inlet.pull_chunk(wait_s, most, min_samples=1, as_numpy=True)
        except self._lsl.util.LostError:
            self.lost = True
            return None
        if not len(stamps):
            return None
        self._heard_s = time.monotonic()
        return Samples(self.name, stamps + self.offset.value_s, self.described.convert(values))

    @property
    def away(self) -> bool:
        """Whether its connection is lost, or nothing has arrived for a second."""
        return self.lost or time.monotonic() - self._heard_s > 1.0

    def again(self, info: Any) -> "Inlet | None":
        """Connect to a stream that is described as this one; None if it does not answer in time.

        A ValueError says what is described otherwise.
        """
        self.close()
        try:
            # two seconds to answer, after which it is tried anew
            back = Inlet(self._lsl, info, self.options, self.is_markers, 2.0)
            require_like(self.described, back.described)
            back.description = replace(back.description, rate_hz=self.description.rate_hz)
            back.open()
        except (ConnectionError, RuntimeError):  # of the library, whatever is wrong
            return None
        if abs(back.offset.value_s - self.offset.value_s) < SAME_CLOCK_S:
            back.offset = self.offset  # its computer was not started anew
        return back

    def close(self) -> None:
        """Stop receiving; of a sender that hangs, that takes the library half a second."""
        self.lost, self._inlet = True, None


FORGET_S, ANSWERS_S = 2.0, 0.75
"""After the first, a stream that no longer answers is not among those that are there. Within the
second all answer, also others of one name: the library asks twice."""


Searching = Callable[[Sequence[str], Sequence[str]], object]
"""Takes the names that are missing and those that are there."""


class LslSource:
    """Receives one stream of markers and any of other signals, found by their names.

    Parameters
    ----------
    markers
        Name of the stream of markers.
    analog
        Names of the others.
    options
        What a person states about the streams: axes, units, labels to rename.
    listen
        Address of this computer at which streams are searched for.
    timeout_s
        How long they are searched for.
    searching
        Called meanwhile, at every look, with the names that are missing and those that are there.
    senders
        Of several streams of one name, those of these computers, or with these identities, are
        received.

    Raises
    ------
    ValueError
        The extra is missing, a stream's description lacks something or contradicts itself, or
        several streams of one name match. One line.
    ConnectionError
        A stream is not there within the timeout, or does not answer.

    Notes
    -----
    Time stamps are the senders', brought onto this computer's clock by the offset that the library
    measures every two seconds (`ClockOffset`). The library's own removal of jitter is not used: it
    assumes the nominal rate, needs minutes to settle, and moves samples around lost ones. A stream
    that states no rate, as that of Qualisys' own bridge, has the rate of its first second.

    A stream that goes away is searched for in the background and taken up again when it is back
    under the same name, from the same sender where one was chosen; until then it sends nothing. Its
    description is read again before any sample is taken: if channels, units, axes, rate or plates
    are others, `receive` says so.
    """

    def __init__(
        self,
        markers: str,
        analog: Sequence[str] = (),
        *,
        options: ReadOptions | None = None,
        listen: str = LOOPBACK,
        timeout_s: float = 5.0,
        searching: Searching = lambda absent, there: None,
        senders: Sequence[str] = (),
    ) -> None:
        names, lsl, options = (markers, *analog), load_lsl(listen), options or ReadOptions()
        if len(set(names)) < len(names):
            raise ValueError(f"streams are named more than once: {listed(map(repr, names))}")
        self._resolver, self._sought_s = lsl.ContinuousResolver(forget_after=FORGET_S), 0.0
        self._chosen: dict[str, Any] = {}
        of_markers, *others = self._find(names, timeout_s, searching, senders)
        first = Inlet(lsl, of_markers, options, is_markers=True)
        # places of plates are in the markers' axes
        of_all = replace(options, axes=first.described.axes)
        self._inlets = [first, *(Inlet(lsl, info, of_all, is_markers=False) for info in others)]
        for inlet in self._inlets:
            inlet.open()
        for inlet in self._inlets:
            inlet.find_rate()
        self._workers = ThreadPoolExecutor(len(self._inlets), thread_name_prefix="lsl")
        self._returning: dict[int, Future[Inlet | None]] = {}
        rates_hz = [stream.rate_hz for stream in self.streams]
        self._fastest = rates_hz.index(max(rates_hz))

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """What is received: markers first."""
        return tuple(inlet.description for inlet in self._inlets)

    @property
    def plates(self) -> tuple[DescribedPlate, ...]:
        """Plates as the streams describe them."""
        return tuple(plate for inlet in self._inlets for plate in inlet.described.plates)

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give what has arrived; an empty list if nothing does within the timeout [s].

        At most the samples of 50 ms of each stream; what else has arrived follows with the next
        call. A ValueError says that a stream came back with another description.
        """
        deadline, wait = time.monotonic() + timeout_s, 0.0
        while True:
            self._seek()
            waits = [wait * (k == self._fastest) for k in range(len(self._inlets))]
            pulled = map(Inlet.pull, self._inlets, waits)
            received = [samples for samples in pulled if samples is not None]
            remaining = deadline - time.monotonic()
            if received or remaining <= 0:
                return received
            wait = min(0.001, remaining)  # for the fastest stream

    def _find(
        self, names: Sequence[str], timeout_s: float, searching: Searching, senders: Sequence[str]
    ) -> list[Any]:
        """Give the streams of these names, once all are there.

        Of several of one name all but one may be those of a program that has ended just now.
        """
        begun_s, complete_s = time.monotonic(), np.inf
        while True:
            there, now_s = _by_name(self._resolver), time.monotonic()
            absent = [name for name in names if name not in there]
            several = [name for name in names if len(there.get(name, [])) > 1]
            if absent and now_s - begun_s > timeout_s:
                raise ConnectionError(
                    f"no stream is called {listed(map(repr, absent))} within {timeout_s:g} s; "
                    f"streams there: {listed(map(repr, map(printable, there)))}"
                )
            complete_s = np.inf if absent else min(complete_s, now_s if several else np.inf)
            if absent:
                searching(absent, list(there))
            if several and now_s - complete_s > FORGET_S:
                self._chosen = {name: _choose(name, there[name], senders) for name in several}
            elif absent or several or now_s - begun_s <= ANSWERS_S:
                time.sleep(POLL_S)
                continue
            return [self._chosen.get(name, there[name][0]) for name in names]

    def _seek(self) -> None:
        """Take up again what is away, if it is there; a worker waits for answers.

        A sender that hangs is left for another one of its name, once it is not found any more.
        """
        away = [k for k, inlet in enumerate(self._inlets) if inlet.away]
        if not away or time.monotonic() < self._sought_s:
            return
        self._sought_s, by_name = time.monotonic() + 0.1, _by_name(self._resolver)
        for k in away:
            inlet = self._inlets[k]
            there = by_name.get(inlet.name, [])
            if inlet.name in self._chosen:
                there = [info for info in there if _identity(info) == inlet.identity]
            # every outlet has an identity of its own: a sender that is back has another one
            others = [info for info in there if info.uid() != inlet.uid]
            if k in self._returning:
                if self._returning[k].done():
                    self._inlets[k] = self._returning.pop(k).result() or inlet
            elif there and (inlet.lost or len(others) == len(there)):
                inlet.lost = True
                newest = max(others or there, key=lambda info: info.created_at())
                self._returning[k] = self._workers.submit(inlet.again, newest)

    def close(self) -> None:
        """Stop receiving."""
        self._workers.shutdown(cancel_futures=True)
        for inlet in self._inlets:
            inlet.close()


def _choose(name: str, there: Sequence[Any], senders: Sequence[str]) -> Any:
    """Give the stream of a name that is from one of the senders; a ValueError lists several."""
    matching = [info for info in there if set(_identity(info)) & set(senders)] or list(there)
    if len(matching) == 1:
        return matching[0]
    shown = [f"{short(host)} ({short(source)})" for host, source in map(_identity, matching)]
    raise ValueError(
        f"{len(matching)} streams are called {short(name)!r}: from {', '.join(shown)}; choose one: "
        "--sender COMPUTER, or its identity in brackets"
    )


def _identity(info: Any) -> tuple[str, str]:
    """Give the computer that sends a stream, and the identity that the sender gives it."""
    return info.hostname(), info.source_id()


def _by_name(resolver: Any) -> dict[str, list[Any]]:
    there = dict[str, list[Any]]()
    for info in resolver.results():
        there.setdefault(info.name(), []).append(info)
    return there
