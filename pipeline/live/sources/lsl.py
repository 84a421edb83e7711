"""Streams of Lab Streaming Layer."""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Final

from hbm.spelling import listed, printable, short
from pipeline.config.live import LOOPBACK
from pipeline.io.stated import Stated
from pipeline.live.network import load_lsl
from pipeline.live.sources.lsl_inlet import Inlet, await_clocks, share_clocks
from pipeline.live.stream import Samples, StatedPlate, StreamDescription

WAIT_S: Final = 0.001
"""Between looks at the streams; the fastest is waited for."""
SETTLE_S: Final = 0.75
"""Within it every stream answers, also others of the same names: the library asks twice."""
POLL_S: Final = 0.02
"""Between looks at what is there, while streams are searched for."""
SEEK_S: Final = 0.1
"""Between looks for a stream that is away."""
FORGET_S: Final = 2.0
"""After it, a stream that no longer answers is not among those that are there."""


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
    searching
        Called meanwhile, at every look, with the names that are missing and those that are there.

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
    under the same name; until then it sends nothing. Its description is read again before any
    sample is taken: if channels, units, axes, rate or plates are others, `receive` says so.
    """

    def __init__(
        self,
        markers: str,
        analog: Sequence[str] = (),
        *,
        stated: Stated | None = None,
        listen: str = LOOPBACK,
        timeout_s: float = 5.0,
        searching: Callable[[Sequence[str], Sequence[str]], object] | None = None,
    ) -> None:
        names = (markers, *analog)
        if len(set(names)) < len(names):
            raise ValueError(f"streams are named more than once: {listed(map(repr, names))}")
        lsl = load_lsl(listen)
        self._resolver = lsl.ContinuousResolver(forget_after=FORGET_S)
        self._sought_s = 0.0
        settled_s = time.monotonic() + SETTLE_S
        found = _find(self._resolver, names, timeout_s, searching)
        try:
            self._inlets = _described(lsl, found, stated or Stated())
            await_clocks(self._inlets)
        finally:  # a description that is wrong may be that of another stream of the same name
            time.sleep(max(0.0, settled_s - time.monotonic()))
            _require_unique(_by_name(self._resolver), names)
        share_clocks(self._inlets)
        for inlet in self._inlets:
            inlet.open()
        for inlet in self._inlets:
            inlet.find_rate()
        self._workers = ThreadPoolExecutor(len(self._inlets), thread_name_prefix="lsl")
        self._fastest = max(self._inlets, key=lambda inlet: inlet.description.rate_hz)

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """What is received: markers first."""
        return tuple(inlet.description for inlet in self._inlets)

    @property
    def plates(self) -> tuple[StatedPlate, ...]:
        """Plates as the streams describe them."""
        return tuple(plate for inlet in self._inlets for plate in inlet.plates)

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give what has arrived; an empty list if nothing does within the timeout [s].

        At most the samples of 50 ms of each stream; what else has arrived follows with the next
        call. A ValueError says that a stream came back with another description.
        """
        deadline = time.monotonic() + timeout_s
        wait = 0.0
        while True:
            self._seek()
            found = [
                samples
                for inlet in self._inlets
                if (samples := inlet.pull(wait if inlet is self._fastest else 0.0)) is not None
            ]
            remaining = deadline - time.monotonic()
            if found or remaining <= 0:
                return found
            wait = min(WAIT_S, remaining)

    def _seek(self) -> None:
        """Take up again what is away, if it is there."""
        away = [inlet for inlet in self._inlets if inlet.away]
        if not away or time.monotonic() < self._sought_s:
            return
        self._sought_s = time.monotonic() + SEEK_S
        there = _by_name(self._resolver)
        for inlet in away:
            inlet.take_up(there.get(inlet.name, []), self._workers)

    def close(self) -> None:
        """Stop receiving."""
        self._workers.shutdown(cancel_futures=True)
        for inlet in self._inlets:
            inlet.close()


def _find(
    resolver: Any,
    names: Sequence[str],
    timeout_s: float,
    searching: Callable[[Sequence[str], Sequence[str]], object] | None,
) -> list[Any]:
    """Give the streams of these names, once all are there.

    Of several of one name all but one may be those of a program that has ended just now.
    """
    deadline = time.monotonic() + timeout_s
    forgotten_s: float | None = None
    while True:
        there, now = _by_name(resolver), time.monotonic()
        absent = [name for name in names if name not in there]
        if not absent:
            forgotten_s = forgotten_s or now + FORGET_S
            if now > forgotten_s or all(len(there[name]) == 1 for name in names):
                return [there[name][0] for name in names]
        elif now > deadline:
            raise ConnectionError(
                f"no stream is called {listed(map(repr, absent))} within {timeout_s:g} s; "
                f"streams there: {listed(map(repr, map(printable, there)))}"
            )
        elif searching is not None:
            searching(absent, list(there))
        time.sleep(POLL_S)


def _described(lsl: Any, found: Sequence[Any], stated: Stated) -> list[Inlet]:
    """Connect to streams, markers first; their axes are those of all."""
    first = Inlet(lsl, found[0], stated, is_markers=True)
    return [first, *(Inlet(lsl, info, replace(stated, axes=first.axes)) for info in found[1:])]


def _require_unique(there: Mapping[str, Sequence[Any]], names: Sequence[str]) -> None:
    if several := [name for name in names if len(there.get(name, [])) > 1]:
        raise ValueError(
            f"{len(there[several[0]])} streams are called {short(several[0])!r}; close all but one "
            "of the programs that send them, or give each stream a name of its own and state it "
            "in [live] of study.toml (markers, analog)"
        )


def _by_name(resolver: Any) -> dict[str, list[Any]]:
    there: dict[str, list[Any]] = {}
    for info in resolver.results():
        there.setdefault(info.name(), []).append(info)
    return there
