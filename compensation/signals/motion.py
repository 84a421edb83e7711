"""What signals are made of: random motion, moves between positions, changes of speed, pulses.

Every part is sampled at `RATE_HZ`, begins and ends at rest, and stays within the given limits.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from hbm.spatial import Array

RATE_HZ: Final = 100.0
"""Of all signals: D-Flow commands the machine so."""
MIN_SWAY_HZ: Final = 0.2
MIN_PITCH_HZ: Final = 0.15
MIN_BELT_HZ: Final = 0.4
"""High-pass of random motion, chosen such that it fills its range: in 300 s, random pitch comes
within 6 % of it on either side (100 seeds)."""
FADE_S: Final = 0.5
"""In which random motion begins and ends, chosen."""
FILTER_SETTLING_S: Final = 20.0
"""Of random motion drawn beyond both ends and discarded: the high-pass settles in it."""
ROUNDING_SAMPLES: Final = 1e-9
"""Of a duration in samples, which adds no sample."""
SOFT_CLIP_SHARE: Final = 0.8
"""Of the range, beyond which random motion bends smoothly towards its end."""


class Extent(NamedTuple):
    """Largest excursion, speed and acceleration of a part, each either way."""

    range: float
    speed: float
    acceleration: float


def samples(duration_s: float) -> int:
    """Give the number of samples of a duration."""
    return round(duration_s * RATE_HZ)


def random_position(
    rng: np.random.Generator, count: int, sd: float, min_hz: float, most: Extent
) -> Array:
    """Draw (count,) positions from white acceleration of a standard deviation, without drift."""
    white = _white(rng, count, sd, most.acceleration)
    x = _high_passed(np.cumsum(np.cumsum(white)) / RATE_HZ**2, min_hz)
    x = _soft_clipped(x, most.range) * fade(count, FADE_S)
    return _scaled_down(_scaled_down(x, 1, most.speed), 2, most.acceleration)


def random_speed(
    rng: np.random.Generator, count: int, sd: float, reach: float, acceleration: float
) -> Array:
    """Draw (count,) deviations from the mean speed from white acceleration."""
    v = _high_passed(np.cumsum(_white(rng, count, sd, acceleration)) / RATE_HZ, MIN_BELT_HZ)
    return _scaled_down(_soft_clipped(v, reach) * fade(count, FADE_S), 1, acceleration)


def positions(levels: tuple[float, ...], hold_s: float, most: Extent) -> Array:
    """Go from neutral through the levels (shares of the range), hold each, and return."""
    parts, at = [], 0.0
    for level in (*levels, 0.0):
        approach = at + move(level * most.range - at, most.speed, most.acceleration)
        at = level * most.range
        parts += [approach, np.full(samples(hold_s), at)]
    return np.concatenate(parts)


def move(distance: float, speed: float, acceleration: float) -> Array:
    """Move over a distance, from rest to rest, as fast as the limits allow; no first sample.

    Constant acceleration, constant speed, and the same deceleration, all slowed down by the part of
    a sample that the duration lacks.
    """
    far = abs(distance)
    fastest = min(speed, float(np.sqrt(far * acceleration)))
    ramp_s = fastest / acceleration
    seconds = far / fastest + ramp_s
    count = int(np.ceil(seconds * RATE_HZ - ROUNDING_SAMPLES))
    after = np.linspace(0, seconds, count + 1)[1:]
    cruised = fastest * np.clip(after - ramp_s, 0, seconds - 2 * ramp_s)
    begun, ended = np.minimum(after, ramp_s), np.clip(seconds - after, 0, ramp_s)
    changing = acceleration / 2 * (begun**2 + ramp_s**2 - ended**2)
    return np.asarray(np.sign(distance) * (cruised + changing))


def speeds(mean: float, levels: tuple[float, ...], hold_s: float, acceleration: float) -> Array:
    """Go from the mean speed through the levels, hold each, and return."""
    parts, at = [], mean
    for level in (*levels, mean):
        parts += [ramp(at, level, acceleration), np.full(samples(hold_s), level)]
        at = level
    return np.concatenate(parts)


def pulse(mean: float, acceleration: float, pulse_s: float, period_s: float) -> Array:
    """Accelerate from the mean speed for a time, brake as fast, and wait for the period to end."""
    there = ramp(mean, mean + acceleration * pulse_s, acceleration)
    both = np.concatenate([there, ramp(there[-1], mean, acceleration)])
    return np.pad(both, (0, samples(period_s) - len(both)), constant_values=mean)


def ramp(start: float, stop: float, acceleration: float) -> Array:
    """Change the speed at constant acceleration, without the first sample."""
    count = int(np.ceil(abs(stop - start) / acceleration * RATE_HZ - ROUNDING_SAMPLES))
    return np.linspace(start, stop, count + 1)[1:]


def fade(count: int, seconds: float) -> Array:
    """Give weights that rise from 0 to 1 and fall again, without a jump in speed."""
    at = np.arange(count) / RATE_HZ
    to_end = np.minimum(at, at[::-1]) / seconds
    return (1 - np.cos(np.pi * np.minimum(to_end, 1))) / 2


def _white(rng: np.random.Generator, count: int, sd: float, most: float) -> Array:
    return np.clip(sd * rng.normal(size=count + 2 * samples(FILTER_SETTLING_S)), -most, most)


def _high_passed(drifting: Array, cutoff_hz: float) -> Array:
    sos = butter(2, cutoff_hz, "high", fs=RATE_HZ, output="sos")
    settling = samples(FILTER_SETTLING_S)
    passed: Array = sosfiltfilt(sos, drifting)[settling:-settling]
    return passed


def _soft_clipped(x: Array, reach: float) -> Array:
    """Compress what exceeds a share of the reach smoothly, so that it stays within."""
    knee = SOFT_CLIP_SHARE * reach
    beyond = np.maximum(np.abs(x) - knee, 0)
    return np.sign(x) * (
        np.minimum(np.abs(x), knee) + (reach - knee) * np.tanh(beyond / (reach - knee))
    )


def _scaled_down(x: Array, order: int, most: float) -> Array:
    """Scale motion down where its derivative of an order exceeds a limit."""
    largest = float(np.max(np.abs(np.diff(x, order)))) * RATE_HZ**order
    return x if largest <= most else x * (most / largest)
