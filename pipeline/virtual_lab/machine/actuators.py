"""Actuators: how the platform follows what it is commanded."""

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.spatial import Array
from pipeline.virtual_lab.machine.platform import PlatformMotion
from pipeline.virtual_lab.machine.treadmill import Machine


def move_platform(machine: Machine, sway: Array, pitch: Array, rate_hz: float) -> PlatformMotion:
    """Follow commanded sway and pitch within the machine's limits, starting at rest.

    Parameters
    ----------
    machine
        Limits and bandwidths.
    sway, pitch
        Commanded, (N,) [m] and [rad].
    rate_hz
        Sampling rate of the commands [Hz].

    Returns
    -------
    PlatformMotion
        Positions with their exact derivatives.
    """
    limits = machine.limits
    pitch_rad, pitch_rad_per_s = np.radians([limits.pitch_deg, limits.pitch_deg_per_s])
    sway = _limited(sway, limits.sway_m, limits.sway_m_per_s, rate_hz)
    pitch = _limited(pitch, pitch_rad, pitch_rad_per_s, rate_hz)
    return PlatformMotion(
        follow(sway, machine.sway_hz, rate_hz),
        follow(pitch, machine.pitch_hz, rate_hz),
        np.array(machine.pivot_m),
    )


def _limited(command: Array, max_value: float, max_speed: float, rate_hz: float) -> Array:
    """Limit a command to a range and a speed.

    A critically damped second-order system has a positive impulse response of unit area: following
    the limited command it exceeds neither.
    """
    within = np.clip(command, -max_value, max_value)
    step = max_speed / rate_hz
    if np.abs(np.diff(within)).max(initial=0.0) <= step:
        return within
    value, values = float(within[0]), []
    for wanted in within.tolist():
        value += min(max(wanted - value, -step), step)
        values.append(value)
    return np.array(values)


def follow(command: Array, bandwidth_hz: float, rate_hz: float) -> Array:
    """Respond as a critically damped second-order system to a command linear between samples.

    Gives value, velocity and acceleration, (3, N).
    """
    omega = 2 * np.pi * bandwidth_hz
    rest = float(command[0])
    rows = []
    for derivative in range(3):
        numerator = np.array([omega**2, *[0.0] * derivative])
        denominator = np.array([1, 2 * omega, omega**2])
        b, a, _ = cont2discrete((numerator, denominator), 1 / rate_hz, method="foh")
        rows.append(lfilter(b.ravel(), a, command - rest))
    rows[0] += rest
    return np.stack(rows)
