"""Check of gait events against those of the plates and of heel, toe and sacrum markers."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.markers import Markers, MarkerSet
from hbm.notes import Note
from hbm.spatial import Array, Mask
from pipeline.config.schema import EventMethod
from pipeline.io.recording import Event
from pipeline.trial.gait.detection import TIMED_BY_PLATES
from pipeline.trial.gait.event_agreement import EventAgreement, compare_events
from pipeline.trial.gait.events import force_events, zeni_events

MIN_EVENTS: Final = 3
"""Of a kind, for their mean to mean something; and half of those of the source that has fewer."""
MAX_APART_S: Final = 0.5
"""Of two events that may be the same: half of a stride."""
MAX_AGREEMENT_MS: Final = 100.0
MAX_OFFSET_MS: Final = 150.0
"""In walking, markers turn up to 100 ms before or after the load crosses its threshold."""
MAX_SD_MS: Final = 100.0
"""Standard deviation of offsets beyond which events are not the same ones."""
MIN_CARRIED_SHARE: Final = 0.8
"""Of the frames: on a treadmill all, and fewer where a plate is dead or feet land beside them."""
OTHER_SIDE: Final = {"left": "right", "right": "left"}


def check_events(
    events: Iterable[Event], references: Mapping[str, Iterable[Event]]
) -> tuple[Note, ...]:
    """Find gait events that carry the other side's name, are early, or late.

    Parameters
    ----------
    events
        The events that are used.
    references
        Where other events of the same trial come from -> these events; the first that can be
        compared decides.

    Returns
    -------
    tuple of Note
        ``events_of_other_side`` where events coincide with the reference's of the other side;
        ``events_offset`` where those of a kind are 150 ms and more away from the reference's on
        average, always by about the same time.
    """
    events = tuple(events)
    for source, reference in references.items():
        notes = _compare(events, tuple(reference), source)
        if notes is not None:
            return notes
    return ()


def reference_events(
    feet: Mapping[str, Array],
    time: Array,
    threshold_n: float,
    markers: Markers,
    marker_set: MarkerSet,
    carried: Mask,
    method: EventMethod,
) -> dict[str, tuple[Event, ...]]:
    """Give a trial's gait events by its plates and its markers, as far as both can be found.

    Parameters
    ----------
    feet
        "left_foot" and "right_foot" -> action on that foot in lab axes, unfiltered, (T, 6).
    time
        (T,) [s].
    threshold_n
        Vertical force of contact [N].
    markers, marker_set
        Trajectories, and the landmarks that they mark.
    carried
        Frames in which the plates carry the subject, (T,): plates that miss many steps show other
        events than the feet.
    method
        What the events that are compared with these were found by; the same is no reference.

    Returns
    -------
    dict[str, tuple of Event]
        Where they come from -> events.
    """
    sides = {foot.removesuffix("_foot"): wrench for foot, wrench in feet.items()}
    found = {}
    if method not in TIMED_BY_PLATES and np.mean(carried) >= MIN_CARRIED_SHARE:
        found["the plates"] = force_events(sides, time, threshold_n)
    if method != "zeni":
        with suppress(ValueError):  # without these markers, or too short for the filter
            found["heel, toe and sacrum markers"] = zeni_events(markers, marker_set)
    return found


def _compare(
    events: tuple[Event, ...], reference: tuple[Event, ...], source: str
) -> tuple[Note, ...] | None:
    """Compare with one reference; None where too few of its events are the same."""
    other_side = [replace(e, side=OTHER_SIDE[e.side]) for e in reference]
    own, crossed = _comparable(events, reference), _comparable(events, other_side)
    if not (own or crossed):
        return None
    far = [kind for kind in own if abs(kind.mean_ms) > MAX_OFFSET_MS]
    exchanged = [kind for kind in crossed if abs(kind.mean_ms) < MAX_AGREEMENT_MS]
    if exchanged and len(far) == len(own):
        return (Note.of("events_of_other_side", source=source),)
    if not far:
        return ()
    offset_ms = {f"{kind.side} {kind.label.replace('_', ' ')}s": kind.mean_ms for kind in far}
    return (Note.of("events_offset", source=source, offset_ms=offset_ms),)


def _comparable(events: Iterable[Event], reference: Iterable[Event]) -> list[EventAgreement]:
    """Compare kinds of events of which enough are about equally far from the reference's."""
    return [
        kind
        for kind in compare_events(events, reference, MAX_APART_S)
        if kind.matched >= max(MIN_EVENTS, min(kind.only_in_first, kind.only_in_second))
        and kind.sd_ms < MAX_SD_MS
    ]
