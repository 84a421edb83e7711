"""Turns that bring a model's vectors nearest to measured ones, for many frames at once.

A joint with three axes turns freely; one or two hinges turn in sequence about theirs. What is
measured enters through the cross-covariance ``B = Σ w (measured) (model)ᵀ``; the nearest turn makes
``trace(Rᵀ B)`` largest.
"""

from functools import cache
from typing import Final

import numpy as np

from hbm.coordinates import TREE
from hbm.spatial import Array, fit_rotation, skew

SWEEPS: Final = 4
COFACTORS: Final = np.array(
    [
        (4, 5, 3, 7, 8, 6, 1, 2, 0),
        (8, 6, 7, 2, 0, 1, 5, 3, 4),
        (5, 3, 4, 8, 6, 7, 2, 0, 1),
        (7, 8, 6, 1, 2, 0, 4, 5, 3),
    ]
)
ROOT_STEPS: Final = 5
FLAT: Final = 1e-9
FEW: Final = 24
ON_A_LINE: Final = 1e-2
SETTLED: Final = 1e-6
TINY: Final = 1e-300
CYCLIC: Final = {(0, 1, 2), (1, 2, 0), (2, 0, 1)}


def nearest_rotation(covariance: Array) -> Array:
    """Give the proper rotations nearest to cross-covariances, as `fit_rotation` does.

    Parameters
    ----------
    covariance
        Measured by model, (F, 3, 3).

    Returns
    -------
    Array
        Rotations that take the model's vectors to the measured ones, (F, 3, 3).

    Notes
    -----
    In closed form but for a root of a quartic (Markley 1993, J Astronaut Sci 41:261), which is far
    quicker for many frames than singular values. For few, and where that is singular, as with
    markers on one line, `fit_rotation` steps in.
    """
    if len(covariance) < FEW:
        return fit_rotation(covariance)
    flat = covariance.reshape(-1, 9)
    plus, minus = flat[:, COFACTORS[0]] * flat[:, COFACTORS[1]], flat[:, COFACTORS[2]]
    cofactor = plus - minus * flat[:, COFACTORS[3]]
    norm, size = np.vecdot(flat, flat), 4 * np.vecdot(cofactor, cofactor)
    determinant = np.vecdot(flat[:, :3], cofactor[:, :3])
    root = np.sqrt(norm + np.sqrt(3 * size))
    for _ in range(ROOT_STEPS):
        rest = root**2 - norm
        slope, step = 4 * root * rest - 8 * determinant, np.zeros_like(root)
        short = rest**2 - 8 * determinant * root - size
        np.divide(short, slope, out=step, where=slope > FLAT * root**3)
        root -= step
    half = (root**2 - norm) / 2
    scale = half * root - determinant
    square = covariance @ np.swapaxes(covariance, 1, 2) @ covariance
    rotation = (half + norm)[:, None] * flat + root[:, None] * cofactor - square.reshape(-1, 9)
    singular = (scale <= ON_A_LINE * root**3) | (np.abs(step) > SETTLED * root)
    rotation = (rotation / np.where(singular, 1, scale)[:, None]).reshape(-1, 3, 3)
    if singular.any():
        rotation[singular] = fit_rotation(covariance[singular])
    return np.asarray(rotation)


def three_angles(R: Array, first: int) -> Array:
    """Split rotations into the angles of three consecutive coordinates with coordinate axes.

    Parameters
    ----------
    R
        Rotations, (F, 3, 3).
    first
        Number of the first coordinate.

    Returns
    -------
    Array
        Angles, (F, 3) [rad], the middle one within ±90°.
    """
    (i, j, k), (a, b, c) = _axes_and_senses(first)
    sign = 1.0 if (i, j, k) in CYCLIC else -1.0
    angles = np.empty((len(R), 3))
    angles[:, 0] = a * np.arctan2(-sign * R[:, j, k], R[:, k, k])
    angles[:, 1] = b * np.arcsin(np.clip(sign * R[:, i, k], -1, 1))
    angles[:, 2] = c * np.arctan2(-sign * R[:, i, j], R[:, i, i])
    return angles


@cache
def _axes_and_senses(first: int) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Give the numbers of three coordinates' axes, and whether they point along or against."""
    axes = [TREE[i].axis or () for i in range(first, first + 3)]
    return tuple(axis.index(sum(axis)) for axis in axes), tuple(sum(axis) for axis in axes)


def hinge_angles(covariance: Array, parts: Array, begins: tuple[float, ...]) -> tuple[Array, Array]:
    """Turn one or two hinges in sequence onto measured directions.

    Parameters
    ----------
    covariance
        Measured by model, in the frame before the first hinge, (F, 3, 3).
    parts
        Of the hinges' turns (see `parts_of_turns`), (n, 3, 9).
    begins
        First angles of the second hinge to try [rad].

    Returns
    -------
    angles
        (F, n) [rad].
    turn
        The rotation they give, (F, 3, 3).

    Notes
    -----
    ``trace(Rᵀ B)`` is linear in (1, cos, sin) of each angle, so each hinge has its best angle in
    closed form. Two hinges take turns, and of all beginnings the best end is kept.
    """
    flat = covariance.reshape(-1, 9)
    if len(parts) == 1:
        waves = _best_waves(flat @ parts[0].T)
        return _angle(waves)[:, None], (waves @ parts[0]).reshape(-1, 3, 3)
    first, second = parts.reshape(2, 3, 3, 3)
    met = (flat @ (first[:, None] @ second).reshape(9, 9).T).reshape(-1, 3, 3)
    back = np.swapaxes(met, 1, 2)
    after = np.stack([np.ones_like(begins), np.cos(begins), np.sin(begins)], axis=-1)
    for _ in range(SWEEPS):
        before = _best_waves(after @ back)
        after = _best_waves(before @ met)
    ends = np.vecdot(before @ met, after)
    best = np.arange(len(covariance)), ends.argmax(axis=1)
    before, after = before[best], after[best]
    turns = (
        (waves @ part).reshape(-1, 3, 3) for waves, part in ((before, parts[0]), (after, parts[1]))
    )
    return np.stack([_angle(before), _angle(after)], axis=1), np.matmul(*turns)


def parts_of_turns(axes: Array) -> Array:
    """Give what 1, cos and sin of the angle multiply in rotations about axes.

    Parameters
    ----------
    axes
        Unit vectors, (n, 3).

    Returns
    -------
    Array
        Three matrices per axis, flat, (n, 3, 9).
    """
    along = axes[:, :, None] * axes[:, None]
    return np.stack([along, np.eye(3) - along, skew(axes)], axis=1).reshape(-1, 3, 9)


def _best_waves(met: Array) -> Array:
    """Give 1, cos and sin of the angles whose sum with these factors, (..., 3), is largest."""
    waves = met / np.maximum(np.hypot(met[..., 1], met[..., 2]), TINY)[..., None]
    waves[..., 0] = 1
    return np.asarray(waves)


def _angle(waves: Array) -> Array:
    return np.asarray(np.arctan2(waves[..., 2], waves[..., 1]))
