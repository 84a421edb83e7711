"""Channels that the treadmill's controller streams to the recorder: belt speed and platform."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.machine.instruments.sampling import add_noise, interpolated, jitter

UPDATE_HZ: Final = 200.0
"""How often the controller updates the belt speed that it reports (van de Loosdrecht 2018); in
between the recorder holds the last value."""


@dataclass(frozen=True, slots=True)
class Stream:
    """When a controller reads what it streams.

    Attributes
    ----------
    delay_s
        How much later its values arrive than what they show [s].
    jitter_s
        Standard deviation of its instants, one every 1 / `UPDATE_HZ` [s].
    doubled_per_minute
        How often a value is repeated instead of read anew.
    held
        Whether a value stays until the next; else the channel goes on between its instants.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    doubled_per_minute: float = 0.0
    held: bool = False

    def sample(self, values: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Give what the recorder holds of what happens, (N, C), at ``rate_hz``, (N, C)."""
        step = max(round(rate_hz / UPDATE_HZ), 1)
        count = len(values)
        first = np.arange(0, count, step)
        of_jitter, of_doubled = rng.spawn(2)
        late = np.full(len(first), -self.delay_s * rate_hz)
        late += rate_hz * jitter(len(first), self.jitter_s, of_jitter)
        seconds = step / rate_hz
        doubled = of_doubled.random(len(first)) < self.doubled_per_minute / 60 * seconds
        late[doubled] -= step
        if self.held:
            return np.repeat(interpolated(values, first + late), step, axis=0)[:count]
        if not late.any():
            return values
        return interpolated(values, np.arange(count) + np.repeat(late, step)[:count])


@dataclass(frozen=True, slots=True)
class BeltSpeedSensor:
    """Reports the speed of a belt.

    Attributes
    ----------
    noise
        Standard deviation of white noise on the way to the recorder, from sample to sample [m/s].
    stream
        When the speed is read.
    """

    noise: float
    stream: Stream = Stream(held=True)

    def measure(self, speed: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Report the true speed of a belt, (N,) [m/s] at ``rate_hz``."""
        (of_stream,) = rng.spawn(1)
        reported = self.stream.sample(speed[:, None], rate_hz, of_stream)
        add_noise(reported, self.noise, rng)
        return np.asarray(reported[:, 0])
