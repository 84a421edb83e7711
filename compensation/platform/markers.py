"""The platform's pose from markers on it: rigid fit, gaps, and markers that disagree."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compensation.platform.pose import PlatformPose
from hbm.notes import Note
from hbm.spatial import Array, Mask, fit_rotation, read_only

MAX_REST_SD_M: Final = 0.005
"""Of a marker in neutral: more than the noise of cameras, less than any motion of a platform."""
MIN_SPREAD_M: Final = 0.02
"""Root-mean-square distance from a line, below which markers do not determine the rotation about
it: 1 mm of noise is 3° there."""
MAX_DISTANCE_M: Final = 20.0
"""Of a marker from the lab's origin; larger numbers are millimetres."""
MAX_LEFT_OUT_SHARE: Final = 0.05
"""Of the frames, in which a marker may be left out without a warning."""


@dataclass(frozen=True, slots=True)
class PoseFit:
    """A pose from markers, and how well they agree with it; `fit_pose` makes one.

    Attributes
    ----------
    pose
        The platform's pose, NaN where fewer than three markers agree.
    marker_error
        Distance of every marker from its position by the pose, (T, M) [m]; NaN where not seen.
    used
        Markers that were fitted, (T, M).

    Examples
    --------
    >>> import numpy as np
    >>> neutral = np.array([[0.0, 0.7, 0], [1.0, 0.7, 0], [1.0, -0.7, 0], [0.0, -0.7, 0]])
    >>> fit_pose([neutral], neutral, outlier_m=0.01).used
    array([[ True,  True,  True,  True]])
    """

    pose: PlatformPose
    marker_error: Array
    used: Mask

    def __post_init__(self) -> None:
        object.__setattr__(self, "marker_error", read_only(self.marker_error))
        object.__setattr__(self, "used", read_only(self.used, bool))


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
    seen = _seen(position)
    missing = np.flatnonzero(~seen.any(axis=0))
    if len(missing):
        raise ValueError(f"platform markers {list(missing + 1)} are never seen in neutral")
    moved = np.nanstd(position, axis=0).max(axis=1)
    if moved.max() > MAX_REST_SD_M:
        raise ValueError(
            f"platform marker {int(np.argmax(moved)) + 1} moves by {1000 * moved.max():.1f} mm in "
            "the frames taken as neutral; choose frames in which the platform stands still"
        )
    mean: Array = np.nanmean(position, axis=0)
    return mean


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
    if not outlier_m > 0:
        raise ValueError(f"outlier_m must be positive, got {outlier_m}")
    if _rank(reference[None], np.ones((1, len(reference)), bool))[0] < 2:
        raise ValueError(
            f"{len(reference)} platform markers lie within 2 cm of a line: "
            "rotation about it cannot be determined"
        )
    seen = _seen(position)
    used = seen.copy()
    rotation, origin, error = _fit(position, reference, used)
    while len(bad := np.flatnonzero(_beyond(error, used, outlier_m) & (used.sum(axis=1) > 3))):
        used[bad] = _without_worst(position[bad], reference, used[bad])
        rotation[bad], origin[bad], error[bad] = _fit(position[bad], reference, used[bad])
    lost = (used.sum(axis=1) < 3) | _beyond(error, used, outlier_m)
    some = np.flatnonzero(~used.all(axis=1))
    lost[some] |= _rank(np.broadcast_to(reference, (len(some), *reference.shape)), used[some]) < 2
    rotation[lost], origin[lost], used[lost] = np.nan, np.nan, False
    error[~seen] = np.nan
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
        Note.of("platform_marker_left_out", marker=name, limit_m=outlier_m, share=share)
        for name, share in zip(names, left_out, strict=True)
        if share > MAX_LEFT_OUT_SHARE
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


def _seen(position: Array) -> Mask:
    return np.asarray(np.isfinite(position).all(axis=2), bool)


def _fit(position: Array, reference: Array, used: Mask) -> tuple[Array, Array, Array]:
    """Give rotation, origin and every marker's error; the identity in frames without markers."""
    weight = used / np.maximum(used.sum(axis=1, keepdims=True), 1)
    filled = np.where(np.isfinite(position), position, 0.0)
    center = np.einsum("tm,tmi->ti", weight, filled)
    reference_center = weight @ reference
    covariance = np.einsum(
        "tm,tmi,tmj->tij",
        weight,
        filled - center[:, None],
        reference - reference_center[:, None],
    )
    rotation = fit_rotation(covariance)
    origin = center - (rotation @ reference_center[..., None])[..., 0]
    model = np.einsum("tij,mj->tmi", rotation, reference) + origin[:, None]
    return rotation, origin, np.linalg.norm(filled - model, axis=2)


def _beyond(error: Array, used: Mask, outlier_m: float) -> Mask:
    return np.asarray((used & (error > outlier_m)).any(axis=1), bool)


def _without_worst(position: Array, reference: Array, used: Mask) -> Mask:
    """Leave out, in every frame, the marker whose absence lets the others fit best."""
    misfit = np.full(used.shape, np.inf)
    for m in range(used.shape[1]):
        others = used.copy()
        others[:, m] = False
        error = np.where(others, _fit(position, reference, others)[2], 0.0)
        misfit[:, m] = np.where(used[:, m], np.sum(error**2, axis=1), np.inf)
    kept = used.copy()
    kept[np.arange(len(kept)), np.argmin(misfit, axis=1)] = False
    return kept


def _rank(reference: Array, used: Mask) -> NDArray[np.int64]:
    """Count the directions, up to 2, in which the used markers spread."""
    weight = used / np.maximum(used.sum(axis=1, keepdims=True), 1)
    center = np.einsum("tm,tmi->ti", weight, reference)
    apart = reference - center[:, None]
    spread = np.sqrt(
        np.maximum(np.linalg.eigvalsh(np.einsum("tm,tmi,tmj->tij", weight, apart, apart)), 0)
    )
    rank: NDArray[np.int64] = np.sum(spread[:, 1:] > MIN_SPREAD_M, axis=1)
    return rank
