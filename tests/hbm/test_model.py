"""The skeleton has one definition: kernels and Pinocchio model follow from the body's joints."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.coordinates import LAST_Q, SEGMENTS
from tests.hbm.people import person
from tests.synthetic import MASS_KG, synthetic_body


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
