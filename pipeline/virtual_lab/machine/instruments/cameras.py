"""The motion capture system: noise, gaps and mislabelled markers."""

from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.faults import CameraFaults

SWAP_S: Final = 0.3
"""How long two markers keep each other's label; assumed: until a labelling program notices."""
MARKERS_OF_A_PERSON: Final = 46
"""Number of markers to which ``gaps_per_minute`` refers: those of the HBM2 set."""


def measure_markers(
    position: Array, faults: CameraFaults, rng: np.random.Generator, rate_hz: float
) -> Array:
    """Report marker positions with noise, gaps (NaN) and swapped labels.

    Parameters
    ----------
    position
        True positions, (T, M, 3) [m].
    faults
        Sizes and rates of the errors.
    rng
        Source of chance.
    rate_hz
        Frame rate [Hz].

    Returns
    -------
    Array
        Reported positions, (T, M, 3) [m].
    """
    frames, markers = position.shape[:2]
    measured = position + faults.noise_m * rng.normal(size=position.shape)
    minutes = frames / rate_hz / 60
    for _ in range(rng.poisson(faults.swaps_per_minute * minutes)):
        start, marker = rng.integers(frames), int(rng.integers(markers))
        distance = np.linalg.norm(position[start] - position[start, marker], axis=1)
        distance[marker] = np.inf
        stop, pair = start + round(SWAP_S * rate_hz), [marker, int(np.argmin(distance))]
        measured[start:stop, pair] = measured[start:stop, pair[::-1]]
    for _ in range(rng.poisson(faults.gaps_per_minute * minutes * markers / MARKERS_OF_A_PERSON)):
        start = rng.integers(frames)
        length = max(1, round(rng.exponential(faults.gap_s) * rate_hz))
        measured[start : start + length, rng.integers(markers)] = np.nan
    return measured
