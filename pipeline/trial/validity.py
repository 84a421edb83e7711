"""Which frames of a trial count: pose known, plates carrying the subject, filters settled."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from hbm.notes import Note
from hbm.signals.filtering import Method
from hbm.signals.samples import stretches
from hbm.spatial import Array, Mask, read_only

SETTLING_PERIODS: Final[Mapping[Method, tuple[float, float]]] = {
    "zero_phase": (1.0, 1.0),
    "realtime": (1.5, 0.0),
}
"""Periods of the cut-off after the first known sample and before the last one in which a filter has
not settled. Measured by cropping a virtual and a real treadmill trial at 16 heel strikes, 6 Hz at
100 Hz: the residual of the frames that are left errs by at most 0.6 N and 0.2 N·m."""
MIN_SETTLING_S: Final = 0.15
"""At higher cut-offs: at 20 Hz, one period leaves 1.7 N and 1.5 of the other filter 4 N, three less
than 0.1 N."""
MAX_DOUBTFUL: Final = 0.15
"""Of what the motion needs: usual errors of gains and stated masses are smaller."""
STEP_S: Final = 0.5
"""About a step; at its ends errors of timing cancel."""


@dataclass(frozen=True, slots=True)
class Validity:
    """Frames in which the motion is known, all support of the body measured, and filters settled.

    Attributes
    ----------
    motion
        Frames in which markers show pelvis and trunk, so that the pose is known, (T,); see
        `pipeline.trial.motion_check.known_frames`. Head, arms and legs without markers are
        interpolated; `hbm.motion.Motion.observed` marks them.
    plates
        Frames in which the plates carry the subject, (T,); see `pipeline.trial.weight_bearing`.
    settled
        Frames far enough from the ends of the recording and from every gap of motion or plates, so
        that the filters have settled, (T,); see `settled_frames`.

    Examples
    --------
    >>> yes, no = True, False
    >>> validity = Validity(np.array([yes, yes, no]), np.array([yes, no, no]), np.array([yes] * 3))
    >>> validity.counts.tolist()
    [True, False, False]
    """

    motion: Mask
    plates: Mask
    settled: Mask

    def __post_init__(self) -> None:
        shapes = []
        for field in fields(self):
            mask = read_only(getattr(self, field.name), bool)
            object.__setattr__(self, field.name, mask)
            shapes.append(mask.shape)
        if len(set(shapes)) > 1 or len(shapes[0]) != 1:
            found = ", ".join(map(str, shapes))
            raise ValueError(
                f"validity: motion, plates and settled must have the same shape (T,), got {found}"
            )

    @property
    def counts(self) -> Mask:
        """Frames that count, (T,)."""
        return np.asarray(self.motion & self.plates & self.settled)


def settling_s(filters: Iterable[tuple[Method, float]]) -> tuple[float, float]:
    """Give how long filters need to settle.

    Parameters
    ----------
    filters
        Method and cut-off [Hz] of each filter that the motion or the plates pass.

    Returns
    -------
    after, before
        The longest time after a first sample and before a last one [s].

    Examples
    --------
    >>> [round(time_s, 3) for time_s in settling_s([("zero_phase", 6.0), ("zero_phase", 20.0)])]
    [0.167, 0.167]
    >>> [round(time_s, 3) for time_s in settling_s([("realtime", 6.0)])]
    [0.25, 0.0]
    """
    periods = [(np.array(SETTLING_PERIODS[method]), cutoff_hz) for method, cutoff_hz in filters]
    times = [
        np.where(needed > 0, np.maximum(needed / cutoff_hz, MIN_SETTLING_S), 0.0)
        for needed, cutoff_hz in periods
    ]
    after, before = np.max(times, axis=0)
    return float(after), float(before)


def settled_frames(known: Mask, time: Array, settling: tuple[float, float]) -> Mask:
    """Find the frames in which filters have settled.

    Parameters
    ----------
    known
        Whether there are samples to filter, (T,). A filter begins anew after every gap.
    time
        (T,) [s].
    settling
        Time after the first and before the last sample of a stretch [s], as `settling_s` gives it.

    Returns
    -------
    Mask
        (T,).

    Examples
    --------
    >>> known = np.array([True] * 6 + [False] + [True] * 4)
    >>> settled_frames(known, np.arange(11) / 100, (0.02, 0.02)).nonzero()[0].tolist()
    [2, 3]
    """
    settled = np.zeros(len(time), bool)
    after_s, before_s = settling
    for start, stop in stretches(known):
        own = time[start:stop]
        settled[start:stop] = (own >= own[0] + after_s) & (own <= own[-1] - before_s)
    return settled


def carried_notes(
    validity: Validity, time: Array, need: Array, measured: Array
) -> tuple[Note, ...]:
    """Say what plates measure of what the motion needs where frames are left out, or doubtful.

    Parameters
    ----------
    validity
        Which frames count.
    time
        (T,) [s].
    need, measured
        Vertical force that the motion needs, and that of all plates, filtered, (T,) [N].

    Returns
    -------
    tuple of Note
        ``frames_not_carried`` where there are such frames; ``carried_in_part`` where, in frames
        that count, plates measure more than `MAX_DOUBTFUL` too little or too much on average over
        `STEP_S`.
    """
    notes, known = [], np.isfinite(need + measured)

    def share(frames: Mask) -> float:
        return float(measured[frames].sum() / need[frames].sum())

    if missing := int(np.count_nonzero(~validity.plates)):
        unsupported = known & ~validity.plates
        percent = f"{100 * share(unsupported):.0f} %" if unsupported.any() else "an unknown part"
        frames = len(validity.plates)
        notes.append(
            Note.of("frames_not_carried", missing=missing, frames=frames, measured=percent)
        )
    counts = known & validity.counts
    long = max(1, round(STEP_S / float(np.median(np.diff(time)))))
    present, needed, found = (
        uniform_filter1d(np.where(counts, each, 0.0), long, mode="constant")
        for each in (np.ones(len(time)), need, measured)
    )
    doubtful = counts & (present > 0.5) & (np.abs(found - needed) > MAX_DOUBTFUL * needed)
    if doubtful.any():
        number = int(np.count_nonzero(doubtful))
        notes.append(
            Note.of(
                "carried_in_part", frames=number, first_s=time[doubtful][0], share=share(doubtful)
            )
        )
    return tuple(notes)
