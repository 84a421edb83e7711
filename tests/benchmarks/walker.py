"""A simulated walk of any length, with exact velocities, accelerations and loads."""

from dataclasses import dataclass

import numpy as np

from hbm.coordinates import INDEX, N_Q, TREE
from hbm.kernels.native import kernels
from hbm.markers import Markers
from hbm.poses import marker_positions
from hbm.spatial import Array
from tests.synthetic import RATE_HZ, synthetic_body

STRIDE_HZ = 0.9
HARMONICS = 3
NOISE_M = 0.004
TRANSLATIONS = np.array([c.translates for c in TREE])
MEAN_DEG = {"KneeFlexion": 25, "ElbowFlexion": 30, "HipFlexion": 8, "ShoulderAbduction": 10}
AMPLITUDE_DEG = {
    "KneeFlexion": 25,
    "HipFlexion": 22,
    "ShoulderFlexion": 18,
    "AnklePlantarFlexion": 12,
}
AMPLITUDE_M = 0.02
OTHER_AMPLITUDE_DEG = 5


@dataclass(frozen=True)
class Walk:
    """Coordinates with exact derivatives, measured markers, and the loads on the feet."""

    time: Array
    q: Array
    v: Array
    a: Array
    markers: Markers
    wrenches: dict[str, Array]


def walk(frames: int, seed: int = 1) -> Walk:
    """Every coordinate oscillates with the strides, whose rate varies; 4 mm of marker noise."""
    rng, body = np.random.default_rng(seed), synthetic_body()
    time = np.arange(frames) / RATE_HZ
    phase, rate, change = _strides(time)
    mean, amplitude = _mean_and_amplitude()
    q, v, a = (np.tile(mean * k, (frames, 1)) for k in (1, 0, 0))
    for h in range(1, HARMONICS + 1):
        size = amplitude * rng.uniform(0.5, 1, N_Q) / h**2
        angle = h * phase[:, None] + rng.uniform(0, 2 * np.pi, N_Q)
        q += size * np.sin(angle)
        v += size * h * rate[:, None] * np.cos(angle)
        a += size * h * (change[:, None] * np.cos(angle) - h * rate[:, None] ** 2 * np.sin(angle))
    position = marker_positions(body, q)
    position += rng.normal(scale=NOISE_M, size=position.shape)
    needed = kernels().newton_euler(q, v, a, body.geometry, body.inertia_vector)[1]
    left = 0.5 + 0.5 * np.clip(1.5 * np.sin(phase), -1, 1)[:, None]
    wrenches = {"left_foot": left * needed, "right_foot": (1 - left) * needed}
    return Walk(time, q, v, a, Markers(time, body.markers, position), wrenches)


def _strides(time: Array) -> tuple[Array, Array, Array]:
    """Phase of the stride [rad] and its first two derivatives; the rate varies by 5 %."""
    mean, slow = 2 * np.pi * STRIDE_HZ, 2 * np.pi * 0.07
    phase = mean * (time + 0.05 * np.sin(slow * time) / slow)
    rate = mean * (1 + 0.05 * np.cos(slow * time))
    return phase, rate, -mean * 0.05 * slow * np.sin(slow * time)


def _mean_and_amplitude() -> tuple[Array, Array]:
    """Mean and amplitude of every coordinate."""
    mean, amplitude = (
        np.zeros(N_Q),
        np.where(TRANSLATIONS, AMPLITUDE_M, np.radians(OTHER_AMPLITUDE_DEG)),
    )
    for table, out in ((MEAN_DEG, mean), (AMPLITUDE_DEG, amplitude)):
        for name, value in table.items():
            for side in "RL":
                out[INDEX[side + name]] = np.radians(value)
    mean[INDEX["PelvisZ"]] = 0.95
    return mean, amplitude
