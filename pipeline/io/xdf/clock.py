"""Samples at a constant rate whose time stamps scatter, and of which some are missing."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import median_filter, minimum_filter1d

from hbm.spatial import Array

NEIGHBOURS: Final = 5
"""Of so many stamps, the median shows which one is out of order."""
OUT_OF_ORDER_FRAMES: Final = 1.5
"""One stamp that is out of order moves the median by one frame."""
USUAL_HZ: Final = 100.0
MAX_RATE_DIFFERENCE: Final = 0.02
"""Relative; beyond it the nominal rate is not that of the samples."""
MIN_BURST_S: Final = 0.25
"""Within it, some sample is stamped without delay."""
MAX_DROPPED_RATIO: Final = 2
"""Frames spanned per sample held: with more dropped, this is not one recording."""
MAX_GAP_FRAMES: Final = 10**9
MAX_SCATTER_FRAMES: Final = 50


@dataclass(frozen=True, slots=True)
class Clock:
    """Which frame each sample is, and when.

    Attributes
    ----------
    index
        Frame of each sample, from 0, increasing, (N,).
    rate_hz, start_s
        Frame k is at ``start_s + k / rate_hz``.
    scatter_s
        Standard deviation of the time stamps about that.
    """

    index: Array
    rate_hz: float
    start_s: float
    scatter_s: float

    @property
    def frames(self) -> int:
        """Number of frames, dropped ones included."""
        return int(self.index[-1]) + 1

    @property
    def time(self) -> Array:
        """Times of all frames, (frames,) [s]."""
        return self.start_s + np.arange(self.frames) / self.rate_hz

    def on_frames(self, values: Array) -> Array:
        """Give samples, (N, K), at every frame, (frames, K); NaN where one was dropped."""
        if self.frames == len(values):
            return values
        held = np.full((self.frames, values.shape[1]), np.nan)
        held[self.index] = values
        return held


def find_clock(stamps: Array, nominal_hz: float) -> Clock:
    """Find the constant rate of samples, and which are missing, from their time stamps.

    Parameters
    ----------
    stamps
        (N,) [s], N ≥ 2.
    nominal_hz
        The rate that the sender states; 0 where it states none.

    Returns
    -------
    Clock
        The rate is that of a straight line through all stamps.

    Raises
    ------
    ValueError
        The stamps do not advance, scatter over many frames, or most frames are missing.

    Notes
    -----
    A stamp may be late, but not early: of the stamps of a quarter of a second some are on time.
    Where even these come later by a whole number of frames, and stay so, frames were dropped.
    Single stamps that are out of order by more than two frames do not count.

    Examples
    --------
    Ten seconds at 100 Hz, of which the frames 300 to 304 are missing:

    >>> import numpy as np
    >>> frames = np.delete(np.arange(1000), slice(300, 305))
    >>> clock = find_clock(7.0 + frames / 100, 100.0)
    >>> clock.frames, round(clock.rate_hz, 6), bool(np.all(clock.index == frames))
    (1000, 100.0, True)
    """
    period = _period(stamps, nominal_hz)
    stamps = _in_order(stamps, period)
    index = _frames(stamps, max(period / 2, _slope(stamps, _frames(stamps, period))))
    if index[-1] + 1 > MAX_DROPPED_RATIO * len(stamps):
        raise ValueError(f"its times span {index[-1] + 1} frames, but it holds {len(stamps)}")
    slope = _slope(stamps, index)
    if not slope > 0:
        raise ValueError("its time stamps do not advance")
    residual = stamps - index * slope
    start = float(np.median(residual))
    scatter = float(np.std(residual))
    if scatter > MAX_SCATTER_FRAMES * slope:
        raise ValueError(f"its time stamps scatter by {scatter:.3g} s about a constant rate")
    return Clock(index, 1 / slope, start, scatter)


def _in_order(stamps: Array, period: float) -> Array:
    """Give stamps with those between their neighbours that are out of order, (N,) [s]."""
    usual = median_filter(stamps, NEIGHBOURS, mode="nearest")
    right = np.abs(stamps - usual) < OUT_OF_ORDER_FRAMES * period
    if right.all() or np.count_nonzero(right) < 2:
        return stamps
    k = np.arange(len(stamps))
    return np.where(right, stamps, np.interp(k, k[right], stamps[right]))


def _frames(stamps: Array, period: float) -> Array:
    """Give the frame of each sample, (N,), from the time per frame [s]."""
    count = len(stamps)
    window = max(2, round(min(MIN_BURST_S / period, count)))
    lag = stamps - np.arange(count) * period
    on_time = minimum_filter1d(lag, window, mode="nearest", origin=-(window // 2))
    steps = np.rint(np.diff(on_time) / period)
    dropped = np.clip(steps, 0, MAX_GAP_FRAMES).astype(int)
    return np.asarray(np.arange(count) + np.concatenate([[0], np.cumsum(dropped)]))


def _slope(stamps: Array, index: Array) -> float:
    """Give the time per frame by a straight line through all time stamps [s]."""
    offset = index - index.mean()
    return float(offset @ (stamps - stamps.mean()) / (offset @ offset))


def _period(stamps: Array, nominal_hz: float) -> float:
    """Give the time per frame [s]: the nominal one where stamps agree with it."""
    count = len(stamps)
    step = max(1, min(round(MIN_BURST_S * (nominal_hz or USUAL_HZ)), count // 4))
    usual = float(np.median(stamps[step:] - stamps[:-step])) / step
    mean = float(stamps[-1] - stamps[0]) / (count - 1)
    if not mean > 0 or not usual > 0:
        raise ValueError("its time stamps do not advance")
    single = float(np.median(np.diff(stamps)))  # of samples that do not come in bursts
    near = (abs(each * nominal_hz - 1) < MAX_RATE_DIFFERENCE for each in (single, usual, mean))
    return 1 / nominal_hz if any(near) else min(usual, mean)
