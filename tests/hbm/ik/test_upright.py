"""A trunk that no marker shows stands upright in the lab, whatever the pelvis does."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hbm.coordinates import CARRIERS, INDEX, MOVING, N_Q, TREE
from hbm.ik.tracking import solve_ik
from hbm.ik.upright import HEADING_CUTOFF_HZ, TRUNK, YAW, slow_heading, upright_trunk
from hbm.plausibility.outliers import track_motion
from hbm.poses import segment_frames
from hbm.spatial import rotation_about
from tests.hbm.motions import markers_of, motion_of, without
from tests.synthetic import synthetic_body

BODY = synthetic_body()
THORAX = MOVING.index("thorax")
OF_LEGS = [
    name
    for name, s in zip(BODY.markers, BODY.marker_segment, strict=True)
    if s == "pelvis" or any(part in s for part in ("thigh", "shank", "foot", "toes"))
]
ABOVE = [name for name in BODY.markers if name not in OF_LEGS]
ANGLE = st.floats(-1.2, 1.2)


def thorax_of(q):
    return segment_frames(BODY, q)[0][:, THORAX]


def walking(seconds=6.0, turn_radps=0.0, rate_hz=100.0):
    """A pelvis that tilts, rolls and turns with the stride, 0.9 per second, over still legs."""
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    q, stride = np.zeros((len(time), N_Q)), 2 * np.pi * 0.9 * time
    q[:, INDEX["PelvisX"]], q[:, INDEX["PelvisZ"]] = 1.2 * time, 0.95
    q[:, YAW] = np.radians(8) * np.sin(stride) + turn_radps * time
    q[:, INDEX["PelvisForwardPitch"]] = np.radians(10) + np.radians(3) * np.sin(2 * stride)
    q[:, INDEX["PelvisRightRoll"]] = np.radians(6) * np.cos(stride)
    return motion_of(time, q, 0 * q, 0 * q)


@given(st.tuples(ANGLE, ANGLE, ANGLE), st.floats(-7, 7))
def test_it_stands_upright_on_a_pelvis_of_any_orientation(pelvis, heading):
    q = np.zeros((1, N_Q))
    q[:, YAW : YAW + 3] = pelvis
    q[:, TRUNK] = upright_trunk(q, np.array([heading]))
    np.testing.assert_allclose(thorax_of(q)[0], rotation_about([0, 0, 1], heading), atol=1e-12)


@pytest.mark.parametrize("turn_radps", [0.0, 0.5])
def test_it_faces_where_the_pelvis_does_on_average_also_in_a_turn(turn_radps):
    truth = walking(turn_radps=turn_radps)
    yaw = np.where(np.arange(600) % 97 < 5, np.nan, truth.q[:, YAW])
    heading = slow_heading(truth.time, (yaw + np.pi) % (2 * np.pi) - np.pi)
    np.testing.assert_array_equal(np.isnan(heading), np.isnan(yaw))
    error_deg = np.degrees(heading - turn_radps * truth.time)
    assert np.nanmax(np.abs(error_deg[100:500])) < 1.5
    assert np.nanmax(np.abs(error_deg)) < 5, "at the ends half of the pelvis' 8° are left"


def test_of_an_oscillation_at_the_cut_off_half_is_left():
    time = np.arange(4000) / 100
    heading = slow_heading(time, np.sin(2 * np.pi * HEADING_CUTOFF_HZ * time))
    assert np.ptp(heading[1000:3000]) / 2 == pytest.approx(0.5, abs=0.01)


def test_markers_of_the_legs_alone_leave_the_trunk_upright_and_the_legs_as_they_are():
    truth = walking()
    measured = markers_of(BODY, truth)
    whole, legs = solve_ik(BODY, measured), solve_ik(BODY, without(measured, ABOVE))
    below = [i for i, c in enumerate(TREE) if c.segment not in ("thorax", "head")]
    np.testing.assert_allclose(legs.q[:, below], whole.q[:, below], atol=1e-6)
    np.testing.assert_allclose(thorax_of(legs.q)[:, :, 2], np.tile([0, 0, 1], (600, 1)), atol=1e-9)
    assert np.abs(thorax_of(whole.q)[:, 2, 2] - 1).max() > 0.01, "else it was upright anyway"


def test_frame_by_frame_it_is_upright_too():
    truth = walking()
    _, motion, _ = track_motion(BODY, without(markers_of(BODY, truth), ABOVE))
    rotation = thorax_of(motion.q)
    np.testing.assert_allclose(rotation[:, :, 2], np.tile([0, 0, 1], (600, 1)), atol=1e-9)
    facing = np.arctan2(rotation[200:, 1, 0], rotation[200:, 0, 0])
    assert np.ptp(facing) / 2 < np.radians(3), "the pelvis turns by 8°"


@pytest.mark.parametrize("solve", [solve_ik, lambda *given: track_motion(*given)[1]])
def test_what_one_marker_of_the_trunk_leaves_open_is_held_upright_in_the_lab(solve):
    """A marker at the neck shows how the trunk leans, but not where it faces."""
    q = walking().q.copy()
    q[:, TRUNK] = upright_trunk(q, np.zeros(600))
    truth = motion_of(walking().time, q, 0 * q, 0 * q)
    unseen = [n for n in ABOVE if n != "JN"]
    motion = solve(BODY, without(markers_of(BODY, truth), unseen))
    assert CARRIERS == ("pelvis", "thorax")
    error = thorax_of(motion.q)[200:] - np.eye(3)
    assert np.degrees(np.abs(error).max()) < 4, "the pelvis turns by 8°"
