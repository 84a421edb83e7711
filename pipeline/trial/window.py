"""What of a trial counts: its gait cycles, a part of each, or a span; or why nothing does."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain, pairwise
from typing import Final, Literal, NamedTuple

import numpy as np

from compensation.platform import PlatformPose
from hbm.notes import Note
from hbm.spatial import Array, Indices, Mask
from pipeline.config.schema import NOUNS, Condition, Interval, Unit, WantedWindow
from pipeline.io.recording import Event, Recording
from pipeline.trial.gait.cycles import LIMITS as CYCLES
from pipeline.trial.gait.cycles import (
    NO_SWING,
    cut_cycles,
    motion_stops,
    perturbation_onsets,
    select_cycles,
)
from pipeline.trial.gait.events import SIDES
from pipeline.trial.quality import Quality, frames_within, free_of
from pipeline.trial.result import CyclePart

NEEDS: Final[dict[Unit, str]] = {
    "cycle": "two foot strikes of one side",
    "step": "foot strikes of both sides",
    "stance": "a foot strike and the foot off after it",
}


def cycle_shortage(
    events: Sequence[Event], left_out: list[str], time: Array, solved: Mask, why: str, unit: Unit
) -> str:
    """Say why there is no gait cycle, step or stance.

    Parameters
    ----------
    events
        The trial's gait events.
    left_out
        Why each unit that the events show was left out.
    time
        Of the markers, (T,) [s].
    solved
        Whether pose and forces are known, (T,).
    why
        Why there are no events; empty where that is not known.
    unit
        What there is none of.

    Returns
    -------
    str
        The reason, without a full stop.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(300) / 100
    >>> strikes = [Event(4.1, "foot_strike", "left"), Event(5.2, "foot_strike", "left")]
    >>> print(cycle_shortage(strikes, [], time, time >= 0, "", "cycle"))
    a gait cycle needs two foot strikes of one side while markers are recorded, from 0.00 to \
