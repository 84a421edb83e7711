"""The lowest optimum: beside SciPy's best of several starts, with positions by Pinocchio."""

import numpy as np
import pytest

from hbm.ik.problem import Problem
from hbm.ik.tracking import TRIES, lowest, lowest_of_tries
from hbm.kinematics import solve_ik
from tests.hbm.motions import any_pose, markers_of, with_noise, without
from tests.synthetic import synthetic_body

UNUSED = [side + name for side in "LR" for name in ("MEE", "DELT", "FRM", "MEK", "MM")]
GOOD = ("equal", "lower than SciPy", "SciPy lost")


@pytest.fixture(scope="module")
def campaign():
    pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")
    from tests.campaign import inverse_kinematics

    return inverse_kinematics


@pytest.mark.parametrize("seed", range(20))
def test_no_start_of_scipy_ends_lower_whatever_body_pose_and_markers(campaign, seed):
    assert campaign.outcome(campaign.random_case(seed)) in GOOD


@pytest.mark.slow
def test_no_start_of_scipy_ends_lower_in_many_cases(campaign):
    seeds = range(1000, 1300)
    assert {campaign.outcome(campaign.random_case(seed)) for seed in seeds} <= set(GOOD)


def test_a_campaign_s_cases_differ_in_markers_calibration_and_gaps(campaign):
    """What the campaign draws is what it promises: else agreement would prove little."""
    cases = [campaign.random_case(seed) for seed in range(40)]
    markers = [set(case.body.markers) for case in cases]
    assert any("LMEE" in names for names in markers)
    assert sum("LMEE" not in names for names in markers) > 10
    assert sum(np.isnan(case.measured).any() for case in cases) > 10


@pytest.fixture(scope="module")
def arms_shown_weakly():
    """Unrelated poses of a body without medial markers and without markers along the arms."""
    body = synthetic_body()
    markers = with_noise(
        markers_of(body, any_pose(np.random.default_rng(3), 40)), np.random.default_rng(4), 0.003
    )
    return body, without(markers, UNUSED)


def problem_of(body, markers):
    return Problem(body, markers)


def test_the_search_never_ends_above_where_it_began(arms_shown_weakly):
    problem = problem_of(*arms_shown_weakly)
    rows = np.arange(40)
    first = problem.newton(rows, problem.rigid_fit(rows))
    found = lowest(problem, rows, first)
    rounding = 1e-9 * problem.cost(first) + 1e-15
    assert (problem.cost(found) <= problem.cost(first) + rounding).all()
    assert (problem.cost(found) < 0.9 * problem.cost(first)).any(), "nothing was found: no test"


def test_a_frame_s_lowest_optimum_does_not_depend_on_the_other_frames(arms_shown_weakly):
    problem = problem_of(*arms_shown_weakly)
    rows = np.arange(40)
    start = problem.newton(rows, problem.rigid_fit(rows))
    together = lowest(problem, rows, start)
    for k in (0, 17, 39):
        alone = lowest(problem, rows[k : k + 1], start.select(rows[k : k + 1]))
        np.testing.assert_allclose(alone.q[0], together.q[k], atol=1e-9)


def test_one_try_after_the_other_finds_what_a_round_of_tries_finds(arms_shown_weakly):
    problem = problem_of(*arms_shown_weakly)
    rows = np.arange(40)
    first = found = problem.newton(rows, problem.rigid_fit(rows))
    for k in range(TRIES):
        found = lowest_of_tries(problem, rows, found, slice(k, k + 1))
    before, after = problem.cost(first), problem.cost(found)
    whole_round = problem.cost(lowest_of_tries(problem, rows, first))
    assert (after <= before * (1 + 1e-9)).all()
    assert (whole_round < 0.99 * before).sum() > 5, "nothing was found: no test"
    assert (after < 1.01 * whole_round).mean() > 0.9


def test_with_exact_markers_of_weakly_shown_arms_no_pose_is_less_probable_than_the_true_one(
    arms_shown_weakly,
):
    body, truth = arms_shown_weakly[0], any_pose(np.random.default_rng(3), 40)
    exact = without(markers_of(body, truth), UNUSED)
    problem, rows = problem_of(body, exact), np.arange(40)
    found = lowest(problem, rows, problem.newton(rows, problem.rigid_fit(rows)))
    assert found.converged.all()
    assert (problem.cost(found) <= truth.q**2 @ problem.prior).all()


def test_of_two_poses_of_a_hand_that_fit_its_one_marker_equally_the_neutral_one_is_taken():
    """A hand that is flexed and abducted by half a turn more points in the same direction."""
    body = synthetic_body()
    truth = any_pose(np.random.default_rng(5), 30)
    found = solve_ik(body, markers_of(body, truth))
    for side in "LR":
        for name in ("WristFlexion", "HandAbduction"):
            expected = truth.coordinate(side + name)
            np.testing.assert_allclose(found.coordinate(side + name), expected, atol=1e-7)
