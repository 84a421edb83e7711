"""Gait events of a trial: by the motion of the feet, by the plates, or both."""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Final

import numpy as np

from compensation.platform import PlatformPose
from hbm.markers import Markers, MarkerSet
from hbm.numbers import read_numbers
from hbm.signals.filtering import butterworth, low_pass
from hbm.signals.samples import median_of, stretches
from hbm.spatial import Array, Indices
from pipeline.config.schema import EventMethod
from pipeline.io.recording import Event
from pipeline.trial.gait.contact import FEET, Contact
from pipeline.trial.gait.contact import LIMITS as CONTACT
from pipeline.trial.gait.events import (
    LABELS,
    SIDES,
    FoundEvents,
    event_times,
    gait_events,
    in_order,
    match_times,
    turns,
)
from pipeline.trial.gait.events import LIMITS as EVENTS
from pipeline.trial.ground.wrenches import PlateLoad

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "detection")


def foot_motion(places: Array, pose: PlatformPose | None) -> Array:
    """Give how pelvis and feet moved forward on the platform that carries them.

    Parameters
    ----------
    places
        Of pelvis, ankles and balls, not filtered, of `places_of`, (T, 5, 3) [m].
    pose
        The platform's pose at these times; None where it stands still.

    Returns
    -------
    Array
        Forward places of pelvis, ankles and balls, left before right, in the frame of the platform,
        the belts moving in it, (T, 5) [m]; NaN where the pose of body or platform is unknown.
    """
    if pose is None:
        return places[..., 0]
    # first column of the rotation: the platform's forward axis in the lab
    relative = places - pose.position[:, None]
    return np.asarray(np.einsum("ti,tki->tk", pose.rotation[:, :, 0], relative))


def foot_motion_events(time: Array, motion: Array) -> tuple[Event, ...]:
    """Find foot strikes and foot offs by the speed of each foot above the ground.

    Parameters
    ----------
    time
        (T,) [s].
    motion
        How pelvis and feet moved, of `foot_motion`, (T, 5) [m].

    Returns
    -------
    tuple of Event
        In order of time, to a fraction of a frame. In a gap there are none, and none of a foot
        that does not swing past the pelvis.

    Raises
    ------
    ValueError
        If the trial is shorter than the filter needs.

    Notes
    -----
    A foot swings between the instants at which it is farthest behind and ahead of the pelvis (Zeni
    et al. 2008). In the middle of the stance between two swings the ball of the foot rests on the
    ground, whose speed it shows: a belt's, or none. A foot strikes when, after it was farthest
    ahead, the speed of the ankle above the ground falls below 0.6 of the walking speed, that of the
    pelvis above the ground; it leaves when, before it was farthest behind, that of the ball rises
    above 0.8 of it. Belts may so differ from each other, change their speed, or stand still, and
    the platform may move.
    """
    back, events = -time[::-1], list[Event]()
    # low-pass and derivative in one, so that speeds have no noise of differences
    pelvis_speed = butterworth(motion[:, 0], time, EVENTS.cutoff, "zero_phase").velocity
    # ankles ahead of the pelvis and balls behind it, and their speeds
    apart = (motion[:, 1:] - motion[:, :1]) * [1.0, 1.0, -1.0, -1.0]
    apart = low_pass(apart, time, EVENTS.cutoff, "zero_phase")
    speeds = butterworth(motion[:, 1:], time, LIMITS.speed_cutoff, "zero_phase").velocity
    # a swing begins with the ball farthest behind and ends with the ankle farthest ahead
    for foot, side in enumerate(SIDES):
        ahead, behind = (turns(time, x, EVENTS.least_excursion).tolist() for x in apart.T[foot::2])
        ankle_speed, ball_speed = speeds.T[foot::2]
        is_known = np.isfinite(ball_speed + pelvis_speed)
        stances = [(a, b) for a, b in _stances(ahead, behind) if is_known[a:b].all()]
        if not stances:
            continue
        # between stances, speeds of ground and walking change along lines
        middle, *of_stances = _ground(time, stances, ball_speed, pelvis_speed)
        ground, walking = (np.interp(time, middle, speed) for speed in of_stances)
        # falls through zero when the foot has slowed down with the ground
        strike = ankle_speed - ground - LIMITS.strike_fraction * walking
        off = ball_speed - ground - LIMITS.off_fraction * walking
        # foot offs are strikes of the recording backwards in time
        strikes = (_falls_through(time, strike, k) for k in ahead)
        offs = (_falls_through(back, off[::-1], len(time) - 1 - k) for k in behind)
        events += [Event(t, "foot_strike", side) for t in strikes if t is not None]
        events += [Event(-t, "foot_off", side) for t in offs if t is not None]
    return in_order(events)


