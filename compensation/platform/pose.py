"""The pose of the moving platform, from its commanded motion, and what follows from it.

The platform frame moves with the platform and is the lab frame when the platform is in neutral.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from compensation.alignment.delay import Delay, estimate_delay
from compensation.inputs import read_rate, read_signal, refuse_gaps, refuse_unequal
from hbm.signals.resampling import interpolate
from hbm.spatial import GRAVITY_MPS2, Array, fit_rotation, read_only, rotation_about

LEFT: Final = read_only([0.0, 1.0, 0.0])
"""The lab's left axis, along which the platform sways and about which it pitches."""
MAX_SWAY_M: Final = 1.0
"""No platform moves farther sideways: larger numbers are millimetres."""
MAX_PITCH_RAD: Final = 0.8
"""46°; no platform pitches farther: larger numbers are degrees."""
MAX_PIVOT_M: Final = 10.0
"""No pitch axis is farther from the lab's origin: larger numbers are millimetres."""
MIN_MOTION: Final = 1e-3
"""Range of a command, in metres or radians, below which it shows no delay."""
ROTATION_TOLERANCE: Final = 1e-6
"""Of ``RᵀR = 1``: the error of rotations that went through text with seven digits."""


@dataclass(frozen=True, slots=True)
class PlatformPose:
    """Where the platform is: ``p_lab = rotation p_platform + position``; the identity in neutral.

    Attributes
    ----------
    rotation
        Orientation in the lab (columns: the platform's axes), (T, 3, 3).
    position
        The platform frame's origin in the lab, (T, 3) [m]. A gap is NaN in both.

    Examples
    --------
    >>> import numpy as np
    >>> pose = PlatformPose(np.eye(3)[None], [[0.0, 0.05, 0.0]])
    >>> pose.to_lab([1.0, 0.0, 0.0])
    array([[1.  , 0.05, 0.  ]])
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
        if not (np.allclose(product, np.eye(3), atol=ROTATION_TOLERANCE) and proper.all()):
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
        The pose as commanded; the machine follows with a delay, see `pose_delay`.

    Raises
    ------
    ValueError
        Wrong shapes, no samples, gaps, different lengths, or sizes that no platform reaches
        (millimetres, degrees).

    Examples
    --------
    >>> import numpy as np
    >>> pose = commanded_pose(sway=[0.05], pitch=[np.radians(10)], pivot=[0, 0, -0.3])
    >>> print(np.degrees(pose.pitch).round(3), pose.to_lab([0, 0, -0.3]))
    [10.] [[ 0.    0.05 -0.3 ]]
    """
    y, angle = read_signal(sway, "sway"), read_signal(pitch, "pitch")
    refuse_unequal(sway=y, pitch=angle)
    point = np.asarray(pivot, float)
    if point.shape != (3,) or not np.all(np.abs(point) < MAX_PIVOT_M):
        raise ValueError(f"pivot must be one point in metres, (3,), got {point}")
    for name, values, most, unit in (
        ("sway", y, MAX_SWAY_M, "m"),
        ("pitch", angle, MAX_PITCH_RAD, "rad"),
    ):
        if np.max(np.abs(values)) > most:
            raise ValueError(
                f"{name} reaches {np.max(np.abs(values)):.3g}, expected at most {most} {unit}; "
                f"is it in {unit}?"
            )
    rotation = rotation_about(LEFT, angle)
    return PlatformPose(rotation, y[:, None] * LEFT + point - rotation @ point)


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

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(0, 30, 0.01)
    >>> def pose(at):
    ...     return commanded_pose(0.05 * np.sin(at), 0.1 * np.sin(1.7 * at), [0, 0, 0])
    >>> f"{pose_delay(pose(time), pose(time - 0.08), 100.0).seconds:.3f}"
    '0.080'
    """
    signals = [np.column_stack([p.position[:, 1], p.pitch]) for p in (commanded, measured)]
    for name, signal in zip(("commanded pose", "measured pose"), signals, strict=True):
        refuse_gaps(signal, name)
    moving = np.ptp(signals[0], axis=0) > MIN_MOTION
    if not moving.any():
        raise ValueError("the commanded platform does not move: its delay cannot be estimated")
    return estimate_delay(signals[0][:, moving], signals[1][:, moving], rate_hz, longest_s)


def specific_force(pose: PlatformPose, rate_hz: float) -> Array:
    """Give what inertial sensors fixed to the platform measure, from its pose.

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
        markers with accelerometers by them, with the accelerometers as its reference.

    Raises
    ------
    ValueError
        Gaps, fewer than 5 frames, or no rate.

    Examples
    --------
    At rest, pitched by 10° with the front down, a sensor measures gravity along two axes:

    >>> import numpy as np
    >>> pose = commanded_pose(np.zeros(5), np.full(5, np.radians(10)), [0, 0, 0])
    >>> specific_force(pose, 100.0)[0].round(2) + 0.0
    array([-1.7 ,  0.  ,  9.66,  0.  ,  0.  ,  0.  ])
    """
    rate = read_rate(rate_hz)
    refuse_gaps(pose.position, "pose")
    if len(pose.position) < 5:
        raise ValueError(f"pose has {len(pose.position)} frames; its acceleration needs at least 5")
    back = np.swapaxes(pose.rotation, 1, 2)
    acceleration = _derivative(_derivative(pose.position, rate), rate)
    force = (back @ (acceleration + np.array([0, 0, GRAVITY_MPS2]))[..., None])[..., 0]
    cross = back @ _derivative(pose.rotation, rate)  # [ω]×
    omega = np.stack([cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0]], axis=1)
    return np.hstack([force, _derivative(omega, rate)])


def interpolate_pose(pose: PlatformPose, time: ArrayLike, at: ArrayLike) -> PlatformPose:
    """Give the pose at other times, such as those of the plates.

    Parameters
    ----------
    pose
        The platform's pose; gaps are NaN.
    time
        Its times, (T,) [s].
    at
        Wanted times, (N,) [s].

    Returns
    -------
    PlatformPose
        By cubic splines through positions and rotation vectors; NaN inside gaps and outside the
        recorded time.

    Raises
    ------
    ValueError
        Fewer than 4 samples, or times that do not fit the pose.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(0, 1, 0.1)
    >>> pose = commanded_pose(0.1 * time, 0.2 * time, [0, 0, 0])
    >>> between = interpolate_pose(pose, time, [0.25])
    >>> print(between.pitch.round(6), between.position.round(6) + 0.0)
    [0.05] [[0.    0.025 0.   ]]
    """
    known = np.asarray(np.isfinite(pose.position).all(axis=1))
    vectors = np.full((len(pose.position), 6), np.nan)
    vectors[known, :3] = Rotation.from_matrix(pose.rotation[known]).as_rotvec()
    vectors[:, 3:] = pose.position
    wanted = interpolate(time, vectors, at)
    found = np.asarray(np.isfinite(wanted).all(axis=1))
    rotation = np.full((len(wanted), 3, 3), np.nan)
    rotation[found] = Rotation.from_rotvec(wanted[found, :3]).as_matrix()
    return PlatformPose(rotation, np.where(found[:, None], wanted[:, 3:], np.nan))


def mean_pose(pose: PlatformPose) -> PlatformPose:
    """Give the mean of a pose over time.

    Parameters
    ----------
    pose
        The platform's pose; gaps are NaN and do not count.

    Returns
    -------
    PlatformPose
        One pose: the mean position, and the rotation nearest to the mean of the rotations.

    Raises
    ------
    ValueError
        The pose is nowhere known.

    Examples
    --------
    >>> import numpy as np
    >>> pose = commanded_pose([0.0, 0.1], np.radians([8, 12]), [0, 0, 0])
    >>> mean = mean_pose(pose)
    >>> print(np.degrees(mean.pitch).round(6), mean.position.round(6) + 0.0)
    [10.] [[0.   0.05 0.  ]]
    """
    known = np.isfinite(pose.position).all(axis=1)
    if not known.any():
        raise ValueError("the platform's pose is nowhere known")
    rotation = fit_rotation(pose.rotation[known].mean(axis=0))
    return PlatformPose(rotation[None], pose.position[known].mean(axis=0)[None])


def _derivative(values: Array, rate: float) -> Array:
    derivative: Array = np.gradient(values, 1 / rate, axis=0)
    return derivative
