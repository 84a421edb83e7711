"""Our mechanics and Pinocchio's agree in every pose."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hbm.coordinates import INDEX, LAST_Q, N_Q, support
from hbm.dynamics import inverse_dynamics
from hbm.spatial import shift_wrench
from tests.hbm.motions import any_pose

pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")
FEET = ("left_foot", "right_foot")
ROUNDING = 1e-11


@pytest.fixture
def wrenches(motion):
    random = np.random.default_rng(2)
    return {foot: random.normal(scale=300, size=(len(motion.time), 6)) for foot in FEET}


def pinocchio_forces(body, motion, wrenches):
    from tests.hbm.pinocchio_dynamics import free_dynamics

    tau, needed, jacobians = free_dynamics(body, motion.q, motion.v, motion.a, wrenches)
    for segment, wrench in wrenches.items():
        tau[:, support(LAST_Q[segment])] -= np.einsum("tci,ti->tc", jacobians[segment], wrench)
    return tau, needed - shift_wrench(sum(wrenches.values()), motion.q[:, :3])


def assert_agreement(body, motion, wrenches, jobs=1):
    ours = inverse_dynamics(body, motion, wrenches, jobs=jobs)
    pinocchio = pinocchio_forces(body, motion, wrenches)
    for forces, others in zip((ours.tau, ours.residual), pinocchio, strict=True):
        np.testing.assert_array_equal(np.isnan(forces), np.isnan(others))
        largest = max(1, np.nanmax(np.abs(forces)))
        np.testing.assert_allclose(forces, others, rtol=0, atol=ROUNDING * largest)


@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(0, 10), segment=st.sampled_from([*LAST_Q]))
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_pinocchio_agrees_in_any_pose_at_any_speed_wherever_a_wrench_acts(
    body, seed, speed, segment
):
    random = np.random.default_rng(seed)
    pose = any_pose(random, 3)
    v, a = (speed * random.normal(size=(3, N_Q)) for _ in range(2))
    wrench = {segment: random.normal(scale=500, size=(3, 6))}
    assert_agreement(body, replace(pose, v=v, a=10 * a), wrench)


@pytest.mark.parametrize("pitch", [90.0, -90.0, 90.0 + 1e-9])
def test_the_residual_moment_is_right_where_two_axes_of_the_pelvis_coincide(
    body, motion, wrenches, pitch
):
    q = motion.q.copy()
    q[:, INDEX["PelvisForwardPitch"]] = np.radians(pitch)
    assert_agreement(body, replace(motion, q=q), wrenches)


@pytest.mark.parametrize("jobs", [1, 2])
def test_undefined_frames_leave_the_others_as_they_are_on_any_number_of_threads(
    body, motion, wrenches, jobs
):
    q, left = motion.q.copy(), wrenches["left_foot"].copy()
    q[3], left[7] = np.nan, np.nan
    assert_agreement(body, replace(motion, q=q), wrenches | {"left_foot": left}, jobs)
