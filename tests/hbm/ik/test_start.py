"""Rotations align a model with measured directions as independent computations do."""

import numpy as np
from scipy.spatial.transform import Rotation

from hbm.ik.start import nearest_rotation
from hbm.spatial import fit_rotation

FRAMES = 300


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
