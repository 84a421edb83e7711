"""Single marker positions that are far from where the body can be: they are taken as gaps.

In whole trials by what is usual in the trial, frame by frame by what was measured so far, so that a
frame's result is known as soon as it is measured.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.coordinates import CARRIERS, LIMBS, N_Q
from hbm.ik.tracking import FrameSolution, FrameTracker, solve_ik
from hbm.markers import Markers
from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.plausibility.labels import FROZEN, ROUNDING_S, without_frozen_frames
from hbm.signals.filtering import Method
from hbm.signals.samples import without_short_gaps
from hbm.spatial import Array, Indices, Mask

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "outliers")

MAX_ROUNDS: Final = 6
"""Markers of a limb that are left out one after the other: an outlier moves the limb, so that its
other markers seem wrong too until it is gone."""


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
    parts = markers_of_parts(body, motion.markers)
    for _ in range(MAX_ROUNDS):
        error = motion.marker_error
        # most trials end here, after one solution
        if np.fmax.reduce(error, axis=None, initial=0) <= LIMITS.least_excess:
            break
        ever_seen = np.isfinite(error).any(axis=0)
        # what is usual for a marker includes skin and a wrong calibration pose
        usual_m = np.nanmedian(np.where(ever_seen, error, 0.0), axis=0)
        more = farthest_outliers(error - 2 * usual_m, parts)
        if not more.any():
            break
        outliers |= more
        # of a limb of which several markers are outliers, the others tell nothing
        for limb in parts[1:]:
            if len(limb):
                lost = limb_is_lost(outliers[:, limb])
                in_between = without_short_gaps(lost, motion.time, LIMITS.longest_between)
                outliers[np.ix_(in_between, limb)] = True
        columns = [markers.names.index(name) for name in motion.markers]
        position = markers.position.copy()
        position[:, columns] = np.where(outliers[..., None], np.nan, position[:, columns])
        # an outlier moves its limb: only without it do the other markers show themselves
        solved = Markers(markers.time, markers.names, position)
        motion = solve_ik(body, solved, jobs=jobs)
    return solved, motion, outlier_notes(markers, solved)


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
    farthest = np.zeros(excess_m.shape, bool)
    if not (excess_m > LIMITS.least_excess).any():
        return farthest
    for part in parts:
        if len(part):
            far = np.nan_to_num(excess_m[..., part], nan=-np.inf)
            worst = part[far.argmax(axis=-1, keepdims=True)]
            is_outlier = far.max(axis=-1, keepdims=True) > LIMITS.least_excess
            np.put_along_axis(farthest, worst, is_outlier, axis=-1)
    return farthest


def limb_is_lost(outliers: Mask) -> Mask:
    """Whether so many of a limb's markers are outliers, (..., n), that its others tell nothing."""
    count, fraction = outliers.sum(axis=-1), outliers.mean(axis=-1)
    return np.asarray((count >= LIMITS.least_lost) & (fraction >= LIMITS.least_lost_fraction))


def outlier_notes(before: Markers, after: Markers) -> tuple[Note, ...]:
    """Say how many positions of which markers were left out of a trial, if any were."""
    gone = np.isnan(after.position[..., 0]) & ~np.isnan(before.position[..., 0])
    if not gone.any():
        return ()
    count, times = gone.sum(axis=0), before.time[gone.any(axis=1)]
    most = np.argsort(-count, kind="stable")[: LIMITS.markers_named]
    of_marker = {before.names[k]: int(count[k]) for k in most if count[k]}
    ends = {"first_s": times[0], "last_s": times[-1]}
    return (Note.of("marker_outliers", samples=count.sum(), of_marker=of_marker, **ends),)


