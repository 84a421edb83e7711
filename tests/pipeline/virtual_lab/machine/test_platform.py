"""The platform's velocities and accelerations are numerical derivatives of its pose."""

import numpy as np

from pipeline.virtual_lab.machine.platform import Machine, specific_force

UPWARD = np.array([0, 0, 9.81])


def test_specific_force_is_the_second_derivative_of_position_minus_gravity(moving):
    motion, rate_hz = moving
    point = np.array([0.9, -0.5, -0.2])
    pose = motion.pose
    place, step = pose.to_lab(point), 1 / rate_hz
    acceleration = np.gradient(np.gradient(place, step, axis=0), step, axis=0)
    expected = np.einsum("tji,tj->ti", pose.rotation, acceleration + UPWARD)
    np.testing.assert_allclose(specific_force(motion, point)[50:-50], expected[50:-50], atol=2e-3)


def test_positive_pitch_rotates_about_the_pivot_and_lowers_the_front(moving):
    motion, _ = moving
    pose, pivot = motion.pose, np.array(Machine().pivot_m)
    moved = pose.to_lab(pivot)
    np.testing.assert_allclose(
        moved[:, [0, 2]], np.tile(pivot[[0, 2]], (len(moved), 1)), atol=1e-12
    )
    np.testing.assert_allclose(moved[:, 1], motion.sway[0], atol=1e-12)
    front = pose.to_lab(pivot + np.array([1.0, 0, 0]))
    np.testing.assert_allclose(front[:, 2] - pivot[2], -np.sin(motion.pitch[0]), atol=1e-12)
