"""What of a trial counts: its gait cycles, a part of each, or a span; or why nothing does."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np

from compensation.platform import PlatformPose
from hbm.notes import Note
from hbm.spatial import Array, Indices, Mask
from pipeline.config.schema import Condition, Interval
from pipeline.io.recording import Event, Recording
from pipeline.trial.gait.cycles import (
    MIN_PLATFORM_SPEED_MPS,
    cut_cycles,
    found_cycles,
    motion_stops,
    perturbation_onsets,
    select_cycles,
)
from pipeline.trial.gait.events import SIDES
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.result import CyclePart

REASONS: Final = {
    "cycle_unsolved": "frames without a solution or without forces",
    "cycle_not_carried": "plates that do not carry the subject",
    "cycle_unsettled": "an end or a gap too near for the filters to settle",
    "cycle_outside": "an end beyond the recorded markers",
    "cycle_duration": "a duration far from the median",
    "cycle_events": "events that do not alternate",
}
"""Code of the note on a cycle that was left out -> what is wrong with it."""


def cycle_shortage(
    events: Sequence[Event],
    notes: Iterable[Note],
    time: Array,
    solved: Mask,
) -> str:
    """Say why there is no gait cycle.

    Parameters
    ----------
    events
        The trial's gait events.
    notes
        Notes of the trial; those on events and on cycles that were left out count.
    time
        Of the markers, (T,) [s].
    solved
        Whether pose and forces are known, (T,).

    Returns
    -------
    str
        The reason, without a full stop.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(300) / 100
    >>> strikes = [Event(4.1, "foot_strike", "left"), Event(5.2, "foot_strike", "left")]
    >>> cycle_shortage(strikes, (), time, time >= 0)
    'all foot strikes are beyond the markers, which end at 2.99 s: 4.10 to 5.20 s'
    """
    notes = tuple(notes)
    strikes = [event for event in events if event.label == "foot_strike"]
    inside = [event for event in strikes if time[0] <= event.time <= time[-1]]
    counts = [f"{[e.side for e in inside].count(side)} {side}" for side in ("left", "right")]
    left_out = {
        (str(note.values["side"]), note.values["start_s"]): REASONS[note.code]
        for note in notes
        if note.code in REASONS
    }
    unsolved = np.count_nonzero(~solved)
    if unsolved == len(time):
        return "no frame could be solved; check the markers' labels and the calibration pose"
    if not strikes:
        reasons = [f": {note.values['reason']}" for note in notes if note.code == "events_unknown"]
        return f"there are no foot strikes{''.join(reasons)}"
    if not inside:
        return f"all foot strikes are {_beyond(strikes, time)}"
    if left_out:
        reasons = [f"{n} for {reason}" for reason, n in Counter(left_out.values()).most_common()]
        frames = f"; {unsolved} of {len(time)} frames could not be solved" if unsolved else ""
        return f"all gait cycles were left out, {', '.join(reasons)}{frames}"
    if max(Counter(event.side for event in inside).values()) < 2:
        others = [event for event in strikes if event not in inside]
        more = f"; {len(others)} more are {_beyond(others, time)}" if others else ""
        return (
            f"a gait cycle needs two foot strikes of one side, there are {' and '.join(counts)} in "
            f"{time[-1] - time[0]:.2f} s{more}"
        )
    return "none of the gait cycles is one that the condition asks for"


def _beyond(strikes: Sequence[Event], time: Array) -> str:
    times = [event.time for event in strikes]
    return (
        f"beyond the markers, which end at {time[-1]:.2f} s: {min(times):.2f} to {max(times):.2f} s"
    )


Span = tuple[float, float]
WantedWindow = Literal["cycle", "recording"] | Span | None
"""What is to count; None for gait cycles or, where none counts, the whole recording."""
NO_POSE: Final = (
    'window = "motion" needs the platform\'s pose; state its markers or channels under '
    "[treadmill.platform], or another window"
)


@dataclass(frozen=True, slots=True, eq=False)
class Counted:
    """What of a trial counts.

    Attributes
    ----------
    usable
        Side -> start and stop of every gait cycle of which enough is known, (C, 2) [s].
    cycles
        The same of those that the condition asks for.
    onsets
        When the perturbations of a perturbed condition began, (P,) [s].
    part
        The part of the gait cycles that the condition asks for; None for all of them.
    span
        Start and stop of what counts in place of gait cycles [s]; None where these count.
    """

    usable: dict[str, Array]
    cycles: dict[str, Array]
    onsets: Array
    part: CyclePart | None
    span: Span | None


def what_counts(
    recording: Recording,
    events: Sequence[Event],
    quality: Indices,
    rule: Condition,
    wanted: WantedWindow,
    settling: tuple[float, float],
    pose: PlatformPose | None,
    notes: list[Note],
    min_valid_share: float,
) -> Counted:
    """Find what of a trial counts: gait cycles, a part of each, or a span of the recording.

    Parameters are those of `cut_cycles`, `select_cycles`, `perturbed_part` and `counted_span`, and
    so are the errors; the platform's pose is at the T frames. What is left out is noted.
    """
    time = recording.markers.time
    usable, rejected = cut_cycles(events, time, quality, min_valid_share)
    onsets = perturbation_onsets(recording, rule, pose) if rule.perturbed else np.empty(0)
    cycles, selection = select_cycles(usable, rule, onsets)
    part, of_part = perturbed_part(rule, cycles, onsets, time=time, pose=pose)
    span = counted_span(
        wanted, cycles, time, settling, counts=free_of(quality), min_valid_share=min_valid_share
    )
    notes += (*rejected, *selection, *of_part)
    counted = Counted(usable, cycles, onsets, part, span)
    notes += window_notes(
        wanted, counted, events=events, rejected=notes, time=time, quality=quality
    )
    return counted


def counted_span(
    wanted: WantedWindow,
    cycles: Mapping[str, Array],
    time: Array,
    settling: tuple[float, float],
    *,
    counts: Mask,
    min_valid_share: float,
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
        (`pipeline.trial.quality.settling_s`).
    counts
        Whether each frame is valid, (T,).
    min_valid_share
        Least share of the recording's frames that have to be valid, where it stands in for gait
        cycles that were not asked for by name.

    Returns
    -------
    tuple or None
        Start and stop [s]; None where gait cycles count, or where there is none and too little of
        the recording is valid to stand in for them.

    Raises
    ------
    ValueError
        If the recording is too short for the filters to settle, or the stated span holds no frame
        in which they have.

    Examples
    --------
    >>> time = np.arange(1000) / 100
    >>> valid = time < 4
    >>> start, stop = counted_span(
    ...     "recording", {}, time, (1 / 6, 1 / 6), counts=valid, min_valid_share=0.5
    ... )
    >>> f"{start:.2f} to {stop:.2f} s"
    '0.17 to 9.82 s'
    >>> counted_span(None, {}, time, (1 / 6, 1 / 6), counts=valid, min_valid_share=0.5) is None
    True
    """
    if wanted == "cycle" or (wanted is None and any(map(len, cycles.values()))):
        return None
    settled = float(time[0] + settling[0]), float(time[-1] - settling[1])
    if settled[0] >= settled[1]:
        raise ValueError(
            f"the recording lasts {time[-1] - time[0]:.2f} s; its filters need {settling[0]:.2f} s "
            f"at its start and {settling[1]:.2f} s at its end to settle"
        )
    if wanted is None:
        valid = counts[frames_within(time, {}, settled)]
        return settled if np.mean(valid) >= min_valid_share else None
    if isinstance(wanted, str):
        return settled
    span = max(wanted[0], settled[0]), min(wanted[1], settled[1])
    if not ((time >= span[0]) & (time < span[1])).any():
        raise ValueError(
            f"the span {wanted[0]:g} to {wanted[1]:g} s holds no frame; the recording can be used "
            f"from {settled[0]:.2f} to {settled[1]:.2f} s"
        )
    return span


