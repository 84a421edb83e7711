"""Gait events where a plate carries one foot alone, timed at the plate's own samples."""

from bisect import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from hbm.signals.samples import median_of
from hbm.spatial import Array
from pipeline.io.recording import Event
from pipeline.trial.gait.contact import FEET, MIN_STANCE_S, Contact, Foot
from pipeline.trial.gait.events import in_order
from pipeline.trial.ground.loads import PlateLoad

EVENT_THRESHOLD_N: Final = 20.0
"""Of the vertical force at foot strike and foot off, above what the plate reads without load."""
MAX_NOISE_SHARE: Final = 0.2
"""Of the threshold that is noise of the unloaded plate, one standard deviation: of a plate that is
noisier the threshold is higher, so that noise does not cross it."""
MIN_STEP_SHARE: Final = 0.3
"""Of body weight that a step carries at its peak; what a platform adds to its plates is less."""
LANDED_SHARE: Final = 0.15
"""Of body weight, beyond any noise: from there the crossing is looked for backwards."""
LEVEL_S: Final = 0.2
"""Before a contact and after it, of which the median is what the plate reads without load."""
MIN_LEVEL_S: Final = 0.05
"""With less time without load the level is unknown, and so is the event."""
TOGETHER_S: Final = 0.1
"""A foot that comes to a second plate later has landed on the first one."""
MARGIN_S: Final = 0.04
"""From a contact's start or stop at the markers' rate: a foot lands and leaves within it."""


@dataclass(frozen=True, slots=True)
class _Hold:
    """A stretch of frames in which a plate carries a foot.

    ``lands`` and ``leaves`` are whether the plate is without load before and after it, and whose
    foot it is is certain.
    """

    plate: int
    foot: Foot
    start: int
    stop: int
    lands: bool
    leaves: bool


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
    The event is where the load leaves, or falls to, ``EVENT_THRESHOLD_N`` above the level that the
    plate has just before the strike, or just after the foot off: on a platform that moves, plates
    that are not compensated read up to some tens of newtons without load. The loads of plates that
    a foot steps on at the same time are added.
    """
    holds = [hold for contact in contacts for hold in _holds(contact, len(time))]
    back = [
        _Hold(h.plate, h.foot, len(time) - h.stop, len(time) - h.start, h.leaves, h.lands)
        for h in holds
    ]
    loads_back = [PlateLoad(load.number, -load.time[::-1], load.force[::-1]) for load in loads]
    strikes = _landings(holds, loads, time, weight_n)
    offs = _landings(back, loads_back, -time[::-1], weight_n)
    return in_order(
        [
            *(Event(at, "foot_strike", foot.removesuffix("_foot")) for foot, at in strikes),
            *(Event(-at, "foot_off", foot.removesuffix("_foot")) for foot, at in offs),
        ]
    )


def _holds(contact: Contact, frames: int) -> list[_Hold]:
    """Cut a contact where its foot changes."""
    bounds = [contact.start, *contact.changes, contact.stop]
    lands = not contact.ambiguous and contact.start > 0
    leaves = not contact.ambiguous and contact.stop < frames
    return [
        _Hold(
            contact.plate,
            foot,
            start,
            stop,
            lands and start == contact.start,
            leaves and stop == contact.stop,
        )
        for foot, start, stop in zip(contact.feet, bounds[:-1], bounds[1:], strict=True)
    ]


def _landings(
    holds: Sequence[_Hold], loads: Sequence[PlateLoad], time: Array, weight_n: float
) -> list[tuple[Foot, float]]:
    """Find when feet come to plates that are free; backwards in time, when they leave them."""

    @cache
    def total(plates: frozenset[int]) -> PlateLoad:
        return _total([load for load in loads if load.number in plates])

    @cache
    def stops(plates: frozenset[int]) -> list[int]:
        return sorted(hold.stop for hold in holds if hold.plate in plates)

    found = []
    for foot in FEET:
        for stance in _stances([hold for hold in holds if hold.foot == foot]):
            start, stop = min(h.start for h in stance), max(h.stop for h in stance)
            onto = [h for h in stance if time[h.start] - time[start] < TOGETHER_S]
            if not all(hold.lands for hold in onto):
                continue
            plates = frozenset(hold.plate for hold in onto)
            before = stops(plates)[: bisect(stops(plates), start)]
            free_s = time[before[-1] - 1] + MARGIN_S if before else time[0]
            at = _crossing(total(plates), free_s, time[start], time[stop - 1], weight_n)
            found += [] if at is None else [(foot, at)]
    return found


def _stances(holds: Sequence[_Hold]) -> list[list[_Hold]]:
    """Group the holds of one foot by several plates that overlap in time."""
    groups: list[list[_Hold]] = []
    for hold in sorted(holds, key=lambda h: h.start):
        if groups and hold.start < max(h.stop for h in groups[-1]):
            groups[-1].append(hold)
        else:
            groups.append([hold])
    return groups


def _total(loads: Sequence[PlateLoad]) -> PlateLoad:
    """Add the loads of plates, at the samples of the first one."""
    first, *others = loads
    if not others:
        return first
    added = [np.interp(first.time, p.time, p.force, np.nan, np.nan) for p in others]
    return PlateLoad(first.number, first.time, first.force + np.sum(added, axis=0))


def _crossing(
    load: PlateLoad, free_s: float, start_s: float, stop_s: float, weight_n: float
) -> float | None:
    """Give when a plate that is free from a time on becomes loaded, near the start of a stance.

    None where the level without load is unknown, or what follows is no step.
    """
    time, since = load.time, max(free_s, start_s - LEVEL_S - MARGIN_S)
    before = load.force[time.searchsorted(since) : time.searchsorted(start_s - MARGIN_S, "right")]
    at_rest = before[np.isfinite(before)]
    if len(at_rest) * load.step_s < MIN_LEVEL_S or stop_s - start_s < MIN_STANCE_S:
        return None
    first, last = time.searchsorted([start_s - MARGIN_S, stop_s])
    above = load.force[first:last] - median_of(at_rest)
    if not np.fmax.reduce(above, initial=0.0) >= MIN_STEP_SHARE * weight_n:
        return None
    landed = int(np.argmax(above > LANDED_SHARE * weight_n))
    threshold_n = max(EVENT_THRESHOLD_N, float(at_rest.std()) / MAX_NOISE_SHARE)
    below = np.flatnonzero(above[:landed] <= threshold_n)
    if not len(below) or not np.isfinite(above[below[-1] + 1]):
        return None
    k = int(below[-1])
    share = (threshold_n - above[k]) / (above[k + 1] - above[k])
    return float(time[first + k] + share * (time[first + k + 1] - time[first + k]))
