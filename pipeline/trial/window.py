"""What of a trial counts: its gait cycles, or a span of the recording."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array, Mask
from pipeline.io.recording import Event
from pipeline.trial.gait.cycle_shortage import cycle_shortage
from pipeline.trial.gait.cycles import found_cycles
from pipeline.trial.gait.events import SIDES
from pipeline.trial.validity import Validity

Span = tuple[float, float]
WantedWindow = Literal["cycle", "recording"] | Span | None
"""What is to count; None for gait cycles or, where none counts, the whole recording."""


def counted_span(
    wanted: WantedWindow, cycles: Mapping[str, Array], time: Array, settling: tuple[float, float]
) -> Span | None:
    """Give the span of a recording that counts in place of gait cycles.

    Parameters
    ----------
    wanted
        "cycle", "recording", a span [s], or None for gait cycles where there are any.
    cycles
        Side -> the gait cycles that were selected, (C, 2) [s].
    time
        (T,) [s].
    settling
        Time [s] that the filters need at the start and at the end of a recording
        (`pipeline.trial.validity.settling_s`).

    Returns
    -------
    tuple or None
        Start and stop [s]; None where gait cycles count.

    Raises
    ------
    ValueError
        If the recording is too short for the filters to settle, or the stated span holds no frame
        in which they have.

    Examples
    --------
    >>> time = np.arange(1000) / 100
    >>> start, stop = counted_span("recording", {}, time, (1 / 6, 1 / 6))
    >>> f"{start:.2f} to {stop:.2f} s"
    '0.17 to 9.82 s'
    """
    if wanted == "cycle" or (wanted is None and any(map(len, cycles.values()))):
        return None
    settled = float(time[0] + settling[0]), float(time[-1] - settling[1])
    if settled[0] >= settled[1]:
        raise ValueError(
            f"the recording lasts {time[-1] - time[0]:.2f} s; its filters need {settling[0]:.2f} s "
            f"at its start and {settling[1]:.2f} s at its end to settle"
        )
    if wanted is None or isinstance(wanted, str):
        return settled
    span = max(wanted[0], settled[0]), min(wanted[1], settled[1])
    if not ((time >= span[0]) & (time < span[1])).any():
        raise ValueError(
            f"the span {wanted[0]:g} to {wanted[1]:g} s holds no frame; the recording can be used "
            f"from {settled[0]:.2f} to {settled[1]:.2f} s"
        )
    return span


def frames_within(time: Array, cycles: Mapping[str, Array], span: Span | None) -> Mask:
    """Give whether each time, (T,), is in the span or, without one, in a gait cycle."""
    inside = np.zeros(len(time), bool)
    for start, stop in [span] if span else np.concatenate([*cycles.values(), np.empty((0, 2))]):
        inside |= (time >= start) & (time < stop)
    return inside


def window_notes(
    wanted: WantedWindow,
    span: Span | None,
    cycles: Mapping[str, Array],
    *,
    events: Sequence[Event],
    rejected: Iterable[Note],
    time: Array,
    validity: Validity,
) -> tuple[Note, ...]:
    """Say why the recording counts in place of gait cycles, or why nothing counts.

    Parameters
    ----------
    wanted, span
        What was to count, and what `counted_span` gave.
    cycles
        Side -> the gait cycles that were selected, (C, 2) [s].
    events
        The trial's gait events.
    rejected
        Why gait cycles were left out.
    time
        (T,) [s].
    validity
        Which frames count.

    Returns
    -------
    tuple of Note
        ``no_residuals`` where no frame counts; else, where gait cycles were wanted and none counts,
        ``no_gait_cycle`` or, if there are some, ``gait_cycles_left_out``.
    """
    counts = frames_within(time, cycles, span) & validity.counts
    reason = cycle_shortage(events, rejected, time, validity.motion)
    if not counts.any():
        nothing = reason if span is None else _nothing_counts(span, time, validity)
        return (Note.of("no_residuals", reason=nothing),)
    if span is None or wanted is not None:
        return ()
    code = "gait_cycles_left_out" if found_cycles(events, SIDES) else "no_gait_cycle"
    return (Note.of(code, reason=reason, start_s=span[0], stop_s=span[1]),)


def shortage(notes: Iterable[Note]) -> str:
    """Say why a trial has no residuals; empty where its notes do not."""
    return next((str(note.values["reason"]) for note in notes if note.code == "no_residuals"), "")


def _nothing_counts(span: Span, time: Array, validity: Validity) -> str:
    inside = frames_within(time, {}, span)
    frames = np.count_nonzero(inside)
    unsolved = np.count_nonzero(inside & ~validity.motion)
    if unsolved == frames:
        return (
            f"no frame from {span[0]:.2f} to {span[1]:.2f} s could be solved; check the markers' "
            "labels and the calibration pose"
        )
    others = f" ({unsolved} of {frames} frames could not be solved)" if unsolved else ""
    return f"the plates carry the subject in no frame from {span[0]:.2f} to {span[1]:.2f} s{others}"
