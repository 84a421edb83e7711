"""Angles that markers hardly show, against repeated solutions with marker errors."""

import numpy as np
import pytest

from hbm.coordinates import INDEX
from hbm.kinematics import solve_ik
from hbm.markers import Markers
from hbm.plausibility.uncertainty import ROTATES, angle_uncertainty, uncertain_coordinates
from tests.hbm.motions import without
from tests.synthetic import synthetic_body, synthetic_t_pose

BODY = synthetic_body()
OF_FOREARM = ("LFRM", "LMW", "LFIN", "LLW")
ARM = ("left_upper_arm", "left_forearm", "left_hand")


@pytest.fixture(scope="module")
def pose():
    """A second in a T-pose: the same frame a hundred times."""
    return synthetic_t_pose()


def test_the_uncertainty_is_the_scatter_of_solutions_with_errors_of_10_mm(pose):
    """Four hundred solutions; a standard deviation of as many is known within 4 % (SD)."""
    rng, times = np.random.default_rng(1), 400
    position = np.repeat(pose.position[:1], times, axis=0)
    position = position + rng.normal(scale=0.01, size=position.shape)
    solved = solve_ik(BODY, Markers(np.arange(times) / 100, pose.names, position))
    expected = angle_uncertainty(BODY, solve_ik(BODY, pose), np.array([0]))[0]
    shown = ROTATES & (expected < np.radians(8))
    assert np.count_nonzero(shown) > 25
    np.testing.assert_allclose(solved.q.std(axis=0)[shown], expected[shown], rtol=0.2)


def test_where_markers_show_everything_nothing_is_named(pose):
    assert uncertain_coordinates(BODY, solve_ik(BODY, pose)) == ()


def test_an_angle_whose_markers_lie_near_its_axis_is_named_with_its_scatter(pose):
    hidden = [name for name in OF_FOREARM[:-1] if name in BODY.markers]
    motion = solve_ik(BODY, without(pose, hidden))
    (note,) = uncertain_coordinates(BODY, motion)
    assert note.code == "coordinates_uncertain"
    assert "LForeArmPronation" in note.values["deviation_deg"]
    assert all(name.startswith("L") for name in note.values["deviation_deg"])
    expected = np.degrees(angle_uncertainty(BODY, motion, np.array([0]))[0])
    for name, degrees in note.values["deviation_deg"].items():
        assert degrees == pytest.approx(expected[INDEX[name]])
        assert f"{name} {degrees:.0f}°" in note.text


def test_what_no_marker_shows_at_all_is_not_uncertain_but_locked(pose):
    own = zip(BODY.markers, BODY.marker_segment, strict=True)
    arm = [name for name, segment in own if segment in ARM]
    motion = solve_ik(BODY, without(pose, arm))
    assert not motion.observed[:, INDEX["LElbowFlexion"]].any()
    assert uncertain_coordinates(BODY, motion) == ()


def test_unsolved_motion_names_nothing(pose):
    motion = solve_ik(BODY, without(pose, pose.names))
    assert not motion.converged.any()
    assert uncertain_coordinates(BODY, motion) == ()
