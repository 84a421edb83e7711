"""Inverse kinematics finds the optimum, whatever the start, the gaps and the threads."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from hbm.coordinates import COORDINATES, INDEX, LIMBS, N_Q, TREE
from hbm.ik import descent, problem
from hbm.ik.problem import Problem
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.poses import marker_positions
from tests.hbm.motions import (
    TRANSLATIONS,
    any_pose,
    markers_of,
    swinging,
    with_noise,
    without,
)
from tests.synthetic import T_POSE_MM, synthetic_body

NOISE_M = 0.004
SEEN = np.array(["Toe" not in name for name in COORDINATES])
PELVIS = ("LASIS", "RASIS", "LPSIS", "RPSIS")
TRUNK = ("C7", "T10", "JN", "XIPH")
LEG = ("LEK", "MEK", "LTHI", "LM", "MM", "LSHA", "HEE", "MT2", "MT5")


@pytest.fixture(scope="module")
def truth():
    return swinging(np.random.default_rng(10), frames=240)


@pytest.fixture(scope="module")
def noisy(body, truth):
    return with_noise(markers_of(body, truth), np.random.default_rng(11), NOISE_M)


@pytest.fixture(scope="module")
def solved(body, noisy):
    return solve_ik(body, noisy)


def cost(motion):
    return np.nansum(motion.marker_error**2, axis=1)


def refined(body, markers, frame, start, extra=None):
    """SciPy's answer for one frame: weighted distances over all coordinates but the toes."""
    own = [body.markers.index(name) for name in markers.names]
    measured = markers.position[frame]
    seen = np.isfinite(measured[:, 0])

    def away(x):
        q = np.zeros(N_Q)
        q[SEEN] = x
        model = marker_positions(body, q[None])[0, own]
        rows = (model - measured)[seen].ravel()
        return rows if extra is None else np.append(rows, extra(q))

    answer = least_squares(away, start[SEEN], xtol=1e-13, ftol=1e-14, gtol=1e-13)
    q = np.zeros(N_Q)
    q[SEEN] = answer.x
    return q, 2 * answer.cost


# -- the optimum ----------------------------------------------------------------------------------


def test_the_pose_that_made_the_markers_is_recovered(body, truth):
    found = solve_ik(body, markers_of(body, truth))
    np.testing.assert_allclose(found.q[:, SEEN], truth.q[:, SEEN], atol=1e-9)
    assert found.marker_error.max() < 1e-9
    assert found.converged.all()


def test_what_is_reported_as_converged_is_an_optimum(body, noisy, solved):
    """SciPy, started there, stays there; the gradient is that of 1 µm."""
    for frame in (0, 77, 239):
        q, least = refined(body, noisy, frame, solved.q[frame])
        assert cost(solved)[frame] <= least * (1 + 1e-9)
        np.testing.assert_allclose(solved.q[frame], q, atol=2e-6)
    again = Problem(body, noisy).newton(np.arange(len(noisy.time)), solved.q)
    assert again.gradient.max() < 1e-6 * len(body.markers)


def test_marker_errors_are_distances_from_the_model(body, noisy, solved):
    own = [body.markers.index(name) for name in solved.markers]
    model = marker_positions(body, solved.q)[:, own]
    columns = [noisy.names.index(name) for name in solved.markers]
    away = np.linalg.norm(noisy.position[:, columns] - model, axis=-1)
    np.testing.assert_allclose(solved.marker_error, away, atol=1e-12)


def test_rotating_and_shifting_the_lab_rotates_and_shifts_the_pelvis_alone(body, noisy, solved):
    yaw, shift = 2.3, np.array([3.0, -1.0, 0.2])
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    found = solve_ik(body, Markers(noisy.time, noisy.names, noisy.position @ R.T + shift))
    np.testing.assert_allclose(found.q[:, :3], solved.q[:, :3] @ R.T + shift, atol=1e-9)
    np.testing.assert_allclose(found.q[:, 4:], solved.q[:, 4:], atol=1e-9)
    difference = found.q[:, 3] - solved.q[:, 3] - yaw
    np.testing.assert_allclose(np.sin(difference / 2), 0, atol=1e-9)


def test_the_order_of_the_markers_does_not_matter(body, noisy, solved):
    order = np.random.default_rng(12).permutation(len(noisy.names))
    names = tuple(noisy.names[k] for k in order)
    found = solve_ik(body, Markers(noisy.time, names, noisy.position[:, order]))
    np.testing.assert_allclose(found.q, solved.q, atol=1e-10)


# -- priors ----------------------------------------------------------------------------------------


