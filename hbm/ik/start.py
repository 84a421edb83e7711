"""A starting pose from one frame's markers: segment by segment, each aligned with its markers.

The pelvis is fitted rigidly; every further segment is attached at its joint and rotates about it:
by the nearest rotation where the joint has three axes, by the best angle of each hinge where it has
one or two. From such a start Newton's method finds a pose; from zeros it converges to wrong minima.
"""

from functools import cache
from typing import Final

import numpy as np

from hbm.coordinates import FIRST_Q, LAST_Q, MOVING, N_Q, PARENT, TREE
from hbm.ik.descent import MarkerAttachment
from hbm.model import Joint
from hbm.spatial import Array, Mask, cross, fit_rotation, skew


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
    # for fewer frames singular values are as fast
    if len(covariance) < 24:
        return fit_rotation(covariance)
    flat = covariance.reshape(-1, 9)
    # the cofactors of a row are the cross product of the two other rows; entry by entry in memory
    cofactor = cross(covariance[:, (1, 2, 0)], covariance[:, (2, 0, 1)])
    cofactor = np.asfortranarray(cofactor.reshape(-1, 9))
    # the largest root of (x² − |B|²)² − 8 det B · x = 4 |cof B|² is the sum of singular values,
    # the smallest with the sign of det B: so rotations need no decomposition
    norm, size = np.vecdot(flat, flat), 4 * np.vecdot(cofactor, cofactor)
    determinant = np.vecdot(flat[:, :3], cofactor[:, :3])
    root = np.sqrt(norm + np.sqrt(3 * size))
    # from an upper bound five iterations suffice, unless two roots nearly coincide: a flat slope
    for _ in range(5):
        rest = root**2 - norm
        slope, step = 4 * root * rest - 8 * determinant, np.zeros_like(root)
        value = rest**2 - 8 * determinant * root - size
        np.divide(value, slope, out=step, where=slope > 1e-9 * root**3)
        root -= step
    # R = ((½(x² − |B|²) + |B|²) B + x cof B − B Bᵀ B) / (½(x² − |B|²) x − det B)
    half = (root**2 - norm) / 2
    scale = half * root - determinant
    square = covariance @ np.swapaxes(covariance, 1, 2) @ covariance
    rotation = (half + norm)[:, None] * flat + root[:, None] * cofactor - square.reshape(-1, 9)
    # markers on a line or in a point: singular values tell what is left of the rotation
    singular = (scale <= 1e-2 * root**3) | (np.abs(step) > 1e-6 * root)
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
    sign = 1.0 if (j - i) % 3 == 1 else -1.0  # whether the axes follow the right-hand rule
    # R = R_i(α) R_j(β) R_k(γ): β from the one entry that is its sine, the others by two entries
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
    # one hinge: the trace is c₀ + c₁ cos φ + c₂ sin φ, largest at the angle of (c₁, c₂)
    if len(terms) == 1:
        factors = _best_factors(flat @ terms[0].T)
        return _angle(factors)[:, None], (factors @ terms[0]).reshape(-1, 3, 3)
    first, second = terms.reshape(2, 3, 3, 3)
    # two hinges: the trace is bilinear in (1, cos, sin) of both, improved in turn from each start
    bilinear = (flat @ (first[:, None] @ second).reshape(9, 9).T).reshape(-1, 3, 3)
    transposed = np.swapaxes(bilinear, 1, 2)
    distal = np.stack([np.ones_like(starts), np.cos(starts), np.sin(starts)], axis=-1)
    # enough for a starting point
    for _ in range(4):
        proximal = _best_factors(distal @ transposed)
        distal = _best_factors(proximal @ bilinear)
    traces = np.vecdot(proximal @ bilinear, distal)
    # the best of the starts, frame by frame
    best = np.arange(len(covariance)), traces.argmax(axis=1)
    proximal, distal = proximal[best], distal[best]
    rotation = (proximal @ terms[0]).reshape(-1, 3, 3) @ (distal @ terms[1]).reshape(-1, 3, 3)
    return np.stack([_angle(proximal), _angle(distal)], axis=1), rotation


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
    # R = u uᵀ + cos φ (1 − u uᵀ) + sin φ [u]×
    along = axes[:, :, None] * axes[:, None]
    return np.stack([along, np.eye(3) - along, skew(axes)], axis=1).reshape(-1, 3, 9)


def _best_factors(coefficients: Array) -> Array:
    """Give 1, cos and sin of the angles that make their sum with coefficients (..., 3) largest."""
    amplitude = np.hypot(coefficients[..., 1], coefficients[..., 2])
    # no division of zero by zero, where any angle is equally good
    factors = coefficients / np.maximum(amplitude, 1e-300)[..., None]
    factors[..., 0] = 1
    return np.asarray(factors)


def _angle(factors: Array) -> Array:
    return np.asarray(np.arctan2(factors[..., 2], factors[..., 1]))


FOREARM_STARTS_RAD: Final = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)
"""Pronations from which elbow and forearm are improved in turn: any pronation is within 60° of
one."""

NEUTRAL_COVARIANCE: Final = 1e-6 * np.eye(3)
"""Added to a joint's cross-covariance [m²]: where no marker is seen the joint stays neutral; a
marker contributes 1e-3 m² or more, against which it is negligible."""

