"""What segments without markers add to the residuals of a walk is as large as expected."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hbm.coordinates import INDEX, N_Q
from hbm.plausibility.motion import ARMS, TRUNK, unseen_covariance
from hbm.spatial import GRAVITY_MPS2
from tests.hbm.motions import motion_of
from tests.synthetic import synthetic_body

BODY = synthetic_body()
PERCENT = BODY.mass * GRAVITY_MPS2 / 100 * np.repeat([1.0, BODY.height_m], 3)
UPPER = (*TRUNK, "head", *ARMS, "left_shoulder", "right_shoulder")


def expected(unseen=(), yaw=0.0, frames=(True, True, True), but=""):
    """The covariance where markers of segments, but one, are never seen, facing a yaw."""
    q = np.zeros((3, N_Q))
    q[:, INDEX["PelvisYaw"]] = yaw
    markers = zip(BODY.markers, BODY.marker_segment, strict=True)
    hidden = [segment in unseen and name != but for name, segment in markers]
    error_m = np.where(hidden, np.nan, 0.002) * np.ones((3, 1))
    motion = replace(
        motion_of(np.arange(3) / 100, q, 0 * q, 0 * q), markers=BODY.markers, marker_error=error_m
    )
    return unseen_covariance(BODY, motion, np.array(frames))


def spread(covariance):
    return np.sqrt(np.diag(covariance)) / PERCENT


HANDS = ("left_hand", "right_hand")


@pytest.mark.parametrize("unseen", [(), HANDS], ids=["all are shown", "hands are light"])
def test_nothing_is_expected_where_markers_show_the_body(unseen):
    assert not expected(unseen).any()


def test_a_trunk_that_one_marker_shows_is_no_unseen_trunk():
    """Head and arms remain."""
    of_trunk = [n for n, s in zip(BODY.markers, BODY.marker_segment, strict=True) if s == "thorax"]
    for shown in of_trunk:
        assert (spread(expected(UPPER, but=shown))[:3] < spread(expected(UPPER))[:3] / 2).all()


def test_where_no_frame_counts_the_axes_are_those_of_the_lab():
    no_frame = expected(UPPER, yaw=1.0, frames=(False, False, False))
    np.testing.assert_array_equal(no_frame, expected(UPPER, yaw=0.0))


def test_a_walk_with_markers_on_the_legs_alone_is_as_unsure_as_those_of_other_laboratories():
    """SD over 35 recordings of 28 people, % of body weight and of body weight × stature."""
    measured = [4.6, 3.7, 2.8, 0.87, 1.17, 0.22]
    np.testing.assert_allclose(spread(expected(UPPER)), measured, rtol=0.02)


def test_arms_matter_by_their_mass():
    both = expected(ARMS)
    left = expected([segment for segment in ARMS if segment.startswith("left")])
    np.testing.assert_allclose(left, both / 2, rtol=1e-9)
    assert (spread(both)[:5] < spread(expected(UPPER))[:5] / 2).all()


@given(st.floats(-7, 7))
def test_the_expected_residual_turns_with_the_walker(yaw):
    ahead, turned = expected(UPPER), expected(UPPER, yaw)
    c, s = np.cos(yaw), np.sin(yaw)
    for part in (slice(0, 2), slice(3, 5)):
        turn = np.array([[c, -s], [s, c]])
        np.testing.assert_allclose(turned[part, part], turn @ ahead[part, part] @ turn.T)
    assert np.linalg.eigvalsh(turned / np.outer(PERCENT, PERCENT)).min() > 0


def test_an_unseen_force_acts_above_the_pelvis():
    """Forces forward and to the left turn the body about the pelvis as a push at the chest does."""
    covariance = expected(UPPER)
    height_m = [covariance[4, 0] / covariance[0, 0], -covariance[3, 1] / covariance[1, 1]]
    assert height_m == pytest.approx([0.2 * BODY.height_m] * 2, rel=0.15)
