"""The moving platform: where it is, and its plates' wrenches in the lab.

The platform frame moves with the platform and is the lab frame when the platform is in neutral.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from compensation.alignment.delay import Delay, estimate_delay
from compensation.inputs import (
    read_rate,
    read_signal,
    read_table,
    refuse_gaps,
    refuse_unequal,
)
from hbm.spatial import GRAVITY_MPS2, Array, read_only, rotation_about, transform_wrench

_LEFT = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class PlatformPose:
    """Where the platform is: ``p_lab = rotation p_platform + position``; the identity in neutral.

    Attributes
    ----------
    rotation
        Orientation in the lab (columns: the platform's axes), (T, 3, 3).
    position
        The platform frame's origin in the lab, (T, 3) [m]. A gap is NaN in both.
    """

    rotation: Array
    position: Array

    def __post_init__(self) -> None:
        rotation, position = read_only(self.rotation), read_only(self.position)
        if rotation.ndim != 3 or rotation.shape != (len(position), 3, 3):
            raise ValueError(
                f"platform rotation must have shape ({len(position)}, 3, 3), got {rotation.shape}"
            )
        if position.shape != (len(rotation), 3):
            raise ValueError(f"platform position must have shape (frames, 3), got {position.shape}")
        seen = np.isfinite(rotation).all(axis=(1, 2))
        if not np.array_equal(seen, np.isfinite(position).all(axis=1)):
            raise ValueError("platform rotation and position must have their gaps together")
        product = rotation[seen] @ np.swapaxes(rotation[seen], 1, 2)
        proper = np.linalg.det(rotation[seen]) > 0
        if not (np.allclose(product, np.eye(3), atol=1e-6) and proper.all()):
            raise ValueError("platform rotation must hold proper rotations: RᵀR = 1 and det R = 1")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "position", position)

    @property
    def pitch(self) -> Array:
        """Rotation about the lab's left axis, (T,) [rad]; positive lowers the front."""
        angle: Array = np.arctan2(-self.rotation[:, 2, 0], self.rotation[:, 0, 0])
        return angle

    def to_lab(self, points: ArrayLike) -> Array:
        """Bring points of the platform frame, (T, 3) or (3,) [m], to the lab, (T, 3) [m]."""
        points = np.broadcast_to(np.asarray(points, float), self.position.shape)
        moved: Array = (self.rotation @ points[..., None])[..., 0] + self.position
        return moved


def to_lab(wrench_in_plate: ArrayLike, pose: PlatformPose) -> Array:
    """Bring plate wrenches from the moving platform to the lab.

    Parameters
    ----------
    wrench_in_plate
        Wrenches in the platform frame about its origin, that is, in lab axes about the lab origin
        as if the platform were in neutral, (T, 6) [N, N·m]. Compensate inertia before.
    pose
        The platform's pose at the same T instants.

    Returns
    -------
    Array
        Wrenches in lab axes about the lab origin, (T, 6) [N, N·m]; NaN where the pose is.

    Raises
    ------
    ValueError
        Wrong shape or another number of samples.

    Notes
    -----
    ``F = R f``, ``M = R m + d × F``.
    """
    wrench = np.asarray(wrench_in_plate, float)
    if wrench.ndim != 2 or wrench.shape[1] != 6:
        raise ValueError(f"wrench_in_plate must have shape (samples, 6), got {wrench.shape}")
    refuse_unequal(wrench_in_plate=wrench, pose=pose.position)
    return transform_wrench(wrench, pose.rotation, pose.position)


def commanded_pose(sway: ArrayLike, pitch: ArrayLike, pivot: ArrayLike) -> PlatformPose:
    """Give the pose from the machine's own sway and pitch channels.

    Parameters
    ----------
    sway
        Translation along the lab's left axis, (T,) [m].
    pitch
        Rotation about the lab's left axis by the right-hand rule, (T,) [rad]: positive lowers the
        front. D-Flow's pitch has the opposite sign.
    pivot
        A point of the pitch axis with the platform in neutral, (3,) [m]; the axis sways along.

    Returns
    -------
    PlatformPose
        The pose as commanded: the machine follows later, see `pose_delay`.

    Raises
    ------
    ValueError
        Wrong shapes, no samples, gaps, different lengths, or sizes that no platform reaches
        (millimetres, degrees).
    """
    y, angle = read_signal(sway, "sway"), read_signal(pitch, "pitch")
    refuse_unequal(sway=y, pitch=angle)
    point = np.asarray(pivot, float)
    if point.shape != (3,) or not np.all(np.abs(point) < 10):
        raise ValueError(f"pivot must be one point in metres, (3,), got {point}")
    for name, values, most, unit in (("sway", y, 1.0, "m"), ("pitch", angle, 0.8, "rad")):
        if np.max(np.abs(values)) > most:
            raise ValueError(
                f"{name} reaches {np.max(np.abs(values)):.3g}, expected at most {most} {unit}; "
                f"is it in {unit}?"
            )
    rotation = rotation_about(_LEFT, angle)
    return PlatformPose(rotation, y[:, None] * _LEFT + point - rotation @ point)


def pose_delay(
    commanded: PlatformPose, measured: PlatformPose, rate_hz: float, longest_s: float = 0.2
) -> Delay:
    """Estimate by how much the platform (or its record) is later than its command.

    Parameters
    ----------
    commanded, measured
        Poses at the same nominal instants, without gaps.
    rate_hz
        Their sampling rate [Hz].
    longest_s
        Delays are sought up to this, either way [s].

    Returns
    -------
    Delay
        Positive where the measured pose is later.

    Raises
    ------
    ValueError
        As `compensation.estimate_delay`; also a platform that does not move.
    """
    signals = [np.column_stack([p.position[:, 1], p.pitch]) for p in (commanded, measured)]
    for name, signal in zip(("commanded pose", "measured pose"), signals, strict=True):
        refuse_gaps(signal, name)
    moving = np.ptp(signals[0], axis=0) > [1e-3, 1e-3]
    if not moving.any():
        raise ValueError("the commanded platform does not move: its delay cannot be told")
    return estimate_delay(signals[0][:, moving], signals[1][:, moving], rate_hz, longest_s)


def specific_force(pose: PlatformPose, rate_hz: float) -> Array:
    """Give what sensors fixed to the platform feel, from its pose.

    Parameters
    ----------
    pose
        The platform's pose, without gaps.
    rate_hz
        Its sampling rate [Hz].

    Returns
    -------
    Array
        Specific force ``Rᵀ (a - g)`` of the platform's origin [m/s²] and angular acceleration
        [rad/s²], both in platform axes, (T, 6). Up to the centripetal part every accelerometer on
        the platform is a linear combination of these: `compensation.estimate_delay` aligns
        markers with accelerometers by them, the accelerometers being its reference.

    Raises
    ------
    ValueError
        Gaps, fewer than 5 frames, or no rate.
    """
    rate = read_rate(rate_hz)
    refuse_gaps(pose.position, "pose")
    if len(pose.position) < 5:
        raise ValueError(f"pose has {len(pose.position)} frames; its acceleration needs at least 5")
    back = np.swapaxes(pose.rotation, 1, 2)
    acceleration = _derivative(_derivative(pose.position, rate), rate)
    force = (back @ (acceleration + np.array([0, 0, GRAVITY_MPS2]))[..., None])[..., 0]
    turning = back @ _derivative(pose.rotation, rate)  # the cross product with ω
    omega = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)
    return np.hstack([force, _derivative(omega, rate)])


