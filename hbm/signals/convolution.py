"""Signals at other times by cubic convolution: a weighted mean over a short, symmetric reach.

What arrives while it is measured can be resampled by it: a value is known once the samples within
its reach have arrived, and no later sample changes it. Times of samples need not be equal steps.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, Indices, Mask

REACH_STEPS: Final = 2
"""To either side, in steps of the slower one of the two clocks."""
MAX_LOST_SAMPLES: Final = 2.5
"""Longest step between samples within the reach, in steps of their own; a longer one is a gap."""
MAX_GAP_STEPS: Final = 1.5
"""The same in steps of the slower clock: over a longer one the weights nearly cancel."""
SMALLEST_ARM: Final = 1e-9
"""Sum of squared distances, in steps of the slower clock, below which no second sample shows a
slope."""
TINY: Final = 1e-300
"""Avoids the division of zero by zero where there is no sample."""
INSTANTS_AT_ONCE: Final = 4000
"""Bounds the memory for samples within reach."""


@dataclass(frozen=True, slots=True)
class Convolution:
    """How samples at one rate are brought to instants at another.

    Attributes
    ----------
    step_s
        Of the samples [s].
    scale_s
        Step of the slower one of the two clocks [s].

    Notes
    -----
    The value at t is the mean of the samples with the weights ``h((t_k − t) / scale)``, h the cubic
    convolution kernel (Keys 1981, IEEE Trans Acoust Speech Signal Process 29:1153), plus what makes
    it reproduce straight lines whatever the steps. At equal rates it interpolates, and quadratic
    functions are reproduced; from a faster clock it passes 6 Hz to 0.03 % and 10 Hz to 0.2 % at
    100 Hz, and what would alias to below 6 Hz is 65 dB down. It delays nothing, and needs the
    samples of two steps (20 ms at 100 Hz) to either side.

    Examples
    --------
    >>> resampling = Convolution.between(1000.0, 100.0)
    >>> resampling.reach_s
    0.02
    >>> time = np.arange(0, 1, 0.001)
    >>> at = np.array([0.5, 0.51])
    >>> resampling.evaluate(time, np.sin(2 * np.pi * time)[:, None], at).round(4).ravel()
    array([ 0.    , -0.0628])
    """

    step_s: float
    scale_s: float

    @classmethod
    def between(cls, rate_hz: float, new_rate_hz: float) -> "Convolution":
        """Give what brings samples at one rate to another.

        Rates [Hz] are rounded to whole ones, so that the weights do not depend on how long a
        recording was when its rate was measured, nor on the drift of a clock.
        """
        step_s, new_step_s = (1 / max(round(rate), 1) for rate in (rate_hz, new_rate_hz))
        return cls(step_s, max(step_s, new_step_s))

    @property
    def reach_s(self) -> float:
        """How far samples count to either side [s]."""
        return REACH_STEPS * self.scale_s

    @property
    def longest_s(self) -> float:
        """Longest step between samples that is no gap [s]."""
        return min(MAX_LOST_SAMPLES * self.step_s, MAX_GAP_STEPS * self.scale_s)

    def evaluate(self, time: Array, values: Array, at: Array) -> Array:
        """Give a signal at some instants.

        Parameters
        ----------
        time
            Sample times, (N,) [s], increasing.
        values
            Samples, (N, K); NaN where missing.
        at
            Wanted instants, (T,) [s].

        Returns
        -------
        Array
            (T, K); NaN where a sample within reach is NaN, where the samples leave a gap, and where
            they end before the reach does.
        """
        if len(at) == 1:
            return self._at_one(time, values, float(at[0]))[None]
        result = np.empty((len(at), values.shape[1]))
        for first in range(0, len(at), INSTANTS_AT_ONCE):
            block = slice(first, first + INSTANTS_AT_ONCE)
            result[block] = self._at_many(time, values, at[block])
        return result

    def _at_many(self, time: Array, values: Array, at: Array) -> Array:
        start = np.searchsorted(time, at - self.reach_s, side="right")
        stop = np.searchsorted(time, at + self.reach_s, side="left")
        count = int((stop - start).max(initial=0))
        if not count:
            return np.full((len(at), values.shape[1]), np.nan)
        index: Indices = start[:, None] + np.arange(count)
        inside = index < stop[:, None]
        index = np.minimum(index, len(time) - 1)
        later = np.where(inside, time[index] - at[:, None], self.reach_s)
        weights, known = self._weights(later)
        result = (weights[:, None, :] @ np.where(inside[..., None], values[index], 0.0))[:, 0]
        result[~known] = np.nan
        return np.asarray(result)

    def _at_one(self, time: Array, values: Array, at: float) -> Array:
        """Do the same for one instant, (K,), in a third of the time."""
        start = int(time.searchsorted(at - self.reach_s, side="right"))
        stop = int(time.searchsorted(at + self.reach_s, side="left"))
        later = time[start:stop] - at
        if not self._is_known(later):
            return np.full(values.shape[1], np.nan)
        u = np.abs(later) / self.scale_s
        weights = _cubic(u)
        weights /= weights.sum()
        near = 1 - u * u / REACH_STEPS**2
        near *= near
        tilt = near * (later - near.dot(later) / near.sum())
        arm = float(tilt.dot(later))
        if arm > SMALLEST_ARM * self.scale_s**2:
            weights -= tilt * (weights.dot(later) / arm)
        return np.asarray(weights @ values[start:stop])

    def _is_known(self, later: Array) -> bool:
        if not len(later):
            return False
        reach_s, longest_s = self.reach_s, self.longest_s
        if later[0] + reach_s > longest_s or reach_s - later[-1] > longest_s:
            return False
        return len(later) == 1 or bool((later[1:] - later[:-1]).max() <= longest_s)

    def _weights(self, later: Array) -> tuple[Array, Mask]:
        """Give the weights of samples, (T, n), by how much later they are, and which are known.

        Samples that are as late as the reach have none.
        """
        reach_s, longest_s = self.reach_s, self.longest_s
        known = (later[:, 0] + reach_s <= longest_s) & (reach_s - later[:, -1] <= longest_s)
        if later.shape[1] > 1:
            known &= (later[:, 1:] - later[:, :-1]).max(axis=1) <= longest_s
        u = np.abs(later) / self.scale_s
        weights = _cubic(u)
        total = weights.sum(axis=1, keepdims=True)
        total[~known] = 1.0
        weights /= total
        near = 1 - u * u / REACH_STEPS**2
        near *= near
        total = near.sum(axis=1, keepdims=True) + TINY
        tilt = near * (later - (near * later).sum(axis=1, keepdims=True) / total)
        moment = (weights * later).sum(axis=1, keepdims=True)
        arm = (tilt * later).sum(axis=1, keepdims=True)
        moment[arm <= SMALLEST_ARM * self.scale_s**2] = 0.0
        weights -= tilt * (moment / (arm + TINY))
        return weights, known


def _cubic(u: Array) -> Array:
    """Give the cubic convolution kernel at distances up to 2 steps."""
    from_one = 1 - u
    inner = np.maximum(from_one, 0)
    return np.asarray(0.5 * from_one * (2 - u) ** 2 + inner * inner * (2 * u - 1))
