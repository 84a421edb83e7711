"""Gait events of a trial by the method that is wanted: the file's, Zeni's, the plates', or all."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.markers import Markers, MarkerSet
from hbm.notes import Note
from hbm.signals.samples import stretches
from hbm.spatial import Array
from pipeline.config.schema import EventMethod
from pipeline.io.recording import Event
from pipeline.trial.gait.contact import Contact
from pipeline.trial.gait.event_agreement import match_times
from pipeline.trial.gait.events import (
    LABELS,
    MIN_EXCURSION_M,
    NONE_IN_FILE,
    SIDES,
    event_times,
    has_strides,
    in_order,
    zeni_events,
)
from pipeline.trial.gait.foot_motion_events import FootMotion, foot_motion_events
from pipeline.trial.gait.plate_events import plate_events
from pipeline.trial.ground.loads import PlateLoad

NO_SWING: Final = "no foot swings forward and back against the pelvis, as in walking"
TIMED_BY_PLATES: Final[tuple[EventMethod, ...]] = ("plates", "auto")
"""Methods whose events need no comparison with the plates: it would be one with themselves."""
MAX_APART_S: Final = 0.2
"""Of a foot's motion and a plate's load that are the same event; the next one is a second away."""
MIN_CLEAN: Final = 3
"""Events of a kind and foot that plates see, for a median that one wrong contact does not move."""
NEAREST: Final = 5
"""Of these events, the nearest in time, tell how much an event is early or late: gait changes with
the slope and the speed of the ground."""
MAX_DEVIATION_S: Final = 0.05
"""Of a plate's event from what the motion of the foot suggests; beyond, part of the foot was beside
the plate."""


@dataclass(frozen=True, slots=True)
class EventSources:
    """What a trial's gait events can be found from.

    Attributes
    ----------
    of_file
        Events of the recording.
    markers, marker_set
        Trajectories in lab axes, and the landmarks that they mark.
    motion
        How pelvis and feet moved on the platform.
    contacts
        Which foot stood on which plate, in frames of the motion.
    loads
        The plates' loads.
    weight_n
        Body weight.
    """

    of_file: tuple[Event, ...]
    markers: Markers
    marker_set: MarkerSet
    motion: FootMotion
    contacts: tuple[Contact, ...]
    loads: tuple[PlateLoad, ...]
    weight_n: float


def detect_events(
    sources: EventSources, wanted: EventMethod | None
) -> tuple[tuple[Event, ...], EventMethod, Note]:
    """Give a trial's gait events.

    Parameters
    ----------
    sources
        What they can be found from.
    wanted
        "file": as recorded; "zeni": by markers, `zeni_events`; "plates": where plates carry one
        foot alone, `plate_events`; "auto": `combined_events`. None is the file's where some foot
        strikes twice in them, else "auto".

    Returns
    -------
    events
        In order of time.
    method
        Which one gave them.
    note
        The method and how many foot strikes it found, or why there are no events.
    """
    method = wanted or ("file" if has_strides(sources.of_file) else "auto")
    corrections: dict[str, float] = {}
    try:
        match method:
            case "file":
                events, code = sources.of_file, "events_of_file"
                if not events:
                    raise ValueError(NONE_IN_FILE)
            case "zeni":
                events = zeni_events(sources.markers, sources.marker_set)
                code = "events_from_markers"
            case "plates":
                events, code = _of_plates(sources), "events_of_plates"
            case "auto":
                by_motion, of_plates = foot_motion_events(sources.motion), _of_plates(sources)
                if not by_motion:
                    raise ValueError(_no_step(sources.motion))
                events, corrections = combined_events(by_motion, of_plates)
                code = "events_calibrated" if corrections else "events_uncalibrated"
    except ValueError as error:
        return (), method, Note.of("events_unknown", reason=str(error))
    left, right = (event_times(events, "foot_strike", side).size for side in SIDES)
    if not corrections:
        return events, method, Note.of(code, left=left, right=right)
    timed = len(set(events) & set(of_plates))
    calibrated = {kind: 1000 * seconds for kind, seconds in corrections.items()}
    note = Note.of(
        code, left=left, right=right, timed=timed, events=len(events), offset_ms=calibrated
    )
    return events, method, note


def _no_step(motion: FootMotion) -> str:
    """Say why the motion of the feet shows no event: nobody walks, or not for as long as a stride.

    A foot that swings travels against the pelvis; a stride is seen from one turn of it to the next.
    """
    relative = motion.ankles - motion.pelvis[:, None]
    known = np.asarray(np.isfinite(relative).all(axis=1), bool)
    seen = [slice(a, b) for a, b in stretches(known)]
    travel_m = max((float(np.ptp(relative[part], axis=0).max()) for part in seen), default=0.0)
    if travel_m < MIN_EXCURSION_M:
        return NO_SWING
    longest_s = max(float(np.ptp(motion.time[part])) for part in seen)
    return (
        f"pelvis and feet are seen for {longest_s:.2f} s, less than a stride, though a foot "
        f"travels {travel_m:.2f} m against the pelvis; record two strikes of a foot and 0.2 s "
        "around them"
    )


def combined_events(
    by_motion: Sequence[Event], of_plates: Sequence[Event]
) -> tuple[tuple[Event, ...], dict[str, float]]:
    """Combine the events that the feet's motion shows with those that plates time exactly.

    Parameters
    ----------
    by_motion
        Events by the motion of the feet: all that there are, each early or late by some time.
    of_plates
        Events by the plates: of contacts in which a plate carries one foot alone.

    Returns
    -------
    events
        Those of the motion, in order of time: as the plates time them or, where they do not, moved
        by what they show of the nearest events of this kind and foot.
    corrections
        Kind of event, such as "left foot strikes" -> median of plate minus motion over all that
        plates time [s]; of both feet where they time fewer than `MIN_CLEAN` of this one, and none
        where there are too few of both: such events stay as the motion shows them.

    Notes
    -----
    The correction is the median of the `NEAREST` events in time. An event that the plates time
    farther than `MAX_DEVIATION_S` from the corrected motion is taken from the motion. What plates
    show without a step in the motion is none.

    Examples
    --------
    >>> late = [Event(t + 0.02, "foot_strike", "left") for t in range(1, 6)]
    >>> of_plates = [Event(float(t), "foot_strike", "left") for t in (1, 2, 4)]
    >>> events, corrections = combined_events(late, of_plates)
    >>> [round(event.time, 3) for event in events], round(corrections["left foot strikes"], 3)
    ([1.0, 2.0, 3.0, 4.0, 5.0], -0.02)
    """
    events, corrections = [], {}
    for label in LABELS:
        moved, timed = (
            {side: event_times(each, label, side) for side in SIDES}
            for each in (by_motion, of_plates)
        )
        pairs = {side: match_times(moved[side], timed[side], MAX_APART_S) for side in SIDES}
        seen = {
            side: (moved[side][own], timed[side][other]) for side, (own, other) in pairs.items()
        }
        both = tuple(np.concatenate(each) for each in zip(*seen.values(), strict=True))
        for side in SIDES:
            known, true = seen[side] if len(seen[side][0]) >= MIN_CLEAN else both
            times, offset = moved[side], true - known
            if len(known) >= MIN_CLEAN:
                corrections[f"{side} {label.replace('_', ' ')}s"] = float(np.median(offset))
                times = _corrected(times, known, offset)
                own, other = pairs[side]
                near = np.abs(timed[side][other] - times[own]) <= MAX_DEVIATION_S
                times[own[near]] = timed[side][other[near]]
            events += [Event(float(time), label, side) for time in times]
    return in_order(events), corrections


def _corrected(times: Array, known: Array, offset: Array) -> Array:
    """Move times (E,) by the median offset of the nearest of those (K,) whose offset is known."""
    apart = np.abs(known - times[:, None])
    nearest = np.argsort(apart, axis=1, kind="stable")[:, :NEAREST]
    return np.asarray(times + np.median(offset[nearest], axis=1))


def _of_plates(sources: EventSources) -> tuple[Event, ...]:
    return plate_events(sources.contacts, sources.loads, sources.motion.time, sources.weight_n)
