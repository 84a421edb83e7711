"""Force plates side by side, one under each belt: where they are, and what they report."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from hbm.spatial import Array, rotation_about, transform_wrench
from pipeline.io.recording import Plate
from pipeline.virtual_lab.faults import PlateFaults
from pipeline.virtual_lab.machine.instruments.sampling import (
    Clock,
    add_noise,
    chunks,
    folded,
    noise_sd_at,
    quantise,
    wander,
)

PLATE_LENGTH_M: Final = 1.8
PLATE_WIDTH_M: Final = 0.5
"""Belt surface of each plate; assumed, as on common split-belt treadmills."""
PLATE_CENTERS_M: Final = np.array([[0.0, PLATE_WIDTH_M / 2, 0.0], [0.0, -PLATE_WIDTH_M / 2, 0.0]])
"""Centres of the left and the right plate's surface with the platform in neutral."""
MOMENT_ARM_M: Final = 1 / 3
"""By which errors drawn for forces are multiplied to give those of moments [N·m per N]: about how
far the load cells are from the centre of a plate."""


FULL_SCALE_N: Final = 4000.0
"""Range of a plate's forces, either way; of its moments, by `MOMENT_ARM_M`; assumed."""
ERROR_SCALE: Final = np.array([1.0, 1.0, 1.0, *[MOMENT_ARM_M] * 3])


@dataclass(frozen=True, slots=True)
class ForcePlate:
    """How a plate's load cells report a wrench: all errors are about one point of the plate.

    Attributes
    ----------
    gain
        Cross-talk and gain: measured = gain @ true, (6, 6).
    curvature
        Vertical force too large by this share of full scale at full scale, growing with its square.
    full_scale_n
        Vertical force at which ``curvature`` is stated [N].
    offset
        Zero error, (6,) [N, N·m].
    drift
        Change of the zero, (6,) [N/s, N·m/s].
    noise
        Standard deviation of white noise from sample to sample at `ANALOG_HZ`, (6,) [N, N·m].
    wander
        Standard deviation of a zero that wanders, (6,) [N, N·m].
    zero_shift
        Standard deviation of the zero from recording to recording, (6,) [N, N·m].
    alias
        Root mean square of interference from above half the sampling rate, (6,) [N, N·m]; in each
        recording some of it.
    bits
        Of its converter over `FULL_SCALE_N` either way; 0 for a perfect one.
    clock
        When it samples.
    """

    gain: Array = field(default_factory=lambda: np.eye(6))
    curvature: float = 0.0
    full_scale_n: float = 1.0
    offset: Array = field(default_factory=lambda: np.zeros(6))
    drift: Array = field(default_factory=lambda: np.zeros(6))
    noise: Array = field(default_factory=lambda: np.zeros(6))
    wander: Array = field(default_factory=lambda: np.zeros(6))
    zero_shift: Array = field(default_factory=lambda: np.zeros(6))
    alias: Array = field(default_factory=lambda: np.zeros(6))
    bits: int = 0
    clock: Clock = field(default_factory=Clock)

    def measure(self, wrench: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Report true wrenches.

        Parameters
        ----------
        wrench
            What the load cells carry, (N, 6) [N, N·m].
        rate_hz
            Sampling rate [Hz]. White noise keeps its density at any.
        rng
            Source of the noise.

        Returns
        -------
        Array
            (N, 6) [N, N·m], about the same point.
        """
        of_clock, of_zero, of_wander, of_alias = rng.spawn(4)
        measured = self.clock.sample(wrench, rate_hz, of_clock) @ self.gain.T
        zero = self.offset + self.zero_shift * of_zero.standard_normal(6)
        noise = noise_sd_at(self.noise, rate_hz)
        time = np.arange(len(wrench))[:, None] / rate_hz
        wandering = wander(len(wrench), rate_hz, 6, of_wander) if self.wander.any() else None
        alias = self.alias * of_alias.standard_normal(6)
        tone = folded(len(wrench), of_alias)[:, None] if self.alias.any() else None
        for part in chunks(len(wrench)):
            here = measured[part]
            if self.curvature:
                here[:, 2] += self.curvature / self.full_scale_n * here[:, 2] ** 2
            here += zero
            if self.drift.any():
                here += time[part] * self.drift
            if wandering is not None:
                here += wandering[part] * self.wander
            if tone is not None:
                here += tone[part] * alias
            add_noise(here, noise, rng)
            quantise(here, FULL_SCALE_N * ERROR_SCALE, self.bits)
        return np.asarray(measured)


def make_force_plate(
    faults: PlateFaults, rng: np.random.Generator, clock: Clock | None = None
) -> ForcePlate:
    """Draw a plate's errors.

    Parameters
    ----------
    faults
        Their standard deviations.
    rng
        Source of chance.
    clock
        When it samples; by default late by the left plate's delay.

    Returns
    -------
    ForcePlate
        Errors of moments are a third of those of forces, in N·m and N (`MOMENT_ARM_M`).
    """
    gain = np.eye(6) + faults.cross_talk * rng.normal(size=(6, 6)) * ERROR_SCALE[:, None]
    return ForcePlate(
        gain=gain,
        curvature=faults.curvature * rng.normal(),
        full_scale_n=FULL_SCALE_N,
        offset=faults.offset_n * rng.normal(size=6) * ERROR_SCALE,
        drift=faults.drift_n_per_min / 60 * rng.normal(size=6) * ERROR_SCALE,
        noise=np.repeat([faults.force_noise_n, faults.moment_noise_nm], 3),
        wander=faults.wander_n * ERROR_SCALE,
        zero_shift=faults.zero_shift_n * ERROR_SCALE,
        alias=faults.alias_n * ERROR_SCALE,
        bits=faults.bits,
        clock=clock or Clock(faults.delay_s),
    )


def misplaced(wrench: Array, faults: PlateFaults) -> Array:
    """Give wrenches as plates see them that are not where the cameras' coordinates say.

    Parameters
    ----------
    wrench
        In the platform frame about its origin, (N, 6) [N, N·m].
    faults
        Rotation and offset from the cameras' to the plates' coordinates.

    Returns
    -------
    Array
        In the plates' frame about its origin, (N, 6) [N, N·m]: what a force plate reports as if it
        were in the platform frame.
    """
    offset = np.array([faults.placement_forward_m, faults.placement_left_m, 0.0])
    if faults.placement_deg == 0 and not offset.any():
        return wrench
    turned = rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(faults.placement_deg))
    return transform_wrench(wrench, turned, offset)


def recorded_plate(number: int, time: Array, wrench_in_plate: Array) -> Plate:
    """Give a plate as a recording holds it.

    Parameters
    ----------
    number
        1 for the left plate, 2 for the right.
    time
        Sample times, (N,) [s].
    wrench_in_plate
        In the platform's axes about the plate's centre, (N, 6) [N, N·m].

    Returns
    -------
    Plate
        Its axes are parallel to the platform's.
    """
    center = PLATE_CENTERS_M[number - 1]
    x, y = PLATE_LENGTH_M / 2, PLATE_WIDTH_M / 2
    corners = center + np.array([[x, y, 0], [x, -y, 0], [-x, -y, 0], [-x, y, 0]])
    return Plate(number, time, wrench_in_plate, np.eye(3), center, corners)
