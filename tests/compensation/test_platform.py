"""The platform's pose is that of its markers or commands, and wrenches and pressures ride on it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensation import check_pose
from compensation.platform import (
    PlatformPose,
    center_of_pressure,
    commanded_pose,
    fit_pose,
    interpolate_pose,
    neutral_markers,
    pose_delay,
    specific_force,
    to_lab,
)
from hbm.notes import Note
from hbm.spatial import rotation_about, shift_wrench

MARKERS = np.array(
    [[0.9, 0.7, 0.02], [-1.0, 0.75, 0.03], [-0.95, -0.7, 0.0], [1.0, -0.72, 0.05], [0.1, 0.8, 0.3]]
)
NAMES = ("front left", "rear left", "rear right", "front right", "top")
PIVOT = np.array([0.15, 0.0, -0.4])
time = np.arange(300) / 100
SWAY, PITCH = 0.05 * np.sin(3 * time), np.radians(10) * np.sin(2 * time + 0.4)


@pytest.fixture(scope="module")
def pose():
    return commanded_pose(SWAY, PITCH, PIVOT)


def seen(pose, noise_m=0.0, seed=0):
    """Where the cameras see the platform's markers, (T, M, 3)."""
    points = np.stack([pose.to_lab(m) for m in MARKERS], axis=1)
    return points + noise_m * np.random.default_rng(seed).normal(size=points.shape)


def same_pose(one, other, angle_rad, distance_m):
    np.testing.assert_allclose(one.rotation, other.rotation, atol=angle_rad)
    np.testing.assert_allclose(one.position, other.position, atol=distance_m)


# Commanded pose ---------------------------------------------------------------------------------


def test_the_pitch_axis_only_sways(pose):
    expected = PIVOT + SWAY[:, None] * [0, 1, 0]
    np.testing.assert_allclose(pose.to_lab(PIVOT), expected, atol=1e-15)
    np.testing.assert_allclose(pose.pitch, PITCH, atol=1e-15)


def test_between_its_samples_the_pose_is_that_of_the_motion(pose):
    at = time[:-1] + 0.005
    true = commanded_pose(0.05 * np.sin(3 * at), np.radians(10) * np.sin(2 * at + 0.4), PIVOT)
    same_pose(interpolate_pose(pose, time, at), true, 1e-7, 1e-7)


def test_a_pose_is_not_interpolated_across_a_gap_or_beyond_its_ends(pose):
    rotation, position = pose.rotation.copy(), pose.position.copy()
    rotation[100:120], position[100:120] = np.nan, np.nan
    found = interpolate_pose(PlatformPose(rotation, position), time, [0.5, 1.1, 1.5, 2.995])
    np.testing.assert_array_equal(np.isnan(found.pitch), [False, True, False, True])


def test_positive_pitch_lowers_the_front():
    tilted = commanded_pose([0.0], [np.radians(10)], np.zeros(3))
    np.testing.assert_allclose(
        tilted.to_lab([1.0, 0, 0]), [[np.cos(np.radians(10)), 0, -np.sin(np.radians(10))]]
    )


# Wrenches in the lab ----------------------------------------------------------------------------


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_a_force_through_a_point_of_the_platform_stays_a_force_through_it(seed):
    rng = np.random.default_rng(seed)
    pose = commanded_pose(SWAY[:5], PITCH[:5], PIVOT)
    point, force = rng.normal(size=3), rng.normal(size=(5, 3))
    in_plate = np.hstack([force, np.cross(point, force)])
    in_lab = to_lab(in_plate, pose)
    about_point = shift_wrench(in_lab, pose.to_lab(point))
    np.testing.assert_allclose(about_point[:, 3:], 0, atol=1e-12)
    np.testing.assert_allclose(in_lab[:, :3], (pose.rotation @ force[..., None])[..., 0])


def test_ignoring_the_pose_causes_the_error_that_mechanics_predicts():
    weight = np.array([[0, 0, 700.0, 0, 0, 0]])
    swayed = to_lab(weight, commanded_pose([0.05], [0.0], PIVOT))
    pitched = to_lab(weight, commanded_pose([0.0], [np.radians(10)], PIVOT))
    assert swayed[0, 3] == pytest.approx(35.0)  # 5 cm × 700 N
    assert pitched[0, 0] == pytest.approx(700 * np.sin(np.radians(10)))  # 122 N


# Centre of pressure -----------------------------------------------------------------------------


@settings(max_examples=20)
@given(
    x=st.floats(-1, 1), y=st.floats(-0.5, 0.5), height=st.floats(-0.1, 0.1), free=st.floats(-20, 20)
)
def test_the_center_of_pressure_comes_back(x, y, height, free):
    force, point = np.array([60.0, -25, 700]), np.array([x, y, height])
    moment = np.cross(point, force) + np.array([0, 0, free])
    wrench = np.hstack([force, moment])[None]
    np.testing.assert_allclose(center_of_pressure(wrench, 30, height), [point], atol=1e-12)


def test_the_center_of_pressure_moves_along_the_line_of_action_with_the_surface():
    wrench = np.tile([100.0, 0, 500, -100, -150, -20], (2, 1))
    points = center_of_pressure(wrench, 30.0, np.array([0.0, 0.1]))
    np.testing.assert_allclose(points, [[0.3, -0.2, 0], [0.32, -0.2, 0.1]], atol=1e-12)


def test_an_unloaded_plate_has_no_center_of_pressure():
    unloaded, gap = [0, 0, 29.0, 1, 2, 3], [np.nan] * 6
    wrench = np.array([unloaded, [0, 0, 31.0, 1, 2, 3], gap, [0, 0, -31.0, 1, 2, 3]])
    missing = [True, False, True, True]
    assert np.isnan(center_of_pressure(wrench, 30)).tolist() == [[m] * 3 for m in missing]


