"""Gait cycles, and signals over 0–100 % of a cycle."""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hbm.notes import Note
from hbm.signals.resampling import interpolate
from hbm.spatial import Array, Indices
from pipeline.io.recording import Event
from pipeline.trial.gait.events import SIDES, event_times
from pipeline.trial.quality import NO_SUPPORT, Quality, free_of

MIN_DURATION: Final = 0.6
MAX_DURATION: Final = 1.5
"""Of a gait cycle, in medians of the trial: a missed or surplus foot strike makes 2 or 0.5."""


def gait_cycles(events: Iterable[Event], side: str) -> tuple[Array, tuple[Note, ...]]:
    """Cut a trial into gait cycles, from foot strike to foot strike of one side.

    Parameters
    ----------
    events
        Gait events.
    side
        "left" or "right".

    Returns
    -------
    spans
        Start and stop of each plausible cycle, half-open, (C, 2) [s].
    rejected
        Why cycles were left out: ``cycle_duration`` outside 0.6 to 1.5 medians, or
        ``cycle_events`` that do not alternate (the foot does not leave the ground once, or the
        other foot does not strike once), judged where the trial has events of that kind at all.

    Raises
    ------
    ValueError
        If the side is neither "left" nor "right".
    """
    if side not in SIDES:
        raise ValueError(f'side must be "left" or "right", got {side!r}')
    events = tuple(events)
    strikes = event_times(events, "foot_strike", side)
    spans = np.column_stack([strikes[:-1], strikes[1:]])
    duration = np.diff(spans, axis=1)[:, 0]
    expected = [("foot_off", side), ("foot_strike", SIDES[1 - SIDES.index(side)])]
    within = {kind: event_times(events, *kind) for kind in expected}
    accepted: list[bool] = []
    rejected: list[Note] = []
    typical = np.median(duration) if len(duration) else np.nan
    for start, stop in spans:
        cycle = {"side": side, "start_s": start, "stop_s": stop}
        ratio = (stop - start) / typical
        if not MIN_DURATION <= ratio <= MAX_DURATION:
            rejected.append(Note.of("cycle_duration", **cycle, ratio=ratio))
            accepted.append(False)
            continue
        counts = {
            f"{foot} {label.replace('_', ' ')}": np.count_nonzero((times > start) & (times < stop))
            for (label, foot), times in within.items()
            if times.size
        }
        wrong = {event: count for event, count in counts.items() if count != 1}
        rejected += [
            Note.of("cycle_events", **cycle, event=event, count=count)
            for event, count in wrong.items()
        ]
        accepted.append(not wrong)
    return spans[np.array(accepted, bool)], tuple(rejected)


def cut_cycles(
    events: Sequence[Event], time: Array, quality: Indices, min_valid_share: float
) -> tuple[dict[str, Array], tuple[Note, ...]]:
    """Cut gait cycles of both sides; leave out those of which too little counts, with the reason.

    Parameters
    ----------
    events
        Gait events.
    time
        (T,) [s].
    quality
        Flags of every frame, (T,).
    min_valid_share
        Of a cycle's frames that count: with less the cycle is left out.

    Returns
    -------
    cycles
        Side -> start and stop of each cycle, (C, 2) [s].
    rejected
        Why cycles were left out: as `gait_cycles`, ``cycle_outside`` the recorded markers,
        ``cycle_unsolved``, ``cycle_not_carried`` or ``cycle_unsettled``.
    """
    cycles: dict[str, Array] = {}
    rejected: list[Note] = []
    known = free_of(quality, Quality.POSE_UNKNOWN)
    masks = free_of(quality, NO_SUPPORT), free_of(quality)
    for side in SIDES:
        spans, reasons = gait_cycles(events, side)
        rejected += reasons
        accepted = []
        for start, stop in spans:
            inside = slice(*np.searchsorted(time, (start, stop)))
            cycle = {"side": side, "start_s": start, "stop_s": stop}
            frames = max(inside.stop - inside.start, 1)
            carried, counted = (np.count_nonzero(mask[inside]) / frames for mask in masks)
            reason = None
            if start < time[0] or stop > time[-1]:
                reason = Note.of("cycle_outside", **cycle)
            elif not known[inside].all():
                reason = Note.of("cycle_unsolved", **cycle)
            elif carried < min_valid_share:
                reason = Note.of("cycle_not_carried", **cycle, share=carried)
            elif counted < min_valid_share:
                reason = Note.of("cycle_unsettled", **cycle, share=counted)
            accepted.append(reason is None)
            rejected += [] if reason is None else [reason]
        cycles[side] = spans[np.array(accepted, bool)]
    return cycles, tuple(rejected)


def found_cycles(events: Sequence[Event], sides: Iterable[str]) -> int:
    """Count the gait cycles that the foot strikes of some sides show, whether they can be used."""
    strikes = (event_times(events, "foot_strike", side).size for side in sides)
    return sum(max(count - 1, 0) for count in strikes)


def normalise(time: ArrayLike, values: ArrayLike, cycles: ArrayLike, samples: int = 101) -> Array:
    """Bring signals to 0–100 % of each gait cycle by cubic splines.

    Parameters
    ----------
    time
        Sample times, (T,) [s], increasing.
    values
        Signals, (T, ...).
    cycles
        Start and stop of each cycle, (C, 2) [s].
    samples
        Samples per cycle, both ends included.

    Returns
    -------
    Array
        Signals over the cycles, (C, samples, ...); NaN in gaps and outside the recorded time.

    Raises
    ------
    ValueError
        If the signals do not fit the times.
    """
    start, stop = np.asarray(cycles, float).reshape(-1, 2).T[..., None]
    return interpolate(time, values, start + (stop - start) * np.linspace(0, 1, samples))


def mean_and_sd(curves: Array) -> tuple[Array, Array]:
    """Give mean and SD over cycles, (C, samples, ...) to (samples, ...), of what is known of each.

    NaN where no cycle is known.
    """
    known = np.ma.masked_invalid(curves)
    mean, sd = (np.ma.filled(x, np.nan) for x in (known.mean(axis=0), known.std(axis=0)))
    return np.asarray(mean), np.asarray(sd)
