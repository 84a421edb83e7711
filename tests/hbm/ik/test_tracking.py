"""Inverse kinematics finds the lowest optimum that SciPy finds from several starts."""

import numpy as np
import pytest

from hbm.ik import tracking
from hbm.ik.problem import Problem
from hbm.ik.tracking import TRIES, look_for_lower, lowest_of_tries, solve_ik
from hbm.markers import Markers
from tests.hbm.motions import any_pose, markers_of, swinging, with_noise, without
from tests.synthetic import synthetic_body

BODY = synthetic_body()
UNUSED = [side + name for side in "LR" for name in ("MEE", "DELT", "FRM", "MEK", "MM")]
GOOD = ("equal", "lower than SciPy", "SciPy lost")
ROWS = np.arange(40)
TRUTH = any_pose(np.random.default_rng(3), len(ROWS))


@pytest.mark.parametrize("seed", range(6))
def test_no_start_of_scipy_ends_lower_whatever_body_pose_and_markers(seed):
    pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")
    from tests.campaign import inverse_kinematics as campaign

    assert campaign.outcome(campaign.random_case(seed)) in GOOD


def from_rigid_fits(markers):
    problem = Problem(BODY, without(markers, UNUSED))
    return problem, problem.newton(ROWS, problem.rigid_fit(ROWS))


@pytest.fixture(scope="module")
def arms_shown_weakly():
    """Unrelated poses of a body without medial markers and without markers along the arms."""
    return from_rigid_fits(with_noise(markers_of(BODY, TRUTH), np.random.default_rng(4), 0.003))


def lowest(problem, start):
    found = start.select(np.arange(len(start.row)))
    look_for_lower(problem, found, np.arange(len(start.row)))
    return found


def test_the_search_never_ends_above_where_it_began_whatever_else_is_solved(arms_shown_weakly):
    problem, start = arms_shown_weakly
    found = lowest(problem, start)
    before, after = problem.cost(start), problem.cost(found)
    assert (after <= before * (1 + 1e-9) + 1e-15).all()
    assert (after < 0.9 * before).any(), "nothing was found: no test"
    for k in (0, 17, 39):
        alone = lowest(problem, start.select(ROWS[k : k + 1]))
        np.testing.assert_allclose(alone.q[0], found.q[k], atol=1e-9)


def test_one_try_after_the_other_finds_what_a_round_of_tries_finds(arms_shown_weakly):
    problem, first = arms_shown_weakly
    found = first
    for k in range(TRIES):
        found = lowest_of_tries(problem, found, slice(k, k + 1))
    before, after = problem.cost(first), problem.cost(found)
    whole_round = problem.cost(lowest_of_tries(problem, first))
    assert (after <= before * (1 + 1e-9)).all()
    assert (whole_round < 0.99 * before).sum() > 5, "nothing was found: no test"
    assert (after < 1.01 * whole_round).mean() > 0.9


def test_with_exact_markers_of_weakly_shown_arms_no_pose_is_less_probable_than_the_true_one():
    problem, start = from_rigid_fits(markers_of(BODY, TRUTH))
    found = lowest(problem, start)
    assert found.converged.all()
    assert (problem.cost(found) <= TRUTH.q**2 @ problem.prior).all()


def test_of_two_poses_of_a_hand_that_fit_its_one_marker_equally_the_neutral_one_is_taken():
    """A hand that is flexed and abducted by half a turn more points in the same direction."""
    truth = any_pose(np.random.default_rng(5), 30)
    found = solve_ik(BODY, markers_of(BODY, truth))
    for side in "LR":
        for name in ("WristFlexion", "HandAbduction"):
            expected = truth.coordinate(side + name)
            np.testing.assert_allclose(found.coordinate(side + name), expected, atol=1e-7)


@pytest.mark.parametrize(("missing", "tried"), [((), 0), (UNUSED, len(ROWS))])
def test_unrelated_poses_get_all_tries_where_the_first_ones_lead_lower(monkeypatch, missing, tried):
    frames = []
    monkeypatch.setattr(tracking, "look_for_lower", lambda *given: frames.append(len(given[2])))
    noisy = with_noise(markers_of(BODY, TRUTH), np.random.default_rng(4), 0.003)
    solve_ik(BODY, without(noisy, missing))
    assert frames[-1] == tried


def test_frames_without_markers_before_a_walk_change_nothing_in_those_with_markers():
    """Not even where a wrist loses its markers: neighbouring frames show how it is bent."""
    moving = swinging(np.random.default_rng(5), frames=120)
    walk = with_noise(markers_of(BODY, moving), np.random.default_rng(6), 0.003)
    walk = without(without(walk, UNUSED), ["LLW", "LMW"], slice(60, 70))
    position = np.pad(walk.position, ((180, 0), (0, 0), (0, 0)), constant_values=np.nan)
    longer = Markers(np.arange(len(position)) / 100, walk.names, position)
    expected, found = solve_ik(BODY, walk), solve_ik(BODY, longer)
    np.testing.assert_allclose(found.q[180:], expected.q, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.observed[180:], expected.observed)
    assert found.converged.tolist() == [False] * 180 + [True] * 120


def test_coordinates_nearby_lead_to_the_same_optimum_where_they_are_known():
    rng = np.random.default_rng(0)
    markers = with_noise(markers_of(BODY, swinging(rng)), rng, 0.001)
    near, unknown = solve_ik(BODY, markers).q.copy(), slice(10, 15)
    near[unknown] = np.nan
    moved = with_noise(markers, rng, 0.0005)
    expected = solve_ik(BODY, moved).q.copy()
    expected[unknown] = np.nan
    np.testing.assert_allclose(solve_ik(BODY, moved, near=near).q, expected, atol=1e-9)
