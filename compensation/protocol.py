"""The calibration and validation signals of the thesis, and which to use.

Source: van de Loosdrecht (2018), II.B.2, E.1, E.2 and Figs E.1 and E.2; random motion after Hnat et
al. (2018) and Hnat and van den Bogert (2014). What the thesis does not state is chosen here and
marked as chosen.

Deviations from the original: random motion bends smoothly towards its range instead of being
clipped, and moves have the largest speed and acceleration that the machine allows instead of being
steps, so that no signal exceeds its limits; every signal begins and ends at rest. Square waves of
sway turn once more without a hold: the platform follows with a delay and reaches its acceleration
only where the speed changes from one direction to the other, not where it starts from rest.
"""

from itertools import product
from typing import Final, NamedTuple

import numpy as np
import scipy

from compensation.signals import MachineLimits, Signal
from hbm.spatial import Array

RATE_HZ: Final = 100.0
"""Of all signals: D-Flow commands the machine so."""
PLATFORM_KINDS: Final = (
    "random",
    "square_sway",
    "gaps",
    "square_pitch",
    "constant_sway",
    "constant_pitch",
    "all",
)
BELT_KINDS: Final = ("random", "gaps", "square", "constant", "perturbations", "all")
ADVISED_PLATFORM_SIGNAL: Final = "all_60s_3mps"
"""To begin with, on any machine. It does not leave less than others: kinds of signals differ by 4 %
on average, and this one leaves a fifth more of the lateral force than plain random motion
(tests/validation/calibration_signals.md). But it holds everything that the others hold, at the
fastest belts, so that neither sway, pitch nor belt speed of a trial leaves the range of the
calibration. The thesis found this kind best in 7 of 24 columns, in 8 that with square waves of
sway, the faster belts better (F.2.4) and the longer duration not necessary (IV.B)."""
ADVISED_BELT_SIGNAL: Final = "belt_perturbations_60s_1mps"
"""The kind and duration that the thesis found best (III.B.2), at one of its two mean speeds; in
simulated experiments any signal will do."""
DURATIONS_S: Final = (60, 300)
PLATFORM_BELT_MPS: Final = (0.0, 3.0)
"""Belt speeds of the signals for pitch and sway."""
BELT_VARIANCE: Final = {1.0: 25.0, 2.0: 2000.0}
"""Mean speed [m/s] -> variance of the acceleration [m²/s⁴]."""

USED_SHARE: Final = 0.95
"""Of range and belt acceleration that random motion and moves use."""
GAPS: Final = {60: 3, 300: 15}
"""Duration [s] -> number of gaps without perturbation."""
REPEATS: Final = 3
"""Of square waves, constant parts, belt perturbations, and all of them together."""
HOLD_S: Final = 1.5
"""At each level of a square wave, chosen."""
CONSTANT_S: Final = 5.0
"""At each level of a constant part, chosen."""
GAP_S: Final = 3.0
"""Of each gap, chosen."""
GENTLE_MPS2: Final = 1.0
"""Acceleration of belts between constant speeds, chosen."""