def _stances(ahead: list[int], behind: list[int]) -> list[tuple[int, int]]:
    """Pair each frame in which a foot is farthest ahead with the next in which it is behind."""
    # the next turn behind, if it comes before the next turn ahead
    stops = np.searchsorted(behind, ahead, side="right")
    pairs = [(a, behind[k]) for a, k in zip(ahead, stops, strict=True) if k < len(behind)]
    following = [*ahead[1:], np.inf]
    return [(a, b) for (a, b), after in zip(pairs, following, strict=False) if b < after]


def _ground(
    time: Array, stances: list[tuple[int, int]], ball_speed: Array, pelvis_speed: Array
) -> Array:
    """Give time, speed of the ground and walking speed in every stance, (3, S) [s], [m/s]."""
    of_stances = []
    for start, stop in stances:
        first, last = (round(start + fraction * (stop - start)) for fraction in LIMITS.mid_stance)
        # a ball at rest shows how fast the ground moves
        speed = median_of(ball_speed[first : last + 1])
        walking = float(np.mean(pelvis_speed[start:stop])) - speed
        of_stances.append(((time[first] + time[last]) / 2, speed, walking))
    return np.array(of_stances).T


def _falls_through(time: Array, value: Array, frame: int) -> float | None:
    """Give when a value first falls to zero from a frame on; None if not within a stride."""
    after = value[frame : 1 + np.searchsorted(time, time[frame] + EVENTS.shortest_stride)]
    below = np.flatnonzero(~(after > 0))
    if not len(below) or not np.isfinite(after[below[0]]):
        return None
    if below[0] == 0:
        return float(time[frame])
    # the zero on a line between two frames
    k = frame + int(below[0]) - 1
    return float(time[k] + (time[k + 1] - time[k]) * value[k] / (value[k] - value[k + 1]))


PLATE, FOOT, START, STOP, LANDS, LEAVES = range(6)
"""Columns of `_holds`."""


def plate_events(
    contacts: Sequence[Contact], loads: Sequence[PlateLoad], time: Array, weight_n: float
) -> tuple[Event, ...]:
    """Find foot strikes and foot offs at which a plate carries one foot alone.

    Parameters
    ----------
    contacts
        Which foot stood on which plate when, of `share_between_feet`.
    loads
        The plates' loads.
    time
        Of the frames that the contacts count, (T,) [s].
    weight_n
        Body weight.

    Returns
    -------
    tuple of Event
        In order of time, to a fraction of a plate's sample. There is none where a foot comes to or
        leaves a plate that carries the other one, nor of a contact that is uncertain, nor where the
        recording begins or ends.

    Notes
    -----
    The event is where the load leaves, or falls to, 20 N above the level that the plate has just
    before the strike, or just after the foot off: on a platform that moves, plates that are not
    compensated read up to some tens of newtons without load. The loads of plates that a foot steps
    on at the same time are added.
    """
    holds = _holds(contacts, len(time))
    # what happens at foot off is a strike of the recording backwards in time
    back = holds[:, [PLATE, FOOT, STOP, START, LEAVES, LANDS]]
    back[:, [START, STOP]] = len(time) - back[:, [START, STOP]]
    loads_back = [PlateLoad(load.number, -load.time[::-1], load.force[::-1]) for load in loads]
    strikes = _landings(holds, loads, time, weight_n)
    offs = _landings(back, loads_back, -time[::-1], weight_n)
    events = [Event(at, "foot_strike", SIDES[foot]) for foot, at in strikes]
    return in_order([*events, *(Event(-at, "foot_off", SIDES[foot]) for foot, at in offs)])


