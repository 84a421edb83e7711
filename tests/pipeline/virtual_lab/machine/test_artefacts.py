"""What plates have to carry of the treadmill, compared with independent derivations."""

import numpy as np
import pytest

from pipeline.virtual_lab.machine.actuators import move_platform
from pipeline.virtual_lab.machine.artefacts import (
    ROLLER_PLACE_M,
    belt_moment,
    drive_wrenches,
    inertial_wrench,
    roller_wrench,
)
from pipeline.virtual_lab.machine.platform import motion_terms, specific_force
from pipeline.virtual_lab.machine.treadmill import LEFT_ASSEMBLY, Machine, TreadmillMotion
from pipeline.virtual_lab.protocol.walking_protocol import PITCH_DEG

RATE_HZ = 1000.0


def assembly_wrench(motion, assembly):
    return motion_terms(motion) @ inertial_wrench(assembly, motion.pivot).T


def test_an_assemblys_wrench_is_the_sum_over_its_point_masses(moving):
    """Eight point masses without symmetry, each with the specific force of its own place."""
    motion, _ = moving
    corners = np.array([[x, y, z] for x in (-0.8, 0.9) for y in (0.1, 0.4) for z in (-0.2, 0.0)])
    corners += np.random.default_rng(1).uniform(-0.1, 0.1, size=corners.shape)
    mass = 150 / 8
    center = corners.mean(axis=0)
    away = corners - center
    tensor = sum(mass * (a @ a * np.eye(3) - np.outer(a, a)) for a in away)
    assembly = type(LEFT_ASSEMBLY)(150.0, tuple(center), tuple(map(tuple, tensor)))
    force = [mass * specific_force(motion, c) for c in corners]
    tare = mass * 9.81 * np.array([0, 0, 1.0])
    expected = np.hstack(
        [
            sum(f - tare for f in force),
            sum(np.cross(c, f - tare) for c, f in zip(corners, force, strict=True)),
        ]
    )
    np.testing.assert_allclose(assembly_wrench(motion, assembly), expected, atol=1e-6)


def test_pitching_the_assemblies_makes_the_force_that_their_weight_makes():
    time = np.arange(30_000) / RATE_HZ
    pitch = np.radians(PITCH_DEG) * np.sin(2 * np.pi * time / 30)
    motion = move_platform(Machine(), 0 * time, pitch, RATE_HZ)
    force = assembly_wrench(motion, LEFT_ASSEMBLY)[:, 0]
    expected = 150 * 9.81 * np.sqrt(np.mean(np.sin(pitch) ** 2))
    assert np.sqrt(np.mean(force**2)) == pytest.approx(expected, rel=0.02)


def test_a_belt_at_constant_speed_leaves_no_moment_and_an_accelerating_one_does():
    acceleration = np.zeros(4000)
    acceleration[1000:3000] = 2.0
    moment = belt_moment(Machine(), acceleration, RATE_HZ)
    assert np.abs(moment[:999]).max() == 0
    assert moment[2900] == pytest.approx(2 * Machine().belt_moment_kg_m, rel=1e-3)


def test_accelerating_belts_load_their_plates_in_pitch_alone():
    time = np.arange(2000) / RATE_HZ
    at_rest = move_platform(Machine(), 0 * time, 0 * time, RATE_HZ)
    motion = TreadmillMotion(time, at_rest, 1.5 * time, np.empty(0))
    for wrench in drive_wrenches(Machine(), motion, 0.0, RATE_HZ):
        assert wrench[-1, 4] == pytest.approx(1.5 * Machine().belt_moment_kg_m, rel=1e-3)
        assert np.abs(np.delete(wrench, 4, axis=1)).max() < 1e-9


@pytest.mark.parametrize("side", [1, -1])
def test_an_unbalanced_roller_pulls_at_its_axle_with_the_square_of_the_speed(side):
    wrench = roller_wrench(np.full(3000, 1.7), RATE_HZ, 0.2, 0.4, side)
    np.testing.assert_allclose(np.linalg.norm(wrench[:, :3], axis=1), 0.2 * 1.7**2)
    place = np.array(ROLLER_PLACE_M) * [1, side, 1]
    np.testing.assert_allclose(wrench[:, 3:], np.cross(place, wrench[:, :3]), atol=1e-12)
    assert np.abs(wrench[:1000].mean(axis=0)).max() < 0.05  # it turns
