"""The signals of the thesis: calibration of pitch, sway and belts, and validation.

Source: van de Loosdrecht (2018), E.1 and E.2; random motion after Hnat et al. (2018) and Hnat and
van den Bogert (2014). What the thesis does not state is chosen here and marked as chosen.

Deviations from the original: random motion bends smoothly towards its range instead of being
clipped, and moves have minimum jerk, so that accelerations stay within the machine's; every signal
begins and ends at rest.
"""

from typing import Final

import numpy as np

from compensation.signals.motion import (
    RATE_HZ,
    Extent,
    fade,
    move,
    positions,
    ramp,
    random_position,
    random_speed,
    samples,
    speeds,
)
from compensation.signals.signal import MachineLimits, Signal
from hbm.spatial import Array

PLATFORM_KINDS: Final = (
    "random",
    "square_sway",
    "gaps",
    "square_pitch",
    "constant_sway",
    "constant_pitch",
    "all",
)
BELT_KINDS: Final = ("random", "gaps", "square", "constant", "all")
DURATIONS_S: Final = (60, 300)
BELT_VARIANCE: Final = {1.0: 25.0, 2.0: 2000.0}
"""Mean speed [m/s] -> variance of the acceleration [m²/s⁴]."""

USED_SHARE: Final = 0.95
"""Of range and belt acceleration that random motion and moves use."""
SWAY_SD_MPS2: Final = 0.707
PITCH_SD_DEGPS2: Final = 127.0
"""Standard deviations of the white acceleration."""
GAPS: Final = {60: 3, 300: 15}
"""Duration [s] -> number of gaps without perturbation."""
REPEATS: Final = 3
"""Of square waves, constant parts, and all of them together."""
HOLD_S: Final = 1.5
"""At each level of a square wave, chosen."""
CONSTANT_S: Final = 5.0
"""At each level of a constant part, chosen."""
GAP_S: Final = 3.0
"""Of each gap, chosen."""
GENTLE_MPS2: Final = 1.0
"""Acceleration of belts between constant speeds, chosen."""

WALKING_MPS: Final = 1.3
RUNNING_MPS: Final = 2.5
"""Belt speeds of the validation signals (E.2), as all that follows but where it is chosen."""
SWAY_M: Final = 0.05
SWAY_MPS: Final = 0.31
SWAY_MPS2: Final = 5.0
"""Acceleration of the machine that the sway reaches its speed with, chosen."""
SWAY_BACK_MPS: Final = 0.05
"""Speed of the return, chosen such that it is no perturbation."""
SWAY_HELD_S: Final = 7.0
"""From the onset of a sway to its return."""
PITCH_DEG: Final = 10.0
PITCH_PERIOD_S: Final = 30.0
PULSE_FROM_MPS: Final = 1.0
PULSE_TO_MPS: Final = 2.8
PULSE_MPS2: Final = 12.0
PULSE_PERIOD_S: Final = 5.0
"""Belt pulses of 0.15 s; the speed from which they start is chosen."""


def pitch_and_sway_signals(
    seed: int, belt_speed: float, limits: MachineLimits | None = None
) -> tuple[Signal, ...]:
    """Draw the 14 calibration signals for pitch and sway.

    Parameters
    ----------
    seed
        The same seed gives the same signals; every signal has its own random motion.
    belt_speed
        Constant speed of the belts [m/s]: 0 or 3 in the thesis.
    limits
        Of the machine; the thesis' where None.

    Returns
    -------
    tuple[Signal, ...]
        `PLATFORM_KINDS` for 60 s, then for 300 s, at 100 Hz, named
        ``<kind>_<duration>s_<speed>mps``. In the long ones, and in those with gaps, the added parts
        are included in the duration; in the short ones they extend it.

    Examples
    --------
    >>> signal = pitch_and_sway_signals(seed=1, belt_speed=3.0)[1]
    >>> signal.name, f"{abs(signal.sway).max():.4f} m"
    ('square_sway_60s_3mps', '0.0475 m')
    """
    limits = limits or MachineLimits()
    return tuple(
        _platform_signal(i, kind, duration, seed, belt_speed, limits)
        for duration in DURATIONS_S
        for i, kind in enumerate(PLATFORM_KINDS)
    )


