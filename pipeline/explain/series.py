"""How frames become coefficients: Fourier series of gait cycles, cosines of stretches of frames."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from hbm.spatial import Array, Indices, Mask


@dataclass(frozen=True, slots=True, eq=False)
class CycleSeries:
    """How frames become Fourier coefficients of each gait cycle.

    The coefficients are those of least squares over the frames of a cycle, scaled so that the sum
    of their squares is the mean square over the cycle. In frames that do not count, signals are
    taken as zero.

    Attributes
    ----------
    frames
        Per cycle its frames that count.
    inverse
        Per cycle what gives its coefficients from these frames, (B, N): the mean, and sine and
        cosine of each harmonic.
    """

    frames: tuple[Indices, ...]
    inverse: tuple[Array, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def coefficients(self, signal: Array) -> Array:
        """Give the coefficients of a signal, (…, T, 6) to (…, C, B, 6)."""
        parts = [
            inverse @ signal[..., frames, :]
            for inverse, frames in zip(self.inverse, self.frames, strict=True)
        ]
        return np.stack(parts, axis=-3)

    def some(self, cycles: slice) -> "CycleSeries":
        """Give the same of some of the cycles."""
        return CycleSeries(self.frames[cycles], self.inverse[cycles])


def cycle_series(
    time: Array, spans: Sequence[tuple[float, float]], to_hz: float, counts: Mask | None = None
) -> CycleSeries:
    """Find how the frames of gait cycles become Fourier coefficients.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    spans
        Start and stop of each cycle, half-open, (C, 2) [s].
    to_hz
        Up to which frequency [Hz]; no more than a third of the frames of a cycle allow.
    counts
        Whether each frame counts, (T,); by default all do.

    Returns
    -------
    CycleSeries
        With the mean, and sine and cosine of each harmonic of the cycle.

    Examples
    --------
    >>> time = np.arange(0, 2, 0.01)
    >>> series = cycle_series(time, [(0.0, 1.0), (1.0, 2.0)], 2.0)
    >>> signal = np.tile(3 + 4 * np.sin(2 * np.pi * time)[:, None], (1, 6))
    >>> np.abs(series.coefficients(signal)[0, :3, 0]).round(3).tolist()
    [3.0, 2.828, 0.0]
    """
    counts = np.ones(len(time), bool) if counts is None else counts
    cycles = [np.arange(*np.searchsorted(time, span)) for span in spans]
    frames = tuple(cycle[counts[cycle]] for cycle in cycles)
    # all cycles have as many harmonics; sine and cosine leave three frames for each coefficient
    duration = float(np.median([stop - start for start, stop in spans]))
    harmonics = max(1, min(int(np.ceil(to_hz * duration)), min(map(len, frames)) // 6))
    inverse = []
    for (start, stop), cycle in zip(spans, cycles, strict=True):
        phase = 2 * np.pi * (time[cycle] - start) / (stop - start)
        # sines and cosines of mean square one, so that squares of coefficients add up to it
        waves = [np.ones(len(phase))]
        for h in range(1, harmonics + 1):
            waves += [np.sqrt(2) * np.sin(h * phase), np.sqrt(2) * np.cos(h * phase)]
        # leaving columns out takes the signal as zero in frames that do not count
        inverse.append(np.linalg.pinv(np.column_stack(waves))[:, counts[cycle]])
    return CycleSeries(frames, tuple(inverse))


def stretch_series(time: Array, bounds: Indices, to_hz: float) -> CycleSeries:
    """Find how stretches of frames that repeat nothing become coefficients: as of one gait cycle.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    bounds
        First frame of each and the one after its last, (N, 2).
    to_hz
        Up to which frequency [Hz].

    Returns
    -------
    CycleSeries
        With the mean and cosines of each stretch, by its share of all frames: half a period of a
        cosine passes from one end of a stretch to the other, which need not be alike.

    Examples
    --------
    >>> series = stretch_series(np.arange(0, 1, 0.01), np.array([[0, 40], [50, 90]]), 2.0)
    >>> abs(series.coefficients(np.full((100, 6), 2.0))[0, :, 0]).round(3).tolist()
    [1.414, 0.0, 1.414, 0.0]
    """
    frames = np.concatenate([np.arange(*stretch) for stretch in bounds])
    inverse = []
    for count in np.diff(bounds).ravel().tolist():
        duration_s = count * (time[-1] - time[0]) / (len(time) - 1)
        # wave k has k / 2 periods in the stretch; three frames for each coefficient at least
        waves = np.arange(max(1, min(int(2 * to_hz * duration_s), count // 3)) + 1)
        # frames at the middles of as many intervals: cosines are orthogonal there
        phase = np.pi * (np.arange(count) + 0.5) / count
        basis = np.cos(np.outer(phase, waves)) * np.where(waves, np.sqrt(2), 1)
        # weighed by length, so that squares add up to the mean square over all stretches
        inverse.append(np.linalg.pinv(basis) * np.sqrt(count / len(frames)))
    return CycleSeries((frames,), (scipy.linalg.block_diag(*inverse),))
