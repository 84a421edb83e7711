"""The chain repeats what processing did, and each of its steps can be changed."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.segments import Inertia
from hbm.spatial import GRAVITY_MPS2, shift_wrench
from pipeline.explain.linearise import result_chain


def test_the_residual_of_the_chain_is_the_measured_one(chain, walk):
    np.testing.assert_allclose(chain.residual, walk[1].measured.residual, atol=1e-8)


def test_the_residual_of_a_chain_on_a_moving_platform_is_the_compensated_one(moving):
    compensated = moving[-1].compensated
    np.testing.assert_allclose(result_chain(*moving).residual, compensated.residual, atol=1e-8)


def test_some_frames_of_a_trial_have_the_same_residual_but_for_their_ends(moving):
    """The platform is not in neutral where they begin."""
    part = result_chain(*moving).of_frames(slice(500, 1000))
    assert abs(part.platform.pitch[0]) > np.radians(2)
    expected = moving[-1].compensated.residual[650:850]
    np.testing.assert_allclose(part.residual[150:-150], expected, atol=1e-3)


def test_a_heavier_pelvis_needs_its_own_weight_and_inertia_more(chain):
    """A point mass in the pelvis origin, by Newton's second law on the filtered origin."""
    pelvis = chain.body.segments["pelvis"]
    total = pelvis.mass + 1.0
    center = pelvis.mass * pelvis.center / total
    # parallel axes: both parts about the common centre
    apart, own = pelvis.center - center, -center
    tensor = pelvis.tensor + pelvis.mass * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    tensor = tensor + (own @ own * np.eye(3) - np.outer(own, own))
    segments = dict(chain.body.segments) | {"pelvis": Inertia(total, center, tensor)}
    heavier = chain.changed(body=replace(chain.body, segments=segments))
    added = heavier.residual - chain.residual
    expected = chain.filtered.acceleration[:, :3] + [0, 0, GRAVITY_MPS2]
    np.testing.assert_allclose(added[:, :3], expected, atol=1e-9)
    np.testing.assert_allclose(added[:, 3:], 0, atol=1e-9)


def test_a_load_on_a_plate_acts_on_the_residual_where_the_plate_is(chain):
    load = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])
    wrenches = [chain.wrenches[0], chain.wrenches[1] + load]
    added = (chain.changed(wrenches=wrenches).residual - chain.residual)[200:-200]
    plate, pelvis = chain.plates[1], chain.filtered.value[200:-200, :3]
    force = plate.rotation @ load[:3]
    moment = np.cross(plate.center - pelvis, force)
    np.testing.assert_allclose(added[:, :3], -np.tile(force, (len(added), 1)), atol=1e-6)
    np.testing.assert_allclose(added[:, 3:], -moment, atol=1e-6)


@pytest.mark.parametrize("axis", range(3))
def test_a_motion_elsewhere_needs_the_same_wrench_about_the_pelvis(chain, axis):
    q = chain.q.copy()
    q[:, axis] += 0.3
    moved = chain.changed(q=q)
    np.testing.assert_allclose(moved.needed, chain.needed, atol=1e-6)
    expected = shift_wrench(chain.on_ground, moved.filtered.value[:, :3])
    np.testing.assert_allclose(moved.needed - moved.residual, expected, atol=1e-6)
