"""Samples over time: checks, stretches, and the blocks between gaps."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hbm.spatial import Array, Indices, Mask

MAX_STEP_DIFFERENCE: Final = 2e-3
"""Difference between time steps that count as equal, relative to their mean: times rounded to
0.01 ms at 100 Hz."""


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
    if np.ptp(step) > MAX_STEP_DIFFERENCE * np.mean(step):
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
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


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


def blocks_without_gaps(columns: Array, needed: int) -> Iterator[tuple[slice, Mask | slice]]:
    """Find blocks of at least ``needed`` finite rows in (T, K), and the columns that share them.

    Columns are a slice where all share them, which takes no copy.
    """
    finite = np.isfinite(columns)
    if finite.size and finite.all():
        if len(columns) >= needed:
            yield slice(0, len(columns)), slice(None)
        return
    same_gaps: dict[bytes, list[int]] = {}
    known = np.ascontiguousarray(finite.T)
    for number, of_column in enumerate(known):
        same_gaps.setdefault(of_column.tobytes(), []).append(number)
    for numbers in same_gaps.values():
        chosen: Mask | slice = slice(None)
        if len(same_gaps) > 1:
            chosen = np.isin(np.arange(len(known)), numbers)
        for start, stop in stretches(known[numbers[0]]):
            if stop - start >= needed:
                yield slice(start, stop), chosen


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
