"""The equations of motion hold for closed loops and invariances, as independent ones have them."""

from dataclasses import replace

import numpy as np
import pytest

from hbm import dynamics
from hbm.coordinates import INDEX, LAST_Q, MOVING, support
from hbm.dynamics import filter_motion, inverse_dynamics, inverse_dynamics_variants
from hbm.poses import center_of_mass, segment_frames
from hbm.spatial import GRAVITY_MPS2, rotation_about, shift_wrench, transform_wrench
from tests.hbm.motions import motion_of, swinging
from tests.synthetic import MASS_KG

PELVIS = slice(0, 3)
RELATIVE = 1e-9
WEIGHT = MASS_KG * GRAVITY_MPS2


@pytest.fixture(scope="module")
def pin():
    return pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")


@pytest.fixture
def wrenches(motion):
    rng, frames = np.random.default_rng(2), len(motion.time)
    return {
        "left_foot": rng.normal([30, 20, 500, 40, 90, 10], 50, (frames, 6)),
        "right_foot": rng.normal([-30, 10, 300, -40, 60, 5], 50, (frames, 6)),
    }


def agree(actual, expected, scale=WEIGHT):
    np.testing.assert_allclose(actual, expected, rtol=RELATIVE, atol=RELATIVE * scale)


def at_lab_origin(residual, motion):
    return shift_wrench(residual, -motion.q[:, PELVIS])


def still(q):
    return motion_of(np.arange(len(q)) / 100, q, np.zeros_like(q), np.zeros_like(q))


def test_residual_vanishes_when_the_ground_carries_the_motion(body, motion):
    free = inverse_dynamics(body, motion, {})
    closed = inverse_dynamics(body, motion, {"right_foot": at_lab_origin(free.residual, motion)})
    agree(closed.residual, 0)
    agree(closed.tau[:, :6], 0)


def test_residual_does_not_depend_on_the_segment_that_a_wrench_acts_on(body, motion, wrenches):
    feet = inverse_dynamics(body, motion, wrenches)
    left, right = wrenches.values()
    elsewhere = inverse_dynamics(body, motion, {"head": left, "right_hand": right})
    agree(elsewhere.residual, feet.residual)
    assert np.abs(elsewhere.tau - feet.tau).max() > 10


def test_rotating_and_shifting_the_lab_rotates_and_shifts_the_residual(body, motion, wrenches):
    """Rotated about the vertical, the only axis about which gravity stays the same."""
    yaw, shift = 2.1, np.array([0.7, -1.9, 0.4])
    R = rotation_about([0, 0, 1], yaw)
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    q[:, PELVIS] = q[:, PELVIS] @ R.T + shift
    v[:, PELVIS], a[:, PELVIS] = v[:, PELVIS] @ R.T, a[:, PELVIS] @ R.T
    q[:, INDEX["PelvisYaw"]] += yaw
    moved = {s: transform_wrench(w, R, shift) for s, w in wrenches.items()}
    before = inverse_dynamics(body, motion, wrenches)
    after = inverse_dynamics(body, replace(motion, q=q, v=v, a=a), moved)
    agree(after.residual, transform_wrench(before.residual, R, np.zeros(3)))
    agree(after.tau[:, 3:], before.tau[:, 3:])


def test_residual_projected_on_the_pelvis_axes_is_the_force_on_its_coordinates(body, motion):
    found = inverse_dynamics(body, motion, {})
    rotation, _ = segment_frames(body, motion.q)
    yaw = rotation_about([0.0, 0, 1], motion.q[:, INDEX["PelvisYaw"]])
    axes = np.stack(
        [np.broadcast_to([0.0, 0, 1], yaw[:, :, 0].shape), yaw[:, :, 1], rotation[:, 0, :, 0]], 1
    )
    agree(found.tau[:, :3], found.residual[:, :3])
    agree(found.tau[:, 3:6], np.einsum("tci,ti->tc", axes, found.residual[:, 3:]))


