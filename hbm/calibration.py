"""Which instants of a recording the body is built from."""

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array

QUIET_MPS = 0.05
WINDOW_S = 1.0
INSTANTS = 50


def calibration_frames(
    markers: Markers, used: list[str], window_s: tuple[float, float] | None
) -> tuple[Array, str]:
    """Choose the instants that the calibration pose is taken from.

    Parameters
    ----------
    markers
        The calibration recording.
    used
        Labels that matter.
    window_s
        Start and end [s]; by default the second in which the markers move least.

    Returns
    -------
    frames
        At most 50 frames, evenly spread over the window, in which all markers that are visible at
        all are visible.
    said
        One sentence for the user: which window, and whether the subject stood still in it.

    Raises
    ------
    ValueError
        If the window holds no frame, or no frame shows all markers at once.
    """
    time = markers.time
    position = markers.position[:, [markers.names.index(name) for name in used]]
    if window_s is None:
        start, stop = _quietest(position, markers.rate_hz)
    else:
        inside = np.flatnonzero((time >= window_s[0]) & (time < window_s[1]))
        if not len(inside):
            raise ValueError(
                f"the calibration window {window_s[0]:g}–{window_s[1]:g} s holds no frame; the "
                f"recording runs from {time[0]:g} to {time[-1]:g} s"
            )
        start, stop = int(inside[0]), int(inside[-1]) + 1
    seen = ~np.isnan(position[start:stop, :, 0])
    ever = seen.any(axis=0)
    complete = start + np.flatnonzero(seen[:, ever].all(axis=1))
    if not len(complete):
        rare = used[int(np.argmin(np.where(ever, seen.sum(axis=0), np.inf)))]
        raise ValueError(
            f"no frame from {time[start]:.2f} to {time[stop - 1]:.2f} s shows all calibration "
            f"markers at once; {rare} is missing most often; choose another window"
        )
    spread = np.unique(np.linspace(0, len(complete) - 1, INSTANTS).round().astype(int))
    speed = _speed(position[start:stop], markers.rate_hz)
    manner = "standing still" if speed < QUIET_MPS else f"moving at {speed:.2f} m/s"
    said = (
        f"calibration pose from {time[start]:.2f} to {time[stop - 1]:.2f} s, "
        f"{manner} (mean of {len(spread)} instants)"
    )
    return complete[spread], said


def _speed(position: Array, rate_hz: float) -> float:
    """Median over markers of the RMS speed after removing what is faster than a tenth second."""
    step = max(1, round(rate_hz / 10))
    moved = position[step:] - position[:-step]
    speed = np.linalg.norm(moved, axis=-1) * rate_hz / step
    return float(np.nanmean(speed)) if np.isfinite(speed).any() else 0.0


def _quietest(position: Array, rate_hz: float) -> tuple[int, int]:
    """Find the second in which the markers move least."""
    length = min(len(position), max(2, round(WINDOW_S * rate_hz)))
    starts = range(0, len(position) - length + 1, max(1, length // 10))
    speeds = [_speed(position[s : s + length], rate_hz) for s in starts]
    best = starts[int(np.argmin(speeds))]
    return best, best + length
