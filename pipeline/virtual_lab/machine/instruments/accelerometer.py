"""Triaxial accelerometers on the platform: where they are, and what they report."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import GRAVITY_MPS2, Array, rotation_about
from pipeline.virtual_lab.faults import AccelerometerFaults

PLACES_M: Final = {
    "rear_left": (-0.90, 0.62, -0.20),
    "front_right": (0.95, -0.58, -0.20),
    "front_left": (0.88, 0.60, -0.06),
    "rear_right": (-0.86, -0.63, -0.32),
}
"""Name and place in the platform frame: the first two at opposite corners, as in the thesis; the
other two, assumed, at other heights, so that they distinguish rotations."""
SENSOR_NAMES: Final = tuple(PLACES_M)


@dataclass(frozen=True, slots=True)
class Accelerometer:
    """A triaxial accelerometer fixed to the platform.

    Attributes
    ----------
    name
        Where it is.
    place
        In the platform frame, (3,) [m].
    sensitivity
        Reading = sensitivity @ specific force + offset, (3, 3); holds gains and misaligned axes.
    offset
        (3,) [m/s²].
    noise
        Standard deviation of white noise from sample to sample [m/s²].
    limit
        Where it clips [m/s²].
    """

    name: str
    place: Array
    sensitivity: Array
    offset: Array
    noise: float
    limit: float

    def measure(self, specific_force: Array, rng: np.random.Generator) -> Array:
        """Report the specific force at its place, (N, 3) [m/s²], by its three channels."""
        measured = specific_force @ self.sensitivity.T + self.offset
        noisy = measured + self.noise * rng.normal(size=measured.shape)
        return np.clip(noisy, -self.limit, self.limit)


def make_accelerometers(
    faults: AccelerometerFaults, rng: np.random.Generator
) -> tuple[Accelerometer, ...]:
    """Draw the accelerometers of a laboratory.

    Parameters
    ----------
    faults
        How many there are, and the standard deviations of their errors.
    rng
        Source of chance.

    Returns
    -------
    tuple of Accelerometer
        In the order of `PLACES_M`.
    """
    sensors = []
    for name, place in list(PLACES_M.items())[: faults.sensors]:
        axis = rng.normal(size=3)
        misalignment = rotation_about(
            axis / np.linalg.norm(axis), np.radians(faults.misalignment_deg) * rng.normal()
        )
        gain = np.diag(1 + faults.gain_share * rng.normal(size=3))
        sensors.append(
            Accelerometer(
                name,
                np.array(place),
                sensitivity=gain @ misalignment,
                offset=faults.offset_mps2 * rng.normal(size=3),
                noise=faults.noise_mps2,
                limit=faults.range_g * GRAVITY_MPS2,
            )
        )
    return tuple(sensors)