PULSE_MPS2: Final = 12.0
PULSE_S: Final = 0.15
PULSE_PERIOD_S: Final = 5.0
"""Acceleration of a belt perturbation, for how long, and how often (E.2)."""


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

    Raises
    ------
    ValueError
        As `platform_signal`.

    Examples
    --------
    >>> signal = pitch_and_sway_signals(seed=1, belt_speed=3.0)[1]
    >>> signal.name, f"{abs(signal.sway).max():.4f} m"
    ('square_sway_60s_3mps', '0.0475 m')
    """
    drawn, limits = product(DURATIONS_S, PLATFORM_KINDS), limits or MachineLimits()
    return tuple(platform_signal(name, s, seed, belt_speed, limits) for s, name in drawn)


def belt_signals(
    seed: int, mean_speed: float, limits: MachineLimits | None = None
) -> tuple[Signal, ...]:
    """Draw the 12 calibration signals for belt acceleration.

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
        As `belt_signal`.

    Examples
    --------
    >>> len(belt_signals(seed=1, mean_speed=2.0))
    12
    """
    drawn, limits = product(DURATIONS_S, BELT_KINDS), limits or MachineLimits()
    return tuple(belt_signal(name, s, seed, mean_speed, limits) for s, name in drawn)


def platform_signal(
    kind: str, duration: int, seed: int, belt_speed: float, limits: MachineLimits
) -> Signal:
    """Draw one of `pitch_and_sway_signals`, given its kind and duration [s].

    Raises
    ------
    ValueError
        If the machine is so slow that the added parts leave no random motion in the duration.
    """
    # every signal has random numbers of its own: one does not depend on which others are drawn
    name = f"{kind}_{duration}s_{belt_speed:g}mps"
    rng = np.random.default_rng((seed, PLATFORM_KINDS.index(kind), duration))
    sway = Extent(USED_SHARE * limits.sway_m, limits.sway_m_per_s, limits.sway_m_per_s2)
    degrees = (USED_SHARE * limits.pitch_deg, limits.pitch_deg_per_s, limits.pitch_deg_per_s2)
    pitch = Extent(*(float(np.radians(value)) for value in degrees))
    square, constant = ((1.0, -1.0), HOLD_S), ((1.0, 0.5), CONSTANT_S)
    # after the square wave straight from end to end
    turning_sway = np.concatenate([positions(*square, sway), positions((1.0, -1.0), 0.0, sway)])
    parts = {
        "square_sway": _in_column(0, turning_sway),
        "square_pitch": _in_column(1, positions(*square, pitch)),
        "constant_sway": _in_column(0, positions(*constant, sway)),
        "constant_pitch": _in_column(1, positions(*constant, pitch)),
    }
    added = _additions(kind, duration, parts, gap=np.zeros((samples(GAP_S), 2)))
    random = []
    for count in _stretches(name, kind, duration, added):
        # white acceleration of 0.707 m/s² and 127 °/s² (SD); the high-pass is such that it fills
        # the range: in 300 s, random pitch comes within 6 % of it on either side (100 seeds)
        y = random_position(rng, count, 0.707, 0.2, sway)
        angle = random_position(rng, count, np.radians(127.0), 0.15, pitch)
        random.append(np.column_stack([y, angle]))
    sway_signal, pitch_signal = _interleaved(random, added).T
    belt = np.full(len(sway_signal), float(belt_speed))
    return Signal(name, RATE_HZ, sway_signal, pitch_signal, belt)


def belt_signal(kind: str, duration: int, seed: int, mean: float, limits: MachineLimits) -> Signal:
    """Draw one of `belt_signals`, given its kind, duration [s] and mean speed [m/s].

    Raises
    ------
    ValueError
        If the mean speed is not of the protocol, or the machine's belts cannot exceed it, or
        accelerate so slowly that the added parts leave no random motion in the duration.
    """
    if mean not in BELT_VARIANCE:
        raise ValueError(f"mean_speed must be one of {list(BELT_VARIANCE)} m/s, got {mean}")
    name = f"belt_{kind}_{duration}s_{mean:g}mps"
    acceleration, reach = USED_SHARE * limits.belt_m_per_s2, limits.belt_m_per_s - mean
    if reach <= 0:
        raise ValueError(
            f"{name}: belt_m_per_s must exceed its mean speed of {mean:g}, "
            f"the machine allows {limits.belt_m_per_s:g}"
        )
    rng = np.random.default_rng((seed, 100 + BELT_KINDS.index(kind), duration))
    # as strong as the machine allows within the length of a pulse
    push = min(PULSE_MPS2, acceleration, USED_SHARE * reach / PULSE_S)
    parts = {
        "square": speeds(mean, (3.0, -3.0), HOLD_S, acceleration),
        "constant": speeds(mean, (-1.0, -0.3), CONSTANT_S, GENTLE_MPS2),
        "perturbations": pulse(mean, push, PULSE_S, PULSE_PERIOD_S),
    }
    added = _additions(kind, duration, parts, gap=np.full(samples(GAP_S), mean))
    sd = float(np.sqrt(BELT_VARIANCE[mean]))
    random = [
        mean + random_speed(rng, count, sd, reach, acceleration)
        for count in _stretches(name, kind, duration, added)
    ]
    start, stop = ramp(0.0, mean, GENTLE_MPS2), ramp(mean, 0.0, GENTLE_MPS2)
    speed = np.concatenate([[0.0], start, _interleaved(random, added), stop])
    rest = np.zeros(len(speed))
    return Signal(name, RATE_HZ, rest, rest, speed)


def _additions(kind: str, duration: int, parts: dict[str, Array], gap: Array) -> list[Array]:
    """Give the parts between stretches of random motion; each begins and ends at their ends."""
    if kind == "random":
        return []
    if kind == "gaps":
        return [gap] * GAPS[duration]
    if kind == "all":
        return [np.concatenate([*parts.values(), gap])] * REPEATS
    return [parts[kind]] * REPEATS


def _stretches(name: str, kind: str, duration: int, added: list[Array]) -> list[int]:
    """Count the samples of each stretch of random motion, which begins and ends gradually."""
    count = samples(duration)
    # long signals keep their duration, short ones are as much longer as their additions
    if kind == "gaps" or duration == max(DURATIONS_S):
        count -= sum(map(len, added))
    if count < samples(2 * FADE_S) * (len(added) + 1):
        raise ValueError(
            f"{name}: its moves take {sum(map(len, added)) / RATE_HZ:.0f} of {duration} s, the "
            "machine's speed or acceleration allows no less"
        )
    edges = np.linspace(0, count, len(added) + 2).astype(int)
    return [int(n) for n in np.diff(edges)]


def _interleaved(random: list[Array], added: list[Array]) -> Array:
    pairs = [part for pair in zip(random, added, strict=False) for part in pair]
    return np.concatenate([*pairs, random[-1]])


def _in_column(column: int, motion: Array) -> Array:
    table = np.zeros((len(motion), 2))
    table[:, column] = motion
    return table


WALKING_MPS: Final = 1.3
RUNNING_MPS: Final = 2.5
PITCH_PERIOD_S: Final = 30.0


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
    # the stream 200 of random numbers is none of a calibration signal's
    sway, pitch, belt = _sway(), _pitch(), _belt(np.random.default_rng((seed, 200)))
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
    """Sway three times to either side, as far and fast as the thesis' machine goes."""
    thesis, far = MachineLimits(), MachineLimits().sway_m
    there = move(far, thesis.sway_m_per_s, thesis.sway_m_per_s2)
    # a return so slow (0.05 m/s, 0.1 m/s²) that it is no perturbation, 7 s after the onset
    back = far + move(-far, 0.05, 0.1)
    held = np.full(samples(7.0) - len(there), far)
    side, rest = np.concatenate([there, held, back]), np.zeros(samples(3.0))
    sides = (part for sign in (1, -1) * 3 for part in (sign * side, rest))
    return np.concatenate([rest, *sides])


