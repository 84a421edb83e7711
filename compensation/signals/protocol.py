"""The signals of the thesis: calibration of pitch, sway and belts, and validation.

Source: van de Loosdrecht (2018), E.1 and E.2; random motion after Hnat et al. (2018) and Hnat and
van den Bogert (2014). What the thesis leaves open is chosen here and marked as chosen.

Deviations from the original: random motion bends smoothly towards its range instead of being
clipped, and moves are of least jerk, so that accelerations stay within the machine's; every signal
begins and ends at rest.
"""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from compensation.signals.signal import MachineLimits, Signal
from hbm.spatial import Array

RATE_HZ = 100.0
PLATFORM_KINDS = (
    "random",
    "square_sway",
    "gaps",
    "square_pitch",
    "constant_sway",
    "constant_pitch",
    "all",
)
BELT_KINDS = ("random", "gaps", "square", "constant", "all")
DURATIONS_S = (60, 300)
BELT_VARIANCE = {1.0: 25.0, 2.0: 2000.0}  # mean speed [m/s] -> variance of acceleration [m²/s⁴]

_USED = 0.95  # share of range and of belt acceleration that random motion and moves use
_SWAY_SD, _PITCH_SD_DEG = 0.707, 127.0  # of the white acceleration [m/s², °/s²]
_GAPS, _REPEATS = {60: 3, 300: 15}, 3
_PLATFORM_SLOWEST_HZ, _BELT_SLOWEST_HZ = 0.2, 0.4  # high-pass, chosen: motion fills its range
_FADE_S, _HOLD_S, _CONSTANT_S, _GAP_S = 0.5, 1.5, 5.0, 3.0  # chosen
_SETTLE_S = 20.0  # drawn and thrown away at both ends, for the filter
_GENTLE = 1.0  # m/s², chosen: belts between constant speeds


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
        ``<kind>_<duration>s_<speed>mps``. In the long ones, and in those with gaps, what is added
        is part of the duration; in the short ones it comes on top.
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
        1 or 2 [m/s]; the variance of the acceleration goes with it.
    limits
        Of the machine; the thesis' where None.

    Returns
    -------
    tuple[Signal, ...]
        `BELT_KINDS` for 60 s, then for 300 s, at 100 Hz, named
        ``belt_<kind>_<duration>s_<speed>mps``; durations as `pitch_and_sway_signals`, and the
        run-up and run-down on top.

    Raises
    ------
    ValueError
        Another mean speed.
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
        At 100 Hz. Sway: 5 cm to alternate sides at up to 0.31 m/s, back slowly after 7 s, belts
        1.3 m/s. Pitch: ± 10° in 30 s, belts 1.3 m/s. Running: belts 2.5 m/s. Boarding: all at
        rest. Belt: 0.15 s of 12 m/s² and back, every 5 s, from 1 m/s (chosen).
    """
    there, back = _move(0.05, 0.31, 5.0), 0.05 + _move(-0.05, 0.05, 5.0)
    side = np.concatenate([there, np.full(700 - len(there), 0.05), back])
    still = np.zeros(300)
    sway = np.concatenate([still, *(part for sign in (1, -1) * 3 for part in (sign * side, still))])
    time = np.arange(12000) / RATE_HZ
    pitch = np.radians(10) * np.sin(2 * np.pi * time / 30) * _fade(len(time), 3.0)
    pulse = np.concatenate([_ramp(1.0, 2.8, 12.0), _ramp(2.8, 1.0, 12.0)])
    every_5_s = np.pad(pulse, (0, 500 - len(pulse)), constant_values=1.0)
    belt = np.concatenate([_ramp(0.0, 1.0, _GENTLE), *[every_5_s] * 12, _ramp(1.0, 0.0, _GENTLE)])
    rest = np.zeros(6000)
    return (
        Signal("sway", RATE_HZ, sway, 0 * sway, 0 * sway + 1.3),
        Signal("pitch", RATE_HZ, 0 * pitch, pitch, 0 * pitch + 1.3),
        Signal("running", RATE_HZ, rest, rest, rest + 2.5),
        Signal("boarding", RATE_HZ, rest, rest, rest),
        Signal("belt", RATE_HZ, 0 * belt, 0 * belt, belt),
    )


def _platform_signal(
    index: int, kind: str, duration: int, seed: int, belt_speed: float, limits: MachineLimits
) -> Signal:
    rng = np.random.default_rng((seed, index, duration))
    sway = np.array([_USED * limits.sway_m, limits.sway_m_per_s, limits.sway_m_per_s2])
    pitch = np.radians([_USED * limits.pitch_deg, limits.pitch_deg_per_s, limits.pitch_deg_per_s2])
    square, constant = ((1.0, -1.0), _HOLD_S), ((1.0, 0.5), _CONSTANT_S)
    courses = {
        "square_sway": _in_column(0, _positions(*square, sway)),
        "square_pitch": _in_column(1, _positions(*square, pitch)),
        "constant_sway": _in_column(0, _positions(*constant, sway)),
        "constant_pitch": _in_column(1, _positions(*constant, pitch)),
    }
    added = _additions(kind, duration, courses, gap=np.zeros((_samples(_GAP_S), 2)))
    random = [
        np.column_stack(
            [
                _random_position(rng, count, _SWAY_SD, sway),
                _random_position(rng, count, np.radians(_PITCH_SD_DEG), pitch),
            ]
        )
        for count in _shares(kind, duration, added)
    ]
    sway_course, pitch_course = _interleaved(random, added).T
    belt = np.full(len(sway_course), float(belt_speed))
    name = f"{kind}_{duration}s_{belt_speed:g}mps"
    return Signal(name, RATE_HZ, sway_course, pitch_course, belt)


def _belt_signal(
    index: int, kind: str, duration: int, seed: int, mean: float, limits: MachineLimits
) -> Signal:
    rng = np.random.default_rng((seed, 100 + index, duration))
    hardest, reach = _USED * limits.belt_m_per_s2, limits.belt_m_per_s - mean
    courses = {
        "square": _speeds(mean, (3.0, -3.0), _HOLD_S, hardest),
        "constant": _speeds(mean, (-1.0, -0.3), _CONSTANT_S, _GENTLE),
    }
    added = _additions(kind, duration, courses, gap=np.full(_samples(_GAP_S), mean))
    sd = float(np.sqrt(BELT_VARIANCE[mean]))
    random = [
        mean + _random_speed(rng, count, sd, reach, hardest)
        for count in _shares(kind, duration, added)
    ]
    start, stop = _ramp(0.0, mean, _GENTLE), _ramp(mean, 0.0, _GENTLE)
    speed = np.concatenate([[0.0], start, _interleaved(random, added), stop])
    rest = np.zeros(len(speed))
    return Signal(f"belt_{kind}_{duration}s_{mean:g}mps", RATE_HZ, rest, rest, speed)


def _additions(kind: str, duration: int, courses: dict[str, Array], gap: Array) -> list[Array]:
    """Give what comes between stretches of random motion, ends matching."""
    if kind == "random":
        return []
    if kind == "gaps":
        return [gap] * _GAPS[duration]
    if kind == "all":
        return [np.concatenate([*courses.values(), gap])] * _REPEATS
    return [courses[kind]] * _REPEATS


def _shares(kind: str, duration: int, added: list[Array]) -> list[int]:
    """Count the samples of each stretch of random motion."""
    count = _samples(duration)
    if kind == "gaps" or duration == max(DURATIONS_S):
        count -= sum(map(len, added))
    edges = np.linspace(0, count, len(added) + 2).astype(int)
    return [int(n) for n in np.diff(edges)]


def _interleaved(random: list[Array], added: list[Array]) -> Array:
    pairs = [part for pair in zip(random, added, strict=False) for part in pair]
    return np.concatenate([*pairs, random[-1]])


def _in_column(column: int, course: Array) -> Array:
    table = np.zeros((len(course), 2))
    table[:, column] = course
    return table


def _samples(duration_s: float) -> int:
    return round(duration_s * RATE_HZ)


# Random motion: white acceleration, integrated, high-passed both ways, kept within `most` ---------


def _random_position(rng: np.random.Generator, count: int, sd: float, most: Array) -> Array:
    """Draw (count,) positions; most = range, speed, acceleration."""
    reach, fastest, hardest = (float(value) for value in most)
    white = _white(rng, count, sd, hardest)
    x = _high_passed(np.cumsum(np.cumsum(white)) / RATE_HZ**2, _PLATFORM_SLOWEST_HZ)
    x = _bent(x, reach) * _fade(count, _FADE_S)
    return _slowed(_slowed(x, 1, fastest), 2, hardest)


def _random_speed(
    rng: np.random.Generator, count: int, sd: float, reach: float, hardest: float
) -> Array:
    """Draw (count,) deviations from the mean speed."""
    v = _high_passed(np.cumsum(_white(rng, count, sd, hardest)) / RATE_HZ, _BELT_SLOWEST_HZ)
    return _slowed(_bent(v, reach) * _fade(count, _FADE_S), 1, hardest)


def _slowed(x: Array, order: int, most: float) -> Array:
    """Scale a course down where its derivative of an order exceeds what is allowed."""
    largest = float(np.max(np.abs(np.diff(x, order)))) * RATE_HZ**order
    return x if largest <= most else x * (most / largest)


def _white(rng: np.random.Generator, count: int, sd: float, most: float) -> Array:
    return np.clip(sd * rng.normal(size=count + 2 * _samples(_SETTLE_S)), -most, most)


def _high_passed(drifting: Array, slowest_hz: float) -> Array:
    sos = butter(2, slowest_hz, "high", fs=RATE_HZ, output="sos")
    settle = _samples(_SETTLE_S)
    passed: Array = sosfiltfilt(sos, drifting)[settle:-settle]
    return passed


def _bent(x: Array, reach: float) -> Array:
    """Bend what goes beyond 80 % of the reach smoothly, so that it stays within."""
    knee = 0.8 * reach
    beyond = np.maximum(np.abs(x) - knee, 0)
    return np.sign(x) * (
        np.minimum(np.abs(x), knee) + (reach - knee) * np.tanh(beyond / (reach - knee))
    )


def _fade(count: int, seconds: float) -> Array:
    """Give weights that rise from 0 to 1 and fall again, without a jump in speed."""
    at = np.arange(count) / RATE_HZ
    to_end = np.minimum(at, at[::-1]) / seconds
    return (1 - np.cos(np.pi * np.minimum(to_end, 1))) / 2


# Moves between positions and between speeds ------------------------------------------------------


def _positions(levels: tuple[float, ...], hold_s: float, most: Array) -> Array:
    """Go from neutral through the levels (shares of the range), hold each, and back."""
    reach, fastest, hardest = (float(value) for value in most)
    parts, at = [], 0.0
    for level in (*levels, 0.0):
        move = at + _move(level * reach - at, fastest, hardest)
        at = level * reach
        parts += [move, np.full(_samples(hold_s), at)]
    return np.concatenate(parts)


def _move(distance: float, fastest: float, hardest: float) -> Array:
    """Least-jerk move over a distance (Flash and Hogan 1985), without its first sample."""
    seconds = max(
        15 / 8 * abs(distance) / fastest, np.sqrt(10 / np.sqrt(3) * abs(distance) / hardest)
    )
    count = int(np.ceil(seconds * RATE_HZ))
    s = np.arange(1, count + 1) / count
    position: Array = distance * s**3 * (10 - 15 * s + 6 * s**2)
    return position


def _speeds(mean: float, levels: tuple[float, ...], hold_s: float, hardest: float) -> Array:
    """Go from the mean speed through the levels, hold each, and back."""
    parts, at = [], mean
    for level in (*levels, mean):
        parts += [_ramp(at, level, hardest), np.full(_samples(hold_s), level)]
        at = level
    return np.concatenate(parts)


def _ramp(start: float, stop: float, acceleration: float) -> Array:
    """Change of speed at constant acceleration, without its first sample."""
    count = int(np.ceil(abs(stop - start) / acceleration * RATE_HZ - 1e-9))
    return np.linspace(start, stop, count + 1)[1:]
