"""Whether the plates carry the subject, frame by frame: only then is the residual meaningful.

Newton's second law says what the ground has to carry: the vertical force that the motion needs.
What the plates do not carry of it is carried by a foot beside them or by a plate that does not
record.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from hbm.signals.filtering import Method
from hbm.signals.samples import stretches
from hbm.spatial import Array, Mask
from pipeline.io.recording import Event
from pipeline.trial.gait.events import SIDES, event_times

MIN_NEED: Final = 0.3
"""Of body weight: in flight there is nothing to carry."""
MIN_CARRIED: Final = 0.5
"""Of what the motion needs: errors of timing and of the body model leave more, even at contact."""
MAX_LASTING_DEFICIT: Final = 0.2
"""Of body weight, on average over `LASTING_S`: half of a foot beside a plate, or more."""
LASTING_S: Final = 0.5
"""About a step; at its ends errors of timing cancel."""
MIN_LOADED_SHARE: Final = 0.5
"""Of a stance in which a plate under that foot is loaded, so that it stands on a plate."""
MIN_STANCE_DEFICIT: Final = 0.1
"""Of body weight, on average over a stance that no plate sees: less is an error of its events."""
MAX_GAIN_ERROR: Final = 0.4
"""Of the share of the need that plates measure in walking when nothing else carries the subject:
gains and stated masses err by less. Beyond, the plates mostly carry nobody."""
MAX_STANDING_ERROR: Final = 0.15
"""The same where nobody walks: a foot that stands beside the plates all the time takes more."""
USUAL_PERCENTILE: Final = 80.0
"""Of the share in the frames of a trial: some are of a foot beside the plates."""
MIN_ALONE: Final = 0.9
"""Share of all plates' force of one that carries the subject alone."""
MIN_ALONE_LOAD: Final = 0.3
"""Of the need: a lighter load is that of a foot which lands or leaves."""
MIN_ALONE_S: Final = 0.1
"""That a plate does so: noise of light loads lasts for less."""
MIN_CONTACTS: Final = 5
"""For what a plate usually measures: no foot lands half beside it as often, always equally."""
SPREAD_PERIODS: Final[Mapping[Method, tuple[float, float]]] = {
    "zero_phase": (0.6, 0.6),
    "realtime": (0.0, 1.0),
}
"""Periods of the cut-off before and after, over which the low-pass brings a force that is not there
into frames where it is: on a treadmill, a missing step leaves 1 N beyond them."""


def carried_frames(
    time: Array,
    need: Array,
    plates: Array,
    *,
    weight_n: float,
    events: Sequence[Event],
    feet: Mapping[str, Array],
    threshold_n: float,
    cutoff_hz: float,
    method: Method,
) -> Mask:
    """Find the frames in which the plates carry the subject.

    Parameters
    ----------
    time
        (T,) [s].
    need
        Vertical force that the motion needs from the ground, (T,) [N]; NaN where unknown.
    plates
        Vertical force of each plate through the same filter, without what it reads at rest, (P, T)
        [N].
    weight_n
        Body weight [N].
    events
        Gait events, which say when a foot stands.
    feet
        "left_foot" and "right_foot" -> wrench of the plates under that foot, unfiltered, (T, 6).
    threshold_n
        Vertical force above which a foot is on a plate [N].
    cutoff_hz, method
        The filter, which spreads what is missing into neighbouring frames.

    Returns
    -------
    Mask
        (T,). Not while the plates carry less than half of what the motion needs, not while they
        miss a fifth of body weight on average over half a second, and not during a stance whose
        foot loads no plate for half of it; nor next to such frames, as far as the filter reaches.
        The filter settles within one period of its cut-off at either end; these frames are judged
        by the first and the last one between them.

    Notes
    -----
    What a plate carries is judged beside what it usually measures in the trial, so that a plate
    with a wrong gain, or a wrong mass, is not taken for a foot beside the plates: its residual is
    real.
    """
    needed = need > MIN_NEED * weight_n
    strikes = sum(event.label == "foot_strike" for event in events)
    most = MAX_GAIN_ERROR if strikes >= MIN_CONTACTS else MAX_STANDING_ERROR
    carried = np.sum(plates / _usual_shares(plates, need, needed, time, most)[:, None], axis=0)
    deficit = np.nan_to_num(need - carried) / weight_n
    missing = needed & (carried < MIN_CARRIED * need)
    frames = max(1, round(LASTING_S / float(np.median(np.diff(time)))))
    lasting = uniform_filter1d(deficit, frames, mode="nearest") > MAX_LASTING_DEFICIT
    missing |= lasting & (deficit > 0)
    for side in SIDES:
        for start, stop in np.searchsorted(time, stances(events, side)):
            inside = slice(start, stop)
            loaded = feet[f"{side}_foot"][inside, 2] > threshold_n
            if np.count_nonzero(loaded) < MIN_LOADED_SHARE * len(loaded):
                missing[inside] |= np.mean(deficit[inside]) > MIN_STANCE_DEFICIT
    settled = np.flatnonzero((time >= time[0] + 1 / cutoff_hz) & (time <= time[-1] - 1 / cutoff_hz))
    if len(settled):
        missing = missing[np.clip(np.arange(len(time)), settled[0], settled[-1])]
    before, after = (periods / cutoff_hz for periods in SPREAD_PERIODS[method])
    return ~widened(missing, time, before, after)


def stances(events: Sequence[Event], side: str) -> Array:
    """Give when a foot stands: from each strike to the next foot off, (S, 2) [s].

    A strike without a foot off before the next strike is left out.
    """
    strikes = event_times(events, "foot_strike", side)
    offs = event_times(events, "foot_off", side)
    following = np.searchsorted(offs, strikes)
    stop = np.append(offs, np.inf)[following]
    complete = stop < np.append(strikes[1:], np.inf)
    return np.column_stack([strikes, stop])[complete]


def _usual_shares(plates: Array, need: Array, needed: Mask, time: Array, most: float) -> Array:
    """Give the share of the need that each plate measures when it carries everything, (P,).

    By the frames in which it carries the subject alone, where it does so often enough, else by
    those of all plates together; at most so far from 1.
    """
    total = plates.sum(axis=0)
    together = _usual(total[needed] / need[needed], most)
    shares = []
    for plate in plates:
        alone = needed & (plate > MIN_ALONE * total) & (plate > MIN_ALONE_LOAD * need)
        lasting = [time[b - 1] - time[a] > MIN_ALONE_S for a, b in stretches(alone)]
        often = np.count_nonzero(lasting) >= MIN_CONTACTS
        shares.append(_usual(plate[alone] / need[alone], MAX_GAIN_ERROR) if often else together)
    return np.array(shares)


def _usual(share: Array, most: float) -> float:
    """Give what a share usually is; 1 where that is implausible, farther from 1 than so much."""
    usual = float(np.percentile(share, USUAL_PERCENTILE)) if len(share) else 1.0
    return usual if abs(usual - 1) <= most else 1.0


def widened(mask: Mask, time: Array, before_s: float, after_s: float) -> Mask:
    """Add to the frames of a mask those within a time before and after them."""
    wide = mask.copy()
    for start, stop in stretches(mask):
        first = np.searchsorted(time, time[start] - before_s)
        wide[first : np.searchsorted(time, time[stop - 1] + after_s, "right")] = True
    return wide
