"""Soft tissue artefact: the skin carries the markers away from the bones."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.signal import lfilter

from hbm.spatial import Array
from pipeline.virtual_lab.faults import CameraFaults

SKIN_RMS_M: Final = {
    "pelvis": 0.004,
    "thorax": 0.004,
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
Gait Posture 21:212; Peters et al. 2010, Gait Posture 31:1); head, hands and feet, for which no
review has a value, are assumed small."""
PERIODIC_SHARE: Final = 0.8
"""Share of the displacement's variance that repeats in every gait cycle; assumed, as the artefact
is largely reproducible within a subject (Leardini et al. 2005)."""
COMMON_SHARE: Final = 0.5
"""Share of that periodic variance which all markers of a segment have in common; assumed."""
HARMONIC_AMPLITUDES: Final = ((1, 0.8), (2, 0.5), (3, 0.33))
"""Harmonics of the gait cycle and their RMS, whose squares add up to 1; assumed, falling as those
of the joint angles do."""
CORRELATION_S: Final = 0.15
"""Time constant of the part that does not repeat; assumed: soft tissue oscillates within a tenth of
a stride or two."""
WALKING_STRIDES_PER_S: Final = 0.7
"""Stride rate from which on the artefact has its full size; slow walking."""


def displace_markers(
    position: Array,
    segment: tuple[str, ...],
    rotation: Mapping[str, Array],
    phase: Array,
    faults: CameraFaults,
    rng: np.random.Generator,
    rate_hz: float,
) -> Array:
    """Displace markers with the skin under them, those of a segment partly together.

    Parameters
    ----------
    position
        Positions of the markers if they were fixed to the bones, (T, M, 3) [m].
    segment
        Segment of each marker, (M,).
    rotation
        Segment -> its orientation, (T, 3, 3).
    phase
        Phase of the right gait cycle, (T,) [strides]; constant while standing.
    faults
        ``skin_scale`` multiplies the published magnitudes.
    rng
        Source of chance.
    rate_hz
        Frame rate [Hz].

    Returns
    -------
    Array
        Positions of the markers on the skin, (T, M, 3) [m].
    """
    if faults.skin_scale == 0:
        return position
    displaced = position.copy()
    angle = 2 * np.pi * phase[:, None]
    stride_rate = np.abs(np.gradient(phase)) * rate_hz
    walking = np.clip(stride_rate / WALKING_STRIDES_PER_S, 0, 1)
    for name in dict.fromkeys(segment):
        part = name.split("_", 1)[1] if name.startswith(("left_", "right_")) else name
        size = faults.skin_scale * SKIN_RMS_M[part]
        common = _periodic(angle, rng)
        for k in (k for k, s in enumerate(segment) if s == name):
            periodic = np.sqrt(COMMON_SHARE) * (common + _periodic(angle, rng))
            irregular = _irregular(len(position), rng, rate_hz)
            shift = np.sqrt(PERIODIC_SHARE) * periodic + np.sqrt(1 - PERIODIC_SHARE) * irregular
            shift *= size / np.sqrt(3) * walking[:, None]
            displaced[:, k] += (rotation[name] @ shift[..., None])[..., 0]
    return displaced


def _periodic(angle: Array, rng: np.random.Generator) -> Array:
    """Draw a displacement that repeats with the gait cycle, unit variance per axis, (T, 3)."""
    wave = np.zeros((len(angle), 3))
    for harmonic, amplitude in HARMONIC_AMPLITUDES:
        start = rng.uniform(0, 2 * np.pi, 3)
        wave += np.sqrt(2) * amplitude * np.cos(harmonic * angle + start)
    return wave


def _irregular(frames: int, rng: np.random.Generator, rate_hz: float) -> Array:
    """Draw low-passed white noise of unit variance per axis, (T, 3)."""
    keep = np.exp(-1 / (CORRELATION_S * rate_hz))
    noise = rng.normal(size=(frames, 3))
    once = lfilter([1 - keep], [1, -keep], noise, axis=0)
    twice = lfilter([1 - keep], [1, -keep], once, axis=0)
    variance = (1 - keep) ** 4 * (1 + keep**2) / (1 - keep**2) ** 3
    return np.asarray(twice / np.sqrt(variance))
