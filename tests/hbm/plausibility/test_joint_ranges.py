"""Joint angles that no human joint reaches."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hbm.coordinates import INDEX
from hbm.ik.continuity import BALL_JOINTS
from hbm.kinematics import solve_ik
from hbm.plausibility.motion import RANGE_DEG, impossible_angles
from tests.hbm.motions import any_pose, relabelled, without
from tests.synthetic import synthetic_body, synthetic_t_pose

BODY = synthetic_body()
CLUSTER = ("LLEK", "RLEK"), ("LMEK", "RMEK"), ("LLTHI", "RLTHI")


@pytest.fixture(scope="module")
def still():
    return solve_ik(BODY, synthetic_t_pose())


def turned(motion, frames=slice(None), **degrees):
    """The same motion with other angles."""
    q = motion.q.copy()
    for name, angle in degrees.items():
        q[frames, INDEX[name]] = np.radians(angle)
    return replace(motion, q=q)


def test_poses_within_the_joints_ranges_are_possible():
    motion = any_pose(np.random.default_rng(7), 300)
    solved = replace(motion, markers=BODY.markers, marker_error=np.zeros((300, len(BODY.markers))))
    assert impossible_angles(BODY, solved) == ()


def test_a_thigh_s_markers_exchanged_with_the_other_s_turn_leg_joints_beyond_their_range(walk):
    assert impossible_angles(BODY, solve_ik(BODY, walk)) == ()
    motion = solve_ik(BODY, relabelled(walk, *CLUSTER))
    assert motion.converged.any()
    (note,) = impossible_angles(BODY, motion)
    assert (note.code, note.level) == ("joint_angles_impossible", "warning")
    of_leg = ("Hip", "Knee", "Ankle", "Foot")
    assert all(name[1:].startswith(of_leg) for name in note.values["extreme_deg"])
    assert note.values["share"] > 0.5


@settings(deadline=None)
@given(degrees=st.floats(-150, 150), turns=st.integers(-2, 2))
def test_a_hip_s_rotation_is_impossible_beyond_its_range_and_never_within(still, degrees, turns):
    low, high = RANGE_DEG["HipInternalRotation"]
    assume(min(abs(degrees - low), abs(degrees - high)) > 1e-6)
    motion = turned(still, LHipInternalRotation=degrees + 360 * turns)
    notes = impossible_angles(BODY, motion)
    if low < degrees < high:
        assert notes == ()
    else:
        (note,) = notes
        assert list(note.values["extreme_deg"]) == ["LHipInternalRotation"]
        assert note.values["extreme_deg"]["LHipInternalRotation"] == pytest.approx(degrees)


@settings(deadline=None)
@given(st.data())
def test_neither_full_turns_nor_a_ball_joint_s_other_angles_matter(still, data):
    """(a, b, c) and (a + π, π − b, c + π) are one rotation about three axes at right angles."""
    first = data.draw(st.sampled_from([i for i in BALL_JOINTS if i > 5]))
    q = still.q.copy()
    q[:, first : first + 3] = q[:, first : first + 3] * [1, -1, 1] + np.pi
    knee = INDEX["LKneeFlexion"]
    q[:, knee] += 2 * np.pi * data.draw(st.integers(-2, 2))
    assert impossible_angles(BODY, replace(still, q=q)) == ()


@pytest.mark.parametrize("frames", [1, 10, 100])
def test_the_share_of_frames_and_the_extreme_are_named(still, frames):
    motion = turned(still, slice(0, frames), RKneeFlexion=-50.0)
    motion = turned(motion, slice(0, 1), RKneeFlexion=-60.0)
    (note,) = impossible_angles(BODY, motion)
    assert note.values["share"] == pytest.approx(frames / 100)
    assert note.values["extreme_deg"] == {"RKneeFlexion": pytest.approx(-60.0)}
    assert f"in {frames:.1f} % of the frames" in note.text
    assert "RKneeFlexion -60°" in note.text


def test_an_angle_that_the_markers_hardly_show_does_not_count(still):
    """One marker, 5 mm from the forearm's axis: 10 mm of error turn it half-way round."""
    pronation = turned(still, LForeArmPronation=-120.0)
    assert len(impossible_angles(BODY, pronation)) == 1
    hidden = [name for name in BODY.markers if name in ("LFRM", "LMW", "LFIN")]
    position, k = BODY.marker_position.copy(), BODY.markers.index("LLW")
    position[k, :2] = [0.0, 0.005]
    near_axis = replace(BODY, marker_position=position)
    error = pronation.marker_error.copy()
    error[:, [pronation.markers.index(name) for name in hidden]] = np.nan
    assert impossible_angles(near_axis, replace(pronation, marker_error=error)) == ()


def test_an_angle_that_no_marker_shows_does_not_count(still):
    unseen = still.observed.copy()
    unseen[:, INDEX["LKneeFlexion"]] = False
    bent = turned(still, LKneeFlexion=-90.0)
    assert len(impossible_angles(BODY, bent)) == 1
    assert impossible_angles(BODY, replace(bent, observed=unseen)) == ()


def test_frames_without_a_solution_do_not_count(still):
    bent = turned(still, slice(0, 20), LKneeFlexion=-90.0)
    converged = np.arange(100) >= 20
    assert impossible_angles(BODY, replace(bent, converged=converged)) == ()
    nothing = replace(bent, converged=np.zeros(100, bool))
    assert impossible_angles(BODY, nothing) == ()


def test_gaps_of_markers_make_no_angle_impossible(walk):
    gone = without(walk, ["LLEK", "LMEK"], slice(5, 20))
    assert impossible_angles(BODY, solve_ik(BODY, gone)) == ()


def test_every_range_belongs_to_a_coordinate_and_contains_zero():
    for name, (low, high) in RANGE_DEG.items():
        assert name in INDEX or {f"R{name}", f"L{name}"} <= set(INDEX)
        assert low < 0 < high
        assert high - low < 360