# Pose from markers ------------------------------------------------------------------------------


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_any_rigid_motion_is_found(seed):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(20, 3))
    rotation = rotation_about(
        axis / np.linalg.norm(axis, axis=1, keepdims=True), rng.uniform(-3, 3, 20)
    )
    pose = PlatformPose(rotation, rng.normal(size=(20, 3)))
    same_pose(fit_pose(seen(pose), MARKERS, outlier_m=0.01).pose, pose, 1e-12, 1e-12)


def test_camera_noise_goes_into_the_pose_as_the_markers_spread_allows(pose):
    fit = fit_pose(seen(pose, noise_m=0.0005), MARKERS, outlier_m=0.01)
    error = fit.pose.pitch - PITCH
    arm = np.sqrt(np.sum((MARKERS - MARKERS.mean(axis=0))[:, [0, 2]] ** 2))
    assert np.std(error) == pytest.approx(0.0005 / arm, rel=0.15)


def test_fewer_than_three_markers_are_a_gap_with_a_note(pose):
    markers = seen(pose)
    markers[20:50, :3] = np.nan
    fit = fit_pose(markers, MARKERS, outlier_m=0.01)
    gap = np.isnan(fit.pose.position).all(axis=1)
    assert np.flatnonzero(gap).tolist() == list(range(20, 50))
    note = Note.of("platform_pose_unknown", unknown=30, frames=300)
    assert check_pose(fit, NAMES, 0.01)[0] == note


def test_three_markers_in_a_line_are_a_gap(pose):
    line = MARKERS.copy()
    line[2] = (line[0] + line[1]) / 2
    reference_pose = np.stack([pose.to_lab(m) for m in line], axis=1)
    reference_pose[10:20, 3:] = np.nan
    fit = fit_pose(reference_pose, line, outlier_m=0.01)
    assert np.flatnonzero(np.isnan(fit.pose.pitch)).tolist() == list(range(10, 20))


@pytest.mark.parametrize("marker", [4])
def test_a_loose_marker_is_found_and_left_out(pose, marker):
    markers = seen(pose, noise_m=0.0003)
    markers[100:, marker] += [0.03, -0.02, 0.04]
    fit = fit_pose(markers, MARKERS, outlier_m=0.01)
    same_pose(fit.pose, pose, 2e-3, 2e-3)
    assert not fit.used[100:, marker].any()
    assert fit.used.sum() == 300 * 5 - 200
    (note,) = check_pose(fit, NAMES, 0.01)
    assert note.level == "warning"
    assert note.values["marker"] == NAMES[marker]
    assert note.values["share"] == pytest.approx(200 / 300)
    assert note.values["limit_m"] == 0.01


def test_three_markers_that_disagree_give_no_pose(pose):
    markers = seen(pose)[:, :3]
    markers[5, 0] += 0.1
    fit = fit_pose(markers, MARKERS[:3], outlier_m=0.01)
    assert np.flatnonzero(np.isnan(fit.pose.pitch)).tolist() == [5]


def test_neutral_reference_is_the_mean_over_frames_at_rest():
    frames = MARKERS + 0.0005 * np.random.default_rng(0).normal(size=(200, 5, 3))
    frames[:150, 2] = np.nan
    np.testing.assert_allclose(neutral_markers(frames), MARKERS, atol=4e-4)


# Delay of the pose ------------------------------------------------------------------------------


def test_delay_of_the_platform_behind_its_command_comes_back():
    at = np.arange(3000) / 100

    def command(t):
        sway = 0.03 * np.sin(2 * np.pi * 0.4 * t) + 0.01 * np.sin(2 * np.pi * 1.3 * t)
        return commanded_pose(sway, 0.1 * np.sin(2 * np.pi * 0.23 * t + 1), PIVOT)

    measured = fit_pose(seen(command(at - 0.031), noise_m=0.0005), MARKERS, outlier_m=0.01)
    found = pose_delay(command(at), measured.pose, 100)
    assert found.seconds == pytest.approx(0.031, abs=5e-4)
    assert abs(found.seconds - 0.031) < 3 * found.standard_error


def test_specific_force_of_the_pose_is_what_accelerometers_measure(laboratory):
    lab = laboratory(crooked=False)
    trial = lab.random_trial(1, rate_hz=100, duration=20)
    pose = PlatformPose(trial.motion.rotation, trial.motion.position)
    felt = specific_force(pose, 100)[5:-5]
    np.testing.assert_allclose(felt[:, :3], trial.motion.force_0[5:-5], atol=0.05)
    np.testing.assert_allclose(felt[:, 3:], trial.motion.alpha[5:-5], atol=0.1)


# Wrong input ------------------------------------------------------------------------------------


def broken(rotation_scale=1.0, mirror=False):
    rotation = np.tile(np.eye(3) * rotation_scale, (4, 1, 1))
    if mirror:
        rotation[:, 0, 0] = -1
    return rotation, np.zeros((4, 3))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: to_lab(np.ones((3000, 6)), p), "pose 300"),
        (lambda p: PlatformPose(*broken(mirror=True)), "proper rotations"),
        (lambda p: commanded_pose(50 * SWAY / 0.05, PITCH, PIVOT), "sway reaches .* is it in m"),
        (lambda p: commanded_pose(SWAY, np.degrees(PITCH), PIVOT), "pitch .*in rad"),
        (lambda p: fit_pose(1000 * seen(p), MARKERS, 0.01), "in metres"),
        (lambda p: neutral_markers(seen(p)), "moves by .*neutral"),
    ],
)
def test_wrong_input_gets_one_clear_error(pose, call, message):
    with pytest.raises(ValueError, match=message):
        call(pose)