2.99 s; there are 0 left and 0 right, and 2 from 4.10 to 5.20 s
    """
    strikes = [event for event in events if event.label == "foot_strike"]
    # events of a file may be outside its markers
    beyond = [event.time for event in strikes if not time[0] <= event.time <= time[-1]]
    counts = {side: sum(e.side == side and e.time not in beyond for e in strikes) for side in SIDES}
    unsolved = np.count_nonzero(~solved)
    if unsolved == len(time):
        return "no frame could be solved; check the markers' labels and the calibration pose"
    if not strikes:
        return "there are no foot strikes" + (f": {why}" if why else "")
    if max(counts.values()) < 2 if unit == "cycle" else not left_out:
        named = " and ".join(f"{count} {side}" for side, count in counts.items())
        if beyond:
            named += f", and {len(beyond)} from {min(beyond):.2f} to {max(beyond):.2f} s"
        return (
            f"a {NOUNS[unit]} needs {NEEDS[unit]} while markers are recorded, from "
            f"{time[0]:.2f} to {time[-1]:.2f} s; there are {named}"
        )
    if left_out:
        frames = f"; {unsolved} of {len(time)} frames could not be solved" if unsolved else ""
        return f"all {NOUNS[unit]}s were excluded, {counted_reasons(left_out)}{frames}"
    return "none of the gait cycles is one that the condition asks for"


def counted_reasons(left_out: Sequence[str]) -> str:
    """Count why gait cycles were left out, the most frequent reason first."""
    return ", ".join(f"{n} for {reason}" for reason, n in Counter(left_out).most_common())


Span = tuple[float, float]
NO_POSE: Final = (
    'window = "motion" needs the platform\'s pose; give its markers or channels under '
    "[treadmill.platform], or another window"
)


class Counted(NamedTuple):
    """What of a trial counts.

    Attributes
    ----------
    cycles
        Side -> start and stop of every gait cycle that the condition asks for and of which enough
        is known, (C, 2) [s].
    onsets
        When the perturbations of a perturbed condition began, (P,) [s].
    part
        The part of the gait cycles that the condition asks for; None for all of them.
    span
        Start and stop of what counts in place of gait cycles [s]; None where these count.
    unit
        Whether ``cycles`` are gait cycles, steps or stances.
    found
        How many of them the events of these sides show, whether they count or not.
    shortage
        Why there are no residuals; empty where there are.
    notes
        What was left out, or counts in place of gait cycles.
    """

    cycles: dict[str, Array]
    onsets: Array
    part: CyclePart | None
    span: Span | None
    unit: Unit
    found: int
    shortage: str = ""
    notes: tuple[Note, ...] = ()


def what_counts(
    recording: Recording,
    events: Sequence[Event],
    quality: Indices,
    rule: Condition,
    settling: tuple[float, float],
    pose: PlatformPose | None,
    min_valid_share: float,
    feet: Array | None = None,
    why_no_events: str = "",
) -> Counted:
    """Find what of a trial counts: gait cycles, a part of each, or a span of the recording.

    Parameters are those of `cut_cycles`, `select_cycles`, `perturbed_part` and `counted_span`, and
    so are the errors; the platform's pose is at the T frames.
    """
    time, counts, wanted = recording.markers.time, free_of(quality), rule.wanted
    # what is asked for; by default gait cycles, else steps, else stances
    units = [unit for unit in NOUNS if unit == wanted] or [*NOUNS]
    cut = {u: cut_cycles(events, time, quality, min_valid_share, u, feet) for u in units}
    unit = next((u for u in units if any(map(len, cut[u][0].values()))), units[0])
    usable, left_out = cut[unit]
    # perturbations decide which cycles count, and which part of them
    onsets = perturbation_onsets(recording, rule, pose) if rule.perturbed else np.empty(0)
    cycles, selection = select_cycles(usable, rule, onsets) if unit == "cycle" else (usable, ())
    part, of_part = perturbed_part(rule, cycles, onsets, time, pose)
    span = counted_span(wanted, cycles, time, settling, counts, min_valid_share)
    of_sides = [*chain(*(left_out[side] for side in cycles))]
    of_all = sum(len(usable[side]) for side in cycles) + len(of_sides)
    counted = Counted(cycles, onsets, part, span, unit, of_all)
    excluded: tuple[Note, ...] = ()
    if count := len(of_sides):
        values = {"unit": _nouns(unit, count), "reasons": counted_reasons(of_sides)}
        excluded = (Note.of("cycles_left_out", count=count, **values),)
    solved = free_of(quality, Quality.POSE_UNKNOWN)
    of_asked = [*chain(*cut[units[0]][1].values())]
    of_cycles = cycle_shortage(events, of_asked, time, solved, why_no_events, units[0])
    none_found = {*chain(*left_out.values())} <= {NO_SWING}  # who stands makes no gait cycle
    frames = time, counts, solved
    shortage, instead = _nothing_counts(wanted, counted, none_found, of_cycles, *frames)
    return counted._replace(shortage=shortage, notes=(*excluded, *selection, *of_part, *instead))


def _nouns(unit: Unit, count: int) -> str:
    """Name a number of units."""
    return NOUNS[unit] + "s" * (count > 1)


def counted_span(
    wanted: WantedWindow,
    cycles: Mapping[str, Array],
    time: Array,
    settling: tuple[float, float],
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
    >>> start, stop = counted_span("recording", {}, time, (1 / 6, 1 / 6), valid, 0.5)
    >>> f"{start:.2f} to {stop:.2f} s"
    '0.17 to 9.82 s'
    >>> counted_span(None, {}, time, (1 / 6, 1 / 6), valid, 0.5) is None
    True
    """
    if wanted in NOUNS or (wanted is None and any(map(len, cycles.values()))):
        return None
    # without the ends of the recording, where filters have not settled
    settled = float(time[0] + settling[0]), float(time[-1] - settling[1])
    if settled[0] >= settled[1]:
        raise ValueError(
            f"the recording lasts {time[-1] - time[0]:.2f} s; its filters need {settling[0]:.2f} s "
            f"at its start and {settling[1]:.2f} s at its end to settle"
        )
    if wanted is None:
        valid = counts[frames_within(time, settled)]
        return settled if np.mean(valid) >= min_valid_share else None
    if isinstance(wanted, str):
        return settled
    span = max(wanted[0], settled[0]), min(wanted[1], settled[1])
    if not frames_within(time, span).any():
        raise ValueError(
            f"the span {wanted[0]:g} to {wanted[1]:g} s holds no frame; the recording can be used "
            f"from {settled[0]:.2f} to {settled[1]:.2f} s"
        )
    return span


