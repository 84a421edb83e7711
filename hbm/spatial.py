"""Frames and wrenches: rotate, shift, transform; gravity; arrays that cannot be changed.

A wrench is ``[fx fy fz mx my mz]``. Unless a suffix says otherwise it is expressed in lab axes
(X forward, Y left, Z up) about the lab origin. Every function works on any number of leading
dimensions and broadcasts them.
"""

from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

WRENCH_COMPONENTS: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
"""Names of a wrench's components, in their order."""
GRAVITY_MPS2: Final = 9.81
"""Acceleration of free fall, along -Z of the lab; the value that the Human Body Model uses."""


def read_only(value: ArrayLike) -> Array:
    """Give an array that cannot be changed: a copy, unless it cannot yet.

    Truth values stay such, all others become floats.
    """
    array = np.asarray(value)
    # a mask stays a mask; integers, which division would truncate, become floats
    dtype = bool if array.dtype == bool else float
    # unchangeable is an array if the one whose memory it is a part of is so too
    owner = array if array.base is None else array.base
    writeable = array.flags.writeable or not isinstance(owner, np.ndarray) or owner.flags.writeable
    if array.dtype == dtype and not writeable:
        return array
    return frozen(np.array(array, dtype))


def freeze_arrays(owner: object, of: str, **shapes: tuple[int, ...]) -> None:
    """Make arrays of a frozen dataclass unchangeable; a ValueError for another shape."""
    for name, shape in shapes.items():
        value = read_only(getattr(owner, name))
        if value.shape != shape:
            raise ValueError(f"{of}: {name} must have shape {shape}, got {value.shape}")
        object.__setattr__(owner, name, value)


def frozen(value: Array) -> Array:
    """Make an array that nobody else holds unchangeable, so that `read_only` need not copy it."""
    for array in (value, value.base):
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    return value


def shift_wrench(wrench: ArrayLike, to: ArrayLike) -> Array:
    """Express wrenches about another point.

    Parameters
    ----------
    wrench
        Wrenches about the origin of the frame they are expressed in, (..., 6) [N, N·m].
    to
        The new reference point in the same frame, (..., 3) [m].

    Returns
    -------
    Array
        The same wrenches about ``to``, (..., 6). Shifting back is shifting by ``-to``.
    """
    wrench, to = np.asarray(wrench, float), np.asarray(to, float)
    force, moment = wrench[..., :3], wrench[..., 3:]
    shape = (*np.broadcast_shapes(force.shape, to.shape)[:-1], 6)
    shifted = np.empty_like(wrench, shape=shape)  # in memory as the wrenches are
    shifted[..., :3] = force
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # np.cross takes four times as long
        cross = to[..., j] * force[..., k] - to[..., k] * force[..., j]
        shifted[..., 3 + i] = moment[..., i] - cross
    return shifted


def rotate_wrench(wrench: ArrayLike, rotation: ArrayLike) -> Array:
    """Express wrenches in other axes about the same point.

    Parameters
    ----------
    wrench
        Wrenches, (..., 6) [N, N·m].
    rotation
        Rotations that take coordinates in the wrenches' axes to the new axes, (..., 3, 3).

    Returns
    -------
    Array
        Wrenches in the new axes, (..., 6).
    """
    wrench, rotation = np.asarray(wrench, float), np.asarray(rotation, float)
    # one rotation for all: forces and moments as rows, so that R w is w Rᵀ
    if rotation.ndim == 2:
        return np.reshape(wrench.reshape(-1, 3) @ rotation.T, wrench.shape)
    parts = [(rotation @ wrench[..., k : k + 3, None])[..., 0] for k in (0, 3)]
    return np.concatenate(parts, axis=-1)


