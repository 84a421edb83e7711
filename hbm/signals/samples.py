"""Samples over time: checks, stretches, and the blocks between gaps."""

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hbm.spatial import Array, Indices, Mask

MIN_SPLINE_SAMPLES: Final = 4
"""Of a cubic spline."""


def sample_times(time: ArrayLike, signal: Array) -> Array:
    """Check sample times against the signal; a single number is a rate and becomes times."""
    times = np.asarray(time, float)
    if signal.ndim == 0 or len(signal) < 2:
        raise ValueError(f"a signal needs at least 2 samples over time, got shape {signal.shape}")
    if times.ndim == 0:
        times = np.arange(len(signal)) / times
    if times.shape != signal.shape[:1]:
        raise ValueError(f"{len(signal)} samples need as many times, got shape {times.shape}")
    if not np.all(np.diff(times) > 0):
        raise ValueError("sample times must increase and be free of NaN")
    return times


def mean_rate_hz(time: Array) -> float:
    """Give the mean sampling rate of sample times (T,) [Hz]."""
    return float((len(time) - 1) / (time[-1] - time[0]))


def require_equal_steps(time: Array) -> None:
    """Refuse sample times (T,) whose steps differ by more than 0.2 %."""
    step = np.diff(time)
    # times that were rounded to 0.01 ms at 100 Hz have equal steps
    if np.ptp(step) > 2e-3 * np.mean(step):
        raise ValueError(
            f"zero-phase filters need equal time steps, got {step.min():.6g} to {step.max():.6g} s;"
            " bring the signal to equal steps with resample() first"
        )


def require_length(time: Array, needed: int) -> None:
    """Refuse fewer samples than needed."""
    if len(time) < needed:
        raise ValueError(
            f"this needs at least {needed} samples at {mean_rate_hz(time):g} Hz, got {len(time)}"
        )


def stretches(mask: Mask) -> Indices:
    """Give first sample and the one after the last of each stretch in which a mask is true, (S, 2).

    Examples
    --------
    >>> stretches(np.array([True, False, True, True])).tolist()
    [[0, 1], [2, 4]]
    """
    between = np.zeros(len(mask) + 2, bool)  # false before and after
    # a stretch begins and ends where the mask changes
    between[1:-1] = mask
    return np.flatnonzero(between[1:] != between[:-1]).reshape(-1, 2)


