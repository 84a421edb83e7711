"""Angles that markers hardly show, against repeated solutions with marker errors."""

import numpy as np
import pytest

from hbm.coordinates import INDEX
from hbm.ik.problem import covariance, marker_slopes
from hbm.kinematics import solve_ik
from hbm.markers import Markers
from hbm.notes import Note
from hbm.plausibility.motion import ROTATES, undetermined_notes
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
    still = solve_ik(BODY, pose)
    own = [BODY.markers.index(name) for name in still.markers]
    slopes = marker_slopes(BODY, still.q[0])[:, own]
    expected = np.sqrt(np.diag(covariance(slopes, np.ones(len(own)))))
    shown = ROTATES & (expected < np.radians(8))
    assert np.count_nonzero(shown) > 25
    np.testing.assert_allclose(solved.q.std(axis=0)[shown], expected[shown], rtol=0.2)


def test_of_markers_that_show_everything_else_only_the_toes_are_named(pose):
    (note,) = undetermined_notes(BODY, solve_ik(BODY, pose))
    assert note == Note.of("coordinates_locked", coordinates=("RToeFlexion", "LToeFlexion"))


def test_an_angle_whose_markers_lie_near_its_axis_is_named_with_the_deviation_of_its_prior(pose):
    hidden = [name for name in OF_FOREARM[:-1] if name in BODY.markers]
    _, note = undetermined_notes(BODY, solve_ik(BODY, without(pose, hidden)))
    assert note.code == "coordinates_uncertain"
    assert note.values["deviation_deg"]["LForeArmPronation"] == pytest.approx(40)
    assert all(name.startswith("L") for name in note.values["deviation_deg"])


def test_an_arm_that_no_marker_shows_is_locked_and_its_mass_is_named(pose):
    own = zip(BODY.markers, BODY.marker_segment, strict=True)
    arm = [name for name, segment in own if segment in ARM]
    motion = solve_ik(BODY, without(pose, arm))
    assert not motion.observed[:, INDEX["LElbowFlexion"]].any()
    locked, mass = undetermined_notes(BODY, motion)
    assert "LElbowFlexion" in locked.values["coordinates"]
    assert mass.code == "mass_not_shown"
    assert mass.values["segments"] == ARM
    assert mass.values["share"] == pytest.approx(0.0494, abs=1e-3)


def test_unsolved_motion_names_nothing(pose):
    motion = solve_ik(BODY, without(pose, pose.names))
    assert not motion.converged.any()
    assert undetermined_notes(BODY, motion) == ()
