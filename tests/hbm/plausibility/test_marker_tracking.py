"""Frame by frame, a trial's motion is the one that the whole trial gives, and never looks ahead."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.coordinates import INDEX, LIMBS, TREE
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.plausibility.outliers import MAX_ROUNDS, MarkerTracker, track_motion
from tests.hbm.motions import markers_of, swinging, with_noise, without
from tests.synthetic import synthetic_body

BODY = synthetic_body()
NOISE_M = 0.003


def swinging_markers(seed=3, frames=120, degrees=40.0):
    random = np.random.default_rng(seed)
    return with_noise(markers_of(BODY, swinging(random, frames, degrees=degrees)), random, NOISE_M)


def tracked(markers):
    return track_motion(BODY, markers)[1]


def displaced(markers, name, offset_m, frames):
    position = markers.position.copy()
    position[frames, markers.names.index(name)] += offset_m
    return Markers(markers.time, markers.names, position)


@given(st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_it_finds_the_optima_that_the_whole_trial_gives(seed):
    markers = swinging_markers(seed)
    whole, found = solve_ik(BODY, markers), tracked(markers)
    np.testing.assert_allclose(found.q, whole.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.marker_error, whole.marker_error, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.observed, whole.observed)
    assert found.converged.all()


@given(st.integers(1, 119), st.integers(0, 5))
@settings(max_examples=8, deadline=None)
def test_later_frames_change_nothing(last, case):
    markers = swinging_markers()
    leg = [n for n, s in BODY.segment_of.items() if s in LIMBS["left leg"]]
    changed = (
        markers,
        without(markers, leg, slice(30, 70)),
        without(markers, markers.names, slice(40, 60)),
        displaced(markers, "LHEE", 0.4, slice(20, 50)),
        without(markers, ("LASIS", "C7"), slice(0, 30)),
        displaced(markers, "RASIS", 0.3, slice(100, 120)),
    )[case]
    short = Markers(changed.time[: last + 1], changed.names, changed.position[: last + 1])
    whole, found = tracked(changed), tracked(short)
    for name in ("q", "marker_error", "observed", "converged"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name)[: last + 1])


@pytest.mark.parametrize("limb", ["left arm", "right leg"])
def test_a_limb_without_markers_keeps_its_last_pose_and_the_rest_is_solved(limb):
    markers = swinging_markers()
    names = [n for n, s in BODY.segment_of.items() if s in LIMBS[limb]]
    found = tracked(without(markers, names, slice(50, 90)))
    own = np.array([c.segment in LIMBS[limb] for c in TREE])
    whole = tracked(markers)
    assert found.converged.all()
    assert not found.observed[50:90, own].any()
    np.testing.assert_array_equal(found.observed[:50], whole.observed[:50])
    np.testing.assert_allclose(found.q[50:90, own], np.tile(found.q[49, own], (40, 1)), atol=1e-8)
    np.testing.assert_allclose(found.q[90:], whole.q[90:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.q[50:90, ~own], whole.q[50:90, ~own], atol=0.06)


def test_frames_without_any_marker_are_lost_and_the_next_one_is_solved():
    markers = swinging_markers()
    found = tracked(without(markers, markers.names, slice(40, 70)))
    np.testing.assert_array_equal(np.flatnonzero(~found.converged), np.arange(40, 70))
    assert np.isnan(found.q[40:70]).all()
    whole = tracked(markers)
    np.testing.assert_allclose(found.q[70:], whole.q[70:], rtol=0, atol=1e-9)


def test_a_marker_that_jumps_is_left_out_from_the_first_frame_on_and_used_when_it_is_back():
    markers = swinging_markers()
    jumped = displaced(markers, "LHEE", 0.3, slice(50, 90))
    cleaned, found, notes = track_motion(BODY, jumped)
    gap = tracked(without(markers, ("LHEE",), slice(50, 90)))
    np.testing.assert_allclose(found.q, gap.q, rtol=0, atol=1e-9)
    (note,) = notes
    assert note.values["of_marker"] == {"LHEE": 40}
    assert np.isnan(cleaned.position[50:90, markers.names.index("LHEE")]).all()


def test_markers_that_all_stand_still_exactly_were_not_measured():
    markers = swinging_markers()
    position = markers.position.copy()
    position[50:80] = position[50]
    found = tracked(Markers(markers.time, markers.names, position))
    np.testing.assert_array_equal(np.flatnonzero(~found.converged), np.arange(55, 80))


@pytest.mark.parametrize(
    "wrong",
    [lambda p: p / 1000, lambda p: p[:, ::-1]],
    ids=["mm taken for m", "labels in another order"],
)
def test_markers_that_do_not_fit_at_all_are_solved_once_a_frame(wrong, monkeypatch):
    """Whatever is left out then, the rest does not fit either: time is better spent on frames."""
    markers = swinging_markers(frames=12)
    tracker, solves = MarkerTracker(BODY, markers.names), []
    solve = tracker.tracker.solve
    monkeypatch.setattr(tracker.tracker, "solve", lambda x: solves.append(1) or solve(x))
    for time, position in zip(markers.time, wrong(markers.position), strict=True):
        tracker.step(time, position)
    assert tracker.unfit
    assert len(solves) <= len(markers.time) + MAX_ROUNDS
    solution = tracker.step(markers.time[-1] + 0.01, markers.position[-1])
    assert not tracker.unfit
    assert np.nanmax(solution.marker_error) < 0.02


def test_a_coordinate_without_markers_from_the_start_is_neutral_until_it_is_seen():
    markers = swinging_markers()
    arm = [n for n, s in BODY.segment_of.items() if s in LIMBS["right arm"]]
    found = tracked(without(markers, arm, slice(0, 30)))
    elbow = INDEX["RElbowFlexion"]
    assert (found.q[:30, elbow] == 0).all()
    np.testing.assert_allclose(found.q[30:], tracked(markers).q[30:], rtol=0, atol=1e-9)
