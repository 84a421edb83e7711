"""Turns onto measured directions: the best ones, by other ways of finding them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hbm.coordinates import INDEX, TREE
from hbm.ik.rotations import hinge_angles, nearest_rotation, parts_of_turns, three_angles
from hbm.spatial import fit_rotation, rotation_about

FRAMES = 300
TURNS = (0.0, 2.0, -2.0)


def noisy_covariances(rng, flatten=(1, 1, 1), markers=5):
    turn = Rotation.random(FRAMES, rng=rng).as_matrix()
    model = rng.normal(size=(FRAMES, markers, 3)) * flatten
    measured = model @ np.swapaxes(turn, 1, 2) + rng.normal(scale=0.1, size=model.shape)
    return np.swapaxes(measured, 1, 2) @ model


def met(turn, covariance):
    return np.einsum("tij,tij->t", turn, covariance)


def test_the_nearest_rotation_is_that_of_singular_values():
    rng = np.random.default_rng(1)
    for covariance in (noisy_covariances(rng), noisy_covariances(rng, (1, 1, 0))):
        np.testing.assert_allclose(
            nearest_rotation(covariance), fit_rotation(covariance), atol=1e-9
        )


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_the_size_of_the_markers_does_not_turn_them(scale):
    covariance = noisy_covariances(np.random.default_rng(2))
    np.testing.assert_allclose(
        nearest_rotation(scale * covariance), nearest_rotation(covariance), atol=1e-12
    )


def test_markers_on_a_line_in_a_point_or_mirrored_are_met_by_a_rotation_all_the_same():
    rng = np.random.default_rng(3)
    awkward = [
        noisy_covariances(rng, markers=1),
        noisy_covariances(rng, (1, 0, 0)),
        np.zeros((FRAMES, 3, 3)),
        np.tile(np.diag([1.0, 1.0, -1.0]), (FRAMES, 1, 1)),
        np.tile(-np.eye(3), (FRAMES, 1, 1)),
    ]
    for covariance in awkward:
        turn = nearest_rotation(covariance)
        square = np.broadcast_to(np.eye(3), turn.shape)
        np.testing.assert_allclose(turn @ np.swapaxes(turn, 1, 2), square, atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(turn), 1, atol=1e-9)
        best = met(fit_rotation(covariance), covariance)
        np.testing.assert_allclose(met(turn, covariance), best, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["PelvisYaw", "TrunkFlexion", "LShoulderAbduction", "RHipFlexion"])
def test_three_angles_give_the_rotation_back(name):
    first = INDEX[name]
    turn = Rotation.random(FRAMES, rng=np.random.default_rng(4)).as_matrix()
    angles = three_angles(turn, first)
    back = np.broadcast_to(np.eye(3), turn.shape)
    for k in range(3):
        back = back @ rotation_about(TREE[first + k].axis, angles[:, k])
    np.testing.assert_allclose(back, turn, atol=1e-12)
    assert np.abs(angles[:, 1]).max() <= np.pi / 2


@pytest.mark.parametrize("hinges", [1, 2])
def test_hinges_find_the_angles_that_made_the_markers(hinges):
    rng = np.random.default_rng(5)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:hinges]
    angles = rng.uniform(-1.5, 1.5, (FRAMES, hinges))
    turn = np.broadcast_to(np.eye(3), (FRAMES, 3, 3))
    for axis, angle in zip(axes, angles.T, strict=True):
        turn = turn @ rotation_about(axis, angle)
    model = rng.normal(size=(4, 3))
    found, way = hinge_angles(turn @ (model.T @ model), parts_of_turns(axes), TURNS)
    np.testing.assert_allclose(way, turn, atol=0.05)
    assert np.median(np.abs(way - turn)) < 1e-3
    assert found.shape == angles.shape


def test_no_single_hinge_angle_is_better():
    rng = np.random.default_rng(6)
    covariance, axis = noisy_covariances(rng), np.array([[0.6, 0.0, 0.8]])
    _, way = hinge_angles(covariance, parts_of_turns(axis), (0.0,))
    for angle in np.linspace(-np.pi, np.pi, 50):
        other = rotation_about(axis[0], np.full(FRAMES, angle))
        assert (met(other, covariance) <= met(way, covariance) + 1e-9).all()
