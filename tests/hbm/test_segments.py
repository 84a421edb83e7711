"""Segment inertias are those of de Leva's table, computed by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.segments import SEXES, Inertia, proportions, segment_inertia
from hbm.spatial import rotation_about

PAIRED = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
DOWN = np.array([0.0, 0.0, -1.0])
LEFT = np.array([0.0, 1.0, 0.0])
numbers = st.floats(-1, 1)
points = st.tuples(numbers, numbers, numbers).map(np.array)


@pytest.mark.parametrize("sex", SEXES)
def test_the_masses_of_all_segments_sum_to_the_body_s(sex):
    table = proportions(sex)
    total = sum(part.mass * (2 if s in PAIRED else 1) for s, part in table.items())
    assert total == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("sex", "mass", "center", "moments"),
    [
        (
            "male",
            0.1416 * 80,
            0.4095 * 0.43,
            0.1416 * 80 * (np.array([0.329, 0.329, 0.149]) * 0.43) ** 2,
        ),
        (
            "female",
            0.1478 / 0.9999 * 80,
            0.3612 * 0.43,
            0.1478 / 0.9999 * 80 * (np.array([0.369, 0.364, 0.162]) * 0.43) ** 2,
        ),
    ],
)
def test_a_thigh_of_43_cm_in_a_body_of_80_kg(sex, mass, center, moments):
    """Mass 14.16 or 14.78 %; moments about the axes forward, left and along."""
    thigh = segment_inertia(proportions(sex)["thigh"], 80.0, np.zeros(3), 0.43 * DOWN, LEFT)
    assert thigh.mass == pytest.approx(mass)
    np.testing.assert_allclose(thigh.center, center * DOWN, atol=1e-15)
    np.testing.assert_allclose(thigh.tensor, np.diag(moments), atol=1e-15)


def test_unspecified_sex_is_the_mean_of_both():
    men, women, both = (proportions(s)["shank"] for s in ("male", "female", "unspecified"))
    assert both.mass == pytest.approx((men.mass + women.mass) / 2)
    assert both.center == pytest.approx((0.4395 + 0.4352) / 2)
    np.testing.assert_allclose(both.gyration, np.add(men.gyration, women.gyration) / 2)


def test_the_foot_s_long_axis_is_horizontal():
    """Heel to toe is the longitudinal axis: the smallest moment is about it."""
    foot = segment_inertia(
        proportions("male")["foot"], 80.0, np.zeros(3), np.array([0.26, 0, 0]), LEFT
    )
    assert np.argmin(np.diag(foot.tensor)) == 0
    np.testing.assert_allclose(foot.center, [0.4415 * 0.26, 0, 0])


@settings(max_examples=25)
@given(a=points, b=points, shift=points, angle=st.floats(-3, 3))
def test_joining_two_parts_and_changing_the_frame_commute(a, b, shift, angle):
    R = rotation_about([0.6, 0.0, 0.8], angle)
    one, two = Inertia(3.0, a, np.diag([0.2, 0.3, 0.4])), Inertia(1.5, b, 0.1 * np.eye(3))
    joined = (one + two).in_frame(R, shift)
    there = one.in_frame(R, shift) + two.in_frame(R, shift)
    assert joined.mass == pytest.approx(4.5)
    np.testing.assert_allclose(joined.center, there.center, atol=1e-12)
    np.testing.assert_allclose(joined.tensor, there.tensor, atol=1e-12)


def test_two_joined_points_have_the_inertia_of_a_dumbbell():
    nothing = np.zeros((3, 3))
    rod = Inertia(2.0, np.array([0.0, 0, 0.5]), nothing) + Inertia(2.0, np.zeros(3), nothing)
    np.testing.assert_allclose(rod.center, [0, 0, 0.25])
    np.testing.assert_allclose(rod.tensor, np.diag([0.25, 0.25, 0]), atol=1e-15)
