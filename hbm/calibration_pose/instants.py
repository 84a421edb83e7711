"""Which instants of a recording the body is built from."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, Indices

QUIET_MPS: Final = 0.05
WINDOW_S: Final = 1.0
TREMOR_S: Final = 0.1
INSTANTS: Final = 100


@dataclass(frozen=True, slots=True)
class Calibration:
    """The instants that show the calibration pose.

    Attributes
    ----------
    frames
        Evenly spread frames in which all markers that are ever visible are visible, (F,).
    still
        Whether the subject stood still.
    note
        Which window, and whether the subject stood still in it.
    """

    frames: Indices
    still: bool
    note: Note


def calibrate(
    markers: Markers, used: list[str], window_s: tuple[float, float] | None
) -> Calibration:
    """Choose the instants that the body is built from.

    Parameters
    ----------
    markers
        The calibration recording.
    used
        Labels that matter.
    window_s
        Start and end [s]; by default the second in which the markers move least, or, where nobody
        ever stands still, the whole recording: over many strides what is periodic averages out.

    Returns
    -------
    Calibration
        At most 100 instants.

    Raises
    ------
    ValueError
        If the window holds no frame, or no frame shows all markers at once.
    """
    time = markers.time
    position = markers.position[:, [markers.names.index(name) for name in used]]
    chosen = _inside(time, window_s)
    seen = ~np.isnan(position[chosen, :, 0])
    complete = chosen[seen[:, seen.any(axis=0)].all(axis=1)]
    if not len(complete):
        rare = used[int(np.argmin(np.where(seen.any(axis=0), seen.sum(axis=0), np.inf)))]
        raise ValueError(
            f"no frame from {time[chosen[0]]:.2f} to {time[chosen[-1]]:.2f} s shows all "
            f"calibration markers at once; {rare} is missing most often; choose another window"
        )
    speed = _speed(position, time)
    if window_s is None:
        complete = _quiet(complete, speed, time)
    spread = np.unique(np.linspace(0, len(complete) - 1, INSTANTS).round().astype(int))
    frames = complete[spread]
    pace = speed[complete]
    moved = float(np.mean(pace[~np.isnan(pace)])) if not np.isnan(pace).all() else 0.0
    still = moved < QUIET_MPS
    window = {
        "start_s": float(time[frames[0]]),
        "stop_s": float(time[frames[-1]]),
        "instants": len(frames),
    }
    note = (
        Note.of("calibration_pose_still", **window)
        if still
        else Note.of("calibration_pose_moving", speed_mps=moved, **window)
    )
    return Calibration(frames, still, note)


def _inside(time: Array, window_s: tuple[float, float] | None) -> Indices:
    if window_s is None:
        return np.arange(len(time))
    inside = np.flatnonzero((time >= window_s[0]) & (time < window_s[1]))
    if not len(inside):
        raise ValueError(
            f"the calibration window {window_s[0]:g}–{window_s[1]:g} s holds no frame; the "
            f"recording runs from {time[0]:g} to {time[-1]:g} s"
        )
    return np.asarray(inside)


def _speed(position: Array, time: Array) -> Array:
    """Mean speed of the visible markers around each frame, tremor faster than 0.1 s left out."""
    speed = np.full(len(position), np.nan)
    if len(position) < 2:
        return speed
    step = min(max(1, round(TREMOR_S / float(np.median(np.diff(time))))), len(position) - 1)
    passed = (time[step:] - time[:-step])[:, None]
    moved = np.linalg.norm(position[step:] - position[:-step], axis=-1) / passed
    seen = ~np.isnan(moved)
    count = seen.sum(axis=1)
    mean = np.where(seen, moved, 0).sum(axis=1) / np.maximum(count, 1)
    speed[step // 2 : step // 2 + len(mean)] = np.where(count > 0, mean, np.nan)
    return speed


def _quiet(complete: Indices, speed: Array, time: Array) -> Indices:
    """Keep the complete frames of the quietest second; all of them if nobody stands still."""
    known = complete[~np.isnan(speed[complete])]
    if not len(known):
        return complete
    total = np.concatenate([[0.0], np.cumsum(speed[known])])
    starts, stops = np.arange(len(known)), np.searchsorted(time[known], time[known] + WINDOW_S)
    count = stops - starts
    mean = np.where(2 * count >= count.max(), (total[stops] - total[starts]) / count, np.inf)
    best = int(np.argmin(mean))
    if mean[best] >= QUIET_MPS:
        return complete
    begin = time[known[best]]
    return np.asarray(complete[(time[complete] >= begin) & (time[complete] < begin + WINDOW_S)])