def test_standing_still_the_residual_is_body_weight_through_the_centre_of_mass(body):
    q = swinging(np.random.default_rng(4)).q
    needed = inverse_dynamics(body, still(q), {}).residual
    agree(needed[:, :3], np.tile([0, 0, WEIGHT], (len(q), 1)))
    arm = center_of_mass(body, q) - q[:, PELVIS]
    agree(needed[:, 3:], np.cross(arm, [0, 0, WEIGHT]))


def test_in_free_fall_all_forces_vanish(body):
    q = swinging(np.random.default_rng(5)).q
    falling = np.zeros_like(q)
    falling[:, INDEX["PelvisZ"]] = -GRAVITY_MPS2
    motion = motion_of(np.arange(len(q)) / 100, q, np.zeros_like(q), falling)
    agree(inverse_dynamics(body, motion, {}).tau, 0)


# -- by hand: every quantity as a Taylor series in time, [value, rate, half the acceleration] ------


def multiply(a, b):
    """Multiply two series of matrices or vectors."""
    return [sum(a[i] @ b[k - i] for i in range(k + 1)) for k in range(min(len(a), len(b)))]


def rotation_series(axis, q, v, a):
    """Series of the rotation about a unit axis by an angle with these derivatives."""
    cross = np.cross(np.eye(3), axis)  # cross @ b == np.cross(axis, b)
    s, c = np.sin(q), np.cos(q)
    sine = [s, c * v, (c * a - s * v**2) / 2]
    cosine = [1 - c, s * v, (s * a + c * v**2) / 2]
    series = [x * cross + y * cross @ cross for x, y in zip(sine, cosine, strict=True)]
    series[0] = series[0] + np.eye(3)
    return series


def frames_by_hand(body, q, v, a):
    """Series of orientation and origin of every segment."""
    zero = np.zeros(3)
    frames = {-1: ([np.eye(3), np.zeros((3, 3)), np.zeros((3, 3))], [zero, zero, zero])}
    for i, joint in enumerate(body.joints):
        R, o = frames[joint.parent]
        axis, offset = joint.axis, joint.offset
        along = (
            [offset + axis * q[i], axis * v[i], axis * a[i] / 2] if joint.translates else [offset]
        )
        moved = multiply(R, [*along, zero, zero])
        o = [x + y for x, y in zip(o, moved, strict=True)]
        frames[i] = (
            (R if joint.translates else multiply(R, rotation_series(axis, q[i], v[i], a[i]))),
            o,
        )
    return {s: frames[LAST_Q[s]] for s in body.segments}


def needed_by_hand(body, q, v, a):
    """Sum m (a − g) and the rate of angular momentum about the lab origin, segment by segment."""
    force, moment = np.zeros(3), np.zeros(3)
    for s, (R, o) in frames_by_hand(body, q, v, a).items():
        part, zero = body.segments[s], np.zeros(3)
        c = [x + y for x, y in zip(o, multiply(R, [part.center, zero, zero]), strict=True)]
        push = part.mass * (2 * c[2] + [0, 0, GRAVITY_MPS2])
        back = [x.T for x in R]
        spin = multiply([R[1], 2 * R[2]], back)
        omega = [np.array([x[2, 1], x[0, 2], x[1, 0]]) for x in spin]
        body_tensor = [part.tensor, np.zeros((3, 3)), np.zeros((3, 3))]
        momentum = multiply(multiply(multiply(R, body_tensor), back), omega)
        force += push
        moment += np.cross(c[0], push) + momentum[1]
    return np.concatenate([force, moment])


def test_residual_equals_newton_and_euler_summed_by_hand(body, motion, wrenches):
    found = inverse_dynamics(body, motion, wrenches).residual
    rows = zip(motion.q, motion.v, motion.a, strict=True)
    needed = np.array([needed_by_hand(body, *row) for row in rows])
    external = sum(wrenches.values())
    agree(found, shift_wrench(needed - external, motion.q[:, PELVIS]))


# -- Pinocchio, on the body's own model -----------------------------------------------------------


