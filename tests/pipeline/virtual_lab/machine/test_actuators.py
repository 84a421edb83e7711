"""The platform follows its commands as critically damped systems can."""

import numpy as np
import pytest

from pipeline.virtual_lab.machine.platform import Machine, move_platform
from pipeline.virtual_lab.protocol.walking_protocol import MOTION, sway_command

RATE_HZ = 1000.0


def test_actuators_exceed_neither_range_nor_speed_whatever_the_command():
    command = 5 * np.random.default_rng(0).normal(size=4000)
    command[1000:2000] = 1.0
    motion, limits = move_platform(Machine(), command, command, RATE_HZ), Machine().limits
    settled = 10  # the first command is where the platform is at the start
    assert np.abs(motion.sway[0, settled:]).max() <= limits.sway_m
    assert np.abs(motion.sway[1]).max() <= limits.sway_m_per_s * (1 + 1e-9)
    assert np.abs(motion.pitch[0, settled:]).max() <= np.radians(limits.pitch_deg)
    assert np.abs(motion.pitch[1]).max() <= np.radians(limits.pitch_deg_per_s) * (1 + 1e-9)
    assert motion.sway[0, 1900] == pytest.approx(limits.sway_m, rel=1e-3)


@pytest.mark.parametrize(("direction", "hz"), [("sway", 7.0), ("pitch", 3.0)])
def test_actuators_follow_constant_speed_late_by_twice_their_time_constant(direction, hz):
    time = np.arange(3000) / RATE_HZ
    ramp = 0.01 * time
    motion = getattr(move_platform(Machine(), ramp, ramp, RATE_HZ), direction)
    assert (ramp[-1] - motion[0, -1]) / 0.01 == pytest.approx(2 / (2 * np.pi * hz), rel=1e-3)
    assert motion[1, -1] == pytest.approx(0.01)


def test_sway_reaches_its_speed_and_stays_within_the_assumed_acceleration():
    time = np.arange(3000) / RATE_HZ
    motion = move_platform(Machine(), sway_command([1.0], [1.0], time), 0 * time, RATE_HZ)
    assert motion.sway[1].max() == pytest.approx(MOTION.sway_speed, rel=0.02)
    assert motion.sway[2].max() == pytest.approx(5.0, rel=0.1)
    assert motion.sway[0][-1] == pytest.approx(0.05, abs=1e-6)
