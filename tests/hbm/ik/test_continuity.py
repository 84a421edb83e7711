"""Among equivalent coordinates of a pose, those whose angles are continuous are given."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.coordinates import INDEX, N_Q
from hbm.ik.continuity import BALL_JOINTS, ROTATIONS, continuous, nearest_equivalent
from hbm.poses import segment_frames
from tests.synthetic import synthetic_body

BODY = synthetic_body()


def swings(frames=200, seed=0, size=2.5):
    """Smooth motions whose joints swing far beyond their singular positions."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 2, frames)[:, None]
    rate, phase = rng.uniform(0.5, 2, N_Q), rng.uniform(0, 2 * np.pi, N_Q)
    q = size * (np.sin(rate * time + phase) - np.sin(phase))
    q[:, :3] *= 0.1
    return q


def scrambled(q, rng):
    """The same poses, in every frame by a random choice of equivalent coordinates."""
    equivalent = q.copy()
    for i in BALL_JOINTS:
        other = rng.random(len(q)) < 0.5
        equivalent[other, i : i + 3] = equivalent[other, i : i + 3] * [1, -1, 1] + np.pi
    for i in ROTATIONS:
        equivalent[:, i] += 2 * np.pi * rng.integers(-2, 3, len(q))
    return equivalent


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31))
def test_smooth_motion_is_recovered_from_any_equivalent_coordinates(seed):
    q = swings(seed=seed)
    found = continuous(scrambled(q, np.random.default_rng(seed)))
    np.testing.assert_allclose(found, q, atol=1e-9)


def test_the_poses_stay_the_same():
    q = scrambled(swings(), np.random.default_rng(1))
    for before, after in zip(
        segment_frames(synthetic_body(), q),
        segment_frames(synthetic_body(), continuous(q)),
        strict=True,
    ):
        np.testing.assert_allclose(after, before, atol=1e-9)


def test_frames_without_a_solution_are_skipped():
    q = swings()
    gaps = scrambled(q, np.random.default_rng(2))
    gaps[50:60] = np.nan
    found = continuous(gaps)
    assert np.isnan(found[50:60]).all()
    np.testing.assert_allclose(
        np.delete(found, range(50, 60), 0), np.delete(q, range(50, 60), 0), atol=1e-9
    )


@pytest.mark.parametrize("frames", [0, 1])
def test_recordings_of_no_or_one_frame_work(frames):
    q = np.full((frames, N_Q), 0.1)
    q[:, INDEX["RShoulderFlexion"]] = 3.0
    found = continuous(q)
    assert found.shape == (frames, N_Q)
    assert (np.abs(found) <= np.pi).all()
    assert (np.abs(found[:, INDEX["RShoulderFlexion"]]) <= np.pi / 2).all()


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_the_equivalent_nearest_to_a_frame_is_the_one_that_was_scrambled(seed):
    rng = np.random.default_rng(seed)
    q = swings(size=1.4)
    for before, pose in zip(q[:-1:40], scrambled(q, rng)[1::40], strict=True):
        found = nearest_equivalent(pose, before)
        assert np.abs(found - before).max() < np.pi / 2
        for a, b in zip(
            segment_frames(BODY, found[None]), segment_frames(BODY, pose[None]), strict=True
        ):
            np.testing.assert_allclose(a, b, atol=1e-9)


def test_no_joint_is_left_a_full_turn_too_far_and_a_subject_may_turn():
    before, pose = np.zeros(N_Q), np.zeros(N_Q)
    wrist, yaw = INDEX["LWristFlexion"], INDEX["PelvisYaw"]
    before[[wrist, yaw]], pose[[wrist, yaw]] = 2 * np.pi, 0.1
    found = nearest_equivalent(pose, before)
    np.testing.assert_allclose(found[[wrist, yaw]], [0.1, 2 * np.pi + 0.1])
