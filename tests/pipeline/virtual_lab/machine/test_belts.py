"""Belts follow their command, load their plates in pitch alone, and slow under who brakes."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import BeltFaults
from pipeline.virtual_lab.machine.belts import carried_of_belts, make_drives, run_belts
from pipeline.virtual_lab.machine.platform import Machine

RATE_HZ = 1000.0


def linear(command):
    return run_belts(Machine(), None, command, RATE_HZ, np.random.default_rng(0))


def test_a_linear_belt_follows_its_command_late_and_does_not_overshoot():
    time = np.arange(3000) / RATE_HZ
    command = np.where(time > 1, 2.0, 1.0)
    speed = linear(command)[0].speed
    assert speed[:1000] == pytest.approx(1.0)
    assert speed.max() <= 2.0 + 1e-9
    reached = time[np.searchsorted(speed, 1.9)] - 1.0
    assert 0.5 / Machine().servo_hz < reached < 1.0 / Machine().servo_hz
    late = linear(time)[0].speed
    assert time[-1] - late[-1] == pytest.approx(2 / (2 * np.pi * Machine().servo_hz), rel=1e-3)


def test_accelerating_balanced_belts_load_their_plates_in_pitch_alone():
    time = np.arange(2000) / RATE_HZ
    for wrench in carried_of_belts(linear(1.5 * time)):
        assert wrench[-1, 4] == pytest.approx(-1.5 * Machine().belt_moment_kg_m, rel=1e-3)
        assert np.abs(np.delete(wrench, 4, axis=1)).max() < 1e-9


def test_a_person_who_brakes_on_a_belt_slows_it_and_the_other_runs_on():
    drives = make_drives(BeltFaults(roughness=0.0), np.random.default_rng(1))
    people = np.zeros((2, 3000, 6))
    people[0, 1000:, 2], people[0, 1500:1700, 0] = 700.0, 150.0  # pushed forward: propulsion
    command = np.full(3000, 1.3)
    left, right = run_belts(
        Machine(), drives, command, RATE_HZ, np.random.default_rng(2), tuple(people)
    )
    assert left.speed[1000:].std() > 0.001
    assert right.speed.std() < 1e-6
    assert left.speed[1500:1700].max() > 1.3 + 0.001  # the foot pushes it backwards
