"""A simulated hammer obeys the law of momentum and comes back as hammers do."""

import numpy as np
import pytest

from pipeline.virtual_lab.protocol.known_weights import HAMMER, STEPS_HZ, Blows, strike


def blow(contact_s, restitution, hand_mps2=20.0):
    return Blows(*(np.array([x]) for x in (contact_s, 2.0, restitution, -10.0, hand_mps2)))


@pytest.mark.parametrize("contact_s", [0.001, 0.004, 0.010])
def test_without_damping_the_force_is_half_a_sine_that_turns_the_speed_round(contact_s):
    time, height, force = (x.squeeze() for x in strike(blow(contact_s, 1.0)))
    touching = force > 0
    assert touching.sum() / STEPS_HZ == pytest.approx(contact_s, rel=0.1)
    assert force.max() == pytest.approx(HAMMER.head * 2.0 * np.pi / contact_s, rel=0.05)
    phase = np.pi * (time[touching] - time[touching][0]) / contact_s
    assert np.corrcoef(np.sin(phase), force[touching])[0, 1] > 0.98
    speed = np.gradient(height, time)[np.flatnonzero(touching)[-1] + 2]
    assert speed == pytest.approx(2.0, rel=0.05)


def test_the_impulse_of_the_force_and_the_hand_is_the_change_of_momentum():
    _, height, force = (x.squeeze() for x in strike(blow(0.005, 0.4)))
    last = np.flatnonzero(force > 0)[-1] + 2
    first = np.flatnonzero(force > 0)[0] - 2
    speed = np.diff(height) * STEPS_HZ
    others = HAMMER.head * (20.0 - 9.81) * (last - first) / STEPS_HZ
    impulse = force[first : last + 1].sum() / STEPS_HZ
    assert HAMMER.head * (speed[last] - speed[first]) == pytest.approx(impulse + others, rel=0.01)
    assert 0.3 * 2.0 < speed[last] < 0.8 * 2.0
