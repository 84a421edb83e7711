"""Samples as they enter a session: on a clock that goes on, and numbers that can be."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.live.stream import Samples, StreamDescription

LARGEST: Final = 1e9
"""No signal is as large in any unit: such a number is damaged."""
MAX_BACK_S: Final = 0.5
"""Samples that are farther back than this are not out of order, their clock was set."""
MAX_AHEAD_S: Final = 1.0
"""The same for samples ahead of the time that has passed and of all other streams."""
CONFIRMED_S: Final = 0.05
"""Of samples that follow each other on another clock; fewer have wrong time stamps."""
MIN_CONFIRMED: Final = 3
SAME_CLOCK_S: Final = 0.05
"""Streams whose clocks were set by amounts that differ by less were set together."""


def known(values: Array) -> Array:
    """Give samples with NaN in place of numbers that no instrument gives."""
    return np.where(np.abs(values) < LARGEST, values, np.nan)


@dataclass(slots=True, eq=False)
class _Clock:
    """One stream's: what is added to its time stamps, its newest time, and samples in doubt."""

    rate_hz: float
    added_s: float = 0.0
    newest_s: float | None = None
    heard_s: float = 0.0
    doubtful: list[tuple[float, Array]] = field(default_factory=list)


class Arrivals:
    """Brings the samples of each stream onto a clock that goes on where the sender sets its own.

    Parameters
    ----------
    streams
        What is received.

    Notes
    -----
    The first sample after the clock was set follows the last one before it by one sampling
    interval, or, after a pause, it is as late as the newest sample of another stream. Streams of
    one sender are moved alike, so that they stay together.

    Examples
    --------
    >>> heels = StreamDescription("Markers", "markers", ("LHEE",), ("m",), 100.0)
    >>> arrivals, values = Arrivals([heels]), np.zeros((5, 3))
    >>> before = arrivals.take(Samples("Markers", 10 + np.arange(5) / 100, values), 0.0)
    >>> after = arrivals.take(Samples("Markers", 2 + np.arange(5) / 100, values), 0.05)
    >>> after.time.round(3).tolist(), round(after.clock_set_s, 3)
    ([10.05, 10.06, 10.07, 10.08, 10.09], -8.05)
    """

    def __init__(self, streams: Sequence[StreamDescription]) -> None:
        self._clocks = {stream.name: _Clock(stream.rate_hz) for stream in streams}

    def take(self, samples: Samples, arrived_s: float) -> Samples:
        """Take what arrived of a stream at a time of this computer [s]; give it as it counts.

        Samples without a time are left out. Those that are in doubt are kept until others confirm
        them; if none do, they are left out too.
        """
        timed = np.isfinite(samples.time)
        stamps, values = samples.time[timed], known(samples.values[timed])
        clock = self._clocks.get(samples.stream)
        if clock is None or not len(stamps):
            return replace(samples, time=stamps, values=values)
        passed_s, clock.heard_s = arrived_s - clock.heard_s, arrived_s
        time = stamps + clock.added_s
        if clock.newest_s is None:
            clock.newest_s = float(time[0])
        latest_s = MAX_AHEAD_S + max(clock.newest_s + passed_s, self._newest_s(samples.stream))
        usual = (time > clock.newest_s - MAX_BACK_S) & (time < latest_s)
        if usual.all() and not clock.doubtful:
            clock.newest_s = max(clock.newest_s, float(time.max()))
            return replace(samples, time=time, values=values)
        return self._sorted_out(replace(samples, time=stamps, values=values), clock, latest_s)

    def _sorted_out(self, samples: Samples, clock: _Clock, latest_s: float) -> Samples:
        """Take samples one by one, some of which may be on another clock."""
        taken: list[tuple[float, Array]] = []
        before_s = clock.added_s
        assert clock.newest_s is not None
        for stamp, value in zip(samples.time.tolist(), samples.values, strict=True):
            time = stamp + clock.added_s
            if clock.newest_s - MAX_BACK_S < time < latest_s:
                clock.doubtful.clear()
                clock.newest_s = max(clock.newest_s, time)
                taken.append((time, value))
                continue
            if clock.doubtful and not 0 < stamp - clock.doubtful[-1][0] < MAX_BACK_S:
                clock.doubtful.clear()
            clock.doubtful.append((stamp, value))
            if len(clock.doubtful) >= max(MIN_CONFIRMED, CONFIRMED_S * clock.rate_hz):
                self._set(samples.stream, clock)
                taken += [(s + clock.added_s, each) for s, each in clock.doubtful]
                clock.newest_s = taken[-1][0]
                latest_s = clock.newest_s + MAX_AHEAD_S
                clock.doubtful.clear()
        values = np.array([value for _, value in taken]).reshape(-1, samples.values.shape[1])
        times = np.array([time for time, _ in taken])
        return Samples(samples.stream, times, values, before_s - clock.added_s)

    def _set(self, stream: str, clock: _Clock) -> None:
        """Find what has to be added to the time stamps of a stream whose clock was set."""
        assert clock.newest_s is not None
        begins_s = clock.doubtful[0][0]
        next_s = clock.newest_s + (1 / clock.rate_hz if clock.rate_hz > 0 else 0.0)
        others = {0.0, *(other.added_s for other in self._clocks.values() if other is not clock)}
        near = min(others, key=lambda added_s: abs(begins_s + added_s - next_s))
        if abs(begins_s + near - next_s) < SAME_CLOCK_S:
            clock.added_s = near
            return
        others_s = self._newest_s(stream)
        clock.added_s = (others_s if others_s > next_s + MAX_BACK_S else next_s) - begins_s

    def _newest_s(self, stream: str) -> float:
        others = (each.newest_s for name, each in self._clocks.items() if name != stream)
        return max((newest_s for newest_s in others if newest_s is not None), default=-np.inf)