def perturbed_part(
    condition: Condition,
    cycles: Mapping[str, Array],
    onsets: Array,
    *,
    time: Array,
    pose: PlatformPose | None,
) -> tuple[CyclePart | None, tuple[Note, ...]]:
    """Find the part of each perturbed gait cycle that a condition asks for.

    Parameters
    ----------
    condition
        States the part.
    cycles
        Side -> the gait cycles that were selected, (C, 2) [s].
    onsets
        When the perturbations began, (P,) [s].
    time
        (T,) [s].
    pose
        The platform's pose, (T,) frames.

    Returns
    -------
    part
        Of a cycle with two perturbations, that of the first one; None where whole cycles count.
    notes
        ``perturbation_without_motion``, ``motion_beyond_cycle`` and ``window_beyond_cycle``.

    Raises
    ------
    ValueError
        If a part in seconds ends beyond every gait cycle or reaches the next perturbation; if the
        platform's motion is wanted and it has no pose, or does not move after any perturbation.
    """
    wanted = condition.part
    if wanted is None:
        return None, ()
    onsets = onsets[onsets >= condition.skip_s]
    stops, notes = onsets, tuple[Note, ...]()
    if wanted == "motion":
        if pose is None:
            raise ValueError(NO_POSE)
        stops = motion_stops(onsets, time, pose)
        notes = _motion_notes(onsets, stops, cycles)
    elif wanted.unit == "s":
        _require_apart(wanted, onsets)
    spans = {
        side: tuple((a, b) for a, b in _part_of_cycles(wanted, own, onsets, stops).tolist())
        for side, own in cycles.items()
    }
    if isinstance(wanted, Interval) and wanted.unit == "s":
        notes = _beyond_cycle(wanted, spans)
    return CyclePart(str(wanted), spans), notes


