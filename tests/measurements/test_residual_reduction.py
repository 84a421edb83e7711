"""The prototype's splines are right, and it does nothing where it should do nothing."""

import numpy as np
import pytest

from hbm.coordinates import N_Q
from hbm.dynamics import inverse_dynamics
from hbm.motion import Motion
from hbm.spatial import shift_wrench
from pipeline.virtual_lab.protocol.walking_protocol import Setting
from pipeline.virtual_lab.protocol.walking_trial import study_subject
from tests.validation.true_body import true_body

pytest.importorskip("pinocchio")
study = pytest.importorskip("tests.validation.residual_reduction")
FRAMES = 90


@pytest.fixture(scope="module")
def moving():
    """A body that moves smoothly, and the ground's wrench that this motion needs."""
    body, rng = true_body(study_subject(Setting(), 0)), np.random.default_rng(1)
    time = np.arange(FRAMES) / study.RATE_HZ
    size, omega = rng.normal(0, 0.1, N_Q), rng.uniform(3, 9, N_Q)
    angle = omega * time[:, None] + rng.uniform(0, 6, N_Q)
    q, v, a = size * np.sin(angle), size * omega * np.cos(angle), -size * omega**2 * np.sin(angle)
    sure = np.ones((FRAMES, N_Q), bool)
    motion = Motion(time, q, v, a, (), np.empty((FRAMES, 0)), sure[:, 0], sure)
    needed = shift_wrench(inverse_dynamics(body, motion, {}).residual, -q[:, :3])
    return body, motion, needed


def test_the_equations_of_motion_balance_and_their_derivatives_are_right(moving):
    body, motion, needed = moving
    state = [np.array(x[:3]) for x in (motion.q, motion.v, motion.a)]
    force, slopes = study.balance(body.model, *state, needed[:3])
    assert np.abs(force).max() < 1e-8
    for rate in range(3):
        for coordinate in range(N_Q):
            changed = [x.copy() for x in state]
            changed[rate][:, coordinate] += 1e-6
            other, _ = study.balance(body.model, *changed, needed[:3])
            assert np.abs((other - force) / 1e-6 - slopes[:, rate, :, coordinate]).max() < 1e-3


def test_splines_reproduce_a_line_and_its_rate():
    values = study.spline_values()
    knots = np.arange(4) - 1.0  # of a line that rises by 1 from knot to knot
    line = values @ knots
    step_s = study.FRAMES / study.RATE_HZ
    np.testing.assert_allclose(line[:, 0], np.arange(study.FRAMES) / study.FRAMES, atol=1e-12)
    np.testing.assert_allclose(line[:, 1], 1 / step_s)
    np.testing.assert_allclose(line[:, 2], 0, atol=1e-9)


def test_a_motion_without_residual_is_not_changed(moving):
    body, motion, needed = moving
    changed = study.reduced(body, motion, {"left_foot": needed})
    assert np.abs(changed.q - motion.q).max() < 1e-9


def test_a_change_is_the_best_between_residual_and_motion_of_markers(moving):
    body, motion, needed = moving
    late = np.vstack([needed[:2], needed[:-2]])
    changed = study.reduced(body, motion, {"left_foot": late})
    metric = study.marker_metric(body, motion.q) / study.MARKER_SD_M**2 + 1e-2 * np.eye(N_Q)

    def cost(share):
        pairs = [(getattr(motion, n), getattr(changed, n)) for n in "qva"]
        state = [before + share * (after - before) for before, after in pairs]
        force, _ = study.balance(body.model, *state, late)
        moved = state[0] - motion.q
        return np.sum((force / study.RESIDUAL_SD) ** 2) + np.einsum(
            "ti,tij,tj->", moved, metric, moved
        )

    assert cost(1.0) < 0.9 * cost(0.0)
    assert cost(1.0) < min(cost(0.95), cost(1.05))


def test_the_rates_of_a_changed_motion_are_those_of_its_coordinates(moving):
    body, motion, needed = moving
    changed = study.reduced(body, motion, {"left_foot": np.vstack([needed[:2], needed[:-2]])})
    moved, rate = changed.q - motion.q, changed.v - motion.v
    by_difference = np.gradient(moved, 1 / study.RATE_HZ, axis=0)
    assert np.abs(by_difference - rate)[2:-2].max() < 0.15 * np.abs(rate).max()
