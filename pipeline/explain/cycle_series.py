"""Signals of gait cycles as Fourier series: what repeats, apart from what does not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbm.spatial import Array, Indices, Mask, read_only


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
        Per cycle what gives its coefficients from these frames, (B, N).
    frequency
        Of each coefficient, (B,) [Hz], for a cycle of median duration.
    """

    frames: tuple[Indices, ...]
    inverse: tuple[Array, ...]
    frequency: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency", read_only(self.frequency))

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
        return CycleSeries(self.frames[cycles], self.inverse[cycles], self.frequency)


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
    >>> series.frequency.tolist()
    [0.0, 1.0, 1.0, 2.0, 2.0]
    """
    every = [np.arange(*np.searchsorted(time, span)) for span in spans]
    counted = [np.ones(len(each), bool) if counts is None else counts[each] for each in every]
    fewest = min(int(own.sum()) for own in counted)
    duration = float(np.median([stop - start for start, stop in spans]))
    harmonics = max(1, min(int(np.ceil(to_hz * duration)), fewest // 6))
    inverse = []
    for (start, stop), each, own in zip(spans, every, counted, strict=True):
        phase = 2 * np.pi * (time[each] - start) / (stop - start)
        waves = [np.ones(len(phase))]
        for h in range(1, harmonics + 1):
            waves += [np.sqrt(2) * np.sin(h * phase), np.sqrt(2) * np.cos(h * phase)]
        inverse.append(np.linalg.pinv(np.column_stack(waves))[:, own])
    order = np.repeat(np.arange(harmonics + 1), 2)[1:]
    frames = tuple(each[own] for each, own in zip(every, counted, strict=True))
    return CycleSeries(frames, tuple(inverse), order / duration)
