"""Single marker positions that are far from where the body can be: they are taken as gaps."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.coordinates import CARRIERS, LIMBS
from hbm.kinematics import solve_ik
from hbm.markers import Markers
from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.signals.samples import stretches
from hbm.spatial import Array, Indices, Mask

MIN_EXCESS_M: Final = 0.1
"""Distance from the model above twice what is usual for the marker in the trial: skin and a wrong
calibration pose move markers by less, and all the time."""
MAX_ROUNDS: Final = 6
"""Markers of a limb that are left out one after the other: an outlier moves the limb, so that its
other markers seem wrong too until it is gone."""
MIN_LOST: Final = 2
MIN_LOST_SHARE: Final = 0.25
"""Markers of a limb that are outliers in a frame, and their share: then its others tell nothing."""
MAX_BETWEEN_S: Final = 0.1
"""Between two frames in which a limb is lost, it is not there for so short a time."""
MAX_NAMED: Final = 6


def solve_without_outliers(
    body: Body, markers: Markers, jobs: int
) -> tuple[Markers, Motion, tuple[Note, ...]]:
    """Solve the inverse kinematics, leaving out single positions that cannot be.

    Parameters
    ----------
    body
        The subject.
    markers
        Trajectories.
    jobs
        Threads.

    Returns
    -------
    markers
        The same with gaps in place of outliers.
    motion
        As `hbm.solve_ik` gives it for these. A limb of which several markers are outliers is
        left out of the frame.
    notes
        ``marker_outliers`` with how many positions of which markers were left out, if any.
    """
    solved, motion = markers, solve_ik(body, markers, jobs=jobs)
    outliers = np.zeros(motion.marker_error.shape, bool)
    for _ in range(MAX_ROUNDS):
        more = outlying_samples(body, motion)
        if not more.any():
            break
        outliers = _with_lost_limbs(body, motion, outliers | more)
        columns = [markers.names.index(name) for name in motion.markers]
        position = markers.position.copy()
        position[:, columns] = np.where(outliers[..., None], np.nan, position[:, columns])
        solved = Markers(markers.time, markers.names, position)
        motion = solve_ik(body, solved, jobs=jobs)
    return solved, motion, outlier_notes(markers, solved)


def outlying_samples(body: Body, motion: Motion) -> Mask:
    """Find the position farthest off on each limb or the trunk in each frame, if it is an outlier.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it.

    Returns
    -------
    Mask
        (T, K): its distance from the model is more than 0.1 m above twice the marker's median.
    """
    if np.fmax.reduce(motion.marker_error, axis=None, initial=0) <= MIN_EXCESS_M:
        return np.zeros(motion.marker_error.shape, bool)
    excess_m = motion.marker_error - 2 * _median(motion.marker_error)
    return farthest_outliers(excess_m, markers_of_parts(body, motion.markers))


def markers_of_parts(body: Body, names: Sequence[str]) -> list[Indices]:
    """Give which markers are on pelvis and trunk, and on each limb; on some there may be none."""
    segment_of = body.segment_of
    segments = [segment_of[name] for name in names]
    parts = (CARRIERS, *LIMBS.values())
    return [np.flatnonzero([segment in part for segment in segments]) for part in parts]


def farthest_outliers(excess_m: Array, parts: Sequence[Indices]) -> Mask:
    """Find the marker farthest off on each part of the body, if it is an outlier.

    Parameters
    ----------
    excess_m
        Distance of each marker from the model above twice what is usual for it, (..., K) [m]; NaN
        where it is not used.
    parts
        As `markers_of_parts` gives them.

    Returns
    -------
    Mask
        (..., K).

    Examples
    --------
    >>> farthest_outliers(np.array([0.2, 0.3, np.nan, 0.05]), [np.array([0, 1]), np.array([2, 3])])
    array([False,  True, False, False])
    """
    found = np.zeros(excess_m.shape, bool)
    if not (excess_m > MIN_EXCESS_M).any():
        return found
    for own in parts:
        if len(own):
            far = np.nan_to_num(excess_m[..., own], nan=-np.inf)
            worst = own[far.argmax(axis=-1, keepdims=True)]
            np.put_along_axis(found, worst, far.max(axis=-1, keepdims=True) > MIN_EXCESS_M, axis=-1)
    return found


def limb_is_lost(outliers: Mask) -> Mask:
    """Whether so many of a limb's markers are outliers, (..., n), that its others tell nothing."""
    count, share = outliers.sum(axis=-1), outliers.mean(axis=-1)
    return np.asarray((count >= MIN_LOST) & (share >= MIN_LOST_SHARE))


def _with_lost_limbs(body: Body, motion: Motion, outliers: Mask) -> Mask:
    """Add the other markers of limbs of which several are outliers, (T, K)."""
    result = outliers.copy()
    _, *limbs = markers_of_parts(body, motion.markers)
    for own in limbs:
        if len(own):
            lost = limb_is_lost(outliers[:, own])
            for start, stop in stretches(~lost):
                inside = start > 0 and stop < len(lost)
                if inside and motion.time[stop] - motion.time[start - 1] <= MAX_BETWEEN_S:
                    lost[start:stop] = True
            result[np.ix_(lost, own)] = True
    return result


def _median(error: Array) -> Array:
    """Give the median of each column, (T, K) to (K,); 0 for one without values."""
    seen = np.isfinite(error).any(axis=0)
    result = np.zeros(error.shape[1])
    result[seen] = np.nanmedian(error[:, seen], axis=0)
    return result


def outlier_notes(before: Markers, after: Markers) -> tuple[Note, ...]:
    """Say how many positions of which markers were left out of a trial, if any were."""
    gone = np.isnan(after.position[..., 0]) & ~np.isnan(before.position[..., 0])
    if not gone.any():
        return ()
    count, times = gone.sum(axis=0), before.time[gone.any(axis=1)]
    most = np.argsort(-count, kind="stable")[:MAX_NAMED]
    of_marker = {before.names[k]: int(count[k]) for k in most if count[k]}
    note = Note.of(
        "marker_outliers",
        samples=int(count.sum()),
        first_s=times[0],
        last_s=times[-1],
        of_marker=of_marker,
    )
    return (note,)
