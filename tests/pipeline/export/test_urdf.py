"""The exported URDF is the same body in Pinocchio and in MuJoCo."""

import numpy as np
import pytest

from hbm.coordinates import COORDINATES, FIXED_TO, MOVING, N_Q, TREE
from hbm.kernels.native import kernels
from pipeline.export.models import write_urdf
from tests.synthetic import synthetic_body

pin = pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")

TRANSLATES = np.array([c.translates for c in TREE])
NUMBER = {s: MOVING.index(FIXED_TO.get(s, s)) for s in (*MOVING, *FIXED_TO)}
"""Segment or point -> number of the frame that it has."""
POSES = 20


@pytest.fixture(scope="module")
def body():
    return synthetic_body()


@pytest.fixture(scope="module")
def path(body, tmp_path_factory):
    path = tmp_path_factory.mktemp("urdf") / "body.urdf"
    write_urdf(body, path)
    return path


@pytest.fixture(scope="module")
def q():
    rng = np.random.default_rng(5)
    return rng.uniform(-1, 1, (POSES, N_Q)) * np.where(TRANSLATES, 0.5, np.pi)


@pytest.fixture(scope="module")
def poses(body, q):
    return kernels().segment_poses(q, body.geometry)[0].reshape(POSES, len(MOVING), 4, 3)


@pytest.fixture(scope="module")
def marker_positions(body, poses):
    own = [MOVING.index(s) for s in body.marker_segment]
    local = np.column_stack([body.marker_position, np.ones(len(own))])
    return np.einsum("tkai,ka->tki", poses[:, own], local)


def test_pinocchio_puts_segments_and_markers_where_we_do(body, path, q, poses, marker_positions):
    model = pin.buildModelFromUrdf(str(path))
    assert model.nq == model.nv == N_Q
    assert set(model.names) - {"universe"} == set(COORDINATES)
    data = model.createData()
    order = order_in(model)
    for k in range(POSES):
        pin.framesForwardKinematics(model, data, q[k, order])
        for segment, j in NUMBER.items():
            frame = data.oMf[model.getFrameId(segment)]
            np.testing.assert_allclose(frame.rotation, poses[k, j, :3].T, rtol=0, atol=1e-12)
            np.testing.assert_allclose(frame.translation, poses[k, j, 3], rtol=0, atol=1e-12)
        theirs = [data.oMf[model.getFrameId(name)].translation for name in body.markers]
        np.testing.assert_allclose(theirs, marker_positions[k], rtol=0, atol=1e-12)


def test_pinocchio_finds_our_generalized_forces(body, path, q):
    rng = np.random.default_rng(6)
    v, a = rng.normal(size=(2, POSES, N_Q))
    ours, _, _ = kernels().newton_euler(q, v, a, body.geometry, body.inertia_vector)
    model = pin.buildModelFromUrdf(str(path))
    data, order = model.createData(), order_in(model)
    for k in range(POSES):
        theirs = pin.rnea(model, data, q[k, order], v[k, order], a[k, order])
        np.testing.assert_allclose(theirs, ours[k, order], rtol=0, atol=1e-9)


def test_mujoco_finds_our_generalized_forces(body, path, q):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    rng = np.random.default_rng(7)
    v, a = rng.normal(size=(2, POSES, N_Q))
    ours, _, _ = kernels().newton_euler(q, v, a, body.geometry, body.inertia_vector)
    model = mujoco.MjModel.from_xml_path(str(path))
    state = mujoco.MjData(model)
    at = [model.joint(name).dofadr[0] for name in COORDINATES]
    for k in range(POSES):
        state.qpos[at], state.qvel[at], state.qacc[at] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, state)
        np.testing.assert_allclose(state.qfrc_inverse[at], ours[k], rtol=0, atol=1e-9)


def order_in(model):
    """Our number of each of the model's coordinates."""
    return [COORDINATES.index(name) for name in model.names[1:]]