def test_pinocchio_and_the_kernels_give_the_same_segment_frames(pin, body, motion):
    model, data = body.model, body.model.createData()
    rotation, origin = segment_frames(body, motion.q)
    for k, q in enumerate(motion.q):
        pin.framesForwardKinematics(model, data, q)
        for s, name in enumerate(MOVING):
            frame = data.oMf[model.getFrameId(name)]
            np.testing.assert_allclose(rotation[k, s], frame.rotation, atol=1e-12)
            np.testing.assert_allclose(origin[k, s], frame.translation, atol=1e-12)


def test_power_of_all_forces_is_the_rate_of_mechanical_energy(pin, body):
    motion = swinging(np.random.default_rng(6), frames=400, rate_hz=2000)
    power = inverse_dynamics(body, motion, {}).power.sum(axis=1)
    model, data = body.model, body.model.createData()
    energy = [
        pin.computeKineticEnergy(model, data, q, v) + pin.computePotentialEnergy(model, data, q)
        for q, v in zip(motion.q, motion.v, strict=True)
    ]
    step = motion.time[1]
    e = np.array(energy)
    rate = (8 * (e[3:-1] - e[1:-3]) - (e[4:] - e[:-4])) / (12 * step)
    np.testing.assert_allclose(power[2:-2], rate, rtol=1e-6, atol=1e-6 * np.abs(rate).max())


# -- the interface --------------------------------------------------------------------------------


def test_variants_in_one_pass_equal_each_alone(body, motion, wrenches):
    sets = [wrenches, {}, {"left_foot": 2 * wrenches["left_foot"]}]
    together = inverse_dynamics_variants(body, motion, sets, jobs=2)
    for one, given in zip(together, sets, strict=True):
        alone = inverse_dynamics(body, motion, given)
        np.testing.assert_array_equal(one.tau, alone.tau)
        np.testing.assert_array_equal(one.residual, alone.residual)


@pytest.mark.parametrize("frames", [7])
def test_the_forces_do_not_depend_on_how_many_frames_are_evaluated_at_once(
    body, motion, wrenches, frames, monkeypatch
):
    whole = inverse_dynamics(body, motion, wrenches)
    monkeypatch.setattr(dynamics, "FRAMES_AT_ONCE", frames)
    blocks = inverse_dynamics(body, motion, wrenches)
    np.testing.assert_array_equal(blocks.tau, whole.tau)
    np.testing.assert_array_equal(blocks.residual, whole.residual)


def test_frames_without_a_solution_or_a_wrench_are_undefined_and_no_others(body, motion, wrenches):
    q = motion.q.copy()
    q[3] = np.nan
    wrenches["left_foot"][7] = np.nan
    found = inverse_dynamics(body, replace(motion, q=q), wrenches)
    undefined = np.isnan(found.residual).any(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(undefined), [3, 7])


def test_only_joints_that_carry_an_undefined_wrench_are_undefined(body, motion, wrenches):
    wrenches["left_foot"][7] = np.nan
    undefined = np.isnan(inverse_dynamics(body, motion, wrenches).tau[7])
    np.testing.assert_array_equal(np.flatnonzero(undefined), sorted(support(LAST_Q["left_foot"])))


def test_an_unfiltered_motion_is_refused(body, motion):
    undefined = np.full_like(motion.q, np.nan)
    with pytest.raises(ValueError, match="filter_motion"):
        inverse_dynamics(body, replace(motion, v=undefined, a=undefined), {})


def test_zero_phase_filter_preserves_slow_movement_and_gives_its_derivatives():
    motion = swinging(np.random.default_rng(7), frames=400, degrees=20)
    smooth = filter_motion(motion, cutoff=12.0, method="zero_phase")
    inner = slice(100, -100)
    for mine, truth in ((smooth.q, motion.q), (smooth.v, motion.v), (smooth.a, motion.a)):
        error = np.abs(mine - truth)[inner].max(axis=0)
        assert (error < 0.01 * np.abs(truth).max(axis=0)).all()
