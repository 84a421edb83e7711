"""A belt that answers linearly to what it is commanded: of the family that compensation fits.

For tests of arithmetic; `pipeline.virtual_lab.machine.belt_drive` is as real belts are.
"""

from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.spatial import Array
from pipeline.virtual_lab.machine.actuators import follow
from pipeline.virtual_lab.machine.belt_drive import BeltMotion
from pipeline.virtual_lab.machine.treadmill import Machine

ROLLER_CIRCUMFERENCE_M: Final = 0.3
"""Belt travel per revolution of a roller; assumed, a roller of about 10 cm diameter."""
ROLLER_AHEAD_M: Final = 0.9
ROLLER_HEIGHT_M: Final = -0.1
"""Place of the front roller in the platform frame: at the front edge of the plate, one roller
radius and the belt's support below its surface."""


def run_linear_belt(
    machine: Machine,
    command: Array,
    rate_hz: float,
    unbalance_kg_per_m: float,
    rng: np.random.Generator,
) -> BeltMotion:
    """Let a belt follow a commanded speed with an unbalanced front roller.

    Parameters
    ----------
    machine
        Bandwidth of the belt, and response of its moment to acceleration.
    command
        Commanded speed, (N,) [m/s].
    rate_hz
        Sampling rate [Hz].
    unbalance_kg_per_m
        Force of the roller by the square of the belt speed [N per (m/s)²].
    rng
        Source of the roller's angle at the first sample.

    Returns
    -------
    BeltMotion
        Reported as it is.
    """
    speed = drive_belt(machine, command, rate_hz)
    acceleration = np.gradient(speed, 1 / rate_hz)
    turned = 2 * np.pi * np.cumsum(speed) / rate_hz / ROLLER_CIRCUMFERENCE_M
    angle = rng.uniform(0, 2 * np.pi) + turned
    forward, upward = (unbalance_kg_per_m * speed**2 * f(angle) for f in (np.cos, np.sin))
    moment = belt_moment(machine, acceleration, rate_hz)
    moment += ROLLER_HEIGHT_M * forward - ROLLER_AHEAD_M * upward
    return BeltMotion(speed, acceleration, speed, moment, forward, upward, 0 * speed)


def drive_belt(machine: Machine, command: Array, rate_hz: float) -> Array:
    """Give the belt's speed under a commanded speed, (N,) [m/s], starting at the first command."""
    return np.asarray(follow(command, machine.servo_hz, rate_hz)[0])


def belt_moment(machine: Machine, belt_acceleration: Array, rate_hz: float) -> Array:
    """Give the pitch moment that a motor leaves in its plate when the belt accelerates.

    Parameters
    ----------
    machine
        The response of moment to acceleration.
    belt_acceleration
        (N,) [m/s²].
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    Array
        About the lab's left axis, (N,) [N·m]; negative where the belt speeds up.

    Notes
    -----
    A second-order response, as Hnat and van den Bogert (2014) found it.
    """
    omega = 2 * np.pi * machine.belt_hz
    numerator = np.array([-(omega**2) * machine.belt_moment_kg_m])
    denominator = np.array([1, 2 * machine.belt_damping * omega, omega**2])
    b, a, _ = cont2discrete((numerator, denominator), 1 / rate_hz, method="bilinear")
    return np.asarray(lfilter(b.ravel(), a, belt_acceleration))
