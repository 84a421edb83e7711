"""Two engines, one mechanics: they agree in every pose, wherever the ground pushes."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hbm import dynamics
from hbm.coordinates import INDEX, LAST_Q, N_Q
from hbm.dynamics import inverse_dynamics
from hbm.engines.engine import choose_engine, kernels_engine, pinocchio_engine
from hbm.kernels import native
from hbm.kernels.native import interpreted_kernels, kernels
from tests.hbm.motions import any_pose

pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")
FEET = ("left_foot", "right_foot")
ROUNDING = 1e-11


@pytest.fixture
def wrenches(motion):
    random = np.random.default_rng(2)
    return {foot: random.normal(scale=300, size=(len(motion.time), 6)) for foot in FEET}


def compute_by(engine, body, motion, wrenches, jobs=1):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dynamics, "choose_engine", engine)
        return inverse_dynamics(body, motion, wrenches, jobs=jobs)


def assert_engines_agree(body, motion, wrenches, jobs=1):
    one, other = (
        compute_by(engine, body, motion, wrenches, jobs)
        for engine in (pinocchio_engine, kernels_engine)
    )
    for forces, others in ((one.tau, other.tau), (one.residual, other.residual)):
        np.testing.assert_array_equal(np.isnan(forces), np.isnan(others))
        largest = max(1, np.nanmax(np.abs(forces)))
        np.testing.assert_allclose(forces, others, rtol=0, atol=ROUNDING * largest)


@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(0, 10), segment=st.sampled_from([*LAST_Q]))
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_both_engines_agree_in_any_pose_at_any_speed_wherever_a_wrench_acts(
    body, seed, speed, segment
):
    random = np.random.default_rng(seed)
    pose = any_pose(random, 3)
    v, a = (speed * random.normal(size=(3, N_Q)) for _ in range(2))
    wrench = {segment: random.normal(scale=500, size=(3, 6))}
    assert_engines_agree(body, replace(pose, v=v, a=10 * a), wrench)


@pytest.mark.parametrize("pitch", [90.0, -90.0, 90.0 + 1e-9])
def test_the_residual_moment_is_right_where_two_axes_of_the_pelvis_coincide(
    body, motion, wrenches, pitch
):
    q = motion.q.copy()
    q[:, INDEX["PelvisForwardPitch"]] = np.radians(pitch)
    assert_engines_agree(body, replace(motion, q=q), wrenches)


@pytest.mark.parametrize("jobs", [1, 2])
def test_both_engines_leave_the_same_frames_undefined_on_any_number_of_threads(
    body, motion, wrenches, jobs
):
    q, left = motion.q.copy(), wrenches["left_foot"].copy()
    q[3], left[7] = np.nan, np.nan
    assert_engines_agree(body, replace(motion, q=q), wrenches | {"left_foot": left}, jobs)


def test_without_pinocchios_parallel_function_the_numbers_are_the_same(
    body, motion, wrenches, monkeypatch
):
    in_parallel = compute_by(pinocchio_engine, body, motion, wrenches)
    monkeypatch.delattr(pinocchio, "rneaInParallel")
    one_by_one = compute_by(pinocchio_engine, body, motion, wrenches)
    np.testing.assert_array_equal(in_parallel.tau, one_by_one.tau)


def test_compiled_kernels_run_else_pinocchio_where_it_can_be_imported_else_interpreted_kernels(
    body, motion, wrenches, monkeypatch
):
    made_from = "kernels generated with CasADi 3."
    compiled = kernels().solve_frames is not None
    assert inverse_dynamics(body, motion, wrenches).engine.startswith(made_from) or not compiled
    monkeypatch.setitem(native._READY, "kernels", interpreted_kernels("virtual machine"))
    forces = inverse_dynamics(body, motion, wrenches)
    assert forces.engine == f"Pinocchio {pinocchio.__version__}"
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    monkeypatch.delitem(sys.modules, "hbm.engines.pinocchio", raising=False)
    assert choose_engine() is kernels_engine()
    assert inverse_dynamics(body, motion, wrenches).engine.startswith(made_from)
