"""Rotations that align a model with measured directions, against independent computations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hbm.coordinates import INDEX, TREE
from hbm.ik.start import hinge_angles, nearest_rotation, rotation_terms, three_angles
from hbm.spatial import fit_rotation, rotation_about

FRAMES = 300
STARTS_RAD = (0.0, 2.0, -2.0)


def noisy_covariances(rng, flatten=(1, 1, 1), markers=5):
    rotation = Rotation.random(FRAMES, rng=rng).as_matrix()
    model = rng.normal(size=(FRAMES, markers, 3)) * flatten
    measured = model @ np.swapaxes(rotation, 1, 2) + rng.normal(scale=0.1, size=model.shape)
    return np.swapaxes(measured, 1, 2) @ model


def alignment(rotation, covariance):
    """What the best rotation makes largest, trace(Rᵀ B)."""
    return np.einsum("tij,tij->t", rotation, covariance)


def test_the_closed_form_gives_the_rotation_of_the_singular_value_decomposition():
    rng = np.random.default_rng(1)
    for covariance in (noisy_covariances(rng), noisy_covariances(rng, (1, 1, 0))):
        np.testing.assert_allclose(
            nearest_rotation(covariance), fit_rotation(covariance), atol=1e-9
        )


def test_markers_on_a_line_in_a_point_or_mirrored_still_give_a_proper_and_best_rotation():
    rng = np.random.default_rng(3)
    degenerate = [
        noisy_covariances(rng, markers=1),
        noisy_covariances(rng, (1, 0, 0)),
        np.zeros((FRAMES, 3, 3)),
        np.tile(np.diag([1.0, 1.0, -1.0]), (FRAMES, 1, 1)),
        np.tile(-np.eye(3), (FRAMES, 1, 1)),
    ]
    for covariance in degenerate:
        rotation = nearest_rotation(covariance)
        identity = np.broadcast_to(np.eye(3), rotation.shape)
        np.testing.assert_allclose(rotation @ np.swapaxes(rotation, 1, 2), identity, atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(rotation), 1, atol=1e-9)
        best = alignment(fit_rotation(covariance), covariance)
        np.testing.assert_allclose(alignment(rotation, covariance), best, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["PelvisYaw", "TrunkFlexion", "LShoulderAbduction", "RHipFlexion"])
def test_rotating_by_the_three_angles_restores_the_rotation(name):
    first = INDEX[name]
    rotation = Rotation.random(FRAMES, rng=np.random.default_rng(4)).as_matrix()
    angles = three_angles(rotation, first)
    restored = np.broadcast_to(np.eye(3), rotation.shape)
    for k in range(3):
        restored = restored @ rotation_about(TREE[first + k].axis, angles[:, k])
    np.testing.assert_allclose(restored, rotation, atol=1e-12)
    assert np.abs(angles[:, 1]).max() <= np.pi / 2


@pytest.mark.parametrize("hinges", [1, 2])
def test_hinges_recover_the_rotation_that_made_the_markers(hinges):
    rng = np.random.default_rng(5)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:hinges]
    angles = rng.uniform(-1.5, 1.5, (FRAMES, hinges))
    rotation = np.broadcast_to(np.eye(3), (FRAMES, 3, 3))
    for axis, angle in zip(axes, angles.T, strict=True):
        rotation = rotation @ rotation_about(axis, angle)
    model = rng.normal(size=(4, 3))
    found, recovered = hinge_angles(rotation @ (model.T @ model), rotation_terms(axes), STARTS_RAD)
    np.testing.assert_allclose(recovered, rotation, atol=0.05)
    assert np.median(np.abs(recovered - rotation)) < 1e-3
    assert found.shape == angles.shape


def test_no_other_angle_of_a_single_hinge_aligns_better():
    rng = np.random.default_rng(6)
    covariance, axis = noisy_covariances(rng), np.array([[0.6, 0.0, 0.8]])
    _, rotation = hinge_angles(covariance, rotation_terms(axis), (0.0,))
    for angle in np.linspace(-np.pi, np.pi, 50):
        other = rotation_about(axis[0], np.full(FRAMES, angle))
        assert (alignment(other, covariance) <= alignment(rotation, covariance) + 1e-9).all()
