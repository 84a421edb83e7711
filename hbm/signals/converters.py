"""What converters do to channels: these stay at a limit, overflow, or jump between two samples."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
import scipy

from hbm.numbers import read_numbers
from hbm.signals.samples import stretches
from hbm.spatial import Array, Indices, Mask

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "converters")


class Jumps(NamedTuple):
    """Samples of a channel between which it jumps: before each, (J,), and by how much, (J,)."""

    at: Indices
    size: Array


def find_jumps(channel: Array, least: float) -> Jumps:
    """Find the jumps of a raw channel, (N,), of at least a size.

    Samples that are exactly zero are lost or gated, and no jump begins or ends there.
    """
    change = np.diff(channel)
    if not (np.abs(change) > least).any():
        return Jumps(np.zeros(0, int), np.zeros(0))
    span = 2 * 8 + 1
    # how fast the channel changes nearby, of which a jump is a small part
    usual = scipy.ndimage.percentile_filter(np.abs(change), 75, size=span, mode="nearest")
    measured = (channel[1:] != 0) & (channel[:-1] != 0)
    at = np.flatnonzero(measured & (np.abs(change) > np.maximum(least, LIMITS.jump * usual)))
    sign, around = np.sign(change), np.pad(change, 1)
    # a load that rises goes on rising in the sample before or after
    same_way = np.maximum(sign * around[:-2], sign * around[2:])
    at = at[np.abs(change[at]) > LIMITS.isolated * same_way[at]]
    return Jumps(at, change[at])


class Wraps(NamedTuple):
    """Overflows of a channel.

    Attributes
    ----------
    at
        Sample before each, (J,).
    period
        By which the channel jumps.
    undone
        The channel without them, (N,).
    """

    at: Indices
    period: float
    undone: Array


def find_wraps(channel: Array, least: float) -> Wraps | None:
    """Find the overflows of a raw channel, (N,), by at least a size; None without any.

    A channel that overflows jumps from one end of its range to the other, often many times where
    noise crosses the limit, and does not jump without that.
    """
    change, full = np.diff(channel), float(np.ptp(channel))
    # from one end of the range to the other, and no change in between
    at = np.flatnonzero(np.abs(change) > full / 2)
    if full <= least or not len(at) or np.abs(change[at]).min() < LIMITS.least_overflow * full:
        return None
    if not (channel[at] * channel[at + 1]).all():  # lost samples are exactly zero
        return None
    # the load changes in the sample of a jump as in the two beside it that do not jump
    smooth = np.pad(np.ma.masked_outside(change, -full / 2, full / 2).filled(0.0), 1)
    quiet = np.pad(np.abs(change) <= full / 2, 1)
    load = (smooth[at] + smooth[at + 2]) / np.maximum(1, quiet[at].astype(int) + quiet[at + 2])
    # no sample is outside the range of the converter
    period = max(full, float(np.median(np.abs(change[at] - load))))
    undone = np.unwrap(channel, period=period)
    # whole periods are still unknown: a channel without load is near its own zero
    undone -= period * np.round(_rest(undone, period) / period)
    leaves = max(channel.min() - undone.min(), undone.max() - channel.max())
    jumps = len(find_jumps(undone, LIMITS.largest_left * full).at)
    if full > LIMITS.largest_range * period or leaves < LIMITS.least_beyond * full or jumps:
        return None
    return Wraps(at, period, undone)


def _rest(channel: Array, period: float) -> float:
    """Give the value of a channel without load: the first one, or the usual one if it is stiller.

    A recording may begin during a step, or be of somebody who stands most of the time.
    """
    ordered, width = np.sort(channel), 2 * LIMITS.rest * period
    # the value at which the channel is most often, within the band
    first = int(np.argmax(np.searchsorted(ordered, ordered + width) - np.arange(len(ordered))))
    near = (channel >= ordered[first]) & (channel <= ordered[first] + width)
    # of its longest stretch the middle half, in which a load neither comes nor goes
    begin, end = max(stretches(near), key=np.ptp)
    quarter = (end - begin) // 4
    usual = channel[begin + quarter : end - quarter]
    start = channel[:50]
    return float(np.median(start if start.std() < usual.std() else usual))


FINEST: Final = 1e-6
"""Of its excursion, to which a channel is known at best: single precision."""


class Limit(NamedTuple):
    """Where a channel stays at a limit: its value, and the samples, (N,)."""

    level: float
    at: Mask


def find_limits(channel: Array, step_s: float) -> Iterator[Limit]:
    """Find where a raw channel, (N,), is clipped, on each side of zero, by its flat tops.

    A load has round peaks of different heights. A channel that is clipped stays at one value, and
    reaches and leaves it steeply. A window of some steps is enough; one with unknown samples has no
    limits.
    """
    # each side of zero has a limit of its own
    largest = float(np.abs(channel).max())
    for side in (channel, -channel):
        if not side.max() > LIMITS.least_range * largest or np.ptp(side) < LIMITS.near * largest:
            continue
        at = _exact_limit(side, step_s)
        at = _blurred_limit(side, step_s) if at is None else at
        if at is not None:
            yield Limit(float(np.median(channel[at])), at)


def _exact_limit(side: Array, step_s: float) -> Mask | None:
    top = float(side.max())
    # converters know a channel in steps, no longer than the shortest from sample to sample
    values = np.round(side / (FINEST * top))
    between = np.abs(np.diff(values))
    longest = FINEST * top * float(between[between > 0].min())
    if np.count_nonzero(side >= top - 1.5 * longest) < LIMITS.flat_samples:
        return None
    step = FINEST * top * float(np.diff(np.unique(values)).min())
    band = 1.5 * step
    # of the samples in a wider band below a round top, 1 / √wider are in the narrow one
    wider = float(np.clip(LIMITS.near * top / band, 4.0, 64.0))
    if wider * band > 0.1 * top:  # too coarse to tell a limit from a round peak
        return None
    at = side >= top - band
    fraction = np.count_nonzero(at) / np.count_nonzero(side >= top - wider * band)
    if fraction < max(LIMITS.least_flat, LIMITS.above_round / np.sqrt(wider)):
        return None
    # of two equal round peaks with a valley as deep as the narrow band, √(2 / (1 + √wider))
    of_two_peaks = np.sqrt(2 / (1 + np.sqrt(wider)))
    if fraction < LIMITS.above_two_peaks * of_two_peaks and not _evenly_wide(side, top / step):
        return None
    # files of a higher rate hold each value, or join values by straight lines
    moving = ((side > 0.05 * top) & ~at)[2:]
    steps = np.diff(side)[1:], np.diff(side, 2)
    changes = min(int(np.sum(moving & (np.abs(change) > FINEST * top))) for change in steps)
    held = max(1.0, np.count_nonzero(moving) / max(1, changes))
    coarse = step > LIMITS.coarse * top
    shortest = held * (LIMITS.flat_samples_coarse if coarse else LIMITS.flat_samples)
    runs = [run for run in stretches(at) if run[1] - run[0] >= shortest]
    if not runs:
        return None
    if coarse:
        # somebody who stands may stay in one step of a coarse converter
        for start, stop in stretches(side > top / 2):
            at[start:stop] &= (stop - start) * step_s < LIMITS.longest_contact
    return at if at.any() else None


def _evenly_wide(side: Array, steps: float) -> bool:
    """Whether a top of so many steps widens below as a round one that is cut off.

    The square of its width then grows evenly with the depth; below two peaks, ever less.
    """
    deepest = int(0.1 * steps)
    depth = np.array([1, round(np.sqrt(2 * deepest)), deepest]) + 0.5
    width = np.count_nonzero(side >= side.max() * (1 - depth[:, None] / steps), axis=1)
    upper, lower = np.diff(width**2) / np.diff(depth)
    return bool(upper <= LIMITS.evenly * deepest**0.25 * lower)


def _blurred_limit(side: Array, step_s: float) -> Mask | None:
    top, padded = float(side.max()), np.append(side, -np.inf)
    high, width = np.sort(side[side > 0.3 * top]), top * np.array([LIMITS.rounded, *LIMITS.noisy])
    # the band of each width that holds most samples
    inside = high.searchsorted(high + 2 * width[:, None]) - np.arange(len(high))
    level = high[inside.argmax(axis=1)] + width
    # samples of each contact, and those that are at the limit, in one row for all bands
    at = np.abs(padded - level[:, None]) <= width[:, None]
    runs = stretches((padded > level[:, None] / 2).ravel())
    before, after = np.flatnonzero(at).searchsorted(runs.T)
    count, lasts, flat = after - before, runs[:, 1] - runs[:, 0], np.zeros(at.shape, bool)
    stays = (lasts * step_s < LIMITS.longest_contact) & (count > LIMITS.shortest_plateau / step_s)
    for start, stop in runs[stays & (count > LIMITS.least_plateau * lasts)]:
        band, first = divmod(start, len(padded))
        contact = slice(first, first + stop - start)
        of_contact, at_limit = side[contact], at[band, contact]
        near = np.abs(of_contact - level[band]) <= 4 * width[band]
        flat[band, contact] = at_limit & (
            first > 0
            and contact.stop < len(side)
            and np.count_nonzero(at_limit) > LIMITS.not_crossed * np.count_nonzero(near)
            and of_contact.max() < LIMITS.largest_overshoot * level[band]
            # one value alone is that of a coarse converter
            and (_is_white(of_contact[near]) if band else np.ptp(of_contact[at_limit]) > 0)
        )
    return next((of_band[:-1] for of_band in flat if of_band.any()), None)


def _is_white(values: Array) -> bool:
    return bool(2 * np.var(values) < LIMITS.white * np.var(np.diff(values)))
