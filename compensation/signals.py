"""Commanded motion of a treadmill, and its limits."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from compensation.inputs import read_rate, refuse_gaps, refuse_unequal
from hbm.notes import Note
from hbm.spatial import Array, read_only

ROUNDING: Final = 1e-9
"""Share of a limit, or of a sample, that is rounding."""


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
        channels = {n: read_only(getattr(self, n)) for n in ("sway", "pitch", "belt_speed")}
        for name, values in channels.items():
            refuse_gaps(values, f"signal {self.name}: {name}")
            object.__setattr__(self, name, values)
        refuse_unequal(**channels)

    @property
    def time(self) -> Array:
        """Sample times from 0, (T,) [s]."""
        return np.arange(len(self.sway)) / self.rate_hz


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
    sizes = [(name, np.max(np.abs(x)), getattr(limits, name)) for name, x in reached.items()]
    return tuple(
        Note.of("signal_beyond_limit", signal=signal.name, quantity=name, largest=size, limit=most)
        for name, size, most in sizes
        if size > most * (1 + ROUNDING)
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
        # a cubic B-spline with the samples as coefficients stays within their range, and so do its
        # derivatives: no limit of the machine is left
        padded = np.pad(samples, 3, mode="edge")
        spline = scipy.interpolate.BSpline(np.arange(-5.0, len(padded) - 1), padded, 3)
        return np.asarray(spline(at))

    channels = (resampled(x) for x in (signal.sway, signal.pitch, signal.belt_speed))
    return Signal(signal.name, rate, *channels)
