"""Newton's method finds one optimum, whatever the memory layout, the place or the threads."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.body import build_body
from hbm.coordinates import COORDINATES, MOVING, N_Q
from hbm.ik import descent
from hbm.ik.descent import MarkerAttachment
from hbm.kernels.native import kernels
from hbm.poses import marker_positions
from tests.synthetic import synthetic_t_pose

FRAMES = 21
TIGHT = 1e-9


@pytest.fixture(scope="module")
def problem():
    body = build_body(synthetic_t_pose(), mass=70.0)
    random = np.random.default_rng(3)
    locked = np.array([name in body.locked for name in COORDINATES])
    q = np.where(locked, 0, random.normal(0, 0.2, (FRAMES, N_Q)))
    measured = marker_positions(body, q)
    measured += random.normal(0, 0.003, measured.shape)
    measured[4, 7] = np.nan
    segment = np.array([MOVING.index(s) for s in body.marker_segment])
    attachment = MarkerAttachment(
        segment,
        body.marker_position,
        np.ones(len(segment)),
        body.geometry,
        measured,
        np.arange(len(segment)),
    )
    prior = np.tile(np.where(locked, 1e9, 0.0), (FRAMES, 1))
    return attachment, q + np.where(locked, 0, 0.03), prior


def solve(problem, **changed):
    attachment, start, prior = problem
    terms = changed.pop("start", start), prior, np.zeros_like(prior)
    markers = {name: changed.pop(name) for name in ("position", "weight") if name in changed}
    rows = np.arange(len(start))
    return descent.solve_frames(replace(attachment, **markers), rows, terms, 1e-6, **changed)


def test_the_memory_layout_of_the_markers_does_not_matter(problem):
    measured = problem[0].position
    by_column = np.asfortranarray(measured)
    mixed = np.ascontiguousarray(measured.transpose(1, 0, 2)).transpose(1, 0, 2)
    expected = solve(problem)
    for layout in (by_column, mixed):
        assert not layout.flags.c_contiguous
        np.testing.assert_array_equal(solve(problem, position=layout).q, expected.q)


def test_a_kilometre_from_the_origin_the_pose_is_the_same(problem):
    attachment, start, _ = problem
    far = np.array([1000.0, -700.0, 300.0])
    there = start.copy()
    there[:, :3] += far
    here, away = solve(problem), solve(problem, position=attachment.position + far, start=there)
    assert away.converged.all()
    np.testing.assert_allclose(away.q[:, 3:], here.q[:, 3:], atol=1e-7)  # markers round to 1e-13 m
    np.testing.assert_allclose(away.q[:, :3] - far, here.q[:, :3], atol=1e-7)


def by_both(monkeypatch, problem, **options):
    """Solve a problem by the compiled and by the interpreted descent."""
    ready = kernels()
    if ready.solve_frames is None:
        pytest.skip("no compiler here: there is only the interpreted descent")
    compiled = solve(problem, **options)
    monkeypatch.setattr(descent, "kernels", lambda: replace(ready, solve_frames=None))
    return compiled, solve(problem, **options)


def test_compiled_and_interpreted_descent_find_the_same_optima(problem, monkeypatch):
    compiled, interpreted = by_both(monkeypatch, problem)
    np.testing.assert_allclose(interpreted.q, compiled.q, atol=TIGHT)
    np.testing.assert_allclose(interpreted.error, compiled.error, atol=TIGHT)
    np.testing.assert_array_equal(interpreted.converged, compiled.converged)


@pytest.mark.parametrize(
    ("constant", "value"),
    [
        ("MAX_ITERATIONS", 2),
        ("MAX_STEP", 0.01),
        ("NEAR_OPTIMUM", 10.0),
        ("DAMPING", 10.0),
        ("DAMPING_FACTOR", 3.0),
        ("DAMPING_DIVISOR", 2.0),
        ("NEGLIGIBLE_DAMPING", 1e-2),
        ("MAX_RELATIVE_RISE", -0.5),
    ],
)
def test_compiled_and_interpreted_descent_use_the_same_constants(
    problem, monkeypatch, constant, value
):
    """Far from the optimum and after a few iterations, every constant has left its mark."""
    away = np.random.default_rng(4).normal(0, 0.7, problem[1].shape)
    start = problem[1] + np.where(problem[2] > 0, 0, away)
    monkeypatch.setattr(descent, "MAX_ITERATIONS", 12)
    usual = solve(problem, start=start)
    monkeypatch.setattr(descent, constant, value)
    compiled, interpreted = by_both(monkeypatch, problem, start=start)
    assert np.abs(compiled.q - usual.q).max() > 1e-6
    np.testing.assert_allclose(interpreted.q, compiled.q, atol=TIGHT)
    np.testing.assert_array_equal(interpreted.converged, compiled.converged)


def test_compiled_and_interpreted_descent_end_slow_frames_alike(problem, monkeypatch):
    start, rising = problem[1] + 0.1, 1e-4
    monkeypatch.setattr(descent, "MAX_ABSOLUTE_RISE", rising)
    usual = solve(problem, start=start)
    monkeypatch.setattr(descent, "SLOW", 2)
    compiled, interpreted = by_both(monkeypatch, problem, start=start)
    assert np.abs(compiled.q - usual.q).max() > 1e-6
    np.testing.assert_allclose(interpreted.q, compiled.q, atol=TIGHT)
