"""The newest samples of a stream: in order, each once, in memory that does not grow."""

import numpy as np

from hbm.spatial import Array, Mask


class SampleBuffer:
    """The newest samples of one stream.

    Parameters
    ----------
    columns
        Channels K.
    length
        Samples that are kept at least.

    Attributes
    ----------
    out_of_order, doubled
        Samples that were left out since one that is later, or as late, was there already.

    Examples
    --------
    >>> buffer = SampleBuffer(columns=1, length=3)
    >>> buffer.append(np.array([0.0, 0.1, 0.1, 0.2]), np.ones((4, 1))).tolist()
    [True, True, False, True]
    >>> buffer.newest_s, buffer.doubled
    (0.2, 1)
    """

    def __init__(self, columns: int, length: int) -> None:
        self.length = length
        self._time, self._values = np.empty(2 * length), np.empty((2 * length, columns))
        self._stop = 0
        self.newest_s = -np.inf
        self.out_of_order = self.doubled = 0

    @property
    def time(self) -> Array:
        """Times of the samples that are kept, (N,) [s]; valid until the next are appended."""
        return self._time[: self._stop]

    @property
    def values(self) -> Array:
        """The samples, (N, K); valid until the next are appended."""
        return self._values[: self._stop]

    def append(self, time: Array, values: Array) -> Mask:
        """Take samples, (N,) [s] and (N, K), that follow the last one; give which do, (N,)."""
        taken = np.ones(len(time), bool) if self._follow(time) else self._in_order(time)
        if not taken.all():
            time, values = time[taken], values[taken]
        time, values = time[-self.length :], values[-self.length :]
        if self._stop + len(time) > len(self._time):
            kept_before = slice(max(0, self._stop - self.length + len(time)), self._stop)
            moved = kept_before.stop - kept_before.start
            self._time[:moved] = self._time[kept_before].copy()
            self._values[:moved] = self._values[kept_before].copy()
            self._stop = moved
        place = slice(self._stop, self._stop + len(time))
        self._time[place], self._values[place] = time, values
        self._stop = place.stop
        if len(time):
            self.newest_s = float(time[-1])
        return taken

    def _follow(self, time: Array) -> bool:
        if not len(time):
            return True
        ends = time[0] > self.newest_s and time[-1] < np.inf
        return bool(ends and (len(time) == 1 or (time[1:] > time[:-1]).all()))

    def _in_order(self, time: Array) -> Mask:
        """Give which samples are later than all before them, (N,), and count the others."""
        later = np.where(np.isfinite(time), time, -np.inf)
        before = np.maximum.accumulate(np.concatenate([[self.newest_s], later]))
        kept = later > before[:-1]
        doubled = int(np.count_nonzero(time == before[:-1]))
        self.doubled += doubled
        self.out_of_order += int(np.count_nonzero(~kept)) - doubled
        return np.asarray(kept)
