"""Segments and markers that the model does not come near."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hbm.kinematics import solve_ik
from hbm.plausibility.motion import large_marker_errors
from tests.hbm.motions import relabelled, without
from tests.synthetic import synthetic_body

BODY = synthetic_body()
MILLIMETRES = st.floats(0.1, 300.0)


@pytest.fixture(scope="module")
def motion(walk):
    return solve_ik(BODY, walk)


def with_errors(motion, **error_mm):
    """The same motion, all markers 5 mm from the model but the named ones."""
    error = np.full(motion.marker_error.shape, 0.005)
    for name, size in error_mm.items():
        error[:, motion.markers.index(name)] = size / 1000
    return replace(motion, marker_error=error)


def codes(motion):
    return {note.code for note in large_marker_errors(BODY, motion)}


def test_a_walk_with_noise_of_4_mm_is_fitted_well(motion):
    assert large_marker_errors(BODY, motion) == ()


def test_exchanged_heels_are_far_from_the_model(walk):
    motion = solve_ik(BODY, relabelled(walk, ("LHEE", "RHEE")))
    segment, marker = large_marker_errors(BODY, motion)
    assert (segment.code, marker.code) == ("segment_error_large", "marker_error_large")
    assert {"left_foot", "right_foot"} <= set(segment.values["farthest_m"])
    assert {"LHEE", "RHEE"} <= set(marker.values["farthest_m"])
    assert "has a marker moved since the calibration pose" in segment.text


@given(size=MILLIMETRES)
def test_a_marker_is_named_from_40_mm_on_and_never_below(motion, size):
    assume(abs(size - 40) > 1e-6)
    found = codes(with_errors(motion, LHEE=size))
    assert ("marker_error_large" in found) == (size > 40)


@given(size=MILLIMETRES)
def test_a_segment_is_named_from_20_mm_on_and_never_below(motion, size):
    assume(abs(size - 20) > 1e-6)
    found = codes(with_errors(motion, LHEE=size, LMT2=size, LMT5=size))
    assert ("segment_error_large" in found) == (size > 20)


def test_a_segment_with_one_marker_is_judged_by_the_limit_of_a_marker(motion):
    assert codes(with_errors(motion, LSHO=35.0)) == set()
    assert codes(with_errors(motion, LSHO=45.0)) == {"marker_error_large"}


def test_the_six_farthest_are_named_the_farthest_first(motion):
    names = motion.markers[:8]
    motion = with_errors(motion, **{name: 50.0 + k for k, name in enumerate(names)})
    note = next(n for n in large_marker_errors(BODY, motion) if n.code == "marker_error_large")
    assert note.values["count"] == 8
    assert list(note.values["farthest_m"]) == list(names[:1:-1])


def test_markers_that_are_never_seen_have_no_error(walk):
    motion = solve_ik(BODY, without(walk, ["LHEE"]))
    assert large_marker_errors(BODY, motion) == ()
