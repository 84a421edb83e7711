"""Signals that are later than they were."""

import numpy as np

from hbm.signals.resampling import interpolate
from hbm.spatial import Array


def delayed(time: Array, values: Array, delay_s: float) -> Array:
    """Give a signal that comes later.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    values
        (T, ...); gaps are NaN.
    delay_s
        By how much [s]; negative for earlier.

    Returns
    -------
    Array
        (T, ...). Before the first and after the last known value these are held; gaps stay where
        they are.

    Examples
    --------
    >>> time = np.arange(6.0)
    >>> delayed(time, time**2, 0.5).round(2).tolist()
    [0.0, 0.25, 2.25, 6.25, 12.25, 20.25]
    """
    at = np.clip(time - delay_s, time[0], time[-1])
    later = interpolate(time, values, at)
    return np.asarray(np.where(np.isnan(later), values, later))
