"""What people beside the empty plate do to the platform: walk, run, stand on the boards."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from hbm.spatial import GRAVITY_MPS2, Array

MASS_KG = 75.0
RIGHT_BELT_M = -0.25
BOARDS_M = 0.6


def walking(time: Array, rng: np.random.Generator) -> Array:
    """Give the wrench of someone who walks on the right belt, about the lab origin, (N, 6)."""
    return _steps(time, rng, per_s=1.85, duty=1.25)


def running(time: Array, rng: np.random.Generator) -> Array:
    """Give the wrench of someone who runs on the right belt, about the lab origin, (N, 6)."""
    return _steps(time, rng, per_s=2.7, duty=0.75)


def boarding(time: Array, rng: np.random.Generator) -> Array:
    """Give the wrench of someone who moves about on the boards beside the belts, (N, 6)."""
    rate = 1 / (time[1] - time[0])
    low = butter(2, (0.3, 6.0), "band", fs=rate, output="sos")
    drawn = sosfiltfilt(low, rng.normal(size=(len(time), 5)), axis=0)
    drawn /= drawn.std(axis=0)
    weight = MASS_KG * GRAVITY_MPS2
    force = drawn[:, :3] * weight * [0.1, 0.1, 0.3] - [0, 0, weight]
    side = BOARDS_M * np.tanh(3 * np.sin(2 * np.pi * time / 15))
    point = np.column_stack([0.5 * drawn[:, 3] / 3, side + 0.02 * drawn[:, 4], 0 * time])
    return np.hstack([force, np.cross(point, force)])


def _steps(time: Array, rng: np.random.Generator, *, per_s: float, duty: float) -> Array:
    """Half sines, each step a little different; ``duty`` is contact by step time."""
    weight = MASS_KG * GRAVITY_MPS2
    wrench = np.zeros((len(time), 6))
    starts = np.arange(1.0, time[-1] - 1.0, 1 / per_s)
    for n, start in enumerate(starts + rng.normal(0, 0.01, len(starts))):
        contact = duty / per_s
        rows = slice(*np.searchsorted(time, [start, start + contact]))
        phase = (time[rows] - start) / contact
        rise = weight * np.pi / 2 / duty * (1 + 0.05 * rng.normal()) * np.sin(np.pi * phase)
        brake = -0.18 * rise * np.cos(np.pi * phase)
        push = 0.05 * (-1) ** n * rise
        force = -np.column_stack([brake, push, rise])
        point = np.column_stack(
            [0.3 - 0.6 * phase, RIGHT_BELT_M + 0.08 * (-1) ** n + 0 * phase, 0 * phase]
        )
        wrench[rows] += np.hstack([force, np.cross(point, force)])
    return wrench
