"""Gait events from the file or from markers, and how far two sources of events agree."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np

from hbm.markers import Markers, MarkerSet
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.filtering import butterworth, low_pass
from hbm.signals.samples import median_of, stretches
from hbm.spatial import Array, Indices
from pipeline.config.schema import EventMethod
from pipeline.io.recording import Event

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "events")

SIDES: Final = ("left", "right")
LABELS: Final = ("foot_strike", "foot_off")

BY_PLATES: Final[tuple[EventMethod, ...]] = ("plates", "auto")
"""Methods whose events need no comparison with the plates: it would be one with themselves."""


class FoundEvents(NamedTuple):
    """Gait events of a trial.

    Attributes
    ----------
    events
        In order of time.
    note
        Which events these are and how many, or why there are none.
    why_none
        Why there are none; empty where there are.
    """

    events: tuple[Event, ...]
    note: Note
    why_none: str = ""

    @classmethod
    def of(cls, events: tuple[Event, ...], code: str, /, **values: Any) -> "FoundEvents":
        """Give events, with a note that counts the strikes of both feet."""
        strikes = {side: event_times(events, "foot_strike", side).size for side in SIDES}
        return cls(events, Note.of(code, **strikes, **values))

    @classmethod
    def none(cls, reason: str) -> "FoundEvents":
        """No events, for a reason."""
        return cls((), Note.of("events_unknown", reason=reason), reason)


def gait_events(
    of_file: tuple[Event, ...], markers: Markers, marker_set: MarkerSet, method: EventMethod
) -> FoundEvents:
    """Give the gait events that a recording shows before its motion is solved.

    They are the file's own or Zeni's, which stand in for "plates" and "auto".

    Parameters
    ----------
    of_file
        The file's events.
    markers, marker_set
        Trajectories, and the landmarks that they mark.
    method
        Where events come from, of `choose_method`.

    Returns
    -------
    FoundEvents
        None where neither the file nor the markers give any.
    """
    if method == "file":
        if of_file:
            return FoundEvents.of(of_file, "events_of_file")
        return FoundEvents.none(
            'the file has none, and others are not looked for with events = "file"'
        )
    try:
        return FoundEvents.of(zeni_events(markers, marker_set), "events_from_markers")
    except ValueError as error:
        return FoundEvents.none(str(error))


def choose_method(
    of_file: tuple[Event, ...],
    swings: "Swings",
    wanted: EventMethod | None,
    of_plates: tuple[Event, ...] = (),
    carried: float = 0.0,
) -> tuple[EventMethod, tuple[Note, ...]]:
    """Choose where a trial's gait events come from: not from a file that the feet contradict.

    Parameters
    ----------
    of_file
        Events of the recording.
    swings
        Of `foot_swings`.
    wanted
        As in the settings; None is the file's where some foot strikes twice in them and the feet do
        not contradict them, else "auto".
    of_plates
        Events where plates carry one foot alone.
    carried
        Share of the frames in which the plates carry the subject: plates that miss many steps show
        other events than the feet.

    Returns
    -------
    method
        Where events are to come from.
    notes
        ``events_contradicted``, or ``events_compared`` and those of `check_events`, where it would
        be the file.
    """
    method = wanted or ("file" if np.isfinite(_stride_s(of_file, SIDES)) else "auto")
    if method != "file" or not of_file:
        return method, ()
    # plates that miss many steps show other events than the feet
    by_plates = {"the plates": of_plates} if carried >= LIMITS.carried_fraction else {}
    doubts = check_events(of_file, by_plates | {"the feet": swings.events})
    if not len(swings.seen):
        return method, doubts
    counts = counterparts(of_file, swings)
    _, _, compared, alone, detected, missing = counts.values()
    # too many of the file without a swing, or swings without an event of the file
    many = alone > LIMITS.alone_fraction * compared or missing > LIMITS.alone_fraction * detected
    # without every other strike, two strides would count as one
    of_side = ([_stride_s(e, [side]) for e in (of_file, swings.events)] for side in SIDES)
    many |= any(by_file > LIMITS.stride_ratio * by_feet for by_file, by_feet in of_side)
    if not many or alone + missing < LIMITS.fewest_events:
        return method, (Note.of("events_compared", **counts), *doubts)
    used = 'the file\'s are used, as events = "file" asks' if wanted else "detected ones are used"
    return wanted or "auto", (Note.of("events_contradicted", **counts, used=used),)


class Swings(NamedTuple):
    """How the feet swing against the pelvis.

    Attributes
    ----------
    time
        (T,) [s].
    feet
        How far each foot is ahead of the pelvis, to its left and above it, (T, 2, 3) [m].
    events
        Foot offs and foot strikes, to some 0.1 s.
    seen
        Spans in which swings can be seen, (S, 2) [s].
    """

    time: Array
    feet: Array
    events: tuple[Event, ...]
    seen: Array


def foot_swings(markers: Markers, marker_set: MarkerSet) -> Swings:
    """Find every swing of the feet, from where a foot is farthest behind to farthest ahead.

    Feet and pelvis are the mean of their visible markers. Ahead is where the pelvis faces, so that
    turns and ways back are seen too; without markers of both its sides, X. Feet are higher in a
    swing than in a stance: that shows who walks backwards. A recording that is too short to be
    filtered shows no swing.
    """
    time, shown = markers.time, marker_set.present(markers.names)

    def middle(labels: Iterable[str]) -> Array:
        places = markers.position[:, [markers.names.index(label) for label in labels]]
        return np.asarray(np.nansum(places, axis=1) / np.isfinite(places).sum(axis=1))

    def of(*segments: str) -> Array:
        return middle(label for label, segment in shown.segment.items() if segment in segments)

    # of both sides, they show where the pelvis faces
    names = [name for name in ("ASIS", "PSIS") if {"L" + name, "R" + name} <= shown.landmark.keys()]
    with np.errstate(invalid="ignore"):  # 0 / 0 where no marker is visible
        # middle of each foot against the middle of the pelvis
        feet = np.stack([of(f"{side}_foot", f"{side}_toes") for side in SIDES], axis=1)
        apart = feet - of("pelvis")[:, None]
        left, right = (middle(shown.landmark[side + name] for name in names) for side in "LR")
        # in the horizontal plane, as complex numbers: turned so that the pelvis faces along X
        way = (left - right)[:, 0] + 1j * (left - right)[:, 1] if names else np.full(len(time), 1j)
        level = (apart[..., 0] + 1j * apart[..., 1]) * (1j * way.conj() / np.abs(way))[:, None]
    feet = np.stack([level.real, level.imag, apart[..., 2]], axis=2)
    try:
        ahead, _, up = np.moveaxis(low_pass(feet, time, LIMITS.cutoff, "zero_phase"), 2, 0)
    except ValueError:
        return Swings(time, feet, (), np.empty((0, 2)))
    # above its lowest place, a foot is higher while it goes ahead: by how far, not where it ends
    lift = up - np.fmin.reduce(up, axis=0)
    # who walks backwards has the feet higher while they go backwards
    ahead = ahead * np.sign(np.nansum(lift * np.gradient(ahead, time, axis=0)))
    events = [
        Event(float(at), label, side)
        for side, place in zip(SIDES, ahead.T, strict=True)
        for label, sign in zip(LABELS, (1, -1), strict=True)
        for at in time[turns(time, sign * place, LIMITS.least_swing)]
    ]
    spans = time[stretches(np.isfinite(ahead).all(axis=1)) - (0, 1)]
    return Swings(time, feet, in_order(events), spans)


def counterparts(of_file: Sequence[Event], swings: Swings) -> dict[str, int]:
    """Match a file's events with the swings of the feet, both ways.

    Returns
    -------
    dict[str, int]
        events, outside: all of the file, and those before or after the recording; compared, alone:
        of the file where swings are seen, and those of them without counterpart; detected, missing:
        of the feet where the file marks events, and those that it lacks.

    Notes
    -----
    Events that are all early or late by up to half a stride, or all of the other side, have
    counterparts where `check_events` names this fault. A file marks what it likes: kinds of events
    that it has not, and pauses of more than a stride without any, lack nothing; but where many of
    its events are outside the recording, it is compared with the whole recording.
    """
    recorded, by_feet = (swings.time[0], swings.time[-1]), swings.events
    stride_s = float(np.nan_to_num(_stride_s(by_feet, SIDES), nan=1.0))
    inside = _within(in_order(of_file), [recorded])
    outside = len(of_file) - len(inside)
    # the offset and the sides that all events have in common
    kinds, exchanged = _compare_sides(inside, by_feet)
    if exchanged:
        by_feet = _of_other_side(by_feet)
    offset_s = float(np.mean([kind.mean_ms / 1000 for kind in kinds] or [0.0]))
    inside = [replace(event, time=event.time - offset_s) for event in inside]
    # in slow walking the same events may be farther apart
    tolerance_s = LIMITS.largest_difference * max(1.0, stride_s)
    # without half a stride at both ends of what is seen, in which a swing may be cut
    compared = _within(inside, swings.seen + np.array([0.5, -0.5]) * stride_s)
    alone = sum(kind.only_in_first for kind in compare_events(compared, by_feet, tolerance_s))
    # spans that the file marks, from pause to pause; events elsewhere may be those missing here
    times = np.array([event.time for event in inside])
    pauses = 1 + np.flatnonzero(np.diff(times) > LIMITS.pause * stride_s)
    # from the first to the last event between two pauses
    marked = [(part[0], part[-1]) for part in np.split(times, pauses) if len(part)]
    if outside and outside + alone > LIMITS.alone_fraction * (outside + len(compared)):
        marked = [recorded]
    of_kinds = {(event.label, event.side) for event in of_file}
    detected = [e for e in _within(by_feet, marked) if (e.label, e.side) in of_kinds]
    missing = sum(kind.only_in_second for kind in compare_events(inside, detected, tolerance_s))
    return {
        "events": len(of_file),
        "outside": outside,
        "compared": len(compared),
        "alone": alone,
        "detected": len(detected),
        "missing": missing,
    }


def _stride_s(events: Sequence[Event], sides: Iterable[str]) -> float:
    """Give the median time between strikes of one foot [s]; NaN where none strikes twice."""
    strides_s = [np.diff(event_times(events, "foot_strike", side)) for side in sides]
    return float(np.median(every_s)) if len(every_s := np.concatenate(strides_s)) else np.nan


def _within(events: Iterable[Event], spans: Array | Sequence[tuple[float, float]]) -> list[Event]:
    """Give the events that are in one of some spans [s]."""
    return [event for event in events if any(a <= event.time <= b for a, b in spans)]


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
    the zero-phase Butterworth filter at 6 Hz first. Of two turning points closer than 0.4 s
    the more extreme counts. A turning point counts only where the foot is seen to travel 0.1 m
    before and after it, so that one at the very ends may be left out.

    Deviations from the original
    ----------------------------
    - The instant is the zero of the filtered velocity, not the nearest frame.
    - Without a toe marker (Human Body Model 2), the second metatarsal head stands in for it.
    """
    sacrum = _forward(markers, marker_set, [("SACR",), ("LPSIS", "RPSIS")])
    # heel and front of a foot, of which the first landmark that has a marker counts
    kinds = ("foot_strike", ("HEE",), 1), ("foot_off", ("MT2", "TOE", "MT5", "MTS"), -1)
    events = []
    for side, letter in (("left", "L"), ("right", "R")):
        for label, names, sign in kinds:
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
    filtered = butterworth(distance, time, LIMITS.cutoff, "zero_phase")
    frame = turns(time, filtered.value, LIMITS.least_excursion)
    # Newton: the zero of the velocity, by the acceleration
    return np.asarray(time[frame] - filtered.velocity[frame] / filtered.acceleration[frame])


