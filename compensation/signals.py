"""Commanded motion of a treadmill, its limits, and the parts that signals are made of."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.interpolate import BSpline
from scipy.signal import butter, sosfiltfilt, welch

from compensation.inputs import read_rate, refuse_gaps, refuse_unequal
from hbm.notes import Note
from hbm.spatial import Array, read_only

ROUNDING: Final = 1e-9
"""Share of a limit, or of a sample, that is rounding."""
WELCH_WINDOW_S: Final = 10.0
"""Of a spectrum: resolves 0.1 Hz, half of the slowest random motion of the protocol."""


@dataclass(frozen=True, slots=True)
class MachineLimits:
    """Range, speed and acceleration that the machine can reach.

    The defaults of range, sway speed and belt acceleration are those of the thesis' machine (van de
    Loosdrecht 2018, II.B and E). It does not state the others: they are assumed such that its
    signals are possible, so take yours from the machine's manual.

    Attributes
    ----------
    sway_m, sway_m_per_s, sway_m_per_s2
        Largest translation, its speed and acceleration.
    pitch_deg, pitch_deg_per_s, pitch_deg_per_s2
        Largest rotation, its speed and acceleration.
    belt_m_per_s, belt_m_per_s2
        Largest belt speed, either way, and its acceleration.

    Examples
    --------
    >>> MachineLimits(pitch_deg_per_s=20.0).pitch_deg
    10.0
    """

    sway_m: float = 0.05
    sway_m_per_s: float = 0.31
    sway_m_per_s2: float = 5.0
    pitch_deg: float = 10.0
    pitch_deg_per_s: float = 50.0
    pitch_deg_per_s2: float = 600.0
    belt_m_per_s: float = 6.0
    belt_m_per_s2: float = 15.0

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0:
                raise ValueError(f"limit {name} must be positive, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True)
class Signal:
    """Commanded motion over time.

    Attributes
    ----------
    name
        Unique among the signals of an experiment.
    rate_hz
        Samples per second.
    sway
        Translation along the lab's left axis, (T,) [m].
    pitch
        Rotation about the lab's left axis by the right-hand rule, (T,) [rad].
    belt_speed
        Speed of both belts, (T,) [m/s].

    Examples
    --------
    >>> import numpy as np
    >>> still = np.zeros(100)
    >>> signal = Signal("walk", rate_hz=100.0, sway=still, pitch=still, belt_speed=still + 1.3)
    >>> f"{signal.time[-1]:.2f} s"
    '0.99 s'
    """

    name: str
    rate_hz: float
    sway: Array
    pitch: Array
    belt_speed: Array

    def __post_init__(self) -> None:
        read_rate(self.rate_hz)
        channels = {
            name: read_only(getattr(self, name)) for name in ("sway", "pitch", "belt_speed")
        }
        for name, values in channels.items():
            refuse_gaps(values, f"signal {self.name}: {name}")
            object.__setattr__(self, name, values)
        refuse_unequal(**channels)

    @property
    def time(self) -> Array:
        """Sample times from 0, (T,) [s]."""
        return np.arange(len(self.sway)) / self.rate_hz

    @property
    def acceleration(self) -> Array:
        """Second differences of sway and pitch, first of belt speed, (T - 2, 3) [m/s², rad/s²]."""
        platform = np.diff(np.column_stack([self.sway, self.pitch]), 2, axis=0) * self.rate_hz**2
        belt = np.diff(self.belt_speed)[1:, None] * self.rate_hz
        return np.hstack([platform, belt])


def check_signal(signal: Signal, limits: MachineLimits) -> tuple[Note, ...]:
    """Find the limits of the machine that a signal exceeds, and by how much.

    Parameters
    ----------
    signal
        Commanded motion.
    limits
        Of the machine.

    Returns
    -------
    tuple of Note
        One ``signal_beyond_limit`` per limit exceeded, empty where the signal is within all.

    Examples
    --------
    >>> import compensation
    >>> sway = compensation.validation_signals()[0]
    >>> for note in check_signal(sway, MachineLimits(sway_m_per_s=0.25)):
    ...     print(note)
    sway: sway_m_per_s reaches 0.301, limit of the machine 0.25
    """
    rate, pitch = signal.rate_hz, np.degrees(signal.pitch)
    reached = {
        "sway_m": signal.sway,
        "sway_m_per_s": np.diff(signal.sway) * rate,
        "sway_m_per_s2": np.diff(signal.sway, 2) * rate**2,
        "pitch_deg": pitch,
        "pitch_deg_per_s": np.diff(pitch) * rate,
        "pitch_deg_per_s2": np.diff(pitch, 2) * rate**2,
        "belt_m_per_s": signal.belt_speed,
        "belt_m_per_s2": np.diff(signal.belt_speed) * rate,
    }
    return tuple(
        Note.of(
            "signal_beyond_limit",
            signal=signal.name,
            quantity=name,
            largest=largest,
            limit=getattr(limits, name),
        )
        for name, values in reached.items()
        if (largest := float(np.max(np.abs(values)))) > getattr(limits, name) * (1 + ROUNDING)
    )


def resample_signal(signal: Signal, rate_hz: float) -> Signal:
    """Bring a signal to another rate without leaving its limits.

    Parameters
    ----------
    signal
        Any signal.
    rate_hz
        The new rate, not below the old one [Hz].

    Returns
    -------
    Signal
        The same motion at the new rate.

    Raises
    ------
    ValueError
        A rate below the signal's.

    Notes
    -----
    The samples become the coefficients of a cubic B-spline, not its values: range, speed and
    acceleration between samples are then averages of those at the samples, so that none grows.

    Examples
    --------
    >>> import compensation
    >>> resample_signal(compensation.validation_signals()[0], 1000.0).rate_hz
    1000.0
    """
    rate = read_rate(rate_hz)
    if rate < signal.rate_hz:
        raise ValueError(
            f"signal {signal.name} has {signal.rate_hz} Hz; decimating it to {rate} Hz would lose "
            "motion, draw it at the lower rate instead"
        )
    count = int((len(signal.sway) - 1) * rate / signal.rate_hz + ROUNDING) + 1
    at = np.arange(count) * signal.rate_hz / rate

    def resampled(samples: Array) -> Array:
        padded = np.pad(samples, 3, mode="edge")
        spline = BSpline(np.arange(-5.0, len(padded) - 1), padded, 3)
        values: Array = spline(at)
        return values

    channels = (resampled(x) for x in (signal.sway, signal.pitch, signal.belt_speed))
    return Signal(signal.name, rate, *channels)


def acceleration_spectrum(signal: Signal) -> tuple[Array, Array]:
    """Give the spectra of a signal's accelerations, by Welch's method over windows of 10 s.

    Parameters
    ----------
    signal
        Commanded motion.

    Returns
    -------
    frequency
        (F,) [Hz].
    density
        Of sway, pitch and belt, (F, 3) [(m/s²)²/Hz, (rad/s²)²/Hz, (m/s²)²/Hz].

    Examples
    --------
    >>> import compensation
    >>> pitch = compensation.validation_signals()[1]
    >>> _, density = acceleration_spectrum(pitch)
    >>> bool(density[:, 1].max() > 0 == density[:, 0].max())
    True
    """
    acceleration = signal.acceleration
    length = min(int(WELCH_WINDOW_S * signal.rate_hz), len(acceleration))
    frequency, density = welch(acceleration, signal.rate_hz, nperseg=length, axis=0)
    return frequency, density


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