def _holds(contacts: Sequence[Contact], frames: int) -> Indices:
    """Cut contacts where the foot changes, (H, 6).

    A row holds the plate's number, the foot, 0 left and 1 right, the first frame and the one after
    the last, and whether the plate is without load before and after it, and whose foot it is is
    certain.
    """
    rows = []
    for contact in contacts:
        is_certain = not contact.ambiguous
        bounds = [contact.start, *contact.changes, contact.stop]
        # where the foot changes the plate is never free: that is no event
        for foot, start, stop in zip(contact.feet, bounds[:-1], bounds[1:], strict=True):
            lands = is_certain and start == contact.start > 0
            leaves = is_certain and stop == contact.stop < frames
            rows.append((contact.plate, FEET.index(foot), start, stop, lands, leaves))
    return np.array(rows, int).reshape(-1, 6)


def _landings(
    holds: Indices, loads: Sequence[PlateLoad], time: Array, weight_n: float
) -> Iterator[tuple[int, float]]:
    """Find when feet come to plates that are free; backwards in time, when they leave them."""

    @cache
    def total(plates: frozenset[int]) -> PlateLoad:
        """Add the loads of plates, at the samples of the first one."""
        first, *others = (load for load in loads if load.number in plates)
        added = [np.interp(first.time, p.time, p.force, np.nan, np.nan) for p in others]
        return PlateLoad(first.number, first.time, first.force + np.sum(added, axis=0))

    holds = holds[np.argsort(holds[:, START], kind="stable")]
    for foot in np.unique(holds[:, FOOT]).tolist():
        of_foot = holds[holds[:, FOOT] == foot]
        # stances of one foot: stretches on several plates that overlap in time
        until = np.maximum.accumulate(of_foot[:, STOP])
        begins = 1 + np.flatnonzero(of_foot[1:, START] >= until[:-1])
        for stance in np.split(of_foot, begins):  # holds of several plates that overlap in time
            start, stop = stance[0, START], stance[:, STOP].max()
            # plates that the foot comes to with the same step
            onto = stance[time[stance[:, START]] - time[start] < LIMITS.together]
            if not onto[:, LANDS].all():
                continue
            # free since whoever was on these plates last has left
            of_plates = np.isin(holds[:, PLATE], onto[:, PLATE])
            before = holds[of_plates & (holds[:, STOP] <= start), STOP]
            free_s = time[before.max() - 1] + LIMITS.margin if len(before) else time[0]
            load = total(frozenset(onto[:, PLATE].tolist()))
            at = _crossing(load, free_s, time[start], time[stop - 1], weight_n)
            if at is not None:
                yield foot, at


def _crossing(
    load: PlateLoad, free_s: float, start_s: float, stop_s: float, weight_n: float
) -> float | None:
    """Give when a plate that is free from a time on becomes loaded, near the start of a stance.

    None where the level without load is unknown, or what follows is no step.
    """
    # samples before the contact, while the plate is free
    time, since = load.time, max(free_s, start_s - LIMITS.level_span - LIMITS.margin)
    before = load.force[
        time.searchsorted(since) : time.searchsorted(start_s - LIMITS.margin, "right")
    ]
    at_rest = before[np.isfinite(before)]
    if (
        len(at_rest) * load.step_s < LIMITS.shortest_level
        or stop_s - start_s < CONTACT.shortest_stance
    ):
        return None
    first, last = time.searchsorted([start_s - LIMITS.margin, stop_s])
    # above the level without load, which drifts and moves with the platform
    above = load.force[first:last] - median_of(at_rest)
    if not np.fmax.reduce(above, initial=0.0) >= LIMITS.step_fraction * weight_n:
        return None
    landed = int(np.argmax(above > LIMITS.landed_fraction * weight_n))
    # a noisier plate needs a higher threshold
    threshold_n = max(LIMITS.event_threshold, float(at_rest.std()) / LIMITS.noise_fraction)
    # backwards from a load that is no noise to the last sample below the threshold
    below = np.flatnonzero(above[:landed] <= threshold_n)
    if not len(below) or not np.isfinite(above[below[-1] + 1]):
        return None
    k = int(below[-1])
    # on a line between two samples
    fraction = (threshold_n - above[k]) / (above[k + 1] - above[k])
    return float(time[first + k] + fraction * (time[first + k + 1] - time[first + k]))