def turns(time: Array, distance: Array, least_m: float) -> Indices:
    """Find the frames in which a filtered distance (T,) is largest; none in a gap."""
    # in each stretch without a gap, since a gap may hide a turn
    apart = max(1, round(LIMITS.shortest_stride / median_of(np.diff(time))))
    frames = [np.zeros(0, int)]
    for start, stop in stretches(np.isfinite(distance)):
        frames.append(start + find_peaks(distance[start:stop], apart, least_m))
    return np.concatenate(frames)


def find_peaks(values: Array, apart: int, prominence: float) -> Indices:
    """Find peaks so many samples apart, the highest of those nearer, that stand out so far.

    As `scipy.signal.find_peaks`, which takes half a second to load.
    """
    # a peak may be flat: of its samples, the middle one
    first = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    last = np.append(first[1:], len(values)) - 1
    # where values rise before, and fall after
    slope = np.sign(np.diff(values[first]))
    top = 1 + np.flatnonzero((slope[:-1] > 0) & (slope[1:] < 0))
    peaks = (first[top] + last[top]) // 2
    # from the highest peak on, nearer ones are left out
    kept = np.ones(len(peaks), bool)
    for k in np.argsort(values[peaks])[::-1]:
        if kept[k]:
            kept &= (np.abs(peaks - peaks[k]) >= apart) | (peaks == peaks[k])
    # prominence: height above the higher one of both lowest points beside it
    fenced = np.concatenate([[np.inf], values, [np.inf]])
    for k in np.flatnonzero(kept):
        height, sides = values[peaks[k]], (fenced[peaks[k] + 1 :: -1], fenced[peaks[k] + 1 :])
        # on each side down to the lowest sample before a higher one
        lowest = [side[: (side > height).argmax()].min() for side in sides]
        kept[k] = height - max(lowest) >= prominence
    return np.asarray(peaks[kept])