def _part_of_cycles(
    wanted: Literal["motion"] | Interval, cycles: Array, onsets: Array, stops: Array
) -> Array:
    """Give start and stop of the part of each cycle, (C, 2) [s]; ``stops`` of the motions, (P,)."""
    first = np.searchsorted(onsets, cycles[:, 0])
    if wanted == "motion":
        return np.column_stack([onsets[first], np.minimum(stops[first], cycles[:, 1])])
    bounds = np.array([wanted.start, wanted.stop])
    if wanted.unit == "%":
        return np.asarray(cycles[:, :1] + np.diff(cycles) * bounds / 100)
    parts = onsets[first][:, None] + bounds
    return np.where(parts[:, 1:] > cycles[:, 1:], np.nan, parts)


def _motion_notes(onsets: Array, stops: Array, cycles: Mapping[str, Array]) -> tuple[Note, ...]:
    """Name perturbations without motion, and motions that last longer than their gait cycle."""
    still = np.isnan(stops)
    if still.all() and len(stops):
        raise ValueError(
            'window = "motion", but the platform moves faster than '
            f"{MIN_PLATFORM_SPEED_MPS:g} m/s after none of the {len(onsets)} perturbations; check "
            "its markers or channels, or state another window"
        )
    notes = [Note.of("perturbation_without_motion", onset_s=onset) for onset in onsets[still]]
    every = np.concatenate([*cycles.values(), np.empty((0, 2))])
    longer = [
        bool(((every[:, 0] <= onset) & (onset < every[:, 1]) & (stop > every[:, 1])).any())
        for onset, stop in zip(onsets, stops, strict=True)
    ]
    if any(longer):
        notes.append(Note.of("motion_beyond_cycle", count=sum(longer), perturbations=len(onsets)))
    return tuple(notes)


def _require_apart(wanted: Interval, onsets: Array) -> None:
    for onset, following in pairwise(onsets.tolist()):
        if onset + wanted.stop > following:
            raise ValueError(
                f"the window of {wanted} after the perturbation at {onset:.2f} s reaches into the "
                f"next one at {following:.2f} s; state a shorter one"
            )