def _pitch() -> Array:
    """Four periods of a sine, begun and ended within 3 s."""
    time = np.arange(samples(4 * PITCH_PERIOD_S)) / RATE_HZ
    sine = np.radians(10.0) * np.sin(2 * np.pi * time / PITCH_PERIOD_S)
    return np.asarray(sine * fade(len(time), 3.0))


def _belt(rng: np.random.Generator) -> Array:
    """Random acceleration, then pulses."""
    # a minute about 1 m/s, from which the pulses start too; chosen
    limits, mean = MachineLimits(), 1.0
    sd, reach = float(np.sqrt(BELT_VARIANCE[mean])), limits.belt_m_per_s - mean
    acceleration = USED_SHARE * limits.belt_m_per_s2
    random = mean + random_speed(rng, samples(60.0), sd, reach, acceleration)
    start, pulses, stop = _pulses(mean)
    return np.concatenate([start, random, pulses, stop])


def _pulses(mean: float) -> tuple[Array, Array, Array]:
    """Give starting the belts, pulses from a speed, and stopping the belts."""
    # twelve pulses, a minute; chosen
    pulses = np.tile(pulse(mean, PULSE_MPS2, PULSE_S, PULSE_PERIOD_S), 12)
    start, stop = ramp(0.0, mean, GENTLE_MPS2), ramp(mean, 0.0, GENTLE_MPS2)
    return np.append(0.0, start), pulses, stop


