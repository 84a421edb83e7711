"""Where accelerometers are best: far apart, not in line, not in one plane."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensation import best_places

CORNERS = [(x, y, z) for x in (-0.9, 0.0, 0.9) for y in (-0.6, 0.0, 0.6) for z in (-0.35, -0.05)]


def chosen(count):
    return np.array([CORNERS[k] for k in best_places(CORNERS, count)])


def test_two_are_at_opposite_corners():
    first, second = chosen(2)
    np.testing.assert_allclose(np.abs((second - first)[:2]), [1.8, 1.2])


def test_three_are_at_corners_and_not_in_line():
    places = chosen(3)
    assert np.linalg.matrix_rank(places[1:] - places[0], tol=0.1) == 2
    np.testing.assert_allclose(np.abs(places[:, :2]), np.tile([0.9, 0.6], (3, 1)))


def test_four_are_at_corners_and_not_in_one_plane():
    places = chosen(4)
    assert np.linalg.matrix_rank(places[1:] - places[0], tol=0.1) == 3


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), shift=st.floats(-3, 3), count=st.integers(1, 4))
def test_neither_origin_nor_axes_matter(seed, shift, count):
    rng = np.random.default_rng(seed)
    places = rng.uniform(-1, 1, (8, 3))
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    assert best_places(places, count) == best_places(places @ axes.T + shift, count)


@pytest.mark.parametrize(
    ("places", "count", "message"),
    [
        (CORNERS[:2], 3, "3 accelerometers for 2 places"),
        (np.zeros((100, 3)), 4, "more than 200000 combinations"),
        (np.zeros((5, 2)), 2, "must have shape"),
    ],
)
def test_an_impossible_choice_is_refused(places, count, message):
    with pytest.raises(ValueError, match=message):
        best_places(places, count)
