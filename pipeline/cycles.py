"""Gait events, gait cycles, and signals over 0–100 % of a cycle."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import find_peaks

from hbm.filtering import butterworth, interpolate
from hbm.markers import Markers
from hbm.spatial import Array
from pipeline.recording import Event, Recording

SIDES = ("left", "right")
LABELS = ("foot_strike", "foot_off")

EVENT_CUTOFF_HZ = 6.0
MINIMUM_STRIDE_S = 0.4
"""Two strikes of one foot closer than this are one (running at 4 m/s takes about 0.7 s)."""
MINIMUM_EXCURSION_M = 0.1
"""Foot against sacrum along the walk: less than the slowest stride, more than standing sway."""
MINIMUM_CONTACT_S = 0.1
"""Shorter contacts and shorter losses of contact are chatter at the threshold, not steps."""
PLAUSIBLE_DURATION = (0.6, 1.5)
"""Shortest and longest gait cycle, in medians of the trial."""

SACRUM = (("SACR",), ("LPSIS", "RPSIS"), ("LPSI", "RPSI"), ("V.Sacral",))
HEEL = ("{}HEE", "{}HEEL", "{}CAL", "{}.Heel")
TOE = ("{}MT2", "{}TOE", "{}.Toe.Tip")


def gait_events(recording: Recording) -> tuple[tuple[Event, ...], str]:
    """Give the gait events of a recording: the file's own where it has them, else Zeni's.

    Parameters
    ----------
    recording
        The trial. Its events are used when some foot strikes at least twice in them.

    Returns
    -------
    events
        In order of time.
    sentence
        Which events these are and how many, for a person.

    Raises
    ------
    ValueError
        As :func:`zeni_events`, where the file has no events.
    """
    strikes = [e.side for e in recording.events if e.label == "foot_strike"]
    if any(strikes.count(side) >= 2 for side in SIDES):
        events, origin = recording.events, "as the file has them"
    else:
        events = zeni_events(recording.markers)
        origin = "from heel, toe and sacrum markers (Zeni 2008), for the file has none"
    counts = (f"{_times(events, 'foot_strike', side).size} {side}" for side in SIDES)
    return events, f"gait events {origin}: {' and '.join(counts)} foot strikes"


def zeni_events(markers: Markers) -> tuple[Event, ...]:
    """Find gait events by the coordinate method of Zeni et al. (2008).

    Parameters
    ----------
    markers
        Trajectories in lab axes, or in those of a treadmill that pitches: the X axis has to be the
        walking direction. Needed are a sacrum (SACR, or the mid-point of both PSIS) and per foot a
        heel and a toe marker (HEE, and MT2 or TOE).

    Returns
    -------
    tuple of Event
        Foot strikes where the heel, foot offs where the toe turns round against the sacrum, in
        order of time and to a fraction of a frame. In a gap there are none.

    Raises
    ------
    ValueError
        If a marker is missing, or if the trial is shorter than the filter needs.

    Notes
    -----
    Zeni, Richards and Higginson 2008, Gait Posture 27:710. A foot strikes where heel − sacrum is
    largest along the walking direction and leaves where toe − sacrum is smallest. Trajectories pass
    the zero-phase Butterworth filter at ``EVENT_CUTOFF_HZ`` first. Of two turning points closer
    than ``MINIMUM_STRIDE_S`` the more extreme counts. A turn counts only where the foot is seen to
    travel ``MINIMUM_EXCURSION_M`` before and after it, so one at the very ends may be left out.

    Deviations from the original
    ----------------------------
    - The instant is the zero of the filtered velocity, not the nearest frame.
    - Without a toe marker (Human Body Model 2), the second metatarsal head stands in for it.
    """
    sacrum = _first_present(markers, SACRUM, "sacrum")
    events = []
    for side, letter in (("left", "L"), ("right", "R")):
        for label, names, sign in (("foot_strike", HEEL, 1), ("foot_off", TOE, -1)):
            choices = [(name.format(letter),) for name in names]
            foot = _first_present(markers, choices, f"{side} {'heel' if sign > 0 else 'toe'}")
            times = _turning_points(markers.time, sign * (foot - sacrum))
            events += [Event(float(t), label, side) for t in times]
    return _in_order(events)


def force_events(
    wrenches: Mapping[str, ArrayLike], time: ArrayLike, threshold_n: float
) -> tuple[Event, ...]:
    """Find gait events where the vertical force crosses a threshold: a check on the markers'.

    Parameters
    ----------
    wrenches
        Side ("left", "right") -> action on that foot in lab axes, (N, 6) [N, N·m], not filtered:
        a filter at 6 Hz begins contact early.
    time
        Sample times, (N,) [s].
    threshold_n
        Vertical force of contact [N], usually 20 to 50.

    Returns
    -------
    tuple of Event
        In order of time, to a fraction of a sample. Contacts and losses of contact shorter than
        ``MINIMUM_CONTACT_S`` are chatter and do not count.

    Raises
    ------
    ValueError
        If a side is not "left" or "right", or wrenches do not fit the times.
    """
    time, events = np.asarray(time, float), []
    for side, wrench in wrenches.items():
        wrench = np.asarray(wrench, float)
        if side not in SIDES or wrench.shape != (len(time), 6):
            raise ValueError(
                f'wrenches must be ({len(time)}, 6) for "left" and "right", '
                f"got {wrench.shape} for {side!r}"
            )
        starts, stops = _contacts(time, wrench[:, 2] - threshold_n)
        events += [Event(float(t), "foot_strike", side) for t in starts]
        events += [Event(float(t), "foot_off", side) for t in stops]
    return _in_order(events)


@dataclass(frozen=True, slots=True)
class EventAgreement:
    """How far two ways of finding one kind of event agree.

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

    def __str__(self) -> str:
        """Say it in one line."""
        return (
            f"{self.side} {self.label.replace('_', ' ')}: {self.mean_ms:+.0f} ± {self.sd_ms:.0f} ms"
            f" ({self.matched} matched, {self.only_in_first} and {self.only_in_second} alone)"
        )


