"""Bodies and motions that cannot be, and errors of markers, are named, and healthy ones are not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hbm.body import build_body
from hbm.coordinates import INDEX, N_Q
from hbm.ik.continuity import BALL_JOINTS
from hbm.ik.problem import ROTATES, covariance
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.plausibility.motion import (
    RANGE_DEG,
    implausible,
    impossible_angles,
    large_marker_errors,
    undetermined_notes,
)
from hbm.poses import marker_positions
from tests.hbm.motions import any_pose, relabelled, without
from tests.hbm.people import person
from tests.synthetic import MASS_KG, T_POSE_MM, synthetic_body, synthetic_t_pose

BODY = synthetic_body()
OF_FOREARM = ("LFRM", "LMW", "LFIN", "LLW")
CLUSTER = ("LLEK", "RLEK"), ("LMEK", "RMEK"), ("LLTHI", "RLTHI")
MILLIMETRES = st.floats(0.1, 300.0)


def test_legs_of_different_length_are_noticed():
    short = {
        n: (*T_POSE_MM[n][:2], T_POSE_MM[n][2] + 40) for n in ("LLM", "LMM", "LHEE", "LMT2", "LMT5")
    }
    body = build_body(person(**short), mass=MASS_KG)
    (note,) = implausible(body)
    assert (note.code, note.level) == ("legs_differ", "warning")


@pytest.mark.parametrize(("height_m", "differs"), [(None, False), (1.85, False), (0.5, True)])
def test_a_stature_that_the_legs_contradict_is_noticed(height_m, differs):
    """The legs are those of a person of 1.71 m."""
    body = build_body(person(), mass=MASS_KG, height_m=height_m)
    assert [note.code for note in implausible(body)] == ["stature_differs"] * differs


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
    step = 1e-6 * np.eye(N_Q)
    there, back = (marker_positions(BODY, still.q[0] + way * step) for way in (1, -1))
    slopes = (there - back)[:, own] / 2e-6
    expected = np.sqrt(np.diag(covariance(slopes, np.ones(len(own), bool))))
    shown = ROTATES & (expected < np.radians(8))
    assert np.count_nonzero(shown) > 25
    np.testing.assert_allclose(solved.q.std(axis=0)[shown], expected[shown], rtol=0.2)


def test_an_angle_whose_markers_lie_near_its_axis_is_named(pose):
    hidden = [name for name in OF_FOREARM[:-1] if name in BODY.markers]
    (note,) = undetermined_notes(BODY, solve_ik(BODY, without(pose, hidden)))
    assert "LForeArmPronation" in note.values["coordinates"]
    assert all(name[0] == "L" or "Toe" in name for name in note.values["coordinates"])


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


@settings(max_examples=30)
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


@settings(max_examples=30)
@given(st.data())
def test_neither_full_turns_nor_a_ball_joint_s_other_angles_matter(still, data):
    """(a, b, c) and (a + π, π − b, c + π) are one rotation about three axes at right angles."""
    first = data.draw(st.sampled_from([i for i in BALL_JOINTS if i > 5]))
    q = still.q.copy()
    q[:, first : first + 3] = q[:, first : first + 3] * [1, -1, 1] + np.pi
    knee = INDEX["LKneeFlexion"]
    q[:, knee] += 2 * np.pi * data.draw(st.integers(-2, 2))
    assert impossible_angles(BODY, replace(still, q=q)) == ()


@pytest.fixture(scope="module")
def motion(walk):
    return solve_ik(BODY, walk)


def with_errors(motion, **error_mm):
    """The same motion, all markers 5 mm from the model but the named ones."""
    error = np.full(motion.marker_error.shape, 0.005)
    for name, size in error_mm.items():
        error[:, motion.markers.index(name)] = size / 1000
    return replace(motion, marker_error=error)


def named(motion):
    notes = large_marker_errors(BODY, motion)
    return [name for note in notes for name in note.values["farthest_m"]]


@given(size=MILLIMETRES)
def test_a_marker_is_named_from_40_mm_on_and_never_below(motion, size):
    assume(abs(size - 40) > 1e-6)
    assert ("LHEE" in named(with_errors(motion, LHEE=size))) == (size > 40)


@given(size=MILLIMETRES)
def test_a_segment_is_named_from_20_mm_on_and_never_below(motion, size):
    assume(abs(size - 20) > 1e-6)
    found = named(with_errors(motion, LHEE=size, LMT2=size, LMT5=size))
    assert ("left_foot" in found) == (size > 20)
