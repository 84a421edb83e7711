"""Two engines, one mechanics: they agree in every pose, and a call in which they do not fails."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hbm import dynamics
from hbm.coordinates import INDEX, LAST_Q, N_Q
from hbm.dynamics import inverse_dynamics
from hbm.engines.engine import (
    ENGINES,
    Engine,
    choose_engine,
    engine_identity,
    other_engine,
    require_agreement,
)
from hbm.model import Body
from tests.hbm.motions import any_pose

pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")
FEET = ("left_foot", "right_foot")
ROUNDING = 1e-11


@pytest.fixture
def wrenches(motion):
    random = np.random.default_rng(2)
    return {foot: random.normal(scale=300, size=(len(motion.time), 6)) for foot in FEET}


@pytest.fixture
def without_pinocchio(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    monkeypatch.delitem(sys.modules, "hbm.engines.pinocchio", raising=False)


def by_both(body, motion, wrenches):
    return [inverse_dynamics(body, motion, wrenches, engine=engine) for engine in ENGINES]


def assert_same(one, other):
    for mine, theirs in ((one.tau, other.tau), (one.residual, other.residual)):
        assert np.abs(mine - theirs).max() < ROUNDING * max(1, np.abs(mine).max())


@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(0, 10), segment=st.sampled_from([*LAST_Q]))
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_both_engines_agree_in_any_pose_at_any_speed_wherever_a_wrench_acts(
    body, seed, speed, segment
):
    random = np.random.default_rng(seed)
    pose = any_pose(random, 3)
    v, a = (speed * random.normal(size=(3, N_Q)) for _ in range(2))
    wrench = {segment: random.normal(scale=500, size=(3, 6))}
    assert_same(*by_both(body, replace(pose, v=v, a=10 * a), wrench))


@pytest.mark.parametrize("pitch", [90.0, -90.0, 90.0 + 1e-9])
def test_the_residual_moment_is_right_where_two_axes_of_the_pelvis_coincide(
    body, motion, wrenches, pitch
):
    q = motion.q.copy()
    q[:, INDEX["PelvisForwardPitch"]] = np.radians(pitch)
    assert_same(*by_both(body, replace(motion, q=q), wrenches))


def test_without_pinocchios_parallel_function_the_numbers_are_the_same(
    body, motion, wrenches, monkeypatch
):
    in_parallel = inverse_dynamics(body, motion, wrenches, engine="pinocchio")
    monkeypatch.delattr(pinocchio, "rneaInParallel")
    one_by_one = inverse_dynamics(body, motion, wrenches, engine="pinocchio")
    np.testing.assert_array_equal(in_parallel.tau, one_by_one.tau)


# -- which engine runs ----------------------------------------------------------------------------


def test_pinocchio_runs_where_it_can_be_imported_and_else_the_kernels(without_pinocchio):
    assert choose_engine().name == "kernels"
    assert engine_identity().startswith("kernels casadi ")
    assert other_engine(choose_engine()) is None


def test_pinocchio_is_the_default_and_each_engine_checks_the_other():
    assert choose_engine().name == "pinocchio"
    for name, other in (ENGINES, ENGINES[::-1]):
        assert other_engine(choose_engine(name)).name == other


def test_stating_pinocchio_where_it_is_missing_is_one_line(without_pinocchio):
    with pytest.raises(ValueError, match='or set engine = "kernels"'):
        choose_engine("pinocchio")
    assert engine_identity("pinocchio") == "pinocchio, missing"


# -- the check by the other engine ----------------------------------------------------------------


MASS, TENSOR = slice(0, 1), slice(4, 10)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("segment", "numbers"),
    [
        *((s, MASS) for s in ("pelvis", "left_hand")),
        ("right_shank", TENSOR),
    ],
)
def test_an_inertia_that_is_a_millionth_off_in_one_engine_is_found(
    body, motion, wrenches, monkeypatch, engine, segment, numbers
):
    wrong = body.inertia_vector.reshape(-1, 10).copy()
    wrong[wrong[:, 0] == body.rigid_bodies[segment].mass, numbers] *= 1 + 1e-6
    monkeypatch.setattr(Body, "inertia_vector", property(lambda _: wrong.ravel()))
    with pytest.raises(ValueError, match=r"disagree: frame \d+ \(\d\.\d+ s\), .*'hbm doctor'"):
        inverse_dynamics(body, motion, wrenches, engine=engine)


def test_a_wrong_jacobian_in_one_engine_is_found(body, motion, wrenches, monkeypatch):
    def shifted(*inputs):
        tau, wrench, found = intact.free_dynamics(*inputs)
        jacobians = {s: j * (1 + 1e-6) for s, j in found.items()}
        return tau, wrench, jacobians

    intact = choose_engine("kernels")
    broken = Engine("kernels", intact.version, shifted)
    monkeypatch.setattr(dynamics, "other_engine", lambda _: broken)
    inverse_dynamics(body, motion, {})
    with pytest.raises(ValueError, match="the two engines of inverse dynamics disagree"):
        inverse_dynamics(body, motion, wrenches)


@given(size=st.floats(1, 1e5), share=st.floats(0, 3e-8))
def test_differences_are_relative_to_the_frames_largest_force_and_moment(size, share):
    forces = np.ones((1, N_Q + 6))
    forces[0, INDEX["PelvisZ"]] = forces[0, INDEX["LHipFlexion"]] = size
    for quantity in ("PelvisX", "RKneeFlexion"):
        other = forces.copy()
        other[0, INDEX[quantity]] += share * size
        arguments = forces, other, ("A", "B"), np.array([0]), np.array([0.0])
        if share > 1.01e-8:
            with pytest.raises(ValueError, match=quantity):
                require_agreement(*arguments)
        elif share < 0.99e-8:
            assert require_agreement(*arguments) == pytest.approx(share, abs=1e-12)


def test_an_undefined_number_of_one_engine_is_a_disagreement():
    forces = np.ones((1, N_Q + 6))
    undefined = np.where(np.arange(N_Q + 6) == 3, np.nan, forces)
    with pytest.raises(ValueError, match="PelvisYaw"):
        require_agreement(forces, undefined, ("A", "B"), np.array([0]), np.array([0.0]))
