"""Recordings played by Lab Streaming Layer."""

import threading
import time as clock
from collections.abc import Callable
from typing import Final

import numpy as np

from pipeline.config.live import LOOPBACK
from pipeline.io.recording import Recording
from pipeline.live.network import load_lsl
from pipeline.live.outlet import Outlet
from pipeline.live.sources.recorded import recorded_streams
from pipeline.live.stream import LAB_AXES

TICK_S: Final = 0.001
"""Between looks at what is due."""
DELIVERY_S: Final = 0.5
"""Left to receivers after the last sample."""
OTHERS_S: Final = 1.0
"""Left to receivers of the other streams once the markers have one: not everybody wants all."""
MAX_SPEED: Final = 20.0
"""Beyond it the library loses samples; `RecordedSource` needs no network and loses none."""


class Replay:
    """Plays a recording by Lab Streaming Layer, on a thread of its own.

    Parameters
    ----------
    recording
        The recording.
    speed
        How many times faster than it was recorded. Time stamps keep the recording's own
        intervals whatever the speed.
    prefix
        Before the names of its streams, so that several replays can be told apart.
    listen
        As for `pipeline.live.network.load_lsl`, with its errors.

    Raises
    ------
    ValueError
        The speed is not above 0 and at most 20.
    """

    def __init__(
        self,
        recording: Recording,
        speed: float = 1.0,
        *,
        prefix: str = "",
        listen: str = LOOPBACK,
    ) -> None:
        if not 0 < speed <= MAX_SPEED:
            raise ValueError(f"speed must be above 0 and at most {MAX_SPEED:g}, got {speed:g}")
        self._now: Callable[[], float] = load_lsl(listen).local_clock
        self._streams = recorded_streams(recording)
        self._prefix, self._speed = prefix, speed
        self._outlets = [
            Outlet(
                name,
                stream.content_type,
                stream.channels,
                stream.description.rate_hz,
                parts=[("axes", LAB_AXES)] if stream.description.kind == "markers" else [],
                plates=stream.plates,
                listen=listen,
            )
            for name, stream in zip(self.names, self._streams, strict=True)
        ]
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._play, name="replay", daemon=True)
        self.start_s = float("nan")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the streams that are sent: markers first."""
        return tuple(self._prefix + stream.description.name for stream in self._streams)

    @property
    def without_receiver(self) -> tuple[str, ...]:
        """Names of the streams that nobody receives now."""
        each = zip(self.names, self._outlets, strict=True)
        return tuple(name for name, outlet in each if not outlet.has_receivers)

    @property
    def ended(self) -> bool:
        """Whether the last sample was sent and receivers had time to take it."""
        return self._thread.ident is not None and not self._thread.is_alive()

    def start(self, timeout_s: float = 0.0) -> bool:
        """Begin to play once every stream has a receiver, or after the timeout.

        Streams that nobody has taken a second after the markers are not waited for.

        Returns
        -------
        bool
            Whether every stream had one.
        """
        deadline = clock.monotonic() + timeout_s
        found = False
        while (absent := self.without_receiver) and clock.monotonic() < deadline:
            if not found and self.names[0] not in absent:
                found, deadline = True, min(deadline, clock.monotonic() + OTHERS_S)
            clock.sleep(TICK_S * 5)
        self._thread.start()
        return not absent

    def close(self) -> None:
        """Stop playing and sending."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        for outlet in self._outlets:
            outlet.close()

    def _play(self) -> None:
        first = min(float(stream.time[0]) for stream in self._streams)
        begun = clock.monotonic()
        self.start_s = self._now() - first
        sent = [0] * len(self._streams)
        while not self._stop.is_set():
            until = first + (clock.monotonic() - begun) * self._speed
            for k, (stream, outlet) in enumerate(zip(self._streams, self._outlets, strict=True)):
                stop = int(np.searchsorted(stream.time, until, "right"))
                if stop > sent[k]:
                    part = slice(sent[k], stop)
                    outlet.push(stream.time[part] + self.start_s, stream.values[part])
                    sent[k] = stop
            if all(n == len(stream.time) for n, stream in zip(sent, self._streams, strict=True)):
                self._stop.wait(DELIVERY_S)
                return
            self._stop.wait(TICK_S)
