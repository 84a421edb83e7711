"""Newton's method: one optimum however its input lies in memory and wherever it stands."""

import numpy as np
import pytest

from hbm import descent
from hbm.body import build_body
from hbm.coordinates import COORDINATES, SEGMENTS, N
from hbm.native import kernels
from hbm.poses import marker_positions
from tests.synthetic import synthetic_t_pose

FRAMES = 21
TIGHT = 1e-9


@pytest.fixture(scope="module")
def problem():
    body = build_body(synthetic_t_pose(), mass=70.0)
    random = np.random.default_rng(3)
    locked = np.array([name in body.locked for name in COORDINATES])
    q = np.where(locked, 0, random.normal(0, 0.2, (FRAMES, N)))
    measured = marker_positions(body, q)
    measured += random.normal(0, 0.003, measured.shape)
    measured[4, 7] = np.nan
    segment = np.array([SEGMENTS.index(s) for s in body.marker_segment])
    worn = descent.Wearing(segment, body.marker_position, np.ones(len(segment)), body.geometry)
    prior = np.tile(np.where(locked, 1e9, 0.0), (FRAMES, 1))
    return worn, measured, q + np.where(locked, 0, 0.03), prior


def solve(problem, **changed):
    worn, measured, start, prior = problem
    given = {
        "position": measured,
        "start": start,
        "prior": prior,
        "reference": np.zeros_like(prior),
    }
    given |= changed
    return descent.solve_frames(worn, *given.values(), tolerance=1e-6)


def test_all_frames_converge_and_the_next_step_would_be_nothing(problem):
    solved = solve(problem)
    assert solved.converged.all()
    again = solve(problem, start=solved.q)
    np.testing.assert_allclose(again.q, solved.q, atol=TIGHT)
    assert np.all(again.gradient < 1e-12)


def test_the_memory_layout_of_the_markers_does_not_matter(problem):
    _, measured, *_ = problem
    turned = np.asfortranarray(measured)
    mixed = np.ascontiguousarray(measured.transpose(1, 0, 2)).transpose(1, 0, 2)
    expected = solve(problem)
    for layout in (turned, mixed):
        assert not layout.flags.c_contiguous
        np.testing.assert_array_equal(solve(problem, position=layout).q, expected.q)


def test_a_kilometre_from_the_origin_the_pose_is_the_same(problem):
    _, measured, start, _ = problem
    far = np.array([1000.0, -700.0, 300.0])
    there = start.copy()
    there[:, :3] += far
    here, away = solve(problem), solve(problem, position=measured + far, start=there)
    assert away.converged.all()
    np.testing.assert_allclose(away.q[:, 3:], here.q[:, 3:], atol=1e-7)  # markers round to 1e-13 m
    np.testing.assert_allclose(away.q[:, :3] - far, here.q[:, :3], atol=1e-7)


def test_without_a_compiler_the_numbers_are_the_same(problem, monkeypatch):
    if kernels().solve_frames is None:
        pytest.skip("no compiler here: there is only one way")
    compiled = solve(problem)
    monkeypatch.setattr(descent, "_native", descent._interpreted)
    interpreted = solve(problem)
    np.testing.assert_allclose(interpreted.q, compiled.q, atol=TIGHT)
    np.testing.assert_allclose(interpreted.error, compiled.error, atol=TIGHT)
    np.testing.assert_array_equal(interpreted.converged, compiled.converged)


@pytest.mark.parametrize("jobs", [2, 7])
def test_workers_do_not_show_in_the_result(problem, jobs):
    worn, measured, start, prior = problem
    many = [np.concatenate([x] * 20) for x in (measured, start, prior, np.zeros_like(prior))]
    one = descent.solve_frames(worn, *many, tolerance=1e-6)
    several = descent.solve_frames(worn, *many, tolerance=1e-6, jobs=jobs)
    np.testing.assert_array_equal(several.q, one.q)


def test_a_missing_marker_has_no_error_and_no_say(problem):
    worn, measured, *_ = problem
    solved = solve(problem)
    assert np.isnan(solved.error[4, 7])
    assert np.isfinite(np.delete(solved.error[4], 7)).all()
    weightless = descent.Wearing(
        worn.segment, worn.local, np.where(np.arange(len(worn.weight)) == 7, 0, 1.0), worn.geometry
    )
    shown = np.nan_to_num(measured, nan=5.0)
    np.testing.assert_allclose(
        solve((weightless, shown, *problem[2:])).q[4], solved.q[4], atol=TIGHT
    )
