"""Accuracy of force plates: known weights, errors, linearity, and where a plate is."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from compensation.inputs import read_rate, read_signal, read_table, refuse_constant, refuse_unequal
from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, Array

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "accuracy")


def orthogonal_rmse(measured: ArrayLike, truth: ArrayLike) -> float:
    """Give the RMS distance from the line of total least squares between measured and truth.

    Both are one quantity in one unit, (N,), and both may be in error. The last singular value of
    the centred pairs is the root of the summed squared distances (Golub and Van Loan 1980;
    Markovsky and Van Huffel 2007). The RMS is that *about the fitted line*: an offset or a wrong
    scale of the plate is not in it. A ValueError for fewer than 3 samples, gaps, or a constant
    channel.

    Examples
    --------
    >>> f"{orthogonal_rmse([1.0, 3.0, 5.5, 7.0], [0.0, 1.0, 2.0, 3.0]):.3f}"
    '0.091'
    """
    m, t = read_signal(measured, "measured"), read_signal(truth, "truth")
    refuse_unequal(measured=m, truth=t)
    _refuse_other_scale(m, t)
    if len(m) < 3:
        raise ValueError(f"{len(m)} samples are too few for a line, give at least 3")
    pairs = np.column_stack([t, m])
    refuse_constant(pairs, "the pair", ("truth", "measured"))
    # the second singular value is what lies across the line of total least squares
    s = np.linalg.svd(pairs - pairs.mean(axis=0), compute_uv=False)
    return float(s[1] / np.sqrt(len(m)))


class Linearity(NamedTuple):
    """How far a plate's output is from a straight line over its load; `linearity` finds it.

    Attributes
    ----------
    nonlinearity
        Three standard deviations of what the straight line leaves [N].
    degrees_of_freedom
        Of that deviation.
    """

    nonlinearity: float
    degrees_of_freedom: int


def linearity(applied: ArrayLike, measured: ArrayLike) -> Linearity:
    """Compare known with measured loads, (N,) [N], by a straight line.

    Ordinary least squares of measured on known; three standard deviations (with ``N - 1``) stand
    for the largest deviation without its outliers (van de Loosdrecht 2018, A.4 and D.1.4). A
    ValueError for gaps and for fewer than 4 loads or 3 different ones.

    Examples
    --------
    >>> found = linearity([100.0, 200.0, 300.0, 400.0], [101.0, 201.0, 303.0, 403.0])
    >>> f"{found.nonlinearity:.2f} N"
    '1.55 N'
    """
    x, y = read_signal(applied, "known loads"), read_signal(measured, "measured loads")
    refuse_unequal(known_loads=x, measured_loads=y)
    if len(np.unique(x)) < 3 or len(x) < 4:
        raise ValueError(
            f"{len(x)} measurements of {len(np.unique(x))} known loads; "
            "linearity needs at least 4 of 3 different loads"
        )
    refuse_constant(y[:, None], "measured loads", ("their only channel",))
    _refuse_other_scale(y, x)
    line = scipy.stats.linregress(x, y)
    # three standard deviations about the regression line
    rest = y - (line.intercept + line.slope * x)
    return Linearity(3 * float(np.std(rest, ddof=1)), len(x) - 2)


def _refuse_other_scale(m: Array, t: Array) -> None:
    """Raise a ValueError where measured and truth have equal shape, but not equal units."""
    sizes = np.linalg.norm(m), np.linalg.norm(t)
    # by shape first: a plate that measures something else is not in another unit
    alike = abs(m @ t) > LIMITS.least_cosine * sizes[0] * sizes[1]
    if alike and not sizes[1] / LIMITS.largest_ratio <= sizes[0] <= LIMITS.largest_ratio * sizes[1]:
        raise ValueError(
            f"measured is {sizes[0] / sizes[1]:.3g} times the truth; are both in one unit?"
        )


def wrench_of_weight(
    mass_kg: float, marker: ArrayLike, rate_hz: float, center_height_m: float
) -> Array:
    """Give the wrench that a plate should measure under a weight with a marker on top.

    Parameters
    ----------
    mass_kg
        Mass of the weight [kg].
    marker
        Low-passed positions of the marker above the weight's centre, lab axes, (T, 3) [m].
    rate_hz
        Their sampling rate [Hz].
    center_height_m
        Height of the weight's centre of mass in the lab while it stands still [m]; with 0, as in
        the thesis, the centre of pressure is always below the marker.

    Returns
    -------
    Array
        Action of the plate on the weight, lab axes about the lab origin, (T, 6) [N, N·m]: force
        ``m (a - g)`` with the twice differentiated marker, through the centre of mass.

    Raises
    ------
    ValueError
        Wrong shape, fewer than 3 samples, gaps, or positions that are not in metres.

    Notes
    -----
    After van de Loosdrecht (2018), II.A and D.1. The weight does not rotate, so the force goes
    through its centre of mass, which moves with the marker.

    Examples
    --------
    >>> wrench = wrench_of_weight(10.0, [[0.5, 0.1, 0.3]] * 3, 100.0, center_height_m=0.15)
    >>> print(wrench[0].round(3) + 0.0)
    [  0.     0.    98.1    9.81 -49.05   0.  ]
    """
    position, rate = read_table(marker, "marker", 3), read_rate(rate_hz)
    if len(position) < 3:
        raise ValueError(f"marker has {len(position)} samples; an acceleration needs at least 3")
    # central differences, twice
    acceleration = np.gradient(np.gradient(position, 1 / rate, axis=0), 1 / rate, axis=0)
    fastest = float(np.median(np.linalg.norm(acceleration, axis=1)))
    if np.max(np.abs(position)) > LIMITS.farthest or fastest > LIMITS.largest_acceleration:
        raise ValueError(
            f"marker lies {np.max(np.abs(position)):.3g} m away and is accelerated by "
            f"{fastest:.3g} m/s²; is it in metres and low-passed?"
        )
    # Newton: a weight that is accelerated; the centre rises with the marker on top
    force = mass_kg * (acceleration + np.array([0, 0, GRAVITY_MPS2]))
    rise = position[:, 2] - position[0, 2]
    center = np.column_stack([position[:, :2], center_height_m + rise])
    return np.hstack([force, np.cross(center, force)])


MIN_SPREAD_M: Final = 1e-9
"""Of the camera points about their mean; below it all places are one."""


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
    """

    angle: float
    offset: Array
    covariance: Array

    @property
    def rotation(self) -> Array:
        """Rotation from camera to plate coordinates, (2, 2)."""
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        return np.array([[cosine, -sine], [sine, cosine]])

    @property
    def standard_error(self) -> Array:
        """Standard errors of angle and offset, (3,) [rad, m, m]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


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
    measured; the uncertainty is added.

    Examples
    --------
    >>> import numpy as np
    >>> camera = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.0, 0.5]])
    >>> found = fit_plate_alignment(camera + [0.002, -0.001], camera)
    >>> print(found.offset.round(4))
    [ 0.002 -0.001]
    """
    plate = read_table(plate_points, "plate points", 2)
    camera = read_table(camera_points, "camera points", 2)
    refuse_unequal(plate_points=plate, camera_points=camera)
    n = len(plate)
    if n < 3:
        raise ValueError(f"{n} places are too few for a static calibration, give at least 3")
    farthest = float(max(np.max(np.abs(plate)), np.max(np.abs(camera))))
    if farthest > LIMITS.farthest:
        raise ValueError(f"a point lies {farthest:.3g} m away; are both in metres?")
    # rotation does not depend on the offset: about both means
    p, c = (points - points.mean(axis=0) for points in (plate, camera))
    apart = float(np.linalg.norm(c))
    ratio = float(np.linalg.norm(p)) / max(apart, MIN_SPREAD_M)
    if apart < MIN_SPREAD_M or abs(ratio - 1) >= LIMITS.largest_spread_error:
        raise ValueError(
            f"plate points spread {np.linalg.norm(p):.3g} about their mean, camera points "
            f"{apart:.3g}, expected the same; are both in metres and in the same order?"
        )
    # a rotation in the plane is a factor: Σ c̄ p has its angle (Procrustes in two dimensions)
    p_complex, c_complex = p @ [1, 1j], c @ [1, 1j]
    rotated = np.sum(np.conj(c_complex) * p_complex)
    # without conjugation: the same with one axis reversed
    if np.abs(np.sum(c_complex * p_complex)) > LIMITS.mirrored * np.abs(rotated):
        raise ValueError(
            "plate and camera points fit better when mirrored; "
            "is one axis reversed, or are the axes exchanged?"
        )
    angle = float(np.angle(rotated))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = camera @ turn.T
    offset = plate.mean(axis=0) - turn @ camera.mean(axis=0)
    residual = plate - turned - offset
    # derivative of the points by the angle: turned by 90°
    by_angle = turned @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    jacobian = np.column_stack([by_angle.ravel(), np.tile([1.0, 0.0], n), np.tile([0.0, 1.0], n)])
    # covariance of a linear fit with three parameters
    variance = np.sum(residual**2) / (2 * n - 3)
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    return PlateAlignment(angle, offset, covariance)