def belt_signals(
    seed: int, mean_speed: float, limits: MachineLimits | None = None
) -> tuple[Signal, ...]:
    """Draw the 10 calibration signals for belt acceleration.

    Parameters
    ----------
    seed
        The same seed gives the same signals; every signal has its own random motion.
    mean_speed
        1 or 2 [m/s]; each has its variance of the acceleration.
    limits
        Of the machine; the thesis' where None.

    Returns
    -------
    tuple[Signal, ...]
        `BELT_KINDS` for 60 s, then for 300 s, at 100 Hz, named
        ``belt_<kind>_<duration>s_<speed>mps``; durations as of `pitch_and_sway_signals`, plus
        starting and stopping the belts.

    Raises
    ------
    ValueError
        Another mean speed.

    Examples
    --------
    >>> len(belt_signals(seed=1, mean_speed=2.0))
    10
    """
    if mean_speed not in BELT_VARIANCE:
        raise ValueError(f"mean_speed must be one of {list(BELT_VARIANCE)} m/s, got {mean_speed}")
    limits = limits or MachineLimits()
    return tuple(
        _belt_signal(i, kind, duration, seed, mean_speed, limits)
        for duration in DURATIONS_S
        for i, kind in enumerate(BELT_KINDS)
    )


def validation_signals() -> tuple[Signal, ...]:
    """Give the 5 validation signals: sway, pitch, running, boarding, belt.

    Returns
    -------
    tuple[Signal, ...]
        At 100 Hz. Sway: 5 cm to alternate sides at up to 0.31 m/s, returning slowly after 7 s,
        belts at 1.3 m/s. Pitch: ± 10° in 30 s, belts at 1.3 m/s. Running: belts at 2.5 m/s.
        Boarding: all at rest. Belt: 0.15 s of 12 m/s² and back, every 5 s, from 1 m/s (chosen).

    Examples
    --------
    >>> [signal.name for signal in validation_signals()]
    ['sway', 'pitch', 'running', 'boarding', 'belt']
    """
    sway, pitch, belt = _validation_sway(), _validation_pitch(), _validation_belt()
    rest = np.zeros(samples(60.0))
    return (
        Signal("sway", RATE_HZ, sway, 0 * sway, 0 * sway + WALKING_MPS),
        Signal("pitch", RATE_HZ, 0 * pitch, pitch, 0 * pitch + WALKING_MPS),
        Signal("running", RATE_HZ, rest, rest, rest + RUNNING_MPS),
        Signal("boarding", RATE_HZ, rest, rest, rest),
        Signal("belt", RATE_HZ, 0 * belt, 0 * belt, belt),
    )


def _validation_sway() -> Array:
    """Sway three times to either side, 3 s of rest between."""
    there = move(SWAY_M, SWAY_MPS, SWAY_MPS2)
    back = SWAY_M + move(-SWAY_M, SWAY_BACK_MPS, SWAY_MPS2)
    held = np.full(samples(SWAY_HELD_S) - len(there), SWAY_M)
    side, rest = np.concatenate([there, held, back]), np.zeros(samples(3.0))
    sides = (part for sign in (1, -1) * 3 for part in (sign * side, rest))
    return np.concatenate([rest, *sides])


def _validation_pitch() -> Array:
    """Four periods of a sine, begun and ended within 3 s."""
    time = np.arange(samples(4 * PITCH_PERIOD_S)) / RATE_HZ
    sine = np.radians(PITCH_DEG) * np.sin(2 * np.pi * time / PITCH_PERIOD_S)
    return np.asarray(sine * fade(len(time), 3.0))


def _validation_belt() -> Array:
    """Twelve pulses of belt speed."""
    low, high = PULSE_FROM_MPS, PULSE_TO_MPS
    pulse = np.concatenate([ramp(low, high, PULSE_MPS2), ramp(high, low, PULSE_MPS2)])
    repeated = np.pad(pulse, (0, samples(PULSE_PERIOD_S) - len(pulse)), constant_values=low)
    start, stop = ramp(0.0, low, GENTLE_MPS2), ramp(low, 0.0, GENTLE_MPS2)
    return np.concatenate([start, *[repeated] * 12, stop])


