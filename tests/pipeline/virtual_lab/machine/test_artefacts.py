"""What plates have to carry of the treadmill is what independent derivations give."""

import numpy as np
import pytest

from pipeline.virtual_lab.machine.platform import (
    LEFT_ASSEMBLY,
    Machine,
    inertial_wrench,
    motion_terms,
    move_platform,
    specific_force,
)
from pipeline.virtual_lab.protocol.walking_protocol import MOTION

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
    pitch = np.radians(MOTION.pitch) * np.sin(2 * np.pi * time / 30)
    motion = move_platform(Machine(), 0 * time, pitch, RATE_HZ)
    force = assembly_wrench(motion, LEFT_ASSEMBLY)[:, 0]
    expected = 150 * 9.81 * np.sqrt(np.mean(np.sin(pitch) ** 2))
    assert np.sqrt(np.mean(force**2)) == pytest.approx(expected, rel=0.02)
