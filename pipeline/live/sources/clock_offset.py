"""How far the clock of a sender is behind this computer's, from measurements that scatter."""

from typing import Final

MEASURE_S: Final = 1.0
"""Between measurements; Lab Streaming Layer makes one every two seconds."""
SMOOTHING_S: Final = 20.0
"""Time constant: measurements scatter by some 0.1 ms, clocks drift by some 10 ppm."""
MAX_STEP_S: Final = 0.01
"""Beyond it a clock was set anew: nothing is smoothed."""


class ClockOffset:
    """Offset that turns a sender's time stamps to this computer's clock.

    Examples
    --------
    Measurements change it slowly, so that time stamps go on increasing evenly:

    >>> offset = ClockOffset()
    >>> offset.measure(0.0, 5.0)
    >>> offset.measure(1.0, 5.001)
    >>> round(offset.value_s, 5)
    5.00005
    >>> offset.resets
    0
    """

    def __init__(self) -> None:
        self.value_s = 0.0
        self.resets = 0
        self._at: float | None = None

    @property
    def known(self) -> bool:
        """Whether there was a measurement."""
        return self._at is not None

    def due(self, now: float) -> bool:
        """Whether it is time for a measurement."""
        return self._at is None or now - self._at >= MEASURE_S

    def measure(self, now: float, offset_s: float) -> None:
        """Take a measurement at a time [s] of this computer's clock."""
        difference = offset_s - self.value_s
        if self._at is None:
            self.value_s = offset_s
        elif abs(difference) > MAX_STEP_S:
            self.value_s = offset_s
            self.resets += 1
        else:
            self.value_s += difference * min(1.0, (now - self._at) / SMOOTHING_S)
        self._at = now