def test_a_prior_is_one_more_row_of_the_least_squares_problem(body, noisy):
    weight, i = 0.3, INDEX["RKneeFlexion"]
    with_prior = Problem(body, noisy)
    with_prior.prior[i] = weight
    every = np.arange(len(noisy.time))
    found = with_prior.newton(every, solve_ik(body, noisy).q)
    for frame in (5, 120):
        q, _ = refined(
            body,
            noisy,
            frame,
            found.q[frame],
            extra=lambda q: np.sqrt(weight) * q[i],
        )
        np.testing.assert_allclose(found.q[frame], q, atol=2e-6)


# -- blocks and threads ---------------------------------------------------------------------------


@pytest.mark.parametrize("jobs", [7])
def test_the_result_does_not_depend_on_the_number_of_threads(body, noisy, solved, jobs):
    np.testing.assert_allclose(solve_ik(body, noisy, jobs=jobs).q, solved.q, atol=1e-9)


@pytest.mark.parametrize("frames", [1, 37])
def test_the_result_does_not_depend_on_how_many_frames_are_solved_at_once(
    body, noisy, solved, frames, monkeypatch
):
    monkeypatch.setattr(problem, "FRAMES_AT_ONCE", frames)
    np.testing.assert_allclose(solve_ik(body, noisy).q, solved.q, atol=1e-9)


@pytest.mark.parametrize("cut", [1, 133])
def test_a_trial_cut_in_two_gives_the_same_coordinates(body, noisy, solved, cut):
    parts = [
        solve_ik(body, Markers(noisy.time[part], noisy.names, noisy.position[part])).q
        for part in (slice(cut), slice(cut, None))
    ]
    difference = np.concatenate(parts) - solved.q
    difference[:, ~TRANSLATIONS] = 2 * np.sin(difference[:, ~TRANSLATIONS] / 2)
    np.testing.assert_allclose(difference, 0, atol=1e-9)


# -- cold start -----------------------------------------------------------------------------------


@pytest.mark.parametrize("noise_m", [0.0, 0.005])
def test_any_pose_is_found_as_from_the_true_pose(body, noise_m):
    """200 unrelated poses in one trial, and some of them alone: neighbours do not help."""
    poses = any_pose(np.random.default_rng(13), 200)
    markers = with_noise(markers_of(body, poses), np.random.default_rng(14), noise_m)
    frames = Problem(body, markers)
    from_truth = frames.newton(np.arange(200), poses.q)
    least = (from_truth.error**2).sum(axis=1)
    found = solve_ik(body, markers)
    assert found.converged.all()
    np.testing.assert_allclose(cost(found), least, rtol=1e-9, atol=1e-15)
    for frame in range(0, 200, 50):
        one = Markers(markers.time[:1], markers.names, markers.position[frame : frame + 1])
        np.testing.assert_allclose(
            cost(solve_ik(body, one))[0], least[frame], rtol=1e-9, atol=1e-15
        )


# -- gaps -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["LASIS", "C7", "RLEE", "LFIN", "LHEE"])
def test_a_second_without_any_one_marker_is_solved(body, noisy, solved, name):
    found = solve_ik(body, without(noisy, [name], slice(70, 170)))
    assert found.converged.all()
    elsewhere = np.r_[0:70, 170:240]
    np.testing.assert_allclose(found.q[elsewhere], solved.q[elsewhere], atol=1e-9)


def test_coordinates_that_lose_their_markers_are_interpolated_linearly(body, noisy):
    found = solve_ik(body, without(noisy, ["LFIN"], slice(70, 170)))
    hand = [INDEX["LWristFlexion"], INDEX["LHandAbduction"]]
    assert not found.observed[70:170, hand].any()
    assert found.observed[:70, hand].all()
    for i in hand:
        line = np.interp(np.arange(69, 171), [69, 170], found.q[[69, 170], i])
        np.testing.assert_allclose(found.q[69:171, i], line, atol=1e-9)
    others = np.setdiff1d(np.flatnonzero(SEEN), hand)
    assert found.observed[:, others].all()


def test_a_pelvis_without_markers_is_found_from_trunk_and_thighs(body, truth):
    exact = without(markers_of(body, truth), ("LASIS", "RASIS", "LPSIS", "RPSIS"))
    found = solve_ik(body, exact)
    assert found.converged.all()
    np.testing.assert_allclose(found.q[:, SEEN], truth.q[:, SEEN], atol=1e-6)


@pytest.mark.parametrize(
    "gone",
    [
        [*PELVIS, *(n for n in T_POSE_MM if n[1:] in LEG)],
        [*TRUNK, *(n for n in T_POSE_MM if "HEAD" in n)],
    ],
    ids=["pelvis and legs", "trunk and head"],
)
def test_only_frames_without_pelvis_or_trunk_are_lost(body, noisy, solved, gone):
    found = solve_ik(body, without(noisy, gone, slice(100, 130)))
    np.testing.assert_array_equal(np.flatnonzero(~found.converged), np.arange(100, 130))
    elsewhere = np.r_[0:100, 130:240]
    np.testing.assert_allclose(found.q[elsewhere], solved.q[elsewhere], atol=1e-9)


