"""Errors of plates under known weights are found as independent computations find them."""

import numpy as np
import pytest
from scipy.optimize import minimize

from compensation.accuracy import linearity, orthogonal_rmse, wrench_of_weight

LOADS = np.repeat([13.44, 22.56, 36.00, 45.08], 6) * 9.81
time = np.arange(2000) / 100


def scattered(seed, slope=1.02, intercept=3.0, noise=2.0, count=200):
    rng = np.random.default_rng(seed)
    true = rng.uniform(0, 400, count)
    return slope * true + intercept + noise * rng.normal(size=count), true + noise * rng.normal(
        size=count
    )


# Truth ------------------------------------------------------------------------------------------


def test_a_weight_at_rest_is_its_weight_below_the_marker():
    marker = np.tile([0.4, -0.3, 0.9], (50, 1))
    wrench = wrench_of_weight(36.0, marker, 100, center_height_m=0.2)
    expected = [0, 0, 36 * 9.81, -0.3 * 36 * 9.81, -0.4 * 36 * 9.81, 0]
    np.testing.assert_allclose(wrench, np.tile(expected, (50, 1)), atol=1e-9)


def test_an_accelerated_weight_pushes_back_through_its_centre():
    marker = np.column_stack([0.3 * np.sin(2 * time), np.full_like(time, 0.25), 1 + 0 * time])
    force_x = 22.56 * -1.2 * np.sin(2 * time)
    wrench = wrench_of_weight(22.56, marker, 100, center_height_m=0.15)[5:-5]
    np.testing.assert_allclose(wrench[:, 0], force_x[5:-5], atol=0.03)
    overturning = 0.15 * force_x[5:-5] - marker[5:-5, 0] * 22.56 * 9.81
    np.testing.assert_allclose(wrench[:, 4], overturning, atol=0.01)
    np.testing.assert_allclose(wrench[:, 2], 22.56 * 9.81)


# Errors -----------------------------------------------------------------------------------------


def test_total_least_squares_agrees_with_a_numerical_minimum():
    measured, truth = scattered(1)

    def squared_distance(parameters):
        angle, distance = parameters  # the line's normal and its distance from the origin
        return np.sum((truth * np.cos(angle) + measured * np.sin(angle) - distance) ** 2)

    best = minimize(
        squared_distance,
        [2.36, 2.0],
        method="Nelder-Mead",
        options={"xatol": 1e-12, "fatol": 1e-12, "maxiter": 5000, "maxfev": 5000},
    )
    rmse = np.sqrt(best.fun / len(truth))
    assert orthogonal_rmse(measured, truth) == pytest.approx(rmse, rel=1e-6)


# Linearity --------------------------------------------------------------------------------------


def test_linearity_agrees_with_the_normal_equations():
    measured = 1.01 * LOADS + 2 + 2e-5 * LOADS**2 + np.random.default_rng(5).normal(size=24)
    x = np.vander(LOADS / 100, 2)
    residual = measured - x @ np.linalg.solve(x.T @ x, x.T @ measured)
    found = linearity(LOADS, measured)
    assert found.nonlinearity == pytest.approx(3 * np.sqrt(np.sum(residual**2) / 23), rel=1e-6)
    assert found.degrees_of_freedom == 22


def test_a_straight_plate_has_no_nonlinearity_and_a_curved_one_has():
    assert linearity(LOADS, 0.97 * LOADS + 5).nonlinearity < 1e-10
    assert linearity(LOADS, LOADS + 3e-4 * LOADS**2).nonlinearity > 5


# Wrong input ------------------------------------------------------------------------------------

MARKER = np.column_stack([0.3 * np.sin(2 * time), 0 * time, 1 + 0 * time])
PAIR = scattered(9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: wrench_of_weight(36, 1000 * MARKER, 100, 0.2), "in metres"),
        (lambda: orthogonal_rmse(PAIR[0] / 1000, PAIR[1]), "in one unit"),
        (lambda: linearity(LOADS[:12], LOADS[:12]), "2 known loads"),
    ],
)
def test_wrong_input_gets_one_clear_error(call, message):
    with pytest.raises(ValueError, match=message):
        call()
