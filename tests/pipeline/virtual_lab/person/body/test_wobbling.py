"""Wobbling masses are damped oscillators whose reaction is on the ground."""

import numpy as np
import pytest

from hbm.spatial import GRAVITY_MPS2
from pipeline.virtual_lab.person.body import Frame, Oscillator, WobblingMass

RATE_HZ = 1000.0
MASS = WobblingMass("right_thigh", 6.0, np.array([0.0, 0.0, -0.2]), 10.0, 0.3)


def shaken(frequency_hz, seconds=4.0, amplitude=0.01):
    """Shake a segment up and down; give times, its acceleration and the mass's reaction."""
    time = np.arange(seconds * RATE_HZ) / RATE_HZ
    omega = 2 * np.pi * frequency_hz
    start = np.clip(time / 0.5, 0, 1) ** 3
    height = amplitude * start * np.sin(omega * time)
    acceleration = np.gradient(np.gradient(height, time), time)
    zero, one = np.zeros((3, 3, len(time))), np.zeros((3, 3, len(time)))
    one[[0, 1, 2], [0, 1, 2]] = 1.0
    origin, second = np.zeros((2, 3, len(time)))
    origin[2], second[2] = height, acceleration
    wrench = np.zeros((6, len(time)))
    Oscillator(MASS, RATE_HZ).add_reaction(wrench, Frame((one, zero, zero), origin, second))
    return time, acceleration, wrench


@pytest.mark.parametrize("frequency_hz", [1.0, 10.0, 25.0])
def test_the_reaction_is_that_of_a_driven_oscillator(frequency_hz):
    """Of the base's acceleration: the transmissibility less one."""
    time, acceleration, wrench = shaken(frequency_hz)
    late = time > 2.0
    ratio, zeta = frequency_hz / MASS.frequency_hz, MASS.damping
    response = (1 + 2j * zeta * ratio) / (1 - ratio**2 + 2j * zeta * ratio) - 1
    expected = abs(response) * np.std(acceleration[late])
    assert np.std(wrench[2, late]) / MASS.mass_kg == pytest.approx(expected, rel=0.02)


def test_a_turned_segment_lets_the_mass_sag_by_the_static_amount():
    """From upright to level: the weight now bends the springs sideways, g / ω²."""
    time = np.arange(3 * RATE_HZ) / RATE_HZ
    angle = np.pi / 2 * np.clip(time / 0.5, 0, 1)
    rotation = np.zeros((3, 3, len(time)))
    rotation[0, 0] = rotation[2, 2] = np.cos(angle)
    rotation[0, 2], rotation[2, 0] = np.sin(angle), -np.sin(angle)
    rotation[1, 1] = 1.0
    zero, still = np.zeros_like(rotation), np.zeros((3, len(time)))
    wrench = np.zeros((6, len(time)))
    Oscillator(MASS, RATE_HZ).add_reaction(wrench, Frame((rotation, zero, zero), still, still))
    sag = GRAVITY_MPS2 / (2 * np.pi * MASS.frequency_hz) ** 2
    np.testing.assert_allclose(wrench[:3, -1], 0, atol=1e-6)
    assert wrench[4, -1] == pytest.approx(-MASS.mass_kg * GRAVITY_MPS2 * sag, rel=1e-3)


def test_chunks_do_not_show():
    time = np.arange(400) / RATE_HZ
    rotation = np.zeros((3, 3, len(time)))
    rotation[[0, 1, 2], [0, 1, 2]] = 1.0
    zero, acceleration = np.zeros_like(rotation), np.zeros((3, len(time)))
    acceleration[0] = np.sin(40 * time)
    whole = np.zeros((6, len(time)))
    still = np.zeros_like(acceleration)
    Oscillator(MASS, RATE_HZ).add_reaction(
        whole, Frame((rotation, zero, zero), still, acceleration)
    )
    parts, oscillator = np.zeros_like(whole), Oscillator(MASS, RATE_HZ)
    for part in (slice(0, 150), slice(150, 400)):
        frame = Frame(
            (rotation[..., part], zero[..., part], zero[..., part]),
            still[:, part],
            acceleration[:, part],
        )
        oscillator.add_reaction(parts[:, part], frame)
    np.testing.assert_allclose(parts, whole, atol=1e-9)