class MarkerTracker:
    """One subject's markers, frame by frame.

    Parameters
    ----------
    body
        The subject.
    labels
        Of the markers that are given, (M,).

    Attributes
    ----------
    frozen
        Whether all visible markers have repeated their positions exactly for 0.05 s; then none was
        measured.
    left_out
        Markers that were left out of the last frame, (K,).

    Examples
    --------
    With ``static``, the markers of a calibration pose, and ``body``, built from them:

    >>> import hbm, numpy as np
    >>> tracker = MarkerTracker(body, static.names)
    >>> solution = tracker.step(static.time[0], static.position[0])
    >>> bool(np.nanmax(solution.marker_error) < 1e-9)
    True
    """

    def __init__(self, body: Body, labels: Sequence[str]) -> None:
        self.tracker = FrameTracker(body, labels)
        self.markers, self.columns = self.tracker.markers, self.tracker.columns
        self.parts = markers_of_parts(body, self.markers)
        self.usual_m = np.full(len(self.markers), LIMITS.usual_distance)
        self.time = self.moved_s = -np.inf
        self.before = np.full((len(self.markers), 3), np.nan)
        self.frozen = False
        self.left_out: Mask = np.zeros(len(self.markers), bool)
        self.unfit = False

    def step(self, time: float, position: Array) -> FrameSolution:
        """Solve the next frame.

        Parameters
        ----------
        time
            Of the frame, after the last one [s].
        position
            Measured markers in the lab, (M, 3) [m]; NaN where missing. Without any, the frame was
            lost: it is unsolved, and what follows is as if it had never come.
        """
        used = position[self.columns]
        measured = np.isfinite(used[:, 0])
        if not measured.any():
            self.frozen, self.left_out = False, np.zeros(len(self.markers), bool)
            return self.tracker.solve(position)
        since_s, self.time = time - self.time, time
        # a camera system that lost contact may repeat its last positions
        if (used != self.before)[measured].any():
            self.moved_s = time
        self.before = used
        self.frozen = time - self.moved_s > FROZEN.shortest - ROUNDING_S
        if self.frozen:
            position = np.full(position.shape, np.nan)
        solution = self._without_outliers(position)
        solution = self.tracker.keep(solution, time)
        # a running median: each new distance moves it by a fixed step, whatever its size
        largest_m = LIMITS.usual_distance_rate * min(since_s, 1.0)
        change_m = (solution.marker_error - self.usual_m).clip(-largest_m, largest_m)
        np.add(self.usual_m, change_m, out=self.usual_m, where=~np.isnan(change_m))
        return solution

    def _without_outliers(self, position: Array) -> FrameSolution:
        """Solve a frame again and again without the marker that is farthest off on each limb.

        Only once as long as the body does not fit at all: so that frames are not late.
        """
        self.left_out = beyond_reach(position[self.columns])
        if self.left_out.any():
            position = self._without_left_out(position)
        solution = self.tracker.solve(position)
        if self.unfit:
            errors_m = solution.marker_error[np.isfinite(solution.marker_error)]
            if not (len(errors_m) and np.median(errors_m) < LIMITS.fitting_distance):
                return solution
        for _ in range(MAX_ROUNDS):
            more = farthest_outliers(solution.marker_error - 2 * self.usual_m, self.parts)
            if not more.any():
                break
            self.left_out |= more
            for limb in self.parts[1:]:
                if len(limb) and limb_is_lost(self.left_out[limb]):
                    self.left_out[limb] = True
            position = self._without_left_out(position)
            solution = self.tracker.solve(position)
        # a body that does not fit has outliers everywhere: to leave them out takes time in vain
        self.unfit = bool(
            np.count_nonzero(self.left_out) > LIMITS.most_left_out * len(self.left_out)
        )
        return solution

    def _without_left_out(self, position: Array) -> Array:
        position = position.copy()
        position[self.columns[self.left_out]] = np.nan
        return position


def beyond_reach(position: Array) -> Mask:
    """Find markers that are too far from the others to be on the same person.

    Parameters
    ----------
    position
        Markers of a frame, (K, 3) [m]; NaN where missing.

    Returns
    -------
    Mask
        (K,).

    Examples
    --------
    >>> beyond_reach(np.array([[0.0, 0, 1], [0.1, 0, 1], [0.2, 0, 1], [7.0, 0, 1]])).tolist()
    [False, False, False, True]
    """
    extent = np.fmax.reduce(position) - np.fmin.reduce(position)
    if not (extent > LIMITS.farthest).any():  # which is faster
        return np.zeros(len(position), bool)
    return np.asarray(
        (np.abs(position - np.nanmedian(position, axis=0)) > LIMITS.farthest).any(axis=1)
    )


def solve_motion(
    body: Body, markers: Markers, method: Method, jobs: int
) -> tuple[Markers, Motion, tuple[Note, ...]]:
    """Find the coordinates of a trial, without marker positions that cannot be.

    Parameters
    ----------
    body
        The subject.
    markers
        Trajectories, T frames.
    method
        Of the filter that follows; with "realtime" no frame depends on a later one.
    jobs
        Threads; one in real time.

    Returns
    -------
    markers
        The same with gaps in place of positions that were left out.
    motion
        Of these, unfiltered.
    notes
        What was left out.
    """
    if method == "realtime":
        return track_motion(body, markers)
    return solve_without_outliers(body, without_frozen_frames(markers, body.markers), jobs)


def track_motion(body: Body, markers: Markers) -> tuple[Markers, Motion, tuple[Note, ...]]:
    """Solve the inverse kinematics of a trial frame by frame, as while it is measured.

    Parameters
    ----------
    body
        The subject.
    markers
        Trajectories.

    Returns
    -------
    markers
        The same with gaps in place of outliers and frozen frames.
    motion
        Of these; coordinates that markers do not show keep their last shown values.
    notes
        ``marker_outliers`` with how many positions of which markers were left out, if any.
    """
    tracker = MarkerTracker(body, markers.names)
    measured, cleaned = markers.position.copy(), markers.position.copy()
    solutions = []
    for k, time in enumerate(markers.time):
        solutions.append(tracker.step(float(time), markers.position[k]))
        cleaned[k, tracker.columns[tracker.left_out]] = np.nan
        if tracker.frozen:
            measured[k] = cleaned[k] = np.nan
    unknown = np.full((len(solutions), N_Q), np.nan)
    motion = Motion(
        markers.time,
        np.array([s.q for s in solutions]),
        unknown,
        unknown,
        tracker.markers,
        np.array([s.marker_error for s in solutions]),
        np.array([s.converged for s in solutions]),
        np.array([s.observed for s in solutions]),
    )
    before, after = (Markers(markers.time, markers.names, x) for x in (measured, cleaned))
    return after, motion, outlier_notes(before, after)
