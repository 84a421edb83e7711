"""The moving platform: its pose from commands or markers, and plate wrenches in the lab.

The platform frame moves with the platform and is the lab frame when the platform is in neutral.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from compensation.delay import Delay, estimate_delay
from compensation.inputs import read_rate, read_signal, refuse_gaps, refuse_unequal
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.resampling import interpolate
from hbm.spatial import (
    GRAVITY_MPS2,
    Array,
    Mask,
    fit_rotation,
    read_only,
    rotation_about,
    transform_wrench,
)

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "platform")

LEFT: Final = read_only([0.0, 1.0, 0.0])
"""The lab's left axis, along which the platform sways and about which it pitches."""


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
        if rotation.shape != (len(position), 3, 3) or position.shape != (len(position), 3):
            raise ValueError(
                "platform rotation and position must have shape (frames, 3, 3) and (frames, 3), "
                f"got {rotation.shape} and {position.shape}"
            )
        is_known = np.isfinite(rotation).all(axis=(1, 2))
        if not np.array_equal(is_known, np.isfinite(position).all(axis=1)):
            raise ValueError("platform rotation and position must have their gaps together")
        product = rotation[is_known] @ np.swapaxes(rotation[is_known], 1, 2)
        proper = (np.linalg.det(rotation[is_known]) > 0).all()
        # rotations that went through text with seven digits
        if not (proper and np.allclose(product, np.eye(3), atol=1e-6)):
            raise ValueError("platform rotation must hold proper rotations: RᵀR = 1 and det R = 1")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "position", position)

    @property
    def pitch(self) -> Array:
        """Rotation about the lab's left axis, (T,) [rad]; positive lowers the front."""
        return np.asarray(np.arctan2(-self.rotation[:, 2, 0], self.rotation[:, 0, 0]))

    def to_lab(self, points: ArrayLike) -> Array:
        """Bring points of the platform frame, (T, 3) or (3,) [m], to the lab, (T, 3) [m]."""
        points = np.broadcast_to(np.asarray(points, float), self.position.shape)
        return np.asarray((self.rotation @ points[..., None])[..., 0] + self.position)


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
    if point.shape != (3,) or not np.all(np.abs(point) < LIMITS.farthest_pivot):
        raise ValueError(f"pivot must be one point in metres, (3,), got {point}")
    limits = (("sway", y, LIMITS.largest_sway, "m"), ("pitch", angle, LIMITS.largest_pitch, "rad"))
    for name, values, most, unit in limits:
        if (largest := np.max(np.abs(values))) > most:
            raise ValueError(
                f"{name} reaches {largest:.3g}, expected at most {most} {unit}; is it in {unit}?"
            )
    # p_lab = R (p − pivot) + pivot + sway
    rotation = rotation_about(LEFT, angle)
    return PlatformPose(rotation, y[:, None] * LEFT + point - rotation @ point)


def pose_delay(commanded: PlatformPose, measured: PlatformPose, rate_hz: float) -> Delay:
    """Estimate by how much the platform (or its record) is later than its command.

    Parameters
    ----------
    commanded, measured
        Poses at the same nominal instants, without gaps.
    rate_hz
        Their sampling rate [Hz].

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
    moving = np.ptp(signals[0], axis=0) > LIMITS.least_motion
    if not moving.any():
        raise ValueError("the commanded platform does not move: its delay cannot be estimated")
    return estimate_delay(signals[0][:, moving], signals[1][:, moving], rate_hz)


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
    step_s = 1 / rate
    velocity = np.gradient(pose.position, step_s, axis=0)
    acceleration = np.gradient(velocity, step_s, axis=0) + np.array([0, 0, GRAVITY_MPS2])
    force = (back @ acceleration[..., None])[..., 0]
    cross = back @ np.gradient(pose.rotation, step_s, axis=0)  # [ω]×
    omega = np.stack([cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0]], axis=1)
    return np.hstack([force, np.gradient(omega, step_s, axis=0)])


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
    is_known = np.asarray(np.isfinite(pose.position).all(axis=1))
    vectors = np.full((len(pose.position), 6), np.nan)
    # rotation vectors of small pitch are smooth: a spline through them stays near a rotation
    turned = scipy.spatial.transform.Rotation.from_matrix(pose.rotation[is_known])
    vectors[is_known, :3] = turned.as_rotvec()
    vectors[:, 3:] = pose.position
    interpolated = interpolate(time, vectors, at)
    inside = np.asarray(np.isfinite(interpolated).all(axis=1))
    rotation = np.full((len(interpolated), 3, 3), np.nan)
    rotation[inside] = scipy.spatial.transform.Rotation.from_rotvec(
        interpolated[inside, :3]
    ).as_matrix()
    return PlatformPose(rotation, np.where(inside[:, None], interpolated[:, 3:], np.nan))


MAX_DISTANCE_M: Final = 20.0
"""Of a marker from the lab's origin; larger numbers are millimetres."""


