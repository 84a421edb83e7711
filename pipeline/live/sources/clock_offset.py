"""How far the clock of a sender is behind this computer's, from measurements that scatter."""

from collections import deque
from typing import Final

import numpy as np

from hbm.spatial import Array

MEASURE_S: Final = 3.0
"""Between looks: the library measures every two to three seconds, and each counts once."""
KEPT: Final = 40
"""Measurements that show offset and drift: those of two minutes."""
DRIFT_FROM: Final = 10
"""Fewer measurements do not show a drift."""
MAX_STEP_S: Final = 0.01
"""Two measurements in a row beyond it: a clock was set anew, and earlier ones do not count."""


class ClockOffset:
    """Brings a sender's time stamps onto this computer's clock.

    Notes
    -----
    Offset and drift are those of the straight line through the measurements of two minutes whose
    slope is the median of all slopes (Theil and Sen): single measurements, which a busy network
    makes wrong by a millisecond and more, have no effect, and a clock that drifts is followed
    without lag.

    Examples
    --------
    >>> import numpy as np
    >>> offset = ClockOffset()
    >>> offset.measure(100.0, 5.0)
    >>> offset.local(np.array([95.5])).tolist()
    [100.5]
    """

    def __init__(self) -> None:
        self.resets = 0
        self._measured: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._looked = self._at = self._value_s = self._drift = 0.0
        self._doubtful_s: float | None = None

    @property
    def known(self) -> bool:
        """Whether there was a measurement."""
        return bool(self._measured)

    @property
    def value_s(self) -> float:
        """Offset at the time of the last measurement [s]."""
        return self._value_s

    def due(self, now: float) -> bool:
        """Whether it is time for a measurement."""
        return not self._measured or now - self._looked >= MEASURE_S

    def measure(self, now: float, offset_s: float) -> None:
        """Take a measurement at a time [s] of this computer's clock."""
        expected = self._value_s + self._drift * (now - self._at)
        self._looked = now
        doubtful_s, self._doubtful_s = self._doubtful_s, None
        if self._measured and abs(offset_s - expected) > MAX_STEP_S:
            if doubtful_s is None or abs(offset_s - doubtful_s) > MAX_STEP_S:
                self._doubtful_s = offset_s
                return
            self._measured.clear()
            self.resets += 1
        self._measured.append((now, offset_s))
        self._at, self._drift = now, 0.0
        time, offset = np.array(self._measured).T
        if len(time) >= DRIFT_FROM:
            first, second = np.triu_indices(len(time), 1)
            slopes = (offset[second] - offset[first]) / (time[second] - time[first])
            self._drift = float(np.median(slopes))
        self._value_s = float(np.median(offset - self._drift * (time - now)))

    def local(self, stamps: Array) -> Array:
        """Give time stamps of the sender, (N,) [s], on this computer's clock."""
        known = stamps + self._value_s
        return np.asarray(known + self._drift * (known - self._at))
