"""Gait cycles, and signals over 0–100 % of a cycle."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from hbm.dynamics import Dynamics
from hbm.signals.resampling import interpolate
from hbm.spatial import Array
from pipeline.io.recording import Event
from pipeline.trial.gait.events import SIDES, event_times

PLAUSIBLE_DURATION = (0.6, 1.5)
"""Shortest and longest gait cycle, in medians of the trial."""


def gait_cycles(events: Iterable[Event], side: str) -> tuple[Array, tuple[str, ...]]:
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
        One sentence per cycle that was left out, with the reason: its duration is outside
        ``PLAUSIBLE_DURATION`` medians, or the events in it do not alternate (the foot does not
        leave the ground once, or the other foot does not strike once), judged where the trial has
        events of that kind at all.

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
    accepted, rejected = [], []
    for start, stop in spans:
        reasons = []
        ratio = (stop - start) / np.median(duration)
        if not PLAUSIBLE_DURATION[0] <= ratio <= PLAUSIBLE_DURATION[1]:
            reasons.append(f"lasts {ratio:.2f} of the median cycle")
        for (label, foot), times in within.items():
            count = np.count_nonzero((times > start) & (times < stop))
            if times.size and count != 1:
                reasons.append(f"has {count} {foot} {label.replace('_', ' ')}s where 1 belongs")
        if reasons:
            rejected.append(f"{side} cycle {start:.2f}–{stop:.2f} s {' and '.join(reasons)}")
        accepted.append(not reasons)
    return spans[np.array(accepted, bool)], tuple(rejected)


def cut_cycles(
    events: Sequence[Event], variants: Iterable[Dynamics]
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Cut gait cycles of both sides; leave out those with undefined frames, with the reason.

    Parameters
    ----------
    events
        Gait events.
    variants
        Dynamics of the same frames: a cycle counts only if it is defined in all of them.

    Returns
    -------
    cycles
        Side -> start and stop of each cycle, (C, 2) [s].
    rejected
        One sentence per cycle that was left out.
    """
    undefined = np.concatenate([d.time[np.isnan(d.residual).any(axis=1)] for d in variants])
    cycles, rejected = {}, []
    for side in ("left", "right"):
        spans, reasons = gait_cycles(events, side)
        hit = [bool(((undefined >= a) & (undefined < b)).any()) for a, b in spans]
        rejected += [
            *reasons,
            *(
                f"{side} cycle {a:.2f}–{b:.2f} s has frames without a solution"
                for (a, b), bad in zip(spans, hit, strict=True)
                if bad
            ),
        ]
        cycles[side] = spans[~np.array(hit, bool)]
    return cycles, tuple(rejected)


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
