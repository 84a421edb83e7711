"""Gait events from the file or from markers, and how far two sources of events agree."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from scipy.signal import find_peaks

from hbm.markers import Markers, MarkerSet
from hbm.notes import Note
from hbm.signals.filtering import butterworth
from hbm.signals.samples import stretches
from hbm.spatial import Array, Indices, Mask
from pipeline.config.schema import EventMethod
from pipeline.io.recording import Event

SIDES: Final = ("left", "right")
LABELS: Final = ("foot_strike", "foot_off")

TIMED_BY_PLATES: Final[tuple[EventMethod, ...]] = ("plates", "auto")
"""Methods whose events need no comparison with the plates: it would be one with themselves."""
EVENT_CUTOFF_HZ: Final = 6.0
"""Gait is below it, marker noise above; as for the motion."""
MIN_STRIDE_S: Final = 0.4
"""Two strikes of one foot closer than this are one (running at 4 m/s takes about 0.7 s)."""
MIN_EXCURSION_M: Final = 0.1
"""Foot against sacrum along the walk: less than the slowest stride, more than standing sway."""

NONE_IN_FILE: Final = 'the file has none, and others are not looked for with events = "file"'

SACRUM: Final = (("SACR",), ("LPSIS", "RPSIS"))
HEEL: Final = "HEE"
TOE: Final = ("MT2", "TOE", "MT5", "MTS")
"""Landmarks that show the sacrum, the heel and the front of a foot, the first that has a marker."""


def gait_events(
    of_file: tuple[Event, ...],
    markers: Markers,
    marker_set: MarkerSet,
    wanted: EventMethod | None = None,
) -> tuple[tuple[Event, ...], Note]:
    """Give the gait events that a recording shows before its motion is solved.

    They are the file's own where it has them, else Zeni's, which stand in for "plates" and "auto".

    Parameters
    ----------
    of_file
        The file's events; by default they are used when some foot strikes at least twice in them.
    markers, marker_set
        Trajectories, and the landmarks that they mark.
    wanted
        Where events are to come from, as in the settings.

    Returns
    -------
    events
        In order of time; none where neither the file nor the markers give any.
    note
        Which events these are and how many, or why there are none.
    """
    if wanted == "file" and not of_file:
        return (), Note.of("events_unknown", reason=NONE_IN_FILE)
    if wanted == "file" or (wanted is None and has_strides(of_file)):
        events, code = of_file, "events_of_file"
    else:
        try:
            events, code = zeni_events(markers, marker_set), "events_from_markers"
        except ValueError as error:
            return (), Note.of("events_unknown", reason=str(error))
    left, right = (event_times(events, "foot_strike", side).size for side in SIDES)
    return events, Note.of(code, left=left, right=right)


def has_strides(events: Sequence[Event]) -> bool:
    """Tell whether some foot strikes at least twice in events."""
    return any(event_times(events, "foot_strike", side).size >= 2 for side in SIDES)


def zeni_events(markers: Markers, marker_set: MarkerSet) -> tuple[Event, ...]:
    """Find gait events by the coordinate method of Zeni et al. (2008).

    Parameters
    ----------
    markers
        Trajectories in lab axes, or in those of a treadmill that pitches: the X axis has to be the
        walking direction.
    marker_set
        The landmarks that they mark. Needed are the sacrum (SACR or PSIS), and per foot the heel
        (HEE) and its front (MT2, TOE or MT5).

    Returns
    -------
    tuple of Event
        Foot strikes where the heel, foot offs where the toe changes direction against the sacrum,
        in order of time and to a fraction of a frame. In a gap there are none.

    Raises
    ------
    ValueError
        If a marker is missing, or if the trial is shorter than the filter needs.

    Notes
    -----
    Zeni, Richards and Higginson 2008, Gait Posture 27:710. A foot strikes where heel − sacrum is
    largest along the walking direction and leaves where toe − sacrum is smallest. Trajectories pass
    the zero-phase Butterworth filter at ``EVENT_CUTOFF_HZ`` first. Of two turning points closer
    than ``MIN_STRIDE_S`` the more extreme counts. A turning point counts only where the foot is
    seen to travel ``MIN_EXCURSION_M`` before and after it, so that one at the very ends may be left
    out.

    Deviations from the original
    ----------------------------
    - The instant is the zero of the filtered velocity, not the nearest frame.
    - Without a toe marker (Human Body Model 2), the second metatarsal head stands in for it.
    """
    sacrum = _forward(markers, marker_set, SACRUM)
    events = []
    for side, letter in (("left", "L"), ("right", "R")):
        for label, names, sign in (("foot_strike", (HEEL,), 1), ("foot_off", TOE, -1)):
            foot = _forward(markers, marker_set, [(letter + name,) for name in names])
            times = _turning_points(markers.time, sign * (foot - sacrum))
            events += [Event(float(t), label, side) for t in times]
    return in_order(events)


def event_times(events: Iterable[Event], label: str, side: str) -> Array:
    """Give the times of one kind of event, in order, (E,) [s]."""
    times = [event.time for event in events if (event.label, event.side) == (label, side)]
    return np.array(sorted(times), float)


def _turning_points(time: Array, distance: Array) -> Array:
    """Find when a distance (T,) is largest; in a gap nothing is found."""
    filtered = butterworth(distance, time, EVENT_CUTOFF_HZ, "zero_phase")
    frame = turns(time, filtered.value)
    return np.asarray(time[frame] - filtered.velocity[frame] / filtered.acceleration[frame])


def turns(time: Array, distance: Array) -> Indices:
    """Find the frames in which a filtered distance (T,) is largest; none in a gap."""
    apart = max(1, round(MIN_STRIDE_S / np.median(np.diff(time))))
    frames = [np.zeros(0, int)]
    for start, stop in stretches(np.isfinite(distance)):
        peaks, _ = find_peaks(distance[start:stop], distance=apart, prominence=MIN_EXCURSION_M)
        frames.append(start + peaks)
    return np.concatenate(frames)


def in_order(events: Iterable[Event]) -> tuple[Event, ...]:
    """Give events in order of time."""
    return tuple(sorted(events, key=lambda event: event.time))


def _forward(markers: Markers, marker_set: MarkerSet, choices: Sequence[Sequence[str]]) -> Array:
    """Give the forward coordinate (T,) of the middle of the first landmarks that have markers."""
    for landmarks in choices:
        names = [marker_set.landmark.get(landmark) for landmark in landmarks]
        columns = [markers.names.index(name) for name in names if name in markers.names]
        if len(columns) == len(landmarks):
            return np.asarray(markers.position[:, columns, 0].mean(axis=1))
    wanted = " or ".join(" with ".join(landmarks) for landmarks in choices)
    raise ValueError(
        f"no marker of the set {marker_set.name!r} shows the landmark {wanted} in this recording"
    )


MAX_DIFFERENCE_S: Final = 0.2
"""Of two events that may be the same; events of one kind and side are a second apart."""


class EventAgreement(NamedTuple):
    """Mean and standard deviation of first minus second [ms]; NaN where too few match."""

    label: str
    side: str
    mean_ms: float
    sd_ms: float
    matched: int
    only_in_first: int
    only_in_second: int

    @property
    def kind(self) -> str:
        """Name the kind of event, such as "left foot strikes"."""
        return f"{self.side} {self.label.replace('_', ' ')}s"


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
    first, second, found = tuple(first), tuple(second), []
    for label, side in product(LABELS, SIDES):
        here, there = event_times(first, label, side), event_times(second, label, side)
        own, other = match_times(here, there, tolerance_s)
        apart_ms, number = 1000 * (here[own] - there[other]), len(own)
        mean_ms = float(apart_ms.mean()) if number else np.nan
        sd_ms = float(apart_ms.std(ddof=1)) if number > 1 else np.nan
        alone = len(here) - number, len(there) - number
        found.append(EventAgreement(label, side, mean_ms, sd_ms, number, *alone))
    return tuple(found)


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
    of_plates: tuple[Event, ...],
    markers: Markers,
    marker_set: MarkerSet,
    carried: Mask,
    method: EventMethod,
) -> dict[str, tuple[Event, ...]]:
    """Give a trial's gait events by its plates and its markers, as far as both can be found.

    Parameters
    ----------
    of_plates
        Events where plates carry one foot alone.
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
    found = {}
    if method not in TIMED_BY_PLATES and np.mean(carried) >= MIN_CARRIED_SHARE:
        found["the plates"] = of_plates
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
    far = [each for each in own if abs(each.mean_ms) > MAX_OFFSET_MS]
    exchanged = [each for each in crossed if abs(each.mean_ms) < MAX_AGREEMENT_MS]
    if exchanged and len(far) == len(own):
        return (Note.of("events_of_other_side", source=source),)
    if not far:
        return ()
    offset_ms = {each.kind: each.mean_ms for each in far}
    return (Note.of("events_offset", source=source, offset_ms=offset_ms),)


def _comparable(events: Iterable[Event], reference: Iterable[Event]) -> list[EventAgreement]:
    """Compare kinds of events of which enough are about equally far from the reference's."""
    return [
        each
        for each in compare_events(events, reference, MAX_APART_S)
        if each.matched >= max(MIN_EVENTS, min(each.only_in_first, each.only_in_second))
        and each.sd_ms < MAX_SD_MS
    ]