@pytest.mark.parametrize("limb", ["left arm", "right leg"])
def test_a_limb_without_markers_for_long_costs_no_frame(body, noisy, solved, limb):
    names = [n for n, s in zip(body.markers, body.marker_segment, strict=True) if s in LIMBS[limb]]
    found = solve_ik(body, without(noisy, names, slice(30, 200)))
    assert found.converged.all()
    own = np.array([c.segment in LIMBS[limb] for c in TREE])
    assert not found.observed[30:200, own].any()
    assert found.observed[30:200, SEEN & ~own].all()
    np.testing.assert_allclose(found.q[:30], solved.q[:30], atol=1e-9)


def test_a_limb_that_cannot_be_solved_is_left_out_and_the_rest_of_the_body_is_solved(
    body, noisy, monkeypatch
):
    """Scattered markers of an arm take more iterations than there are, all else does not."""
    names = [
        n for n, s in zip(body.markers, body.marker_segment, strict=True) if s in LIMBS["left arm"]
    ]
    scattered = noisy.position.copy()
    columns = [noisy.names.index(name) for name in names]
    scattered[60:80, columns] += np.random.default_rng(18).normal(0, 0.6, (20, len(names), 3))
    markers = Markers(noisy.time, noisy.names, scattered)
    monkeypatch.setattr(descent, "MAX_ITERATIONS", 12)
    found = solve_ik(body, markers)
    arm = np.array([c.segment in LIMBS["left arm"] for c in TREE])
    left_out = ~found.observed[:, arm].any(axis=1)
    assert left_out.any()
    assert not left_out[np.r_[0:60, 80:240]].any()
    assert found.converged.all()
    own = [found.markers.index(name) for name in names]
    assert np.isnan(found.marker_error[np.ix_(left_out, own)]).all()
    alone = left_out & found.observed[:, SEEN & ~arm].all(axis=1)
    assert alone.sum() > 5
    expected = solve_ik(body, without(noisy, names)).q
    np.testing.assert_allclose(found.q[alone][:, ~arm], expected[alone][:, ~arm], atol=1e-8)


# -- noise ----------------------------------------------------------------------------------------


def jacobian(body, q, rows):
    step, columns = 1e-6, np.flatnonzero(SEEN)
    moved = np.repeat(q[None], 2 * len(columns), axis=0)
    for k, i in enumerate(columns):
        moved[2 * k, i] += step
        moved[2 * k + 1, i] -= step
    model = marker_positions(body, moved)[:, rows].reshape(len(columns), 2, -1)
    return (model[:, 0] - model[:, 1]).T / (2 * step)


@pytest.mark.parametrize("name", ["LDELT", "RFRM", "RLTHI", "LLSHA"])
def test_dropping_a_tracking_marker_moves_coordinates_by_what_the_noise_explains(body, name):
    """Nested least squares: the estimate without it differs by the difference of covariances."""
    frames = 300
    pose = any_pose(np.random.default_rng(16), 1)
    still = markers_of(body, pose)
    many = Markers(np.arange(frames) / 100, still.names, np.tile(still.position, (frames, 1, 1)))
    many = with_noise(many, np.random.default_rng(17), 0.001)
    full, less = solve_ik(body, many), solve_ik(body, without(many, [name]))
    every = np.arange(len(body.markers))
    covariance = [
        np.linalg.inv(J.T @ J)
        for rows in (every, np.delete(every, body.markers.index(name)))
        for J in [jacobian(body, pose.q[0], rows)]
    ]
    expected = 0.001 * np.sqrt(np.maximum(np.diag(covariance[1] - covariance[0]), 0))
    moved = np.sqrt(np.mean((less.q - full.q)[:, SEEN] ** 2, axis=0))
    assert (moved < 1.2 * expected + 1e-5).all()


# -- errors ---------------------------------------------------------------------------------------


@settings(max_examples=4)
@given(seed=st.integers(0, 2**31))
def test_any_motion_with_any_gaps_is_solved_or_marked(seed):
    rng = np.random.default_rng(seed)
    body, truth = synthetic_body(), swinging(rng, frames=60)
    markers = with_noise(markers_of(body, truth), rng, NOISE_M)
    position = markers.position.copy()
    position[rng.random(position.shape[:2]) < rng.uniform(0, 0.6)] = np.nan
    found = solve_ik(body, Markers(markers.time, markers.names, position))
    np.testing.assert_array_equal(np.isnan(found.q).any(axis=1), ~found.converged)
    np.testing.assert_array_equal(np.isnan(found.q).all(axis=1), ~found.converged)


def test_a_trial_without_any_of_the_body_s_markers_is_refused(body):
    strange = Markers(np.zeros(1), ("A", "B"), np.zeros((1, 2, 3)))
    with pytest.raises(ValueError, match=r"none of .* A, B"):
        solve_ik(body, strange)