def in_order(events: Iterable[Event]) -> tuple[Event, ...]:
    """Give events in order of time."""
    return tuple(sorted(events, key=lambda event: event.time))


def _forward(markers: Markers, marker_set: MarkerSet, choices: Sequence[Sequence[str]]) -> Array:
    """Give the forward coordinate (T,) of the middle of the first landmarks that have markers."""
    shown = marker_set.present(markers.names).landmark
    for landmarks in choices:
        if shown.keys() >= {*landmarks}:
            columns = [markers.names.index(shown[landmark]) for landmark in landmarks]
            return np.asarray(markers.position[:, columns, 0].mean(axis=1))
    names = " or ".join(" with ".join(landmarks) for landmarks in choices)
    raise ValueError(
        f"no marker of the set {marker_set.name!r} shows the landmark {names} in this recording"
    )


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

    @property
    def comparable(self) -> bool:
        """Whether enough events are the same, about equally far from each other."""
        enough = max(LIMITS.fewest_events, min(self.only_in_first, self.only_in_second))
        return bool(self.matched >= enough and self.sd_ms < LIMITS.agreement)


def compare_events(
    first: Iterable[Event], second: Iterable[Event], tolerance_s: float = LIMITS.largest_difference
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
    first, second, agreements = tuple(first), tuple(second), list[EventAgreement]()
    for label, side in product(LABELS, SIDES):
        here, there = event_times(first, label, side), event_times(second, label, side)
        in_first, in_second = match_times(here, there, tolerance_s)
        apart_ms, number = 1000 * (here[in_first] - there[in_second]), len(in_first)
        mean_ms = float(apart_ms.mean()) if number else np.nan
        sd_ms = float(apart_ms.std(ddof=1)) if number > 1 else np.nan
        alone = len(here) - number, len(there) - number
        agreements.append(EventAgreement(label, side, mean_ms, sd_ms, number, *alone))
    return tuple(agreements)


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
    # distances of all pairs; two that are each other's nearest match
    distance = np.abs(first[:, None] - second)
    nearest = distance.argmin(axis=1)
    indices = np.arange(len(first))
    same = (distance.argmin(axis=0)[nearest] == indices) & (
        distance[indices, nearest] <= tolerance_s
    )
    return indices[same], nearest[same]


OTHER_SIDE: Final = {"left": "right", "right": "left"}


def check_events(
    events: Sequence[Event], references: Mapping[str, Sequence[Event]]
) -> tuple[Note, ...]:
    """Find gait events of a file that carry the other side's name, are early, or late.

    Parameters
    ----------
    events
        Of the file.
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
    for source, reference in references.items():
        kinds, exchanged = _compare_sides(events, reference)
        if exchanged:
            return (Note.of("events_of_other_side", source=source),)
        if offset_ms := {
            k.kind: k.mean_ms for k in kinds if abs(k.mean_ms) > LIMITS.largest_offset
        }:
            return (Note.of("events_offset", source=source, offset_ms=offset_ms),)
        if kinds:
            break
    return ()


def _of_other_side(events: Iterable[Event]) -> tuple[Event, ...]:
    """Give events with their sides exchanged."""
    return tuple(replace(event, side=OTHER_SIDE[event.side]) for event in events)


def _compare_sides(
    events: Sequence[Event], reference: Sequence[Event]
) -> tuple[list[EventAgreement], bool]:
    """Compare the kinds of events that are comparable; with sides exchanged where these coincide.

    And tell whether they do.
    """
    # as named, and with left and right exchanged
    same, crossed = (
        [
            kind
            for kind in compare_events(events, others, LIMITS.compared_difference)
            if kind.comparable
        ]
        for others in (reference, _of_other_side(reference))
    )
    # exchanged where they coincide crossed, and all are far as named
    coincide = any(abs(kind.mean_ms) < LIMITS.agreement for kind in crossed)
    exchanged = coincide and all(abs(kind.mean_ms) > LIMITS.largest_offset for kind in same)
    return (crossed if exchanged else same), exchanged