def _platform_signal(
    index: int, kind: str, duration: int, seed: int, belt_speed: float, limits: MachineLimits
) -> Signal:
    rng = np.random.default_rng((seed, index, duration))
    sway = Extent(USED_SHARE * limits.sway_m, limits.sway_m_per_s, limits.sway_m_per_s2)
    degrees = (USED_SHARE * limits.pitch_deg, limits.pitch_deg_per_s, limits.pitch_deg_per_s2)
    pitch = Extent(*(float(np.radians(value)) for value in degrees))
    square, constant = ((1.0, -1.0), HOLD_S), ((1.0, 0.5), CONSTANT_S)
    parts = {
        "square_sway": _in_column(0, positions(*square, sway)),
        "square_pitch": _in_column(1, positions(*square, pitch)),
        "constant_sway": _in_column(0, positions(*constant, sway)),
        "constant_pitch": _in_column(1, positions(*constant, pitch)),
    }
    added = _additions(kind, duration, parts, gap=np.zeros((samples(GAP_S), 2)))
    random = [
        np.column_stack(
            [
                random_position(rng, count, SWAY_SD_MPS2, sway),
                random_position(rng, count, np.radians(PITCH_SD_DEGPS2), pitch),
            ]
        )
        for count in _stretches(kind, duration, added)
    ]
    sway_signal, pitch_signal = _interleaved(random, added).T
    belt = np.full(len(sway_signal), float(belt_speed))
    name = f"{kind}_{duration}s_{belt_speed:g}mps"
    return Signal(name, RATE_HZ, sway_signal, pitch_signal, belt)


def _belt_signal(
    index: int, kind: str, duration: int, seed: int, mean: float, limits: MachineLimits
) -> Signal:
    rng = np.random.default_rng((seed, 100 + index, duration))
    acceleration, reach = USED_SHARE * limits.belt_m_per_s2, limits.belt_m_per_s - mean
    parts = {
        "square": speeds(mean, (3.0, -3.0), HOLD_S, acceleration),
        "constant": speeds(mean, (-1.0, -0.3), CONSTANT_S, GENTLE_MPS2),
    }
    added = _additions(kind, duration, parts, gap=np.full(samples(GAP_S), mean))
    sd = float(np.sqrt(BELT_VARIANCE[mean]))
    random = [
        mean + random_speed(rng, count, sd, reach, acceleration)
        for count in _stretches(kind, duration, added)
    ]
    start, stop = ramp(0.0, mean, GENTLE_MPS2), ramp(mean, 0.0, GENTLE_MPS2)
    speed = np.concatenate([[0.0], start, _interleaved(random, added), stop])
    rest = np.zeros(len(speed))
    return Signal(f"belt_{kind}_{duration}s_{mean:g}mps", RATE_HZ, rest, rest, speed)


def _additions(kind: str, duration: int, parts: dict[str, Array], gap: Array) -> list[Array]:
    """Give the parts between stretches of random motion; each begins and ends at their ends."""
    if kind == "random":
        return []
    if kind == "gaps":
        return [gap] * GAPS[duration]
    if kind == "all":
        return [np.concatenate([*parts.values(), gap])] * REPEATS
    return [parts[kind]] * REPEATS


def _stretches(kind: str, duration: int, added: list[Array]) -> list[int]:
    """Count the samples of each stretch of random motion."""
    count = samples(duration)
    if kind == "gaps" or duration == max(DURATIONS_S):
        count -= sum(map(len, added))
    edges = np.linspace(0, count, len(added) + 2).astype(int)
    return [int(n) for n in np.diff(edges)]


def _interleaved(random: list[Array], added: list[Array]) -> Array:
    pairs = [part for pair in zip(random, added, strict=False) for part in pair]
    return np.concatenate([*pairs, random[-1]])


def _in_column(column: int, motion: Array) -> Array:
    table = np.zeros((len(motion), 2))
    table[:, column] = motion
    return table
