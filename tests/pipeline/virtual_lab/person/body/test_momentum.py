"""The laboratory's own mechanics obeys Newton's laws and agrees with the production's."""

import numpy as np
import pytest

from hbm.coordinates import N_Q
from hbm.dynamics import inverse_dynamics
from hbm.kernels.native import kernels
from hbm.motion import Motion
from hbm.poses import marker_positions as production_markers
from hbm.spatial import GRAVITY_MPS2
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.person.body import (
    ALL_COORDINATES,
    LEG_COORDINATES,
    center_of_mass,
    frames,
    ground_wrench,
    marker_positions,
    moments_of,
)
from pipeline.virtual_lab.person.subject import Person, make_subject
from tests.validation.true_body import true_body

STEP_S = 1e-4


def subject_of(faults):
    return make_subject(Person(), individuality=1.0, faults=faults, rng=np.random.default_rng(4))


@pytest.fixture(scope="module")
def same():
    return subject_of(Faults.none().body)


@pytest.fixture(scope="module")
def other():
    return subject_of(BodyFaults())


def random_state(frames_wanted, coordinates, seed=0):
    state = np.zeros((3, len(ALL_COORDINATES), frames_wanted))
    rng = np.random.default_rng(seed)
    state[:, :coordinates] = rng.normal(size=(3, coordinates, frames_wanted))
    return tuple(state)


def smooth_motion(time):
    """Give coordinates that oscillate, and their first and second derivatives, (55, T) each."""
    rng = np.random.default_rng(3)
    size, phase = rng.normal(size=(2, len(ALL_COORDINATES), 1))
    omega = rng.uniform(2.0, 9.0, (len(ALL_COORDINATES), 1))
    angle = omega * time + phase
    return (
        0.3 * size * np.sin(angle),
        0.3 * size * omega * np.cos(angle),
        -0.3 * size * omega**2 * np.sin(angle),
    )


def test_the_ground_wrench_is_that_of_the_production_s_newton_euler_equations(same):
    """Momentum sums with differentiated rotation matrices against recursive spatial algebra."""
    state = random_state(300, N_Q)
    body = true_body(same)
    coordinates = (np.ascontiguousarray(values[:N_Q].T) for values in state)
    expected = kernels().newton_euler(*coordinates, body.geometry, body.inertia_vector)[1]
    np.testing.assert_allclose(ground_wrench(same.skeleton, state), expected, atol=1e-9)


def test_leg_moments_are_those_of_the_production_s_inverse_dynamics(same):
    """Segments beyond a joint by Newton's and Euler's laws, against recursive spatial algebra."""
    state = random_state(200, N_Q, seed=5)
    rng = np.random.default_rng(6)
    feet = {side: 500 * rng.normal(size=(200, 6)) for side in ("left", "right")}
    q, v, a = (np.ascontiguousarray(values[:N_Q].T) for values in state)
    known = np.ones(q.shape, bool)
    motion = Motion(np.arange(200) / 100, q, v, a, (), np.zeros((200, 0)), known[:, 0], known)
    wrenches = {f"{side}_foot": wrench for side, wrench in feet.items()}
    expected = inverse_dynamics(true_body(same), motion, wrenches)
    found = moments_of(same.skeleton, state, feet, [])
    for name, moment in zip(LEG_COORDINATES, found, strict=True):
        np.testing.assert_allclose(moment, expected.force(name), atol=1e-8, err_msg=name)


def test_markers_are_where_the_production_s_kinematics_put_them(same):
    q, *_ = random_state(50, N_Q, seed=1)
    expected = production_markers(true_body(same), np.ascontiguousarray(q[:N_Q].T))
    np.testing.assert_allclose(marker_positions(same.skeleton, q), expected, atol=1e-12)


def momentum(skeleton, q, rate):
    """Give linear and angular momentum about the lab's origin, (6, T), segment by segment."""
    still = np.zeros_like(q)
    found = frames(skeleton, (q, rate, still))
    ahead, behind = (frames(skeleton, (q + way * STEP_S * rate,)) for way in (1, -1))
    total = np.zeros((6, q.shape[1]))
    for name, part in skeleton.inertias.items():
        R, spin = found[name].rotation[:2]
        tensor = np.einsum("ijt,jk,lkt->ilt", R, part.tensor, R)
        turning = np.einsum("ijt,kjt->ikt", spin, R)
        omega = np.stack([turning[2, 1], turning[0, 2], turning[1, 0]])
        ends = (side[name].point(part.center) for side in (ahead, behind))
        linear = part.mass * np.subtract(*ends) / (2 * STEP_S)
        total[:3] += linear
        total[3:] += np.cross(found[name].point(part.center), linear, axis=0)
        total[3:] += np.einsum("ijt,jt->it", tensor, omega)
    return total


def test_the_ground_wrench_is_the_rate_of_change_of_momentum_less_weight(other):
    """With momenta from velocities alone, differentiated numerically; all 55 coordinates move."""
    time = np.linspace(0.0, 1.0, 21)
    skeleton = other.skeleton
    before, after = (momentum(skeleton, *smooth_motion(time + way * STEP_S)[:2]) for way in (-1, 1))
    state = smooth_motion(time)
    weight = np.array([0.0, 0.0, skeleton.mass * GRAVITY_MPS2])
    place = center_of_mass(skeleton, state[0])
    expected = ((after - before) / (2 * STEP_S)).T
    expected[:, :3] += weight
    expected[:, 3:] += np.cross(place, weight)
    found = ground_wrench(skeleton, state)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=0.02)