class PoseFit(NamedTuple):
    """A pose from markers, and how well they agree with it; `fit_pose` makes one.

    Attributes
    ----------
    pose
        The platform's pose, NaN where fewer than three markers agree.
    marker_error
        Distance of every marker from its position by the pose, (T, M) [m]; NaN where not seen.
    used
        Markers that were fitted, (T, M).
    """

    pose: PlatformPose
    marker_error: Array
    used: Mask


def neutral_markers(markers: ArrayLike) -> Array:
    """Give the platform markers' neutral positions from frames with the platform in neutral.

    Parameters
    ----------
    markers
        Platform markers in those frames, lab axes, (T, M, 3) [m]; gaps are NaN.

    Returns
    -------
    Array
        Mean positions, (M, 3) [m].

    Raises
    ------
    ValueError
        Wrong shape, positions not in metres, a marker never seen, or one that moves by more than
        5 mm (standard deviation).

    Examples
    --------
    >>> import numpy as np
    >>> neutral_markers(np.tile([[[0.0, 0.7, 0], [1.0, 0.7, 0], [1.0, -0.7, 0]]], (100, 1, 1)))
    array([[ 0. ,  0.7,  0. ],
           [ 1. ,  0.7,  0. ],
           [ 1. , -0.7,  0. ]])
    """
    position = _read_markers(markers)
    missing = np.flatnonzero(~np.isfinite(position).all(axis=2).any(axis=0))
    if len(missing):
        raise ValueError(f"platform markers {list(missing + 1)} are never seen in neutral")
    moved = np.nanstd(position, axis=0).max(axis=1)
    if moved.max() > LIMITS.largest_rest_sd:
        raise ValueError(
            f"platform marker {int(np.argmax(moved)) + 1} moves by {1000 * moved.max():.1f} mm in "
            "the frames taken as neutral; choose frames in which the platform stands still"
        )
    return np.asarray(np.nanmean(position, axis=0))


def fit_pose(markers: ArrayLike, neutral: ArrayLike, outlier_m: float) -> PoseFit:
    """Fit the platform's pose to its markers, frame by frame.

    Parameters
    ----------
    markers
        Platform markers in lab axes, (T, M, 3) [m]; gaps are NaN.
    neutral
        The same markers with the platform in neutral, (M, 3) [m].
    outlier_m
        Distance from the fit at which a marker is left out [m]; twice the cameras' error or more.

    Returns
    -------
    PoseFit
        Pose, errors and markers used.

    Raises
    ------
    ValueError
        Wrong shapes, fewer than three markers, markers in a line, or positions not in metres.

    Notes
    -----
    Least squares by singular value decomposition (Söderkvist and Wedin 1993). While a marker lies
    beyond `outlier_m` and four or more are left, the one without which the others fit best is
    left out. Three that still disagree give no pose.

    Examples
    --------
    >>> import numpy as np
    >>> neutral = np.array([[0.0, 0.7, 0], [1.0, 0.7, 0], [1.0, -0.7, 0], [0.0, -0.7, 0]])
    >>> fit = fit_pose([neutral + [0.0, 0.05, 0.0]], neutral, outlier_m=0.01)
    >>> fit.pose.position.round(6) + 0.0
    array([[0.  , 0.05, 0.  ]])
    """
    position, reference = _read_markers(markers), np.asarray(neutral, float)
    if reference.shape != position.shape[1:]:
        raise ValueError(
            f"neutral must have shape {position.shape[1:]} as the markers, got {reference.shape}"
        )
    _read_markers(reference[None])
    if not _spread(reference, np.ones((1, len(reference)), bool))[0]:
        raise ValueError(
            f"{len(reference)} platform markers lie within 2 cm of a line: "
            "rotation about it cannot be determined"
        )
    visible = np.asarray(np.isfinite(position).all(axis=2))
    used = visible.copy()
    rotation, origin, error = _fit(position, reference, used)
    # marker by marker, as long as one is off and three are left
    while len(bad := np.flatnonzero(_beyond(error, used, outlier_m) & (used.sum(axis=1) > 3))):
        used[bad] = _without_worst(position[bad], reference, used[bad])
        rotation[bad], origin[bad], error[bad] = _fit(position[bad], reference, used[bad])
    # three markers that agree, and not in a line
    lost = (used.sum(axis=1) < 3) | _beyond(error, used, outlier_m)
    some = np.flatnonzero(~used.all(axis=1))
    lost[some] |= ~_spread(reference, used[some])
    rotation[lost], origin[lost], used[lost] = np.nan, np.nan, False
    error[~visible] = np.nan
    return PoseFit(PlatformPose(rotation, origin), error, used)