def _beyond_cycle(wanted: Interval, spans: Mapping[str, tuple[Span, ...]]) -> tuple[Note, ...]:
    """Count perturbations after which a window in seconds ends beyond the gait cycle."""
    ends = np.isnan([stop for own in spans.values() for _, stop in own])
    if len(ends) and ends.all():
        raise ValueError(
            f"the window of {wanted} after each perturbation ends beyond all {len(ends)} perturbed "
            "gait cycles; state one that ends sooner"
        )
    if not ends.any():
        return ()
    return (Note.of("window_beyond_cycle", count=int(ends.sum()), perturbations=len(ends)),)


def frames_within(time: Array, cycles: Mapping[str, Array], span: Span | None) -> Mask:
    """Give whether each time, (T,), is in the span or, without one, in a gait cycle."""
    inside = np.zeros(len(time), bool)
    for start, stop in [span] if span else np.concatenate([*cycles.values(), np.empty((0, 2))]):
        if start < stop:  # neither is NaN
            inside[slice(*np.searchsorted(time, (start, stop)))] = True
    return inside


def window_notes(
    wanted: WantedWindow,
    counted: Counted,
    *,
    events: Sequence[Event],
    rejected: Iterable[Note],
    time: Array,
    quality: Indices,
) -> tuple[Note, ...]:
    """Say why the recording counts in place of gait cycles, or why nothing counts.

    ``no_residuals`` where no frame counts; else, where gait cycles were wanted and none counts,
    ``no_gait_cycle`` or, if there are some, ``gait_cycles_left_out``. The notes say why gait cycles
    were rejected.
    """
    cycles, part, span = counted.cycles, counted.part, counted.span
    parts = cycles if part is None else {s: np.reshape(p, (-1, 2)) for s, p in part.spans.items()}
    counts = frames_within(time, parts, span) & free_of(quality)
    reason = cycle_shortage(events, rejected, time, free_of(quality, Quality.POSE_UNKNOWN))
    if not counts.any():
        nothing = reason if span is None else _nothing_counts(span, time, quality)
        if wanted is None and span is None and not any(map(len, cycles.values())):
            nothing = f"{reason}; {_too_little(time, quality)}"
        if part is not None and any(map(len, cycles.values())):
            nothing = f'no frame of the window "{part.name}" of the gait cycles counts'
        return (Note.of("no_residuals", reason=nothing),)
    if span is None or wanted is not None:
        return ()
    code = "gait_cycles_left_out" if found_cycles(events, SIDES) else "no_gait_cycle"
    return (Note.of(code, reason=reason, start_s=span[0], stop_s=span[1]),)


def _too_little(time: Array, quality: Indices) -> str:
    """Say how little of a recording could stand in for gait cycles."""
    valid, frames = np.count_nonzero(free_of(quality)), len(time)
    if not valid:
        return _nothing_counts(
            (float(time[0]), float(np.nextafter(time[-1], np.inf))), time, quality
        )
    return (
        f"{valid} of {frames} frames of the recording are valid, less than min_valid_share; "
        'to use them, state --span all (window = "recording") or a span'
    )


def _nothing_counts(span: Span, time: Array, quality: Indices) -> str:
    inside = frames_within(time, {}, span)
    frames = np.count_nonzero(inside)
    unsolved = np.count_nonzero(inside & ~free_of(quality, Quality.POSE_UNKNOWN))
    if unsolved == frames:
        return (
            f"no frame from {span[0]:.2f} to {span[1]:.2f} s could be solved; check the markers' "
            "labels and the calibration pose"
        )
    others = f" ({unsolved} of {frames} frames could not be solved)" if unsolved else ""
    return f"the plates carry the subject in no frame from {span[0]:.2f} to {span[1]:.2f} s{others}"
