"""The skeleton has one definition: kernels and Pinocchio model follow from the body's joints."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.coordinates import LAST_Q, SEGMENTS, SUBJECT_AXES, SUBJECT_OFFSETS, TREE
from tests.hbm.people import person
from tests.synthetic import MASS_KG, synthetic_body

ONE_ROUNDING = 2.3e-16
"""Pinocchio brings axes to unit length once more, which may change their last bit."""


@pytest.fixture(scope="module")
def pin():
    return pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")


@pytest.fixture(scope="module", params=["all markers", "without the left arm"])
def body(request):
    missing = ("LLEE", "LMEE") if request.param == "without the left arm" else ()
    return build_body(person(*missing), mass=MASS_KG) if missing else synthetic_body()


def same_inertia(theirs, ours):
    np.testing.assert_allclose(theirs.mass, ours.mass, rtol=1e-14)
    np.testing.assert_allclose(theirs.lever, ours.center, rtol=0, atol=1e-15)
    np.testing.assert_allclose(theirs.inertia, ours.tensor, rtol=0, atol=1e-15)


def test_the_pinocchio_model_has_the_18_segments_each_with_its_inertia(pin, body):
    model = body.model
    frames = {f.name: f for f in model.frames if f.type == pin.FrameType.BODY}
    assert {name for name, f in frames.items() if f.inertia.mass > 0} == set(SEGMENTS)
    for s, part in body.segments.items():
        same_inertia(frames[s].inertia, part)
        assert frames[s].parentJoint == LAST_Q[s] + 1
        assert frames[s].placement == pin.SE3.Identity()


def test_markers_are_frames_on_their_segments(pin, body):
    model = body.model
    for name, s, position in zip(
        body.markers, body.marker_segment, body.marker_position, strict=True
    ):
        marker = model.frames[model.getFrameId(name)]
        assert model.frames[marker.parentFrame].name == s
        np.testing.assert_array_equal(marker.placement.translation, position)


def test_the_kernels_geometry_is_the_pinocchio_model_s(pin, body):
    """All of it: what the vector leaves out is zero, or the axis that the kernels contain."""
    model = body.model
    offset = np.array([place.translation for place in model.jointPlacements])[1:]
    axis = np.array([joint.extract().axis for joint in list(model.joints)[1:]])
    own = np.concatenate([offset[list(SUBJECT_OFFSETS)], axis[list(SUBJECT_AXES)]])
    np.testing.assert_allclose(body.geometry, own.ravel(), rtol=0, atol=ONE_ROUNDING)
    assert not np.delete(offset, SUBJECT_OFFSETS, axis=0).any()
    constant = [c.axis for c in TREE if c.axis is not None]
    np.testing.assert_array_equal(np.delete(axis, SUBJECT_AXES, axis=0), constant)
