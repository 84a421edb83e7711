"""The frames of a calibration recording that the body is built from."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array, Indices

MAX_STILL_SPEED_MPS: Final = 0.05
"""Mean marker speed up to which a subject counts as standing still: postural sway gives 0.01 to
0.02 m/s, slow walking 0.3 m/s."""

WINDOW_S: Final = 1.0
"""Duration of the calibration pose to look for."""

SPEED_INTERVAL_S: Final = 0.1
"""Interval over which speeds are measured: marker noise of 1 mm gives 0.01 m/s, and tremor averages
out."""

MAX_FRAMES: Final = 100
"""Frames that the body is averaged over; more make no difference."""


def select_frames(
    markers: Markers, used: list[str], window_s: tuple[float, float] | None
) -> tuple[Indices, float]:
    """Select the frames that the body is built from.

    Parameters
    ----------
    markers
        The calibration recording.
    used
        Labels of the marker set that are in it.
    window_s
        Start and end [s]; by default the second in which the markers move least or, where the
        subject never stands still, the whole recording: over many strides periodic motion of the
        skin averages out.

    Returns
    -------
    frames
        At most 100, evenly spread, in which all markers that are ever visible are visible, (F,).
    speed
        Mean speed of the markers in them [m/s].

    Raises
    ------
    ValueError
        If the window holds no frame, or no frame shows all markers at once.
    """
    time = markers.time
    first_s, last_s = window_s or (-np.inf, np.inf)
    window = np.flatnonzero((time >= first_s) & (time < last_s))
    if not len(window):
        raise ValueError(
            f"the calibration window {first_s:g}–{last_s:g} s holds no frame; the recording runs "
            f"from {time[0]:g} to {time[-1]:g} s"
        )
    paths = [markers.position[:, markers.names.index(name)] for name in used]
    seen = np.stack([~np.isnan(path[window, 0]) for path in paths]).T
    complete = window[seen[:, seen.any(axis=0)].all(axis=1)]
    if not len(complete):
        rarest = used[int(np.argmin(np.where(seen.any(axis=0), seen.sum(axis=0), np.inf)))]
        raise ValueError(
            f"no frame from {time[window[0]]:.2f} to {time[window[-1]]:.2f} s shows all "
            f"calibration markers at once; {rarest} is missing most often; choose another window"
        )
    speed = _speed(paths, time)
    if window_s is None:
        complete = _stillest(complete, speed, time)
    spread = np.unique(np.linspace(0, len(complete) - 1, MAX_FRAMES).round().astype(int))
    known = speed[complete][~np.isnan(speed[complete])]
    return complete[spread], float(np.mean(known)) if len(known) else 0.0


def _speed(paths: Sequence[Array], time: Array) -> Array:
    """Give the mean speed of the visible markers, (T, 3) each, around each frame, (T,) [m/s]."""
    speed = np.full(len(time), np.nan)
    if len(time) < 2:
        return speed
    step = min(max(1, round(SPEED_INTERVAL_S / float(np.median(np.diff(time))))), len(time) - 1)
    total, count = np.zeros(len(time) - step), np.zeros(len(time) - step)
    for path in paths:
        way = np.sqrt(sum((x[step:] - x[:-step]) ** 2 for x in path.T))
        seen = ~np.isnan(way)
        total += np.where(seen, way, 0)
        count += seen
    mean = total / (time[step:] - time[:-step]) / np.maximum(count, 1)
    speed[step // 2 : step // 2 + len(mean)] = np.where(count > 0, mean, np.nan)
    return speed


def _stillest(complete: Indices, speed: Array, time: Array) -> Indices:
    """Keep the complete frames of the stillest second; all of them if the subject never stands."""
    known = complete[~np.isnan(speed[complete])]
    if not len(known):
        return complete
    total = np.concatenate([[0.0], np.cumsum(speed[known])])
    starts, stops = np.arange(len(known)), np.searchsorted(time[known], time[known] + WINDOW_S)
    count = stops - starts
    mean = np.where(2 * count >= count.max(), (total[stops] - total[starts]) / count, np.inf)
    best = int(np.argmin(mean))
    if mean[best] >= MAX_STILL_SPEED_MPS:
        return complete
    begin = time[known[best]]
    return np.asarray(complete[(time[complete] >= begin) & (time[complete] < begin + WINDOW_S)])
