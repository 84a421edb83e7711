"""The belt-speed channel of the treadmill's controller."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array

UPDATE_HZ: Final = 200.0
"""How often the controller updates the speed that it reports (van de Loosdrecht 2018); in
between the recorder holds the last value."""


@dataclass(frozen=True, slots=True)
class BeltSpeedSensor:
    """Reports the speed of a belt.

    Attributes
    ----------
    noise
        Standard deviation of white noise on the way to the recorder, from sample to sample [m/s].
    """

    noise: float

    def measure(self, speed: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Report the true speed of a belt, (N,) [m/s] at ``rate_hz``."""
        step = max(round(rate_hz / UPDATE_HZ), 1)
        held = np.repeat(speed[::step], step)[: len(speed)]
        return np.asarray(held + self.noise * rng.normal(size=len(speed)))
