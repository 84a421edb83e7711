"""Load cells and accelerometers: what they make of what is really there."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import GRAVITY_MPS2, Array, rotation_about
from pipeline.virtual_lab.faults import AccelerometerFaults, PlateFaults
from pipeline.virtual_lab.machine.treadmill import PlatformMotion, specific_force

PLACES: Final = {
    "rear_left": (-0.90, 0.62, -0.20),
    "front_right": (0.95, -0.58, -0.20),
    "front_left": (0.88, 0.60, -0.06),
    "rear_right": (-0.86, -0.63, -0.32),
}


@dataclass(frozen=True, slots=True)
class LoadCells:
    """One plate's calibration errors, drawn once for a laboratory.

    Attributes
    ----------
    gain
        Cross-talk and gain: measured = gain @ true, (6, 6).
    offset
        Zero error, (6,) [N, N·m].
    drift
        Change of the zero, (6,) per second.
    noise
        Standard deviation of white noise, (6,) [N, N·m].
    """

    gain: Array
    offset: Array
    drift: Array
    noise: Array

    def measure(self, wrench: Array, time: Array, rng: np.random.Generator) -> Array:
        """Give what the plate reports for true wrenches, (N, 6) [N, N·m]."""
        told = wrench @ self.gain.T + self.offset + time[:, None] * self.drift
        return np.asarray(told + rng.normal(size=wrench.shape) * self.noise)


def make_load_cells(faults: PlateFaults, rng: np.random.Generator) -> LoadCells:
    """Draw a plate's errors.

    Parameters
    ----------
    faults
        Their sizes.
    rng
        Source of chance.

    Returns
    -------
    LoadCells
        Moments err by a third of what forces do, per newton and newton metre.
    """
    scale = np.array([1.0, 1.0, 1.0, 1 / 3, 1 / 3, 1 / 3])
    gain = np.eye(6) + faults.cross_talk * rng.normal(size=(6, 6)) * scale[:, None]
    return LoadCells(
        gain=gain,
        offset=faults.offset_n * rng.normal(size=6) * scale,
        drift=faults.drift_n_per_min / 60 * rng.normal(size=6) * scale,
        noise=np.repeat([faults.force_noise_n, faults.moment_noise_nm], 3),
    )


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
        Reading = sensitivity @ specific force + offset, (3, 3); holds its crooked axes.
    offset
        (3,) [m/s²].
    noise
        Standard deviation of white noise [m/s²].
    limit
        Where it clips [m/s²].
    """

    name: str
    place: Array
    sensitivity: Array
    offset: Array
    noise: float
    limit: float

    def read(self, motion: PlatformMotion, rng: np.random.Generator) -> Array:
        """Give its three channels, (N, 3) [m/s²]."""
        felt = specific_force(motion, self.place) @ self.sensitivity.T + self.offset
        noisy = felt + self.noise * rng.normal(size=felt.shape)
        return np.clip(noisy, -self.limit, self.limit)


def make_accelerometers(
    faults: AccelerometerFaults, rng: np.random.Generator
) -> tuple[Accelerometer, ...]:
    """Draw the accelerometers of a laboratory.

    Parameters
    ----------
    faults
        How many there are, and the sizes of their errors.
    rng
        Source of chance.

    Returns
    -------
    tuple of Accelerometer
        Rear left and front right first, as in the thesis.
    """
    sensors = []
    for name, place in list(PLACES.items())[: faults.sensors]:
        axis = rng.normal(size=3)
        crooked = rotation_about(
            axis / np.linalg.norm(axis), np.radians(faults.misalignment_deg) * rng.normal()
        )
        gain = np.diag(1 + faults.gain_share * rng.normal(size=3))
        offset = faults.offset_mps2 * rng.normal(size=3)
        limit = faults.range_g * GRAVITY_MPS2
        place_m = np.array(place)
        sensors.append(
            Accelerometer(name, place_m, gain @ crooked, offset, faults.noise_mps2, limit)
        )
    return tuple(sensors)