def check_pose(fit: PoseFit, names: Sequence[str], outlier_m: float) -> tuple[Note, ...]:
    """Find where a pose from markers is unknown, and markers that it had to leave out.

    Parameters
    ----------
    fit
        Result of `fit_pose`.
    names
        The markers' names, (M,).
    outlier_m
        As for `fit_pose` [m].

    Returns
    -------
    tuple of Note
        Warnings: ``platform_pose_unknown``, and a ``platform_marker_left_out`` for every marker
        that was left out in more than 5 % of the frames.

    Examples
    --------
    >>> import numpy as np
    >>> neutral = np.array([[0.0, 0.7, 0], [1.0, 0.7, 0], [1.0, -0.7, 0], [0.0, -0.7, 0]])
    >>> loose = neutral + [[0.0, 0.2, 0.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    >>> fit = fit_pose([loose], neutral, outlier_m=0.01)
    >>> [note.code for note in check_pose(fit, ("PF1", "PF2", "PF3", "PF4"), 0.01)]
    ['platform_marker_left_out']
    """
    lost = np.isnan(fit.pose.pitch)
    notes = []
    if lost.any():
        notes.append(
            Note.of("platform_pose_unknown", unknown=np.count_nonzero(lost), frames=len(lost))
        )
    left_out = np.mean(np.isfinite(fit.marker_error) & ~fit.used & ~lost[:, None], axis=0)
    notes += [
        Note.of("platform_marker_left_out", marker=name, limit_m=outlier_m, share=fraction)
        for name, fraction in zip(names, left_out, strict=True)
        if fraction > LIMITS.most_left_out
    ]
    return tuple(notes)


def _read_markers(markers: ArrayLike) -> Array:
    position = np.array(markers, float)
    if position.ndim != 3 or position.shape[2] != 3:
        raise ValueError(
            f"platform markers must have shape (frames, markers, 3), got {position.shape}"
        )
    if len(position) == 0 or position.shape[1] < 3:
        raise ValueError(
            f"a platform needs 3 markers and 1 frame at least, got {position.shape[1]} markers in "
            f"{len(position)} frames"
        )
    if np.isinf(position).any() or np.nanmax(np.abs(position), initial=0) > MAX_DISTANCE_M:
        raise ValueError(f"platform markers lie beyond {MAX_DISTANCE_M:.0f} m; are they in metres?")
    return position


def _fit(position: Array, reference: Array, used: Mask) -> tuple[Array, Array, Array]:
    """Give rotation, origin and every marker's error; the identity in frames without markers."""
    # least squares of rigid motion: about the centroids, then the origin (Procrustes)
    weight = used / np.maximum(used.sum(axis=1, keepdims=True), 1)
    filled = np.where(np.isfinite(position), position, 0.0)
    center = np.einsum("tm,tmi->ti", weight, filled)
    reference_center = weight @ reference
    moved, apart = filled - center[:, None], reference - reference_center[:, None]
    rotation = fit_rotation(np.einsum("tm,tmi,tmj->tij", weight, moved, apart))
    origin = center - (rotation @ reference_center[..., None])[..., 0]
    model = np.einsum("tij,mj->tmi", rotation, reference) + origin[:, None]
    return rotation, origin, np.linalg.norm(filled - model, axis=2)


def _beyond(error: Array, used: Mask, outlier_m: float) -> Mask:
    return np.asarray((used & (error > outlier_m)).any(axis=1))


def _without_worst(position: Array, reference: Array, used: Mask) -> Mask:
    """Leave out, in every frame, the marker whose absence lets the others fit best."""
    misfit = np.full(used.shape, np.inf)
    for m in range(used.shape[1]):
        others = used.copy()
        others[:, m] = False
        # an outlier drags the pose along: leave out each in turn, keep the best fit of the rest
        error = np.where(others, _fit(position, reference, others)[2], 0.0)
        misfit[:, m] = np.where(used[:, m], np.sum(error**2, axis=1), np.inf)
    kept = used.copy()
    kept[np.arange(len(kept)), np.argmin(misfit, axis=1)] = False
    return kept


def _spread(reference: Array, used: Mask) -> Mask:
    """Whether the used ones of markers (M, 3) spread in two directions, for used (T, M): (T,)."""
    weight = used / np.maximum(used.sum(axis=1, keepdims=True), 1)
    apart = reference - (weight @ reference)[:, None]
    # the second largest variance is that across the line that fits best
    variances = np.linalg.eigvalsh(np.einsum("tm,tmi,tmj->tij", weight, apart, apart))
    return np.asarray(variances[:, 1] > LIMITS.least_spread**2)


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
    wrench = np.asarray(wrench_in_plate, float)
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
        Wrong shape.

    Notes
    -----
    ``x = (h Fx - My) / Fz``, ``y = (h Fy + Mx) / Fz`` (van de Loosdrecht 2018, eq. A.2).

    Examples
    --------
    700 N, 0.3 m in front of the origin and 0.1 m to its left:

    >>> center_of_pressure([[0, 0, 700.0, 70.0, -210.0, 0]], threshold_n=30.0)
    array([[0.3, 0.1, 0. ]])
    """
    fx, fy, fz, mx, my, _ = np.asarray(wrench, float).T
    loaded = fz > threshold_n
    # M about the point is vertical there: x = (h Fx − My) / Fz, y = (h Fy + Mx) / Fz
    height = np.where(loaded, np.asarray(surface_height_m, float), np.nan)
    divisor = np.where(loaded, fz, np.nan)
    return np.array([(height * fx - my) / divisor, (height * fy + mx) / divisor, height]).T
