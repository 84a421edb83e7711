"""What all instruments have in common: when they sample, how finely, and their noise."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import lfilter

from hbm.spatial import Array

ANALOG_HZ: Final = 1000.0
FRAME_HZ: Final = 100.0
"""Sampling rate of plates and analog channels, and frame rate of the cameras: the thesis'. Standard
deviations of noise on plates and analog channels are stated for `ANALOG_HZ`."""
SAMPLES_PER_FRAME: Final = round(ANALOG_HZ / FRAME_HZ)
MAX_JITTER_S: Final = 0.002
"""Largest error of an instant, that of recorded streams."""
WANDER_HZ: Final = 0.5
"""Corner frequency of a zero that wanders; assumed."""
WANDER_UPDATE_HZ: Final = 10.0
"""How often a wandering zero is drawn; in between it is straight."""
CHUNK_SAMPLES: Final = 16_000
"""Samples treated at a time, so that they stay in the processor's cache."""


@dataclass(frozen=True, slots=True)
class Clock:
    """When an instrument samples.

    Attributes
    ----------
    delay_s
        How much later its readings are than what they show [s].
    rate
        Error of its clock, as a share of the time.
    jitter_s
        Standard deviation of its instants [s].
    """

    delay_s: float = 0.0
    rate: float = 0.0
    jitter_s: float = 0.0

    def sample(self, values: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Give what the instrument samples of what happens, (N, C), at ``rate_hz``, (N, C)."""
        if self == Clock():
            return values
        position = np.arange(len(values), dtype=np.float64)
        position *= 1 + self.rate
        position -= self.delay_s * rate_hz
        if self.jitter_s > 0:
            position += rate_hz * jitter(len(values), self.jitter_s, rng)
        return interpolated(values, position)


def jitter(count: int, sd_s: float, rng: np.random.Generator) -> Array:
    """Draw errors of instants, `MAX_JITTER_S` at most, (N,) [s]."""
    return np.clip(sd_s * rng.standard_normal(count), -MAX_JITTER_S, MAX_JITTER_S)


def interpolated(values: Array, position: Array) -> Array:
    """Give values between samples, of the cubic through the four around each.

    Parameters
    ----------
    values
        (N, C).
    position
        Wanted places in samples, (K,); before the first and after the last it is held.

    Returns
    -------
    Array
        (K, C); at a sample exactly that.
    """
    last, found = len(values) - 1, np.empty((len(position), values.shape[1]))
    for part in chunks(len(position)):
        here = np.clip(position[part], 0, last)
        below = np.minimum(here.astype(int), max(last - 1, 0))
        f = here - below
        weights = (
            -f * (f - 1) * (f - 2) / 6,
            (f + 1) * (f - 1) * (f - 2) / 2,
            -(f + 1) * f * (f - 2) / 2,
            (f + 1) * f * (f - 1) / 6,
        )
        total = np.zeros((len(here), values.shape[1]))
        for k, weight in enumerate(weights):
            total += weight[:, None] * values[np.clip(below + k - 1, 0, last)]
        found[part] = total
    return found


def delayed(values: Array, delay_s: float, time: Array) -> Array:
    """Give what a late instrument reports at the times of the others.

    Parameters
    ----------
    values
        What happens, (N, C).
    delay_s
        How much later the instrument is [s].
    time
        Sample times at equal intervals, (N,) [s].

    Returns
    -------
    Array
        The values ``delay_s`` earlier, (N, C); the first value before there are any.
    """
    if delay_s == 0:
        return values
    samples = delay_s / (time[1] - time[0])
    return interpolated(values, np.arange(len(values)) - samples)


def noise_sd_at(sd: Array | float, rate_hz: float) -> Array:
    """Give the standard deviation at a sampling rate of white noise stated for `ANALOG_HZ`.

    Its density stays the same.
    """
    return np.asarray(sd * np.sqrt(rate_hz / ANALOG_HZ))


def add_noise(values: Array, sd: Array | float, rng: np.random.Generator) -> None:
    """Add white noise to readings in place, (N, C), with one standard deviation or one of each."""
    if not np.any(sd):
        return
    drawn = np.empty((min(CHUNK_SAMPLES, len(values)), values.shape[1]))
    for part in chunks(len(values)):
        here = values[part]
        noise = rng.standard_normal(out=drawn[: len(here)])
        noise *= sd
        here += noise


def wander(count: int, rate_hz: float, channels: int, rng: np.random.Generator) -> Array:
    """Draw zeros that wander below `WANDER_HZ`, with standard deviation 1, (N, channels)."""
    step = max(round(rate_hz / WANDER_UPDATE_HZ), 1)
    kept = np.exp(-2 * np.pi * WANDER_HZ / WANDER_UPDATE_HZ)
    drawn = rng.standard_normal((count // step + 2, channels))
    drawn[1:] *= np.sqrt(1 - kept**2)
    drawn = np.asarray(lfilter([1.0], [1.0, -kept], drawn, axis=0))
    share = np.arange(step)[:, None] / step
    between = drawn[:-1, None] + share * np.diff(drawn, axis=0)[:, None]
    return np.asarray(between.reshape(-1, channels)[:count])


def quantise(values: Array, largest: Array | float, bits: int) -> None:
    """Round readings in place to the steps of a converter's range; 0 bits: not at all."""
    if bits == 0:
        return
    step = np.asarray(largest) / 2 ** (bits - 1)
    values /= step
    np.rint(values, out=values)
    values *= step


def folded(count: int, rng: np.random.Generator) -> Array:
    """Draw interference from above half the sampling rate, with root mean square 1, (N,).

    Sampled without a filter it appears as a tone at any frequency below that.
    """
    frequency, phase = rng.uniform(0, np.pi), rng.uniform(0, 2 * np.pi)
    return np.asarray(np.sqrt(2) * np.sin(frequency * np.arange(count) + phase))


def chunks(count: int) -> Iterator[slice]:
    """Give the parts of so many samples that are treated at a time."""
    return (slice(start, start + CHUNK_SAMPLES) for start in range(0, count, CHUNK_SAMPLES))
