"""Static calibration: where a force plate is in the cameras' frame."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inputs import read_table, refuse_unequal
from hbm.spatial import Array, read_only

MAX_DISTANCE_M: Final = 20.0
"""Of a point from the origin; larger numbers are millimetres."""
MIN_SPREAD_M: Final = 1e-9
"""Of the camera points about their mean; below it all places are one."""
MAX_SPREAD_ERROR: Final = 0.5
"""Share by which plate and camera points may spread differently; other units do. A plate whose
moments are a third too large is a bad plate, to be found as one."""
MIRROR_MARGIN: Final = 1.001
"""By which mirrored points must fit better to be taken as mirrored; points on a line fit alike."""


@dataclass(frozen=True, slots=True)
class PlateAlignment:
    """Rotation and offset between camera and plate coordinates in the horizontal plane.

    ``p_plate = R(angle) p_camera + offset``.

    Attributes
    ----------
    angle
        Rotation about the vertical from camera to plate coordinates [rad].
    offset
        The cameras' origin in plate coordinates, (2,) [m].
    covariance
        Of (angle, offset), (3, 3) [rad², rad·m, m²].
    rms_before, rms_after
        Distance between pairs of points before and after alignment, root mean square [m].

    Examples
    --------
    >>> import numpy as np
    >>> alignment = PlateAlignment(np.pi / 2, [0.1, 0.0], np.zeros((3, 3)), 0.0, 0.0)
    >>> alignment.to_plate([[1.0, 0.0]])
    array([[0.1, 1. ]])
    """

    angle: float
    offset: Array
    covariance: Array
    rms_before: float
    rms_after: float

    def __post_init__(self) -> None:
        for name, shape in (("offset", (2,)), ("covariance", (3, 3))):
            value = read_only(getattr(self, name))
            if value.shape != shape:
                raise ValueError(
                    f"plate alignment: {name} must have shape {shape}, got {value.shape}"
                )
            object.__setattr__(self, name, value)

    @property
    def rotation(self) -> Array:
        """Rotation from camera to plate coordinates, (2, 2)."""
        return _rotation(self.angle)

    @property
    def standard_error(self) -> Array:
        """Standard errors of angle and offset, (3,) [rad, m, m]."""
        error: Array = np.sqrt(np.diag(self.covariance))
        return error

    def to_plate(self, points: ArrayLike) -> Array:
        """Bring camera points to plate coordinates, (N, 2) [m] both."""
        return read_table(points, "points", 2) @ self.rotation.T + self.offset

    def to_camera(self, points: ArrayLike) -> Array:
        """Bring plate points to camera coordinates, (N, 2) [m] both."""
        return (read_table(points, "points", 2) - self.offset) @ self.rotation


def fit_plate_alignment(plate_points: ArrayLike, camera_points: ArrayLike) -> PlateAlignment:
    """Find rotation and offset from the same points measured by plate and cameras.

    Parameters
    ----------
    plate_points
        Centres of pressure of a weight at many places, horizontal coordinates, (N, 2) [m].
    camera_points
        The weight's marker at the same places, (N, 2) [m].

    Returns
    -------
    PlateAlignment
        Least-squares rotation and offset with their covariance.

    Raises
    ------
    ValueError
        Wrong shapes, fewer than 3 places, gaps, places that coincide, different units, or mirrored
        axes.

    Notes
    -----
    ``min Σ |P_plate - (R P_camera + O)|²`` (Goldberg et al. 2009; van de Loosdrecht 2018, eq.
    D.1) in closed form: with points about their centroids as complex numbers, the angle is that
    of ``Σ conj(c) p``. The covariance is that of least squares with errors equal and independent
    in both axes, their variance from the residual with ``2 N - 3`` degrees of freedom. It assumes
    that errors differ from place to place: the offset of a marker from the weight's centre is not
    detected.

    Deviations from the original: only the horizontal plane, in which the centre of pressure is
    measured; the uncertainty is added. Eq. D.2 applies the inverse, `to_camera`.

    Examples
    --------
    >>> import numpy as np
    >>> camera = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.0, 0.5]])
    >>> found = fit_plate_alignment(camera + [0.002, -0.001], camera)
    >>> print(found.offset.round(4), f"{found.rms_before:.4f}")
    [ 0.002 -0.001] 0.0022
    """
    plate, camera = (
        read_table(plate_points, "plate points", 2),
        read_table(camera_points, "camera points", 2),
    )
    refuse_unequal(plate_points=plate, camera_points=camera)
    n = len(plate)
    if n < 3:
        raise ValueError(f"{n} places are too few for a static calibration, give at least 3")
    farthest = float(max(np.max(np.abs(plate)), np.max(np.abs(camera))))
    if farthest > MAX_DISTANCE_M:
        raise ValueError(f"a point lies {farthest:.3g} m away; are both in metres?")
    p, c = (points - points.mean(axis=0) for points in (plate, camera))
    apart = float(np.linalg.norm(c))
    ratio = float(np.linalg.norm(p)) / max(apart, MIN_SPREAD_M)
    if apart < MIN_SPREAD_M or abs(ratio - 1) >= MAX_SPREAD_ERROR:
        raise ValueError(
            f"plate points spread {np.linalg.norm(p):.3g} about their mean, camera points "
            f"{apart:.3g}, expected the same; are both in metres and in the same order?"
        )
    p_complex, c_complex = p @ [1, 1j], c @ [1, 1j]
    rotated = np.sum(np.conj(c_complex) * p_complex)
    if np.abs(np.sum(c_complex * p_complex)) > MIRROR_MARGIN * np.abs(rotated):
        raise ValueError(
            "plate and camera points fit better when mirrored; "
            "is one axis reversed, or are the axes exchanged?"
        )
    angle = float(np.angle(rotated))
    rotation = _rotation(angle)
    offset = plate.mean(axis=0) - rotation @ camera.mean(axis=0)
    residual = plate - camera @ rotation.T - offset

    by_angle = (camera @ rotation.T) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    jacobian = np.column_stack([by_angle.ravel(), np.tile([1.0, 0.0], n), np.tile([0.0, 1.0], n)])
    variance = np.sum(residual**2) / (2 * n - 3)
    return PlateAlignment(
        angle,
        offset,
        variance * np.linalg.inv(jacobian.T @ jacobian),
        rms_before=_rms_distance(plate - camera),
        rms_after=_rms_distance(residual),
    )


def _rotation(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _rms_distance(difference: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(difference**2, axis=1))))
