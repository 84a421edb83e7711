"""A platform's axis is that of its pitch where this is more than markers err, else of sway."""

import numpy as np
from scipy.spatial.transform import Rotation

from compensation import PlatformPose
from pipeline.report import empty_treadmill

TIME_S = np.arange(0, 20, 0.01)
LATERAL = np.array([0.0, 1.0, 0.0])


def is_lateral(turned_deg, moved_m):
    """Whether the axis found of rotation vectors and places, (T, 3), is the lateral one."""
    rotation = Rotation.from_rotvec(np.radians(turned_deg)).as_matrix()
    axis = empty_treadmill._axis(PlatformPose(rotation, moved_m))
    return abs(axis @ LATERAL) > 0.99


def test_a_platform_that_sways_and_whose_markers_err_by_half_a_degree_does_not_pitch():
    rng = np.random.default_rng(1)
    noise_deg = rng.uniform(-0.6, 0.6, (len(TIME_S), 3)) * [1.0, 0.1, 1.0]
    sway = 0.05 * np.sin(2 * np.pi * 0.5 * TIME_S)[:, None] * LATERAL
    assert is_lateral(noise_deg, sway)


def test_a_platform_that_pitches_by_a_degree_and_a_half_does():
    pitch = 1.5 * np.sin(2 * np.pi * 0.5 * TIME_S)[:, None] * LATERAL
    noise_m = np.random.default_rng(1).normal(size=(len(TIME_S), 3)) * [1e-3, 1e-4, 1e-3]
    assert is_lateral(pitch, noise_m)