def detect_events(
    of_file: tuple[Event, ...],
    of_plates: tuple[Event, ...],
    motion: Array,
    markers: Markers,
    marker_set: MarkerSet,
    method: EventMethod,
) -> FoundEvents:
    """Give a trial's gait events.

    Parameters
    ----------
    of_file, of_plates
        Events of the recording, and of its plates, by `plate_events`.
    motion
        How pelvis and feet moved on the platform, of `foot_motion`, (T, 5) [m].
    markers, marker_set
        Trajectories in lab axes, and the landmarks that they mark.
    method
        "file": as recorded; "zeni": by markers, `zeni_events`; "plates": where plates carry one
        foot alone; "auto": `combined_events`.

    Returns
    -------
    FoundEvents
        With the method and how many foot strikes it found, or why there are no events.
    """
    if method in ("file", "zeni"):
        return gait_events(of_file, markers, marker_set, method)
    if method == "plates":
        return FoundEvents.of(of_plates, "events_of_plates")
    try:
        by_motion = foot_motion_events(markers.time, motion)
    except ValueError as error:  # the markers' rate is too low for the filter
        return FoundEvents.none(str(error))
    events, corrections = combined_events(by_motion, of_plates)
    if not events:
        # how long pelvis and ankles are seen without a gap
        is_known = np.isfinite(motion[:, :3].sum(axis=1))
        longest_s = max((np.ptp(markers.time[a:b]) for a, b in stretches(is_known)), default=0.0)
        return FoundEvents.none(
            f"no foot swings against the pelvis in {longest_s:.2f} s; record two strikes of a foot"
        )
    if not corrections:
        return FoundEvents.of(events, "events_uncalibrated")
    timed = len({*events} & {*of_plates})
    offset_ms = {kind: 1000 * seconds for kind, seconds in corrections.items()}
    values = {"timed": timed, "events": len(events), "offset_ms": offset_ms}
    return FoundEvents.of(events, "events_calibrated", **values)


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
        plates time [s]; of both feet where they time fewer than three of this one, and none where
        there are too few of both: such events stay as the motion shows them.

    Notes
    -----
    The correction is the median of the five nearest events in time. An event that the plates time
    farther than 0.05 s from the corrected motion is taken from the motion. What plates show without
    a step in the motion is none.

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
        # pairs of the same event, by the motion and by the plates
        moved = [event_times(by_motion, label, side) for side in SIDES]
        timed = [event_times(of_plates, label, side) for side in SIDES]
        pairs = [
            match_times(*times, EVENTS.largest_difference)
            for times in zip(moved, timed, strict=True)
        ]
        # of each foot, what the motion shows and the plates time
        matched = [(moved[k][first], timed[k][second]) for k, (first, second) in enumerate(pairs)]
        both = tuple(np.concatenate(of_feet) for of_feet in zip(*matched, strict=True))
        for k, side in enumerate(SIDES):
            # of both feet where plates time too few of this one
            shown, true = matched[k] if len(matched[k][0]) >= LIMITS.fewest_timed else both
            times, offset = moved[k], true - shown
            if len(shown) >= LIMITS.fewest_timed:
                corrections[f"{side} {label.replace('_', ' ')}s"] = float(np.median(offset))
                times, (first, second) = _corrected(times, shown, offset), pairs[k]
                # a plate that times an event much later has missed part of the foot
                near = np.abs(timed[k][second] - times[first]) <= LIMITS.largest_deviation
                times[first[near]] = timed[k][second[near]]
            events += [Event(float(time), label, side) for time in times]
    return in_order(events), corrections


def _corrected(times: Array, moved: Array, offset: Array) -> Array:
    """Move times (E,) by the median offset of the nearest of those (K,) whose offset is known."""
    apart = np.abs(moved - times[:, None])
    # offsets change over a trial with slope and speed
    nearest = np.argsort(apart, axis=1, kind="stable")[:, : LIMITS.nearest]
    return np.asarray(times + np.median(offset[nearest], axis=1))
