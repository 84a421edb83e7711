"""Gait events: foot strike and foot off, from the file, from markers or from forces."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import find_peaks

from hbm.markers import Markers, MarkerSet
from hbm.notes import Note
from hbm.signals.filtering import butterworth
from hbm.signals.samples import stretches
from hbm.spatial import Array
from pipeline.config.schema import EventMethod
from pipeline.io.recording import Event

SIDES: Final = ("left", "right")
LABELS: Final = ("foot_strike", "foot_off")

EVENT_CUTOFF_HZ: Final = 6.0
"""Gait is below it, marker noise above; as for the motion."""
MIN_STRIDE_S: Final = 0.4
"""Two strikes of one foot closer than this are one (running at 4 m/s takes about 0.7 s)."""
MIN_EXCURSION_M: Final = 0.1
"""Foot against sacrum along the walk: less than the slowest stride, more than standing sway."""
MIN_CONTACT_S: Final = 0.1
"""Shorter contacts and shorter losses of contact are force noise at the threshold, not steps."""

NONE_IN_FILE: Final = 'the file has none, and others are not looked for with events = "file"'

SACRUM: Final = (("SACR",), ("LPSIS", "RPSIS"))
HEEL: Final = "HEE"
TOE: Final = ("MT2", "TOE", "MT5")
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


def force_events(
    wrenches: Mapping[str, ArrayLike], time: ArrayLike, threshold_n: float
) -> tuple[Event, ...]:
    """Find gait events where the vertical force crosses a threshold, to check those of markers.

    Parameters
    ----------
    wrenches
        Side ("left", "right") -> action on that foot in lab axes, (N, 6) [N, N·m], not filtered:
        a low-pass at 6 Hz would begin contact early.
    time
        Sample times, (N,) [s].
    threshold_n
        Vertical force of contact [N], usually 20 to 50.

    Returns
    -------
    tuple of Event
        In order of time, to a fraction of a sample. Contacts and losses of contact shorter than
        ``MIN_CONTACT_S`` are noise and do not count.

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
    return in_order(events)


def event_times(events: Iterable[Event], label: str, side: str) -> Array:
    """Give the times of one kind of event, in order, (E,) [s]."""
    times = [event.time for event in events if (event.label, event.side) == (label, side)]
    return np.array(sorted(times), float)


def _turning_points(time: Array, distance: Array) -> Array:
    """Find when a distance (T,) is largest; in a gap nothing is found."""
    filtered = butterworth(distance, time, EVENT_CUTOFF_HZ, "zero_phase")
    apart = max(1, round(MIN_STRIDE_S / np.median(np.diff(time))))
    known = np.isfinite(filtered.value)
    frames = [np.zeros(0, int)]
    for start, stop in stretches(known):
        peaks, _ = find_peaks(
            filtered.value[start:stop], distance=apart, prominence=MIN_EXCURSION_M
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
    brief = np.append(end, np.inf)[following] - begin < MIN_CONTACT_S
    return begin[~brief], np.delete(end, following[brief])


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
