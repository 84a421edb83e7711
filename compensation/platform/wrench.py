"""Wrenches of plates on a moving platform: in the lab, and where on the surface they act."""

import numpy as np
from numpy.typing import ArrayLike

from compensation.inputs import refuse_unequal
from compensation.platform.pose import LEFT, PlatformPose
from hbm.spatial import Array, rotation_about, transform_wrench


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

    Examples
    --------
    The plate is 10 cm to the left of neutral, its force is vertical:

    >>> import numpy as np
    >>> pose = PlatformPose(np.eye(3)[None], [[0.0, 0.1, 0.0]])
    >>> to_lab([[0, 0, 700.0, 0, 0, 0]], pose)
    array([[  0.,   0., 700.,  70.,   0.,   0.]])
    """
    wrench = _read_wrench(wrench_in_plate, "wrench_in_plate")
    refuse_unequal(wrench_in_plate=wrench, pose=pose.position)
    return transform_wrench(wrench, pose.rotation, pose.position)


def center_of_pressure(
    wrench: ArrayLike, threshold_n: float, surface_height_m: ArrayLike = 0.0
) -> Array:
    """Give the point of a level surface that the ground reaction goes through.

    Parameters
    ----------
    wrench
        Action on the subject about the origin of axes whose third one is normal to the surface
        (of the platform frame, or of the lab where the surface is level), (T, 6) [N, N·m]. Gaps
        are NaN.
    threshold_n
        Force along the normal up to which there is no centre of pressure [N].
    surface_height_m
        Height of the surface along the normal, (T,) or one number [m].

    Returns
    -------
    Array
        Points in the same frame, (T, 3) [m]; NaN where the plate is not loaded. For drawing and
        foot placement, not for dynamics.

    Raises
    ------
    ValueError
        Wrong shape, or a threshold that is not positive.

    Notes
    -----
    ``x = (h Fx - My) / Fz``, ``y = (h Fy + Mx) / Fz`` (van de Loosdrecht 2018, eq. A.2).

    Examples
    --------
    700 N, 0.3 m in front of the origin and 0.1 m to its left:

    >>> center_of_pressure([[0, 0, 700.0, 70.0, -210.0, 0]], threshold_n=30.0)
    array([[0.3, 0.1, 0. ]])
    """
    fx, fy, fz, mx, my, _ = _read_wrench(wrench, "wrench").T
    if not threshold_n > 0:
        raise ValueError(f"threshold_n must be positive, got {threshold_n}")
    loaded = fz > threshold_n
    height = np.where(loaded, np.asarray(surface_height_m, float), np.nan)
    divisor = np.where(loaded, fz, np.nan)
    return np.column_stack([(height * fx - my) / divisor, (height * fy + mx) / divisor, height])


def free_moment(wrench: ArrayLike, threshold_n: float, surface_height_m: ArrayLike = 0.0) -> Array:
    """Give the moment about the surface's normal that is left at the centre of pressure.

    Parameters and errors are those of `center_of_pressure`.

    Returns
    -------
    Array
        Free moments on the subject, (T,) [N·m]; NaN where the plate is not loaded.

    Examples
    --------
    A force of 100 N to the left, 0.3 m in front of the origin, and 5 N·m beside:

    >>> free_moment([[0, 100.0, 700.0, 0, -210.0, 35.0]], threshold_n=30.0).round(6)
    array([5.])
    """
    center = center_of_pressure(wrench, threshold_n, surface_height_m)
    fx, fy, _, _, _, mz = np.asarray(wrench, float).T
    moment: Array = mz - (center[:, 0] * fy - center[:, 1] * fx)
    return moment


def moment_error_of_pivot(pivot_error: ArrayLike, pitch: ArrayLike, force: ArrayLike) -> Array:
    """Give the error of the moments that a misplaced pitch axis in `commanded_pose` causes.

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
    ``(1 - R) ε × F``, at most ``2 sin(φ/2) |ε| |F|``.

    Examples
    --------
    1 cm of height at 10° under 75 kg:

    >>> import numpy as np
    >>> mx, my, mz = moment_error_of_pivot([0, 0, 0.01], np.radians(10), [0, 0, 736.0])
    >>> print(f"{my:.2f} N·m")
    1.28 N·m
    """
    error = np.asarray(pivot_error, float)
    shift = error - rotation_about(LEFT, pitch) @ error
    return np.cross(shift, np.asarray(force, float))


def _read_wrench(values: ArrayLike, name: str) -> Array:
    wrench = np.asarray(values, float)
    if wrench.ndim != 2 or wrench.shape[1] != 6:
        raise ValueError(f"{name} must have shape (samples, 6), got {wrench.shape}")
    return wrench
