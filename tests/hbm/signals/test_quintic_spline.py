"""Derivatives of the quintic spline through samples with equal steps."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from hbm.signals.quintic_spline import spline_derivatives

STEP = 0.01
INSIDE = slice(40, -40)
"""Where what is beyond the ends has fallen below rounding."""


def test_derivatives_are_those_of_the_spline_that_scipy_solves_for():
    time = STEP * np.arange(300)
    samples = np.random.default_rng(0).normal(size=(300, 4))
    spline = make_interp_spline(time, samples, k=5)
    for order, found in enumerate(spline_derivatives(samples, STEP), 1):
        expected = spline(time, order)
        error = np.abs(found - expected)[INSIDE].max()
        assert error < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("frequency_hz", [1.0, 5.0])
def test_a_sine_has_the_velocity_and_acceleration_of_a_sine(frequency_hz):
    omega, time = 2 * np.pi * frequency_hz, STEP * np.arange(300)
    velocity, acceleration = spline_derivatives(np.sin(omega * time)[:, None], STEP)
    at = time[INSIDE]
    assert np.abs(velocity[INSIDE, 0] - omega * np.cos(omega * at)).max() < 1e-6 * omega
    assert np.abs(acceleration[INSIDE, 0] + omega**2 * np.sin(omega * at)).max() < 1e-4 * omega**2
