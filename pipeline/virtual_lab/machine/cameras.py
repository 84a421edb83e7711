"""Cameras and skin: where the markers are seen instead of where the bones carry them."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.signal import lfilter

from hbm.spatial import Array
from pipeline.virtual_lab.faults import CameraFaults

SKIN_M: Final = {
    "pelvis": 0.004,
    "trunk": 0.004,
    "head": 0.001,
    "shoulder": 0.005,
    "upper_arm": 0.006,
    "forearm": 0.004,
    "hand": 0.002,
    "thigh": 0.009,
    "shank": 0.005,
    "foot": 0.002,
    "toes": 0.002,
}
"""RMS displacement of skin markers in walking: thigh the most, then shank (Leardini et al. 2005,
Gait Posture 21:212; Peters et al. 2010, Gait Posture 31:1); head, hands and feet, which no review
gives, are taken small."""
IN_STEP: Final = 0.8
"""Share of the skin's variance that repeats with every stride."""
WOBBLE_S: Final = 0.15


def move_skin(
    position: Array,
    segment: tuple[str, ...],
    rotation: Mapping[str, Array],
    phase: Array,
    faults: CameraFaults,
    rng: np.random.Generator,
    rate_hz: float,
) -> Array:
    """Displace markers with the skin under them, each segment's markers together and apart.

    Parameters
    ----------
    position
        Where the bones carry the markers, (T, M, 3) [m].
    segment
        Segment of each marker, (M,).
    rotation
        Segment -> its orientation, (T, 3, 3).
    phase
        Of the gait cycle, (T,) [strides]; constant while standing.
    faults
        ``skin_scale`` scales the published magnitudes.
    rng
        Source of chance.
    rate_hz
        Of the frames [Hz].

    Returns
    -------
    Array
        Where the markers are, (T, M, 3) [m].
    """
    if faults.skin_scale == 0:
        return position
    moved = position.copy()
    turn = 2 * np.pi * phase[:, None]
    walking = np.clip(np.abs(np.gradient(phase)) * rate_hz / 0.7, 0, 1)
    for name in dict.fromkeys(segment):
        plain = name.split("_", 1)[1] if name.startswith(("left_", "right_")) else name
        size = faults.skin_scale * SKIN_M[plain]
        own = [k for k, s in enumerate(segment) if s == name]
        together = _stride_wave(turn, rng)
        for k in own:
            repeated = np.sqrt(0.5) * (together + _stride_wave(turn, rng))
            wobble = _wobble(len(position), rng, rate_hz)
            shift = np.sqrt(IN_STEP) * repeated + np.sqrt(1 - IN_STEP) * wobble
            shift *= size / np.sqrt(3) * walking[:, None]
            moved[:, k] += (rotation[name] @ shift[..., None])[..., 0]
    return moved


def see(position: Array, faults: CameraFaults, rng: np.random.Generator, rate_hz: float) -> Array:
    """Give what cameras report: noise, gaps (NaN) and markers taken for one another.

    Parameters
    ----------
    position
        Where the markers are, (T, M, 3) [m].
    faults
        Of the cameras.
    rng
        Source of chance.
    rate_hz
        Of the frames [Hz].

    Returns
    -------
    Array
        Reported positions, (T, M, 3) [m].
    """
    frames, markers = position.shape[:2]
    seen = position + faults.noise_m * rng.normal(size=position.shape)
    minutes = frames / rate_hz / 60
    for _ in range(rng.poisson(faults.swaps_per_minute * minutes)):
        start, marker = rng.integers(frames), int(rng.integers(markers))
        away = np.linalg.norm(position[start] - position[start, marker], axis=1)
        away[marker] = np.inf
        stop, pair = start + round(0.3 * rate_hz), [marker, int(np.argmin(away))]
        seen[start:stop, pair] = seen[start:stop, pair[::-1]]
    for _ in range(rng.poisson(faults.gaps_per_minute * minutes * markers / 46)):
        start = rng.integers(frames)
        length = max(1, round(rng.exponential(faults.gap_s) * rate_hz))
        seen[start : start + length, rng.integers(markers)] = np.nan
    return seen


def _stride_wave(turn: Array, rng: np.random.Generator) -> Array:
    """Draw a periodic displacement of unit variance per axis, (T, 3)."""
    wave = np.zeros((len(turn), 3))
    for harmonic, weight in ((1, 0.8), (2, 0.5), (3, 0.33)):
        start = rng.uniform(0, 2 * np.pi, 3)
        wave += np.sqrt(2) * weight * np.cos(harmonic * turn + start)
    return wave


def _wobble(frames: int, rng: np.random.Generator, rate_hz: float) -> Array:
    """Draw a random displacement that remembers itself for a while, unit variance, (T, 3)."""
    keep = np.exp(-1 / (WOBBLE_S * rate_hz))
    noise = rng.normal(size=(frames, 3))
    once = lfilter([1 - keep], [1, -keep], noise, axis=0)
    twice = lfilter([1 - keep], [1, -keep], once, axis=0)
    variance = (1 - keep) ** 4 * (1 + keep**2) / (1 - keep**2) ** 3
    return np.asarray(twice / np.sqrt(variance))