def compare_events(
    first: Iterable[Event], second: Iterable[Event], tolerance_s: float = 0.2
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
            _times(first, label, side), _times(second, label, side), label, side, tolerance_s
        )
        for label in LABELS
        for side in SIDES
    )


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
    strikes = _times(events, "foot_strike", side)
    spans = np.column_stack([strikes[:-1], strikes[1:]])
    duration = np.diff(spans, axis=1)[:, 0]
    expected = [("foot_off", side), ("foot_strike", SIDES[1 - SIDES.index(side)])]
    within = {kind: _times(events, *kind) for kind in expected}
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


def _turning_points(time: Array, distance: Array) -> Array:
    """Find when a distance (T,) is largest; a gap hides what happens in it."""
    filtered = butterworth(distance, time, EVENT_CUTOFF_HZ, "zero_phase")
    apart = max(1, round(MINIMUM_STRIDE_S / np.median(np.diff(time))))
    known = np.isfinite(filtered.value)
    frames = [np.zeros(0, int)]
    for start, stop in np.flatnonzero(np.diff(known, prepend=False, append=False)).reshape(-1, 2):
        peaks, _ = find_peaks(
            filtered.value[start:stop], distance=apart, prominence=MINIMUM_EXCURSION_M
        )
        frames.append(start + peaks)
    frame = np.concatenate(frames)
    return np.asarray(time[frame] - filtered.velocity[frame] / filtered.acceleration[frame])


def _contacts(time: Array, excess: Array) -> tuple[Array, Array]:
    """Find when contacts start and stop from the force above the threshold, (N,)."""
    before, after = excess[:-1], excess[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        crossing = time[:-1] + np.diff(time) * before / (before - after)
    starts, stops = crossing[(before <= 0) & (after > 0)], crossing[(before > 0) & (after <= 0)]
    stops, starts = _without_brief(stops, starts)
    return _without_brief(starts, stops)


def _without_brief(begin: Array, end: Array) -> tuple[Array, Array]:
    """Drop the pairs of times that enclose less than the shortest contact."""
    following = np.searchsorted(end, begin)
    brief = np.append(end, np.inf)[following] - begin < MINIMUM_CONTACT_S
    return begin[~brief], np.delete(end, following[brief])


def _agreement(
    first: Array, second: Array, label: str, side: str, tolerance_s: float
) -> EventAgreement:
    difference = first[:, None] - second
    if difference.size:
        row = np.arange(len(first))
        nearest, back = abs(difference).argmin(axis=1), abs(difference).argmin(axis=0)
        difference = difference[row, nearest][back[nearest] == row]
    matched = 1000 * difference[abs(difference) <= tolerance_s]
    return EventAgreement(
        label,
        side,
        mean_ms=float(matched.mean()) if matched.size else np.nan,
        sd_ms=float(matched.std(ddof=1)) if matched.size > 1 else np.nan,
        matched=matched.size,
        only_in_first=len(first) - matched.size,
        only_in_second=len(second) - matched.size,
    )


def _times(events: Iterable[Event], label: str, side: str) -> Array:
    times = [event.time for event in events if (event.label, event.side) == (label, side)]
    return np.array(sorted(times), float)


def _in_order(events: Iterable[Event]) -> tuple[Event, ...]:
    return tuple(sorted(events, key=lambda event: event.time))


def _first_present(markers: Markers, choices: Sequence[Sequence[str]], what: str) -> Array:
    """Give the forward coordinate (T,) of the first choice that the trial has, in its middle."""
    for names in choices:
        if set(names) <= set(markers.names):
            columns = [markers.names.index(name) for name in names]
            return np.asarray(markers.position[:, columns, 0].mean(axis=1))
    wanted = " or ".join(" with ".join(names) for names in choices)
    raise ValueError(
        f"gait events need a {what} marker: {wanted}; present: {', '.join(markers.names)}"
    )
