"""Vibration of the platform on its base."""

import numpy as np
import pytest

from pipeline.virtual_lab.machine.actuators import move_platform
from pipeline.virtual_lab.machine.base_vibration import PLATFORM_KG, ElasticBase, vibrate
from pipeline.virtual_lab.machine.treadmill import Machine

RATE_HZ = 1000.0
BASE = ElasticBase((25.0, 7.0, 30.0, 22.0, 7.0, 25.0), damping=0.05)


@pytest.fixture
def at_rest():
    still = np.zeros(4000)
    return move_platform(Machine(), still, still, RATE_HZ)


def test_a_base_that_does_not_yield_does_not_vibrate(moving):
    motion, rate_hz = moving
    load = np.random.default_rng(0).normal(size=(motion.sway.shape[1], 6))
    assert not vibrate(None, motion, load, rate_hz).acceleration.any()


def test_a_force_that_starts_suddenly_swings_the_platform_at_its_natural_frequency(at_rest):
    load = np.zeros((4000, 6))
    load[100:, 1] = 60.0
    acceleration = vibrate(BASE, at_rest, load, RATE_HZ).acceleration[:, 1]
    assert acceleration[100] == pytest.approx(60.0 / PLATFORM_KG, rel=0.05)
    rising = np.flatnonzero((acceleration[101:-1] < 0) & (acceleration[102:] >= 0))
    damped_hz = 7.0 * np.sqrt(1 - 0.05**2)
    assert RATE_HZ / np.diff(rising).mean() == pytest.approx(damped_hz, rel=0.01)
    assert np.abs(acceleration[-500:]).max() < 0.01 * np.abs(acceleration).max()


def test_a_constant_moment_leaves_a_constant_rotation(at_rest):
    load = np.zeros((4000, 6))
    load[100:, 4] = 30.0
    vibration = vibrate(BASE, at_rest, load, RATE_HZ)
    inertia = 300.0
    assert vibration.rotation[-1, 1] == pytest.approx(
        30.0 / inertia / (2 * np.pi * 7) ** 2, rel=0.01
    )
    assert np.abs(vibration.angular_acceleration[-1]).max() < 1e-3
