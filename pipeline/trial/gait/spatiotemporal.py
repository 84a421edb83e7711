"""Speed, cadence, length and width of steps, and stance of gait cycles."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.io.recording import Event
from pipeline.trial.gait.events import OTHER_SIDE, SIDES, event_times

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "spatiotemporal")

QUANTITIES: Final = {
    "speed": "m/s",
    "cadence": "steps/min",
    "step length": "m",
    "step width": "m",
    "stance": "% of cycle",
}
"""What is measured of a gait cycle, and its unit."""


@np.errstate(invalid="ignore")
def spatiotemporal(
    time: Array, feet: Array, events: Sequence[Event], spans: Mapping[str, Array]
) -> dict[str, Array]:
    """Measure gait cycles against the ground, which shows by the feet that stand on it.

    Parameters
    ----------
    time
        (T,) [s].
    feet
        Left and right ankle, left and right ball, (T, 4, 3) [m], in axes of which the third is
        normal to the ground; NaN where unknown.
    events
        Gait events.
    spans
        Side -> start and stop of gait cycles, foot strikes of this side, (C, 2) [s].

    Returns
    -------
    dict
        Side -> values of each cycle in the order of `QUANTITIES`, (C, 5); NaN where unknown. Speed
        is that of this foot from strike to strike over the ground. The step ends the cycle: from
        the ankle at the other foot's strike to this ankle at its own, along the stride and across
        it; feet that cross have a negative width.

    Examples
    --------
    >>> time, walk = np.arange(300) / 100, np.zeros((300, 4, 3))
    >>> walk[:, [1, 3], :2] = [0.6, -0.1]  # the feet stand side by side, until the left one steps
    >>> walk[100:, [0, 2], 0] = 1.2
    >>> strikes = [Event(0.2, "foot_strike", "left"), Event(0.7, "foot_strike", "right")]
    >>> strikes += [Event(0.9, "foot_off", "left"), Event(1.2, "foot_strike", "left")]
    >>> cycle = {"left": np.array([[0.2, 1.2]])}
    >>> spatiotemporal(time, walk, strikes, cycle)["left"].round(3).tolist()
    [[1.2, 120.0, 0.6, 0.1, 70.0]]
    """
    # places on the ground as if it stood still: less its way until then
    on_ground = feet[:, :2, :2] - _way_of_ground(time, feet[:, 2:, :2], events)[:, None]
    measured = {}
    for side, of_side in spans.items():
        # the first strike of the other foot and the first foot off within the cycle
        foot, (start, stop) = SIDES.index(side), of_side.T
        other_strike = _first_within(event_times(events, "foot_strike", OTHER_SIDE[side]), of_side)
        foot_off = _first_within(event_times(events, "foot_off", side), of_side)
        begin, end = (_interpolate(time, on_ground[:, foot], at) for at in (start, stop))
        # vectors on the ground, between places of the ankles
        stride, step = end - begin, end - _interpolate(time, on_ground[:, 1 - foot], other_strike)
        length = np.hypot(*stride.T)
        # the part of the step across the stride, to the left of it: the right foot's is negative
        across = (stride[:, 0] * step[:, 1] - stride[:, 1] * step[:, 0]) / length
        measured[side] = np.column_stack(
            [
                length / (stop - start),
                120 / (stop - start),
                np.vecdot(step, stride) / length,
                across if side == "left" else -across,
                100 * (foot_off - start) / (stop - start),
            ]
        )
    return measured


def _way_of_ground(time: Array, balls: Array, events: Sequence[Event]) -> Array:
    """Integrate the velocity of the balls that stand on the ground, (T, 2, 2) to (T, 2) [m]."""
    middles, velocities = list[Array](), list[Array]()
    for foot, side in enumerate(SIDES):
        # stances last from a strike to the first foot off before the next one
        strikes = event_times(events, "foot_strike", side)
        stances = np.column_stack([strikes, np.append(strikes, np.inf)[1:]])
        foot_off = _first_within(event_times(events, "foot_off", side), stances)
        flat = strikes[:, None] + (foot_off - strikes)[:, None] * LIMITS.flat
        begin, end = (_interpolate(time, balls[:, foot], at) for at in flat.T)
        middles.append(flat.mean(axis=1))
        # mean velocity of the ball while it rests on the ground
        velocities.append((end - begin) / np.diff(flat, axis=1))
    middle, velocity = np.concatenate(middles), np.concatenate(velocities)
    is_known = np.isfinite(velocity).all(axis=1)
    if not is_known.any():
        return np.full((len(time), 2), np.nan)
    # between the stances of both feet the velocity changes along lines
    order = np.flatnonzero(is_known)[np.argsort(middle[is_known])]
    speed = np.column_stack([np.interp(time, middle[order], v) for v in velocity[order].T])
    # trapezoids: scipy.integrate takes as long to load as all else here
    steps = (speed[1:] + speed[:-1]) / 2 * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _first_within(times: Array, spans: Array) -> Array:
    """Give the first of some times inside each span, (C, 2) to (C,); NaN where there is none."""
    first = np.append(times, np.nan)[np.searchsorted(times, spans[:, 0], "right")]
    return np.where(first < spans[:, 1], first, np.nan)


def _interpolate(time: Array, places: Array, at: Array) -> Array:
    """Give places, (T, 2), at some times, (C,) to (C, 2); NaN beyond the recorded ones."""
    along = [np.interp(at, time, place, left=np.nan, right=np.nan) for place in places.T]
    return np.column_stack(along)
