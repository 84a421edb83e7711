"""A person who walks on a treadmill for as long as it takes, with exact rates and loads."""

from dataclasses import dataclass

import numpy as np

from hbm.coordinates import INDEX, TREE, N
from hbm.dynamics import filter_motion
from hbm.kernels.native import kernels
from hbm.kinematics import solve_ik
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.poses import marker_positions
from hbm.spatial import Array
from tests.synthetic import RATE_HZ, synthetic_body

STRIDE_HZ = 0.9
HARMONICS = 3
NOISE_M = 0.004
SLIDES = np.array([c.translates for c in TREE])
MEAN_DEG = {"KneeFlexion": 25, "ElbowFlexion": 30, "HipFlexion": 8, "ShoulderAbduction": 10}
SWING_DEG = {"KneeFlexion": 25, "HipFlexion": 22, "ShoulderFlexion": 18, "AnklePlantarFlexion": 12}
SWING_M = 0.02
OTHER_DEG = 5


@dataclass(frozen=True)
class Walk:
    """Coordinates with exact derivatives, measured markers, and the loads on the feet."""

    time: Array
    q: Array
    v: Array
    a: Array
    markers: Markers
    wrenches: dict[str, Array]

    def first(self, frames: int) -> "Walk":
        """Give the same walk, stopped earlier."""
        loads = {foot: wrench[:frames] for foot, wrench in self.wrenches.items()}
        parts = (x[:frames] for x in (self.time, self.q, self.v, self.a))
        return Walk(*parts, first_frames(self.markers, frames), loads)


def first_frames(markers: Markers, frames: int) -> Markers:
    return Markers(markers.time[:frames], markers.names, markers.position[:frames])


def walk(frames: int, seed: int = 1) -> Walk:
    """Every coordinate swings with the strides, whose rate wanders; 4 mm of marker noise."""
    rng, body = np.random.default_rng(seed), synthetic_body()
    time = np.arange(frames) / RATE_HZ
    phase, rate, change = _strides(time)
    mean, swing = _habits()
    q, v, a = (np.tile(mean * k, (frames, 1)) for k in (1, 0, 0))
    for h in range(1, HARMONICS + 1):
        size = swing * rng.uniform(0.5, 1, N) / h**2
        angle = h * phase[:, None] + rng.uniform(0, 2 * np.pi, N)
        q += size * np.sin(angle)
        v += size * h * rate[:, None] * np.cos(angle)
        a += size * h * (change[:, None] * np.cos(angle) - h * rate[:, None] ** 2 * np.sin(angle))
    position = marker_positions(body, q)
    position += rng.normal(scale=NOISE_M, size=position.shape)
    needed = kernels().newton_euler(q, v, a, body.geometry, body.inertia_vector)[1]
    left = 0.5 + 0.5 * np.clip(1.5 * np.sin(phase), -1, 1)[:, None]
    wrenches = {"left_foot": left * needed, "right_foot": (1 - left) * needed}
    return Walk(time, q, v, a, Markers(time, body.markers, position), wrenches)


def solved(trial: Walk) -> Motion:
    """Give the filtered motion that the inverse dynamics of everyone starts from."""
    return filter_motion(solve_ik(synthetic_body(), trial.markers))


def with_random_gaps(markers: Markers, share: float, seed: int = 2) -> Markers:
    """Take single samples away."""
    gone = np.random.default_rng(seed).random(markers.position.shape[:2]) < share
    return _without(markers, gone)


def with_dropouts(markers: Markers, seed: int = 3) -> Markers:
    """In every second another marker is out of sight, for the whole of it."""
    rng, second = np.random.default_rng(seed), np.floor(markers.time).astype(int)
    victim = rng.integers(0, len(markers.names), second[-1] + 1)
    return _without(markers, victim[second][:, None] == np.arange(len(markers.names)))


def _without(markers: Markers, gone: Array) -> Markers:
    position = np.where(gone[..., None], np.nan, markers.position)
    return Markers(markers.time, markers.names, position)


def _strides(time: Array) -> tuple[Array, Array, Array]:
    """Phase of the stride [rad], its rate and the rate's change; the rate wanders by 5 %."""
    mean, slow = 2 * np.pi * STRIDE_HZ, 2 * np.pi * 0.07
    phase = mean * (time + 0.05 * np.sin(slow * time) / slow)
    rate = mean * (1 + 0.05 * np.cos(slow * time))
    return phase, rate, -mean * 0.05 * slow * np.sin(slow * time)


def _habits() -> tuple[Array, Array]:
    """Mean and swing of every coordinate."""
    mean, swing = np.zeros(N), np.where(SLIDES, SWING_M, np.radians(OTHER_DEG))
    for table, out in ((MEAN_DEG, mean), (SWING_DEG, swing)):
        for name, value in table.items():
            for side in "RL":
                out[INDEX[side + name]] = np.radians(value)
    mean[INDEX["PelvisZ"]] = 0.95
    return mean, swing