MIN_ROOT_MARKERS: Final = 3
"""Markers needed for the position and orientation of the pelvis."""

ROOT_SEGMENTS: Final = (
    ("pelvis",),
    ("pelvis", "thorax"),
    ("pelvis", "thorax", "right_thigh", "left_thigh"),
    MOVING,
)
"""Segments whose markers, with the joints held neutral, show the pelvis: the first that suffice."""


class Start:
    """The skeleton, to be aligned with measured markers."""

    def __init__(self, attachment: MarkerAttachment, joints: tuple[Joint, ...]) -> None:
        self.local = attachment.local
        self.offsets = {s: joints[i].offset for s, i in FIRST_Q.items()}
        self.columns = {s: np.flatnonzero(attachment.segment == k) for k, s in enumerate(MOVING)}
        self.rotations = {
            s: [i for i in range(FIRST_Q[s], LAST_Q[s] + 1) if not joints[i].translates]
            for s in MOVING
        }
        self.axis = np.array([joint.axis for joint in joints])
        self.terms = rotation_terms(self.axis)

    def coordinates(self, measured: Array, weight: Array) -> Array:
        """Align the segments with their markers, (F, K, 3) and (K,), from trunk to tip.

        Gives coordinates, (F, 46): those without markers are zero; frames with fewer than three
        markers are NaN.
        """
        is_finite = np.isfinite(measured[..., 0])
        position, weights = np.where(is_finite[..., None], measured, 0.0), is_finite * weight
        R, o, solved = self.pelvis(position, weights)
        q = np.zeros((len(position), N_Q))
        q[:, :3], q[:, 3:6] = o, three_angles(R, 3)
        poses = {"pelvis": (R, o)}
        for s in MOVING[1:]:
            R, o = poses[PARENT[s]]
            # the joint's place in the parent, which is aligned already
            o = o + R @ self.offsets[s]
            on_segment, to_parent = self.columns[s], np.swapaxes(R, 1, 2)
            w, from_joint = weights[:, on_segment], position[:, on_segment] - o[:, None]
            coordinates = slice(FIRST_Q[s], LAST_Q[s] + 1)
            if self.rotations[s] and len(on_segment):
                # from here on in the parent's axes, about the joint
                covariance = to_parent @ _cross_covariance(w, from_joint, self.local[on_segment])
                covariance, joint = covariance + NEUTRAL_COVARIANCE, self.rotations[s]
                if len(joint) < 3:
                    starts = FOREARM_STARTS_RAD if s.endswith("forearm") else (0.0,)
                    angles, rotation = hinge_angles(covariance, self.terms[joint], starts)
                else:
                    rotation = nearest_rotation(covariance)
                    angles = three_angles(rotation, joint[0])
                q[:, coordinates], R = angles, R @ rotation
            elif len(on_segment):
                # the shoulder's point moves as far as its markers do on average
                mean = (to_parent @ _mean(w, from_joint)[..., None])[..., 0]
                translation = mean - _mean(w, self.local[on_segment])
                q[:, coordinates] = translation @ self.axis[coordinates].T
                o = o + (R @ translation[..., None])[..., 0]
            poses[s] = R, o
        q[~solved] = np.nan
        return q

    def pelvis(self, position: Array, weights: Array) -> tuple[Array, Array, Mask]:
        """Fit the pelvis to its own markers; if they are few, with its neighbours held neutral."""
        frames = len(position)
        R, o = np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3))
        solved = np.zeros(frames, bool)
        neutral = {"pelvis": np.zeros(3)}
        for s in MOVING[1:]:
            # places in the pelvis frame with all joints in neutral
            neutral[s] = neutral[PARENT[s]] + self.offsets[s]
        for segments in ROOT_SEGMENTS:
            on_segments = np.concatenate([self.columns[s] for s in segments])
            if len(on_segments) < MIN_ROOT_MARKERS or solved.all():
                continue
            model = np.concatenate([neutral[s] + self.local[self.columns[s]] for s in segments])
            todo = ~solved & ((weights[:, on_segments] > 0).sum(axis=1) >= MIN_ROOT_MARKERS)
            w = weights[todo][:, on_segments]
            w = w / w.sum(axis=1, keepdims=True)
            measured = position[todo][:, on_segments]
            # rotation about the weighted means, then the origin that brings the means together
            center, model_center = np.einsum("tk,tki->ti", w, measured), w @ model
            centered = model - model_center[:, None]
            R[todo] = nearest_rotation(_cross_covariance(w, measured - center[:, None], centered))
            o[todo] = center - (R[todo] @ model_center[..., None])[..., 0]
            solved |= todo
        return R, o, solved


def _cross_covariance(w: Array, measured: Array, model: Array) -> Array:
    """Give weighted cross-covariances, (F, 3, 3), of (F, K, 3) with (K, 3) or (F, K, 3)."""
    return np.asarray(np.swapaxes(w[..., None] * measured, 1, 2) @ model)


def _mean(w: Array, points: Array) -> Array:
    """Give weighted means of points, (F, K, 3) or (K, 3); zero where nothing has weight."""
    total = w.sum(axis=1, keepdims=True)
    fraction = w / np.where(total > 0, total, 1)
    return np.asarray((fraction[:, None] @ points)[:, 0])
