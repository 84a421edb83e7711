"""Standing still: means over tenths of a second, and how far a subject moves in a few of them."""

from typing import Final

import numpy as np

from hbm.spatial import Array, Indices, Mask

TENTH_S: Final = 0.1
"""Noise of plates and markers averages out in it, and a subject who stands hardly moves."""
MAX_STILL_EXTENT_M: Final = 0.02
"""Extent of the path of the median marker in a second: postural sway is smaller, a step larger."""
ROUNDING: Final = 1e-3
"""Of a tenth: times may be stored in single precision."""


def common_tenths(*times: Array) -> tuple[float, int]:
    """Give when signals have all begun, and for how many tenths of a second they all last.

    Parameters
    ----------
    times
        Sample times of each signal, (N,) [s]; a sample stands for one time step, a single one for
        no time.

    Returns
    -------
    begin_s, count
        Start [s], and number of complete tenths from there on.
    """
    begin_s = max(float(time[0]) for time in times)
    if min(map(len, times)) < 2:
        return begin_s, 0
    end_s = min(float(time[-1]) + _step_s(time) for time in times)
    return begin_s, max(0, int((end_s - begin_s) / TENTH_S + ROUNDING))


def tenths(values: Array, time: Array, begin_s: float, count: int) -> Array:
    """Give the means of a signal over successive tenths of a second.

    Parameters
    ----------
    values
        Samples, (N, ...); those that are missing (NaN) do not count.
    time
        (N,) [s], increasing.
    begin_s, count
        When the first tenth begins [s], and how many there are.

    Returns
    -------
    Array
        (count, ...); NaN where no sample is known.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(7) / 20
    >>> tenths(np.arange(7.0), time, *common_tenths(time)).tolist()
    [0.5, 2.5, 4.5]
    """
    edges = np.searchsorted(time, begin_s - _step_s(time) / 2 + TENTH_S * np.arange(count + 1))
    values = values[: edges[-1]]
    known = np.isfinite(values)
    number = np.diff(edges).reshape(-1, *(1,) * (values.ndim - 1))
    if not known.all():
        values, number = np.where(known, values, 0.0), _sums_between(edges, known)
    return np.where(number > 0, _sums_between(edges, values) / np.maximum(number, 1), np.nan)


def median_extent(position: Array) -> float:
    """Give how far the median marker moves.

    Parameters
    ----------
    position
        Markers, (B, K, 3) [m]; gaps are NaN.

    Returns
    -------
    float
        Diagonal of the box that its path fills [m]; NaN where no marker is known.
    """
    box = np.fmax.reduce(position, axis=0) - np.fmin.reduce(position, axis=0)
    extent = np.linalg.norm(box, axis=-1)
    known = extent[np.isfinite(extent)]
    return float(np.median(known)) if len(known) else np.nan


def _step_s(time: Array) -> float:
    return float(time[-1] - time[0]) / (len(time) - 1)


def _sums_between(edges: Indices, values: Array | Mask) -> Array:
    """Give the sums of samples from each edge, (E,), to the next, (E − 1, ...).

    The samples, (N, ...), end at the last edge.
    """
    sums, filled = np.zeros((len(edges) - 1, *values.shape[1:])), np.diff(edges) > 0
    sums[filled] = np.add.reduceat(values, edges[:-1][filled], axis=0, dtype=float)
    return sums
