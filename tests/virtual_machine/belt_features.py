"""What recordings of an unloaded belt are compared by: spectra, and lines that turn with it."""

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from hbm.spatial import Array
from tests.virtual_machine.belt_recording import RATE_HZ, BeltRecording

WINDOW: Final = 512
HOP: Final = 128
SETTLED: Final = 200
"""Samples of a segment of the spectra, their distance, and those left out at both ends."""
BANDS_HZ: Final = np.r_[np.arange(0.6, 9.7), np.arange(11.0, 25.0)]
"""Edges; between 9.6 and 11 Hz the command holds nothing."""
LOW_HZ: Final = 9.6
COHERENT_HZ: Final = 16.0
"""Below which less than a third of the moment is unrelated to the speed. Above, the recorded speed
is mostly noise of its channel."""
FIR_SAMPLES: Final = 30
"""Before and after, of the filter that takes everything linear out of the moment."""
TURN_STEP_M: Final = 0.01


class Features(NamedTuple):
    """Of bands of frequency, (B,) each, logarithms and radians.

    Attributes
    ----------
    gain, phase
        Of pitch moment by reported acceleration, where they are coherent.
    acceleration, moment
        Of the power spectra of reported acceleration, and of the moment where they are coherent.
    left_over
        Of the power of what is unrelated in the moment, below `LOW_HZ`.
    """

    gain: Array
    phase: Array
    acceleration: Array
    moment: Array
    left_over: Array


def segments(recording: BeltRecording) -> tuple[Array, Array]:
    """Give the spectra of overlapping segments of speed and moment, (S, WINDOW / 2 + 1) each."""
    window = np.hanning(WINDOW)
    scale = np.sqrt(2 / (RATE_HZ * np.sum(window**2)))
    starts = range(SETTLED, len(recording.speed) - SETTLED - WINDOW, HOP)

    def spectra(x: Array) -> Array:
        parts = np.stack([x[k : k + WINDOW] for k in starts])
        return scale * np.fft.rfft(window * (parts - parts.mean(axis=1, keepdims=True)))

    return spectra(recording.speed), spectra(recording.moment)


def features(speed: Array, moment: Array) -> Features:
    """Average the spectra of segments over time and bands."""
    f = np.fft.rfftfreq(WINDOW, 1 / RATE_HZ)
    acceleration = 2j * np.pi * f * speed
    aa, mm = (np.mean(np.abs(x) ** 2, axis=0) for x in (acceleration, moment))
    am = np.mean(acceleration.conj() * moment, axis=0)
    rest = mm[1:] - np.abs(am[1:]) ** 2 / aa[1:]
    edges = pairwise(BANDS_HZ)
    kept = [(f >= lo) & (f < hi) for lo, hi in edges if not LOW_HZ <= lo + 0.01 < 11]
    coherent = [band for band in kept if f[band].max() < COHERENT_HZ]
    low = [band for band in kept if f[band].max() < LOW_HZ]
    response = np.array([am[band].sum() / aa[band].sum() for band in coherent])
    return Features(
        np.log(np.abs(response)),
        np.angle(response),
        np.log([aa[band].mean() for band in kept]),
        np.log([mm[band].mean() for band in coherent]),
        np.log([rest[band[1:]].mean() for band in low]),
    )


def left_over(recording: BeltRecording) -> tuple[Array, Array]:
    """Give the moment without its best linear prediction from the speed, and the smooth speed."""
    sos = butter(3, 20, fs=RATE_HZ, output="sos")
    speed = sosfiltfilt(sos, recording.speed)
    acceleration = np.gradient(speed, 1 / RATE_HZ)
    lags = range(-FIR_SAMPLES, FIR_SAMPLES + 1)
    basis = np.column_stack([np.roll(acceleration, k) for k in lags] + [speed, speed**0])
    inner = slice(SETTLED, -SETTLED)
    weights = np.linalg.lstsq(basis[inner], recording.moment[inner])[0]
    return recording.moment - basis @ weights, speed


def find_line(rest: Array, speed: Array, near_turns_per_m: float, within: float) -> float:
    """Find the strongest line near a number of turns per metre."""
    travel = np.cumsum(speed) / RATE_HZ
    even = np.arange(travel[SETTLED], travel[-SETTLED], TURN_STEP_M)
    wave = np.interp(even, travel, rest) * np.hanning(len(even))
    step = 0.1 / (even[-1] - even[0])
    turns = near_turns_per_m + np.arange(-within, within, step)
    power = [abs(np.sum(wave * np.exp(-2j * np.pi * t * even))) for t in turns]
    return float(turns[int(np.argmax(power))])


def line_amplitudes(rest: Array, speed: Array, turns_per_m: float, blocks: int) -> Array:
    """Fit a line that grows with the square of the speed to blocks of time, (blocks,)."""
    angle = 2 * np.pi * turns_per_m * np.cumsum(speed) / RATE_HZ
    wave = speed**2 * np.exp(-1j * angle)
    parts = np.array_split(np.arange(SETTLED, len(rest) - SETTLED), blocks)
    return np.array([abs(2 * rest[p] @ wave[p]) / np.sum(speed[p] ** 4) for p in parts])
