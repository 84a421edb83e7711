"""Agreement between two ways of finding gait events."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from pipeline.io.recording import Event
from pipeline.trial.gait.events import LABELS, SIDES, event_times, force_events

MAX_DIFFERENCE_S: Final = 0.2
"""Of two events that may be the same; events of one kind and side are a second apart."""


@dataclass(frozen=True, slots=True)
class EventAgreement:
    """Agreement between two ways of finding one kind of gait event.

    Attributes
    ----------
    label, side
        The kind of event.
    mean_ms, sd_ms
        Mean and standard deviation of first minus second [ms]; NaN where too few match.
    matched, only_in_first, only_in_second
        Numbers of events.
    """

    label: str
    side: str
    mean_ms: float
    sd_ms: float
    matched: int
    only_in_first: int
    only_in_second: int


def compare_events(
    first: Iterable[Event], second: Iterable[Event], tolerance_s: float = MAX_DIFFERENCE_S
) -> tuple[EventAgreement, ...]:
    """Match the events of two methods and give their differences per kind and side.

    Parameters
    ----------
    first, second
        Events of the same trial.
    tolerance_s
        Largest difference of two events that may be the same [s].

    Returns
    -------
    tuple of EventAgreement
        Left and right foot strikes, left and right foot offs. Two events match when each is the
        other's nearest.
    """
    first, second = tuple(first), tuple(second)
    return tuple(
        _agreement(
            event_times(first, label, side),
            event_times(second, label, side),
            label,
            side,
            tolerance_s,
        )
        for label in LABELS
        for side in SIDES
    )


def match_times(first: Array, second: Array, tolerance_s: float) -> tuple[Array, Array]:
    """Give which times are each other's nearest, as two arrays of indices, (M,) each.

    Parameters
    ----------
    first, second
        Times in order, (E,) and (F,) [s].
    tolerance_s
        Largest difference of two times that may be the same [s].

    Returns
    -------
    own, other
        Indices into ``first`` and ``second``.
    """
    if not (len(first) and len(second)):
        return np.zeros(0, int), np.zeros(0, int)
    distance = np.abs(first[:, None] - second)
    other = distance.argmin(axis=1)
    own = np.arange(len(first))
    same = (distance.argmin(axis=0)[other] == own) & (distance[own, other] <= tolerance_s)
    return own[same], other[same]


def agreement_with_plates(
    events: Iterable[Event], feet: Mapping[str, Array], time: Array, threshold_n: float
) -> tuple[Note, ...]:
    """Give how far gait events are from those of the forces under the feet.

    Parameters
    ----------
    events
        Gait events.
    feet
        "left_foot" and "right_foot" -> action on that foot in lab axes, unfiltered, (T, 6).
    time
        (T,) [s].
    threshold_n
        Vertical force of contact [N].

    Returns
    -------
    tuple of Note
        One ``event_agreement`` per kind and side of which two events match at least; one
        ``events_disagree`` where there is no such kind, though both sources show some event of a
        side more than once.
    """
    sides = {foot.removesuffix("_foot"): wrench for foot, wrench in feet.items()}
    compared = compare_events(events, force_events(sides, time, threshold_n))
    notes = tuple(
        Note.of(
            "event_agreement",
            side=kind.side,
            event=kind.label.replace("_", " "),
            mean_ms=kind.mean_ms,
            sd_ms=kind.sd_ms,
            matched=kind.matched,
            only_events=kind.only_in_first,
            only_plates=kind.only_in_second,
        )
        for kind in compared
        if kind.matched > 1
    )
    repeated = any(
        kind.matched + min(kind.only_in_first, kind.only_in_second) > 1 for kind in compared
    )
    return notes if notes or not repeated else (Note.of("events_disagree"),)


def _agreement(
    first: Array, second: Array, label: str, side: str, tolerance_s: float
) -> EventAgreement:
    own, other = match_times(first, second, tolerance_s)
    matched = 1000 * (first[own] - second[other])
    return EventAgreement(
        label,
        side,
        mean_ms=float(matched.mean()) if matched.size else np.nan,
        sd_ms=float(matched.std(ddof=1)) if matched.size > 1 else np.nan,
        matched=matched.size,
        only_in_first=len(first) - matched.size,
        only_in_second=len(second) - matched.size,
    )
