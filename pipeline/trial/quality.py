"""Which frames count, and why others do not: one integer of flags per frame."""

from collections.abc import Iterable, Mapping
from enum import IntFlag
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.filtering import Method
from hbm.signals.samples import stretches
from hbm.spatial import Array, Indices, Mask

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "quality")


class Quality(IntFlag):
    """Why a frame does not count, or counts in part; 0 where nothing is doubtful.

    The flags of whole trials and of live frames: each holds one integer per frame.

    Examples
    --------
    >>> (Quality.SETTLING | Quality.MARKERS_LEFT_OUT).counts
    False
    >>> Quality.MARKERS_LEFT_OUT.counts
    True
    """

    POSE_UNKNOWN = 1
    """Markers do not show pelvis and trunk."""
    LIMB_UNSEEN = 2
    """Markers do not show a leg, one of its joints, or the pelvis: it keeps its last pose."""
    FORCES_UNKNOWN = 4
    """A plate, an accelerometer or a belt has no samples around the frame."""
    PLATFORM_UNKNOWN = 8
    """The platform's pose is not known, or its neutral one is still measured."""
    LATE = 16
    """Samples did not arrive in time."""
    SETTLING = 32
    """The filters have not settled: near a gap, or near an end of the recording."""
    FOOT_UNCERTAIN = 64
    """Whose foot is on a plate: the joint moments of the legs are uncertain, residuals are not."""
    MARKERS_LEFT_OUT = 128
    """Single markers were far from where the body can be."""
    MARKERS_FROZEN = 256
    """All markers repeat their positions exactly: they are not measured."""
    NOT_CARRIED = 512
    """A foot stands beside the plates, or on one that measures nothing."""
    BRIDGED = 1024
    """Lost, in a gap so short that the filters go on over it."""

    @property
    def counts(self) -> bool:
        """Whether the residuals of the frame count."""
        return not self & DOES_NOT_COUNT


DOES_NOT_COUNT: Final = Quality(sum(Quality)) & ~(Quality.FOOT_UNCERTAIN | Quality.MARKERS_LEFT_OUT)
"""Flags of frames in which residuals do not count."""
NO_SUPPORT: Final = Quality.FORCES_UNKNOWN | Quality.PLATFORM_UNKNOWN | Quality.NOT_CARRIED
"""Flags of frames in which the plates are not known to carry the subject."""


def frames_within(time: Array, *spans: ArrayLike) -> Mask:
    """Give whether each time, (T,), is in one of the spans, each (N, 2) [s]; none is in NaN."""
    inside = np.zeros(len(time), bool)
    for start, stop in np.concatenate([np.reshape(of_kind, (-1, 2)) for of_kind in (*spans, ())]):
        if start < stop:  # neither is NaN
            inside[slice(*np.searchsorted(time, (start, stop)))] = True
    return inside


def free_of(quality: Indices, flags: Quality = DOES_NOT_COUNT) -> Mask:
    """Find the frames without any of some flags, (T,); by default those that count.

    Examples
    --------
    >>> quality = np.array([0, Quality.SETTLING, Quality.FOOT_UNCERTAIN])
    >>> free_of(quality).tolist(), free_of(quality, Quality.FOOT_UNCERTAIN).tolist()
    ([True, False, True], [True, True, False])
    """
    return np.asarray(quality & int(flags) == 0)


def flagged(flags: Mapping[Quality, Mask]) -> Indices:
    """Give the flags of every frame, (T,), from the frames of each flag, (T,)."""
    return np.asarray(sum(np.where(frames, int(flag), 0) for flag, frames in flags.items()))


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
    # filters in a row settle about as long as the slowest of them
    longest_s = np.zeros(2)
    for method, cutoff_hz in filters:
        periods = np.array(LIMITS.settling_periods[method])
        # periods of the cut-off, but at least a time that does not depend on it
        needed_s = np.where(
            periods > 0, np.maximum(periods / cutoff_hz, LIMITS.shortest_settling), 0.0
        )
        longest_s = np.maximum(longest_s, needed_s)
    return float(longest_s[0]), float(longest_s[1])


def settled_frames(sampled: Mask, time: Array, settling: tuple[float, float]) -> Mask:
    """Find the frames in which filters have settled.

    Parameters
    ----------
    sampled
        Whether there are samples to filter, or a gap is bridged, (T,). A filter begins anew after
        every other gap.
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
    # times are rounded to less than a microsecond
    after_s, before_s = (time_s - 1e-6 for time_s in settling)
    for start, stop in stretches(sampled):
        stretch = time[start:stop]
        settled[start:stop] = (stretch >= stretch[0] + after_s) & (
            stretch <= stretch[-1] - before_s
        )
    return settled


def carried_notes(
    quality: Indices, time: Array, need: Array, measured: Array
) -> tuple[tuple[Note, ...], tuple[Note, ...]]:
    """Say what plates measure of what the motion needs where frames are left out, or doubtful.

    Parameters
    ----------
    quality
        Flags of every frame, (T,).
    time
        (T,) [s].
    need, measured
        Vertical force that the motion needs, and that of all plates, filtered, (T,) [N].

    Returns
    -------
    notes
        ``plates_shared`` and ``frames_not_carried`` where there are such frames.
    doubtful
        ``carried_in_part`` where, in frames that count, plates measure 15 % too little or too much
        on average over half a second.
    """
    notes, is_known, frames = [], np.isfinite(need + measured), len(quality)
    if shared := np.count_nonzero(~free_of(quality, Quality.FOOT_UNCERTAIN)):
        notes.append(Note.of("plates_shared", shared=shared, frames=frames))
    carried = free_of(quality, NO_SUPPORT)

    def share(frames: Mask) -> float:
        return float(measured[frames].sum() / need[frames].sum())

    # of frames without support: which part of the need the plates measured
    if missing := np.count_nonzero(~carried):
        unsupported = is_known & ~carried
        part = f"{100 * share(unsupported):.0f} %" if unsupported.any() else "an unknown part"
        notes.append(Note.of("frames_not_carried", missing=missing, frames=frames, measured=part))
    counts = is_known & free_of(quality)
    # means over about a step, of frames that count alone
    long = max(1, round(LIMITS.step / float(np.median(np.diff(time)))))
    present, needed, carries = (
        scipy.ndimage.uniform_filter1d(np.where(counts, signal, 0.0), long, mode="constant")
        for signal in (np.ones(len(time)), need, measured)
    )
    # at least half of the step has to count
    doubtful = counts & (present > 0.5) & (np.abs(carries - needed) > LIMITS.doubtful * needed)
    if not doubtful.any():
        return tuple(notes), ()
    size = {"frames": doubtful.sum(), "first_s": time[doubtful][0], "share": share(doubtful)}
    return tuple(notes), (Note.of("carried_in_part", **size),)
