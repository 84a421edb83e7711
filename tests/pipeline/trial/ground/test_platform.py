"""Plates that move with the platform give wrenches and corners of the moving plate in the lab."""

import numpy as np
import pytest

from compensation import PlatformPose, commanded_pose, to_lab
from hbm.spatial import transform_wrench
from pipeline.trial.ground.platform import moved_corners, pose_at, turned_to_lab
from tests.pipeline import lab


@pytest.fixture
def pose(walker):
    time = walker.plates[0].time
    return commanded_pose(0.05 * np.sin(time), 0.15 * np.sin(2 * time), lab.PIVOT_M)


def test_a_turned_wrench_is_the_same_action_on_the_subject(walker, pose):
    """Read as of a plate at rest, it gives the wrench that the moving plate gives with the pose."""
    for plate in walker.plates:
        turned = turned_to_lab(plate, plate.wrench_in_plate, pose)
        at_rest = transform_wrench(turned, plate.rotation, plate.center)
        np.testing.assert_allclose(at_rest, to_lab(plate.wrench, pose), atol=1e-9)


def test_corners_of_a_platform_that_stays_tilted_are_where_it_is(walker):
    plate = walker.plates[0]
    pose = commanded_pose(np.full(7, 0.03), np.full(7, np.radians(8)), lab.PIVOT_M)
    in_plate = moved_corners(plate, pose)
    in_lab = in_plate @ plate.rotation.T + plate.center
    expected = plate.corners @ pose.rotation[0].T + pose.position[0]
    np.testing.assert_allclose(in_lab, expected, atol=1e-12)


def test_between_markers_the_pose_is_that_of_a_smooth_motion(walker):
    motion = lab.pitching(12.0)
    frames, samples = walker.markers.time, walker.plates[0].time
    found = pose_at(walker, PlatformPose(*motion.pose(frames)), samples)
    rotation, position = motion.pose(samples)
    inside = samples <= frames[-1]
    np.testing.assert_allclose(found.rotation[inside], rotation[inside], atol=1e-5)
    np.testing.assert_allclose(found.position[inside], position[inside], atol=1e-5)
    np.testing.assert_array_equal(found.position[-1], found.position[inside][-1])