def _derivative(values: Array, rate: float) -> Array:
    derivative: Array = np.gradient(values, 1 / rate, axis=0)
    return derivative


def center_of_pressure(
    wrench_in_plate: ArrayLike, threshold_n: float, surface_height_m: float = 0.0
) -> Array:
    """Give the point of the surface that the ground reaction goes through.

    Parameters
    ----------
    wrench_in_plate
        Action on the subject in the platform frame about its origin, (T, 6) [N, N·m].
    threshold_n
        Vertical force below which there is no centre of pressure [N].
    surface_height_m
        Height of the belt surface in the platform frame [m].

    Returns
    -------
    Array
        Points in the platform frame, (T, 3) [m]; NaN below the threshold. `PlatformPose.to_lab`
        brings them to the lab. For drawing and foot placement, not for dynamics.

    Raises
    ------
    ValueError
        Wrong shape, no samples, gaps, or a threshold that is not positive.

    Notes
    -----
    ``x = (h Fx - My) / Fz``, ``y = (h Fy + Mx) / Fz`` (van de Loosdrecht 2018, eq. A.2).
    """
    wrench = read_table(wrench_in_plate, "wrench_in_plate", 6)
    if not threshold_n > 0:
        raise ValueError(f"threshold_n must be positive, got {threshold_n}")
    fx, fy, fz, mx, my, _ = wrench.T
    loaded = np.abs(fz) >= threshold_n
    divisor = np.where(loaded, fz, np.nan)
    x, y = (surface_height_m * fx - my) / divisor, (surface_height_m * fy + mx) / divisor
    return np.column_stack([x, y, np.where(loaded, surface_height_m, np.nan)])


def free_moment(
    wrench_in_plate: ArrayLike, threshold_n: float, surface_height_m: float = 0.0
) -> Array:
    """Give the moment about the surface's normal that is left at the centre of pressure.

    Parameters and errors are those of `center_of_pressure`.

    Returns
    -------
    Array
        Free moments on the subject, (T,) [N·m]; NaN below the threshold.
    """
    center = center_of_pressure(wrench_in_plate, threshold_n, surface_height_m)
    fx, fy, _, _, _, mz = np.asarray(wrench_in_plate, float).T
    moment: Array = mz - (center[:, 0] * fy - center[:, 1] * fx)
    return moment


def moment_error_of_pivot(pivot_error: ArrayLike, pitch: ArrayLike, force: ArrayLike) -> Array:
    """Give the error budget of a misplaced pitch axis in `commanded_pose`.

    Parameters
    ----------
    pivot_error
        Stated minus true pivot, (3,) [m].
    pitch
        Pitch angle, (...) [rad].
    force
        Force of the plates in lab axes, (..., 3) [N].

    Returns
    -------
    Array
        Error of the moment about the lab origin, (..., 3) [N·m]; the force has none.

    Notes
    -----
    ``(1 - R) ε × F``, at most ``2 sin(φ/2) |ε| |F|``: 1 cm at 10° under 75 kg (736 N) is 1.3 N·m.
    """
    error = np.asarray(pivot_error, float)
    shift = error - rotation_about(_LEFT, pitch) @ error
    return np.cross(shift, np.asarray(force, float))