def median_of(values: Array) -> float:
    """Give the median of numbers, (N,), N > 0; NaN where one is: faster than NumPy's where few.

    Examples
    --------
    >>> median_of(np.array([3.0, 1.0, 2.0, 7.0]))
    2.5
    """
    ordered = np.sort(values)  # NaN last
    if np.isnan(ordered[-1]):
        return float("nan")
    return float((ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2)


def medians_of_known(values: Array) -> Array:
    """Give the medians of what is known, (..., T), along the last axis; NaN where nothing is.

    Examples
    --------
    >>> medians_of_known(np.array([[3.0, np.nan, 1.0, 2.0], [np.nan, 4.0, np.nan, 5.0]])).tolist()
    [2.0, 4.5]
    """
    if not values.shape[-1]:
        return np.full(values.shape[:-1], np.nan)
    # the middle ones of those that are known: unknown ones are sorted last
    count = np.count_nonzero(~np.isnan(values), axis=-1)
    middle = np.stack([(count - 1) // 2, count // 2], axis=-1)
    return np.asarray(np.take_along_axis(np.sort(values), middle, axis=-1).mean(axis=-1))


def without_short_gaps(sampled: Mask, time: Array, longest_s: float) -> Mask:
    """Find samples that are known, or between two known ones that are at most so far apart, (T,).

    Examples
    --------
    >>> known = np.array([False, True, False, True, False, False, True])
    >>> without_short_gaps(known, np.arange(7.0), 2.0).tolist()
    [False, True, True, True, False, False, True]
    """
    filled = sampled.copy()
    for start, stop in stretches(~sampled):
        inside = start > 0 and stop < len(sampled)
        if inside and time[stop] - time[start - 1] <= longest_s:
            filled[start:stop] = True
    return filled


def bridged(columns: Array, time: Array, longest_s: float, degree: int) -> Array:
    """Fill unknown samples (T, K) between known ones that are at most so far apart [s].

    By straight lines (``degree`` 1), which know nothing of what follows, or by cubic splines (3),
    for which four samples are needed.
    """
    filled = columns
    for measured, numbers in _columns_by_gaps(np.isfinite(columns)):
        # only bridged samples are filled; longer gaps stay
        rows = np.flatnonzero(without_short_gaps(measured, time, longest_s) & ~measured)
        if len(rows):
            through, at = columns[measured][:, numbers], time[rows]
            filled = columns.copy() if filled is columns else filled
            place = rows if isinstance(numbers, slice) else np.ix_(rows, numbers)
            if degree == 1 or len(through) < MIN_SPLINE_SAMPLES:
                filled[place] = np.transpose([np.interp(at, time[measured], x) for x in through.T])
            else:
                filled[place] = cubic_spline(time[measured], through)(at)
    return filled


def cubic_spline(time: Array, samples: Array) -> Callable[[Array], Array]:
    """Give the cubic spline through (N, K) samples at any times (N,), four or more of them.

    As `scipy.interpolate.make_interp_spline`, which takes a sixth of a second to load: its first
    two intervals, and its last two, are of one polynomial (de Boor 1978, A Practical Guide to
    Splines, chapter IV).

    Examples
    --------
    >>> time = np.array([0.0, 1.0, 2.0, 4.0])
    >>> cubic_spline(time, time[:, None] ** 3)(np.array([3.0])).round(12).tolist()
    [[27.0]]
    """
    step = np.diff(time)
    before, after = step[:-1, None], step[1:, None]
    slope = np.diff(samples, axis=0) / step[:, None]
    # equal curvatures on both sides of each inner sample, of which each row has three derivatives
    right = np.empty_like(samples)
    right[1:-1] = 3 * (after * slope[:-1] + before * slope[1:])
    # one polynomial over the two intervals at each end
    first, last = step[0] + step[1], step[-2] + step[-1]
    right[0] = ((step[0] + 2 * first) * step[1] * slope[0] + step[0] ** 2 * slope[1]) / first
    right[-1] = (step[-1] ** 2 * slope[-2] + (step[-1] + 2 * last) * step[-2] * slope[-1]) / last
    *_, derivative, _ = scipy.linalg.lapack.dgtsv(
        np.append(step[1:], last),
        np.concatenate([step[1:2], 2 * (step[:-1] + step[1:]), step[-2:-1]]),
        np.append(first, step[:-1]),
        right,
    )
    # of each interval, by values and derivatives at its ends
    excess = derivative[:-1] + derivative[1:] - 2 * slope
    square, cube = slope - derivative[:-1] - excess, excess / step[:, None]

    def evaluate(at: Array) -> Array:
        interval = np.searchsorted(time[1:-1], at, side="right")
        t = (at - time[interval])[:, None]
        curved = (square[interval] + t * cube[interval]) / step[interval, None]
        return np.asarray(samples[interval] + t * (derivative[interval] + t * curved))

    return evaluate


def _columns_by_gaps(sampled: Mask) -> Iterator[tuple[Mask, Mask | slice]]:
    """Give which rows of (T, K) samples are known, and the columns that share them.

    Columns are a slice where all share them, which takes no copy.
    """
    if sampled.size and sampled.all():
        yield sampled[:, 0], slice(None)
        return
    # columns with gaps in the same rows share their blocks
    same: dict[bytes, list[int]] = {}
    columns = np.ascontiguousarray(sampled.T)
    for number, of_column in enumerate(columns):
        same.setdefault(of_column.tobytes(), []).append(number)
    for numbers in same.values():
        shared = slice(None) if len(same) == 1 else np.isin(np.arange(len(columns)), numbers)
        yield columns[numbers[0]], shared


def blocks_without_gaps(columns: Array, needed: int) -> Iterator[tuple[slice, Mask | slice]]:
    """Find blocks of at least ``needed`` finite rows in (T, K), and the columns that share them."""
    for complete, numbers in _columns_by_gaps(np.isfinite(columns)):
        for start, stop in stretches(complete):
            if stop - start >= needed:
                yield slice(start, stop), numbers


def unknown(shape: tuple[int, int]) -> Array:
    """Give (T, K) samples that are all NaN, every channel in one piece of memory.

    Filters take channel by channel, and so do sums over time: in one piece, these take a fifth to a
    tenth of the time.
    """
    return np.full(shape[::-1], np.nan).T


def extended(signal: Array, count: int) -> Array:
    """Extend (T, K) samples at both ends by reflection through the end samples.

    Every channel of the result is in one piece of memory.
    """
    ends = ((0, 0), (count, count))
    return np.pad(signal.T, ends, mode="reflect", reflect_type="odd").T
