"""A coordinate that markers do not determine is held by a prior, and nothing else is."""

import numpy as np
import pytest

from hbm.coordinates import COORDINATES, INDEX
from hbm.ik.problem import POSTURE_PRECISION, Problem
from hbm.ik.tracking import FrameTracker, solve_ik
from tests.hbm.motions import markers_of, swinging, with_noise, without
from tests.synthetic import synthetic_body

BODY = synthetic_body()
OF_SEGMENT = {
    s: [n for n, own in zip(BODY.markers, BODY.marker_segment, strict=True) if own == s]
    for s in set(BODY.marker_segment)
}


@pytest.fixture(scope="module")
def truth():
    return swinging(np.random.default_rng(8), degrees=15.0)


def pulled(markers):
    problem = Problem(BODY, markers)
    return {COORDINATES[i] for i in np.flatnonzero(problem.prior)}


def deviation_by_noise(truth, gone, name):
    """SD of a coordinate of one pose that is measured 300 times with 10 mm of noise [rad]."""
    pose = markers_of(BODY, truth)
    repeated = type(pose)(
        np.arange(300) / 100, pose.names, np.repeat(pose.position[:1], 300, axis=0)
    )
    noisy = with_noise(without(repeated, gone), np.random.default_rng(9), 0.01)
    return solve_ik(BODY, noisy).coordinate(name).std()


@pytest.mark.parametrize(
    ("seen", "segments", "weak"),
    [
        ("THEAD", ("head",), {"HeadLeftTwist"}),
        ("JN", ("thorax", "head"), {"TrunkLeftTwist"}),
        ("LLW", ("left_forearm", "left_hand"), {"LForeArmPronation"}),
    ],
)
def test_noise_moves_a_weakly_shown_angle_by_less_than_half_of_what_posture_does(
    truth, seen, segments, weak
):
    gone = [n for s in segments for n in OF_SEGMENT[s] if n != seen]
    found = pulled(without(markers_of(BODY, truth), gone))
    assert weak <= found
    assert not found & {name for name in COORDINATES if "Hip" in name or "Pelvis" in name}
    for name in weak:
        limit = POSTURE_PRECISION[INDEX[name]] ** -0.5 / 2
        assert deviation_by_noise(truth, gone, name) < limit


def test_of_all_markers_no_coordinate_but_the_toes_has_a_prior(truth):
    assert pulled(markers_of(BODY, truth)) == {"RToeFlexion", "LToeFlexion"}


def test_live_a_prior_ends_once_the_markers_that_were_missing_are_seen(truth):
    markers = markers_of(BODY, truth)
    tracker = FrameTracker(BODY, markers.names)
    late = without(markers, ("LHEAD", "RHEAD", "FHEAD"), slice(0, 20))
    for time, position in zip(late.time, late.position, strict=True):
        solution = tracker.solve(position)
        tracker.keep(solution, time)
    np.testing.assert_allclose(solution.q, truth.q[-1] * (tracker.problem.prior == 0), atol=1e-6)