def transform_wrench(wrench: ArrayLike, rotation: ArrayLike, position: ArrayLike) -> Array:
    """Express wrenches given in a moving frame, about its origin, in the lab about the lab origin.

    Parameters
    ----------
    wrench
        Wrenches in the moving frame about its origin, (..., 6) [N, N·m].
    rotation
        Orientation of the moving frame in the lab (columns are its axes), (..., 3, 3).
    position
        Origin of the moving frame in the lab, (..., 3) [m].

    Returns
    -------
    Array
        Wrenches in lab axes about the lab origin, (..., 6):
        ``F = R f`` and ``M = R m + p × F``.
    """
    return shift_wrench(rotate_wrench(wrench, rotation), -np.asarray(position, float))


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Give the rotation about a unit axis by Rodrigues' formula.

    Parameters
    ----------
    axis
        Unit vectors, (..., 3).
    angle
        Angles, (...) [rad], positive by the right-hand rule.

    Returns
    -------
    Array
        Rotation matrices, (..., 3, 3).
    """
    # R = 1 + sin φ [u]× + (1 − cos φ) [u]×²
    cross, angle = skew(axis), np.asarray(angle, float)[..., None, None]
    rotation: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    return rotation


CROSS: Final = np.array([[0, 6, 2], [3, 0, 4], [5, 1, 0]])
"""Entries of the matrix of a cross product among 0, x y z and -x -y -z."""


def skew(vector: ArrayLike) -> Array:
    """Give the matrix of the cross product, ``skew(a) @ b == np.cross(a, b)``.

    Parameters
    ----------
    vector
        Vectors, (..., 3).

    Returns
    -------
    Array
        Skew-symmetric matrices, (..., 3, 3).
    """
    vector = np.asarray(vector, float)
    # entries are picked from 0, v and −v: no arithmetic, whatever the leading dimensions
    signed = np.concatenate([np.zeros((*vector.shape[:-1], 1)), vector, -vector], axis=-1)
    return np.asarray(signed[..., CROSS])


def fit_rotation(covariance: ArrayLike) -> Array:
    """Give the proper rotation nearest to cross-covariances, maximising ``trace(Rᵀ B)``.

    Parameters
    ----------
    covariance
        ``B = Σ w (measured) (model)ᵀ``, (..., 3, 3).

    Returns
    -------
    Array
        Rotations that take the model's vectors to the measured ones, (..., 3, 3); never a
        reflection.

    Notes
    -----
    Orthogonal Procrustes by singular value decomposition (Söderkvist and Wedin 1993,
    J Biomech 26:1473).
    """
    u, _, vt = np.linalg.svd(np.asarray(covariance, float))
    sign = np.ones((*u.shape[:-2], 3))
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    rotation: Array = (u * sign[..., None, :]) @ vt
    return rotation


def dot(a: Array, b: Array) -> Array:
    """Give the product of vectors along each other, (..., 1): it multiplies vectors as it is."""
    return np.asarray((a * b).sum(axis=-1, keepdims=True))


def unit(vector: Array) -> Array:
    """Give the direction of vectors, (..., 3)."""
    return np.asarray(vector / np.sqrt(dot(vector, vector)))


def cross(a: Array, b: Array) -> Array:
    """Give the cross product of vectors, (..., 3); np.cross takes longer."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return product


def perpendicular(vector: Array, to: Array) -> Array:
    """Give the direction of the part of vectors that is perpendicular to others, (..., 3)."""
    along = unit(to)
    return unit(vector - dot(vector, along) * along)


def axes_from(left: Array, up: Array, exact: Literal["left", "up"]) -> Array:
    """Give rotations (columns: forward, left, up) from two directions, one of them exact."""
    # the other direction gives up its part along the exact one (Gram–Schmidt)
    if exact == "left":
        y = unit(left)
        z = perpendicular(up, y)
    else:
        z = unit(up)
        y = perpendicular(left, z)
    # forward completes the right-handed frame
    return np.stack(np.broadcast_arrays(cross(y, z), y, z), axis=-1)


def in_lab_axes(rotation: Array, vector: Array) -> Array:
    """Give vectors of frames, (..., 3), in the axes in which the frames are, (..., 3, 3)."""
    return np.asarray((rotation @ vector[..., None])[..., 0])


def in_axes_of(rotation: Array, vector: Array) -> Array:
    """Give vectors, (..., 3), in the axes of frames, (..., 3, 3)."""
    return in_lab_axes(np.swapaxes(rotation, -1, -2), vector)


def distance(a: Array, b: Array) -> Array:
    """Give the distance between points [m], (...)."""
    return np.asarray(np.sqrt(dot(a - b, a - b))[..., 0])
