"""Rotations that best align a model's vectors with measured ones, for many frames at once.

A joint with three axes rotates freely; one or two hinges rotate in sequence about theirs. The
measurement enters through the cross-covariance ``B = Σ w (measured) (model)ᵀ``; the best rotation R
makes ``trace(Rᵀ B)`` largest.
"""

from functools import cache
from typing import Final

import numpy as np

from hbm.coordinates import TREE
from hbm.spatial import Array, fit_rotation, skew

COFACTORS: Final = np.array(
    [
        (4, 5, 3, 7, 8, 6, 1, 2, 0),
        (8, 6, 7, 2, 0, 1, 5, 3, 4),
        (5, 3, 4, 8, 6, 7, 2, 0, 1),
        (7, 8, 6, 1, 2, 0, 4, 5, 3),
    ]
)
"""Entries a, b, c, d of a flat 3 × 3 matrix whose cofactors, in the same order, are ``ab − cd``."""

CYCLIC: Final = {(0, 1, 2), (1, 2, 0), (2, 0, 1)}
"""Sequences of axes that follow each other by the right-hand rule."""

MIN_FRAMES_CLOSED_FORM: Final = 24
"""For fewer frames singular values are as fast."""

ROOT_ITERATIONS: Final = 5
"""Newton's method on the quartic starts at an upper bound of its largest root, from where five
iterations suffice unless two roots nearly coincide."""

MAX_LAST_STEP: Final = 1e-6
"""Last step of that root, relative to it: convergence is quadratic, so the error is its square."""

MIN_SLOPE: Final = 1e-9
"""Slope of the quartic, relative to the cube of its root, below which the root is a double root."""

MIN_SCALE: Final = 1e-2
"""Scale of the closed form, relative to the cube of the root: it vanishes for markers on one line,
and the closed form loses precision as it becomes small."""

MIN_AMPLITUDE: Final = 1e-300
"""Avoids the division of zero by zero, where any angle is equally good."""

HINGE_ITERATIONS: Final = 4
"""How often the two angles of a double hinge are improved in turn: enough for a starting point."""


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
    faster for many frames than singular values. For few frames, and where the closed form is
    singular, as for markers on one line, `fit_rotation` is used.
    """
    if len(covariance) < MIN_FRAMES_CLOSED_FORM:
        return fit_rotation(covariance)
    flat = covariance.reshape(-1, 9)
    plus, minus = flat[:, COFACTORS[0]] * flat[:, COFACTORS[1]], flat[:, COFACTORS[2]]
    cofactor = plus - minus * flat[:, COFACTORS[3]]
    norm, size = np.vecdot(flat, flat), 4 * np.vecdot(cofactor, cofactor)
    determinant = np.vecdot(flat[:, :3], cofactor[:, :3])
    root = np.sqrt(norm + np.sqrt(3 * size))
    for _ in range(ROOT_ITERATIONS):
        rest = root**2 - norm
        slope, step = 4 * root * rest - 8 * determinant, np.zeros_like(root)
        value = rest**2 - 8 * determinant * root - size
        np.divide(value, slope, out=step, where=slope > MIN_SLOPE * root**3)
        root -= step
    half = (root**2 - norm) / 2
    scale = half * root - determinant
    square = covariance @ np.swapaxes(covariance, 1, 2) @ covariance
    rotation = (half + norm)[:, None] * flat + root[:, None] * cofactor - square.reshape(-1, 9)
    singular = (scale <= MIN_SCALE * root**3) | (np.abs(step) > MAX_LAST_STEP * root)
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
    (i, j, k), (a, b, c) = _axes_and_signs(first)
    sign = 1.0 if (i, j, k) in CYCLIC else -1.0
    angles = np.empty((len(R), 3))
    angles[:, 0] = a * np.arctan2(-sign * R[:, j, k], R[:, k, k])
    angles[:, 1] = b * np.arcsin(np.clip(sign * R[:, i, k], -1, 1))
    angles[:, 2] = c * np.arctan2(-sign * R[:, i, j], R[:, i, i])
    return angles


@cache
def _axes_and_signs(first: int) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Give the lab axes that three coordinates rotate about in the neutral pose, and the signs."""
    axes = [TREE[i].axis or () for i in range(first, first + 3)]
    return tuple(axis.index(sum(axis)) for axis in axes), tuple(sum(axis) for axis in axes)


def hinge_angles(covariance: Array, terms: Array, starts: tuple[float, ...]) -> tuple[Array, Array]:
    """Rotate one or two hinges in sequence to align the model with the measurement.

    Parameters
    ----------
    covariance
        Measured by model, in the frame before the first hinge, (F, 3, 3).
    terms
        Of the hinges' rotations (see `rotation_terms`), (n, 3, 9).
    starts
        First angles of the second hinge to try [rad].

    Returns
    -------
    angles
        (F, n) [rad].
    rotation
        The rotation that they make, (F, 3, 3).

    Notes
    -----
    ``trace(Rᵀ B)`` is linear in (1, cos, sin) of each angle, so the best angle of each hinge has a
    closed form while the other stays. Two hinges are improved in turn from each start, and the best
    result is kept.
    """
    flat = covariance.reshape(-1, 9)
    if len(terms) == 1:
        factors = _best_factors(flat @ terms[0].T)
        return _angle(factors)[:, None], (factors @ terms[0]).reshape(-1, 3, 3)
    first, second = terms.reshape(2, 3, 3, 3)
    bilinear = (flat @ (first[:, None] @ second).reshape(9, 9).T).reshape(-1, 3, 3)
    transposed = np.swapaxes(bilinear, 1, 2)
    distal = np.stack([np.ones_like(starts), np.cos(starts), np.sin(starts)], axis=-1)
    for _ in range(HINGE_ITERATIONS):
        proximal = _best_factors(distal @ transposed)
        distal = _best_factors(proximal @ bilinear)
    traces = np.vecdot(proximal @ bilinear, distal)
    best = np.arange(len(covariance)), traces.argmax(axis=1)
    proximal, distal = proximal[best], distal[best]
    rotations = (
        (factors @ term).reshape(-1, 3, 3)
        for factors, term in ((proximal, terms[0]), (distal, terms[1]))
    )
    return np.stack([_angle(proximal), _angle(distal)], axis=1), np.matmul(*rotations)


def rotation_terms(axes: Array) -> Array:
    """Give the matrices that 1, cos and sin of the angle multiply in rotations about axes.

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


def _best_factors(coefficients: Array) -> Array:
    """Give 1, cos and sin of the angles that make their sum with coefficients (..., 3) largest."""
    amplitude = np.hypot(coefficients[..., 1], coefficients[..., 2])
    factors = coefficients / np.maximum(amplitude, MIN_AMPLITUDE)[..., None]
    factors[..., 0] = 1
    return np.asarray(factors)


def _angle(factors: Array) -> Array:
    return np.asarray(np.arctan2(factors[..., 2], factors[..., 1]))