def perturbed_part(
    condition: Condition,
    cycles: Mapping[str, Array],
    onsets: Array,
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
        ``perturbation_without_motion`` and ``window_beyond_cycle``.

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
    stops, notes = onsets, list[Note]()
    if wanted == "motion":
        if pose is None:
            raise ValueError(NO_POSE)
        # the part lasts as long as the platform moves fast after each onset
        stops = motion_stops(onsets, time, pose)
        still = onsets[np.isnan(stops)]
        if len(still) == len(onsets) > 0:
            raise ValueError(
                'window = "motion", but the platform moves faster than '
                f"{CYCLES.platform_speed:g} m/s after none of the {len(onsets)} perturbations; "
                "check its markers or channels, or set another window"
            )
        notes += [Note.of("perturbation_without_motion", onset_s=onset) for onset in still]
    parts = {
        side: _part_of_cycles(wanted, of_side, onsets, stops) for side, of_side in cycles.items()
    }
    spans = {side: tuple((start, stop) for start, stop in p.tolist()) for side, p in parts.items()}
    if isinstance(wanted, Interval) and wanted.unit == "s":
        for onset, following in pairwise(onsets.tolist()):
            if onset + wanted.stop > following:
                raise ValueError(
                    f"the window of {wanted} after the perturbation at {onset:.2f} s reaches into "
                    f"the next one at {following:.2f} s; set a shorter one"
                )
        beyond = np.isnan(np.concatenate([*parts.values()])[:, 1])
        if len(beyond) and beyond.all():
            raise ValueError(
                f"the window of {wanted} after each perturbation ends beyond all {len(beyond)} "
                "perturbed gait cycles; set one that ends sooner"
            )
        if beyond.any():
            counts = {"count": beyond.sum(), "perturbations": len(beyond)}
            notes.append(Note.of("window_beyond_cycle", **counts))
    return CyclePart(str(wanted), spans), tuple(notes)


def _part_of_cycles(
    wanted: Literal["motion"] | Interval, cycles: Array, onsets: Array, stops: Array
) -> Array:
    """Give start and stop of the part of each cycle, (C, 2) [s]; ``stops`` of the motions, (P,)."""
    # the first perturbation in each cycle
    first = np.searchsorted(onsets, cycles[:, 0])
    if wanted == "motion":
        # a motion that goes on after the cycle is cut at its end
        return np.column_stack([onsets[first], np.minimum(stops[first], cycles[:, 1])])
    bounds = np.array([wanted.start, wanted.stop])
    if wanted.unit == "%":
        return np.asarray(cycles[:, :1] + np.diff(cycles) * bounds / 100)
    # seconds after the onset; a part that ends after the cycle is none
    parts = onsets[first][:, None] + bounds
    return np.where(parts[:, 1:] > cycles[:, 1:], np.nan, parts)


def _nothing_counts(
    wanted: WantedWindow,
    counted: Counted,
    none_found: bool,
    shortage: str,
    time: Array,
    counts: Mask,
    solved: Mask,
) -> tuple[str, tuple[Note, ...]]:
    """Say why nothing counts, and what is to be known where that or something else counts."""
    part, span, cycles = counted.part, counted.span, counted.cycles
    some_cycles = any(map(len, cycles.values()))
    # what was asked for, or stands in for it
    spans = [span] if span else (cycles if part is None else part.spans).values()
    if (frames_within(time, *spans) & counts).any():
        if wanted is not None or (span is None and counted.unit == "cycle"):
            return "", ()
        if span is None:
            count = sum(map(len, cycles.values()))
            values = {"reason": shortage, "unit": _nouns(counted.unit, count)}
            return "", (Note.of("steps_for_cycles", count=count, **values),)
        code = "no_gait_cycle" if none_found else "gait_cycles_left_out"
        return "", (Note.of(code, reason=shortage, start_s=span[0], stop_s=span[1]),)
    inside = frames_within(time, span) if span else np.ones(len(time), bool)
    frames = f"{np.count_nonzero(counts & inside)} of {np.count_nonzero(inside)} frames are used"
    why = f"{np.count_nonzero(inside & ~solved)} unsolved, else the plates do not carry the subject"
    reason = shortage
    if part is not None and some_cycles:
        reason = f'no frame of the window "{part.name}" of the gait cycles is used'
    elif span is not None:
        reason = f"from {span[0]:.2f} to {span[1]:.2f} s {frames} ({why})"
    elif wanted is None:
        takes = "; --span all uses them" if (counts & inside).any() else ""
        reason += f"; {frames}, less than min_valid_share ({why}){takes}"
    return reason, (Note.of("no_residuals", reason=reason),)
