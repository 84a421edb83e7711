"""The validation signals of the thesis: perturbations as they are used with subjects.

Source: van de Loosdrecht (2018), II.B.2 and E.2. What the thesis does not state is chosen here and
marked as chosen.
"""

from typing import Final

import numpy as np

from compensation.signals.motion import (
    RATE_HZ,
    fade,
    move,
    pulse,
    ramp,
    random_speed,
    samples,
)
from compensation.signals.protocol import (
    BELT_VARIANCE,
    GENTLE_MPS2,
    PULSE_MPS2,
    PULSE_PERIOD_S,
    PULSE_S,
    USED_SHARE,
)
from compensation.signals.signal import MachineLimits, Signal
from hbm.spatial import Array

WALKING_MPS: Final = 1.3
RUNNING_MPS: Final = 2.5
SWAY_M: Final = 0.05
SWAY_MPS: Final = 0.31
SWAY_MPS2: Final = 5.0
"""Acceleration with which a sway reaches its speed: the machine's, chosen."""
SWAY_BACK_MPS: Final = 0.05
SWAY_BACK_MPS2: Final = 0.1
"""Speed and acceleration of the return, chosen such that it is no perturbation."""
SWAY_HELD_S: Final = 7.0
"""From the onset of a sway to its return."""
PITCH_DEG: Final = 10.0
PITCH_PERIOD_S: Final = 30.0
BELT_FROM_MPS: Final = 1.0
"""Mean speed of the random part of the belts, and speed from which their pulses start; chosen."""
BELT_RANDOM_S: Final = 60.0
BELT_PULSES: Final = 12
"""Duration of the random part and number of pulses, a minute each; chosen."""
RANDOM_STREAM: Final = 200
"""Number of the random numbers of the validation, which are not those of a calibration signal."""


def validation_signals(seed: int = 0) -> tuple[Signal, ...]:
    """Give the 6 validation signals: sway, pitch, running, boarding, and two of the belts.

    Parameters
    ----------
    seed
        Of the random part of the belts; the rest is the same for every seed.

    Returns
    -------
    tuple[Signal, ...]
        At 100 Hz. Sway: 5 cm to alternate sides at up to 0.31 m/s, returning slowly after 7 s,
        belts at 1.3 m/s. Pitch: ± 10° in 30 s, belts at 1.3 m/s. Running: belts at 2.5 m/s.
        Boarding: all at rest. Belt: a minute of random acceleration about 1 m/s (chosen), then
        pulses of 0.15 s of 12 m/s² and back, every 5 s. Belt with person: pulses from 1.3 m/s.

    Examples
    --------
    >>> [signal.name for signal in validation_signals()]
    ['sway', 'pitch', 'running', 'boarding', 'belt', 'belt_with_person']
    """
    sway, pitch, belt = _sway(), _pitch(), _belt(np.random.default_rng((seed, RANDOM_STREAM)))
    with_person = np.concatenate(_pulses(WALKING_MPS))
    rest = np.zeros(samples(60.0))
    return (
        Signal("sway", RATE_HZ, sway, 0 * sway, 0 * sway + WALKING_MPS),
        Signal("pitch", RATE_HZ, 0 * pitch, pitch, 0 * pitch + WALKING_MPS),
        Signal("running", RATE_HZ, rest, rest, rest + RUNNING_MPS),
        Signal("boarding", RATE_HZ, rest, rest, rest),
        Signal("belt", RATE_HZ, 0 * belt, 0 * belt, belt),
        Signal("belt_with_person", RATE_HZ, 0 * with_person, 0 * with_person, with_person),
    )


def _sway() -> Array:
    """Sway three times to either side, 3 s of rest between."""
    there = move(SWAY_M, SWAY_MPS, SWAY_MPS2)
    back = SWAY_M + move(-SWAY_M, SWAY_BACK_MPS, SWAY_BACK_MPS2)
    held = np.full(samples(SWAY_HELD_S) - len(there), SWAY_M)
    side, rest = np.concatenate([there, held, back]), np.zeros(samples(3.0))
    sides = (part for sign in (1, -1) * 3 for part in (sign * side, rest))
    return np.concatenate([rest, *sides])


def _pitch() -> Array:
    """Four periods of a sine, begun and ended within 3 s."""
    time = np.arange(samples(4 * PITCH_PERIOD_S)) / RATE_HZ
    sine = np.radians(PITCH_DEG) * np.sin(2 * np.pi * time / PITCH_PERIOD_S)
    return np.asarray(sine * fade(len(time), 3.0))


def _belt(rng: np.random.Generator) -> Array:
    """Random acceleration, then pulses."""
    limits, mean = MachineLimits(), BELT_FROM_MPS
    random = mean + random_speed(
        rng,
        samples(BELT_RANDOM_S),
        float(np.sqrt(BELT_VARIANCE[mean])),
        limits.belt_m_per_s - mean,
        USED_SHARE * limits.belt_m_per_s2,
    )
    start, pulses, stop = _pulses(mean)
    return np.concatenate([start, random, pulses, stop])


def _pulses(mean: float) -> tuple[Array, Array, Array]:
    """Give starting the belts, pulses from a speed, and stopping the belts."""
    pulses = np.tile(pulse(mean, PULSE_MPS2, PULSE_S, PULSE_PERIOD_S), BELT_PULSES)
    start, stop = ramp(0.0, mean, GENTLE_MPS2), ramp(mean, 0.0, GENTLE_MPS2)
    return np.append(0.0, start), pulses, stop
