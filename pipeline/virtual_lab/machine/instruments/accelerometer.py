"""Triaxial accelerometers on the platform: where they are, and what they report."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from hbm.spatial import GRAVITY_MPS2, Array, rotation_about
from pipeline.virtual_lab.faults import AccelerometerFaults
from pipeline.virtual_lab.machine.instruments.sampling import (
    Clock,
    add_noise,
    chunks,
    folded,
    noise_sd_at,
    quantise,
)

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
        Reading = sensitivity @ specific force + offset, (3, 3); holds gains, misaligned axes, and
        what each channel shows of the other two axes.
    offset
        (3,) [m/s²].
    noise
        Standard deviation of white noise from sample to sample at `ANALOG_HZ` [m/s²].
    limit
        Where it clips [m/s²].
    curvature
        Reading too large by this share of ``limit`` there, growing with its square, (3,).
    drift
        Change of the offset, (3,) [m/s² per s].
    alias
        Root mean square of interference from above half the sampling rate [m/s²]; in each recording
        and channel some of it.
    bits
        Of its converter over ``limit`` either way; 0 for a perfect one.
    clock
        When it samples.
    """

    name: str
    place: Array
    sensitivity: Array = field(default_factory=lambda: np.eye(3))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    noise: float = 0.0
    limit: float = np.inf
    curvature: Array = field(default_factory=lambda: np.zeros(3))
    drift: Array = field(default_factory=lambda: np.zeros(3))
    alias: float = 0.0
    bits: int = 0
    clock: Clock = field(default_factory=Clock)

    def measure(self, specific_force: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Report the specific force at its place, (N, 3) [m/s²], by its three channels.

        White noise keeps its density at any sampling rate; the drift counts from the first sample.
        """
        of_clock, of_alias = rng.spawn(2)
        measured = self.clock.sample(specific_force, rate_hz, of_clock) @ self.sensitivity.T
        noise = noise_sd_at(self.noise, rate_hz)
        time = np.arange(len(measured))[:, None] / rate_hz
        alias = self.alias * of_alias.standard_normal(3)
        tone = folded(len(measured), of_alias)[:, None] if self.alias else None
        for part in chunks(len(measured)):
            here = measured[part]
            if self.curvature.any():
                here += self.curvature / self.limit * here**2
            here += self.offset
            if self.drift.any():
                here += time[part] * self.drift
            if tone is not None:
                here += tone[part] * alias
            add_noise(here, noise, rng)
            np.clip(here, -self.limit, self.limit, out=here)
            quantise(here, self.limit, self.bits)
        return np.asarray(measured)


def make_accelerometers(
    faults: AccelerometerFaults, rng: np.random.Generator, clocks: Sequence[Clock] = ()
) -> tuple[Accelerometer, ...]:
    """Draw the accelerometers of a laboratory.

    Parameters
    ----------
    faults
        How many there are, and the standard deviations of their errors.
    rng
        Source of chance.
    clocks
        When each samples; by default late by the stated delay.

    Returns
    -------
    tuple of Accelerometer
        In the order of `PLACES_M`.
    """
    clocks = clocks or [Clock(faults.delay_s)] * faults.sensors
    sensors = []
    for (name, place), clock in zip(list(PLACES_M.items())[: faults.sensors], clocks, strict=False):
        axis = rng.normal(size=3)
        misalignment = rotation_about(
            axis / np.linalg.norm(axis), np.radians(faults.misalignment_deg) * rng.normal()
        )
        gain = np.diag(1 + faults.gain_share * rng.normal(size=3))
        offset = faults.offset_mps2 * rng.normal(size=3)
        others = faults.cross_axis * rng.normal(size=(3, 3)) * (1 - np.eye(3))
        sensors.append(
            Accelerometer(
                name,
                np.array(place),
                sensitivity=(gain + others) @ misalignment,
                offset=offset,
                noise=faults.noise_mps2,
                limit=faults.range_g * GRAVITY_MPS2,
                curvature=faults.curvature * rng.normal(size=3),
                drift=faults.drift_mps2_per_min / 60 * rng.normal(size=3),
                alias=faults.alias_mps2,
                bits=faults.bits,
                clock=clock,
            )
        )
    return tuple(sensors)