FADE_S: Final = 0.5
"""In which random motion begins and ends, chosen."""
FILTER_SETTLING_S: Final = 20.0
"""Of random motion drawn beyond both ends and discarded: the high-pass settles in it."""
ROUNDING_SAMPLES: Final = 1e-9
"""Of a duration in samples, which adds no sample."""


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
    # white acceleration, integrated twice; the high-pass takes out the drift of both integrals
    x = _high_passed(np.cumsum(np.cumsum(white)) / RATE_HZ**2, min_hz)
    x = _soft_clipped(x, most.range) * fade(count, FADE_S)
    return _scaled_down(_scaled_down(x, 1, most.speed), 2, most.acceleration)


def random_speed(
    rng: np.random.Generator, count: int, sd: float, reach: float, acceleration: float
) -> Array:
    """Draw (count,) deviations from the mean speed from white acceleration."""
    # at 0.4 Hz, chosen likewise
    v = _high_passed(np.cumsum(_white(rng, count, sd, acceleration)) / RATE_HZ, 0.4)
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
    # trapezoid of speed, or a triangle where the way is too short to reach the limit
    fastest = min(speed, float(np.sqrt(far * acceleration)))
    ramp_s = fastest / acceleration
    seconds = far / fastest + ramp_s
    count = int(np.ceil(seconds * RATE_HZ - ROUNDING_SAMPLES))
    after = np.linspace(0, seconds, count + 1)[1:]
    cruised = fastest * np.clip(after - ramp_s, 0, seconds - 2 * ramp_s)
    # way while the speed changes: a t² / 2 from either end
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
    # half a period of a cosine at either end
    return (1 - np.cos(np.pi * np.minimum(to_end, 1))) / 2


def _white(rng: np.random.Generator, count: int, sd: float, most: float) -> Array:
    return np.clip(sd * rng.normal(size=count + 2 * samples(FILTER_SETTLING_S)), -most, most)


def _high_passed(drifting: Array, cutoff_hz: float) -> Array:
    sos = scipy.signal.butter(2, cutoff_hz, "high", fs=RATE_HZ, output="sos")
    settling = samples(FILTER_SETTLING_S)
    passed: Array = scipy.signal.sosfiltfilt(sos, drifting)[settling:-settling]
    return passed


def _soft_clipped(x: Array, reach: float) -> Array:
    """Compress what exceeds a share of the reach smoothly, so that it stays within."""
    # identity up to the knee, then a hyperbolic tangent of equal slope that ends at the reach
    knee = 0.8 * reach
    beyond = np.maximum(np.abs(x) - knee, 0)
    return np.sign(x) * (
        np.minimum(np.abs(x), knee) + (reach - knee) * np.tanh(beyond / (reach - knee))
    )


def _scaled_down(x: Array, order: int, most: float) -> Array:
    """Scale motion down where its derivative of an order exceeds a limit."""
    largest = float(np.max(np.abs(np.diff(x, order)))) * RATE_HZ**order
    return x if largest <= most else x * (most / largest)
