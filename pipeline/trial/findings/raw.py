"""What raw samples of plates show by themselves: no foot does it, whatever motion and feet say."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from hbm.numbers import read_numbers
from hbm.signals.converters import find_jumps, find_limits
from hbm.signals.samples import stretches, without_short_gaps
from hbm.spatial import WRENCH_COMPONENTS, Array, Indices, Mask, shift_wrench
from pipeline.io.mended_plates import channels_about, find_overflows
from pipeline.io.recording import Plate

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "raw")

RawKind = Literal["dead", "wraps", "clipped", "jumps", "lost"]


@dataclass(frozen=True, slots=True)
class RawFault:
    """A channel of a plate whose samples cannot be the load of a foot.

    Attributes
    ----------
    plate
        Number of the plate.
    channel
        "Fx" to "Mz", moments about the transducer or the centre of the surface.
    kind
        "dead": constant, or noise while others are loaded; "wraps": overflows; "clipped": stays at
        a limit; "jumps": changes at once; "lost": is exactly zero between loaded samples.
    size
        Of "dead" the usual value, of "wraps" the period, of "clipped" the limit, of "jumps" the
        largest one [N or N·m]; zero of "lost".
    count
        Samples that are dead, clipped or lost, overflows, or jumps.
    spans_s
        Where it is, from and to, in order, at least one [s].
    """

    plate: int
    channel: str
    kind: RawKind
    size: float
    count: int
    spans_s: tuple[tuple[float, float], ...]

    @property
    def first_s(self) -> float:
        """Where it begins [s]."""
        return self.spans_s[0][0]


def raw_faults(plates: Sequence[Plate]) -> tuple[RawFault, ...]:
    """Find what raw samples of plates show, in order of plates and channels.

    Parameters
    ----------
    plates
        As recorded, before any correction mixes their channels.

    Returns
    -------
    tuple of RawFault
        At most one of a channel. A channel that is clipped has lost what was beyond its limit;
        overflows can be undone (`pipeline.io.mended_plates`).

    Notes
    -----
    Channels that a laboratory's program computes from other ones, as from eight of a plate, do not
    stay at a limit where one of these does, and nothing is found.
    """
    # what is large is told by the largest load on any plate of the recording
    loads = [np.abs(p.wrench_in_plate[:, 2]).max() for p in plates if len(p.time)]
    largest_n = max(loads, default=0.0)
    return tuple(fault for plate in plates for fault in _of_plate(plate, largest_n))


def _of_plate(plate: Plate, largest_n: float) -> Iterator[RawFault]:
    if len(plate.time) < 2 or not np.isfinite(plate.wrench_in_plate).all():
        return
    time, step_s = plate.time, 1 / plate.rate_hz
    # converters limit each channel, so that moments are about the transducer
    limits, overflows = _limits(plate, step_s), find_overflows(plate)[1]
    channels = shift_wrench(plate.wrench_in_plate, plate.transducer)
    dead, lost = _dead(channels), _lost(plate, largest_n, step_s)
    for axis, name in enumerate(WRENCH_COMPONENTS):
        channel, of = channels[:, axis], (plate.number, name)
        # heel strikes of plates with slow samples rise within one step
        least = (
            LIMITS.least_jump[axis]
            * largest_n
            * (LIMITS.jump_growth * step_s if step_s > LIMITS.fast_step else 1.0)
        )
        # one fault for each channel, that which explains the others first
        if dead[axis]:
            span = ((float(time[0]), float(time[-1])),)
            yield RawFault(*of, "dead", float(np.median(channel)), len(channel), span)
        elif axis in overflows:
            wraps = overflows[axis]
            yield RawFault(*of, "wraps", wraps.period, len(wraps.at), _at(time, wraps.at))
        elif axis in limits:
            level, at = limits[axis]
            spans = stretches(without_short_gaps(at, time, LIMITS.merged_gap))
            count = int(np.count_nonzero(at))
            yield RawFault(*of, "clipped", level, count, _spans(time, spans))
        elif len(lost[axis]):
            spans, count = lost[axis], int(np.diff(lost[axis]).sum())
            yield RawFault(*of, "lost", 0.0, count, _spans(time, spans))
        elif largest_n > LIMITS.least_load and len((jumps := find_jumps(channel, least)).at):
            size = float(np.abs(jumps.size).max())
            yield RawFault(*of, "jumps", size, len(jumps.at), _at(time, jumps.at))


def _at(time: Array, at: Indices) -> tuple[tuple[float, float], ...]:
    return tuple((float(time[k]), float(time[k + 1])) for k in at)


def _spans(time: Array, runs: Indices) -> tuple[tuple[float, float], ...]:
    """Give first and last time of runs of samples, (N, 2)."""
    return tuple((float(time[start]), float(time[stop - 1])) for start, stop in runs)


def _lost(plate: Plate, largest_n: float, step_s: float) -> list[Indices]:
    """Find the runs of samples of each channel that are zero between loaded ones, (N, 2) each."""
    # samples in which a foot is on the plate
    loaded = np.abs(plate.wrench_in_plate[:, 2]) > LIMITS.landing * largest_n
    runs_of_channels = []
    for channel in plate.wrench_in_plate.T:
        # exactly zero, between two samples, and for a short time
        runs = stretches(channel == 0)
        inside = (runs[:, 0] > 0) & (runs[:, 1] < len(channel))
        runs = runs[inside & (np.diff(runs)[:, 0] <= round(LIMITS.longest_loss / step_s))]
        runs = runs[loaded[runs - (1, 0)].all(axis=1)]  # samples before and after
        if len(runs):
            neighbours, change = channel[runs - (1, 0)], np.abs(np.diff(channel))
            least = max(
                LIMITS.least_neighbour * np.abs(channel).max(),
                LIMITS.beyond_noise * np.median(change),
            )
            # else it passes zero
            runs = runs[(np.abs(neighbours) > least).all(axis=1) & (neighbours.prod(axis=1) > 0)]
        runs_of_channels.append(runs)
    return runs_of_channels


def _limits(plate: Plate, step_s: float) -> dict[int, tuple[float, Mask]]:
    """Give the channels that are clipped: the limit of the larger side, and where, (N,)."""
    axes = range(6)
    for _, channels in channels_about(plate):
        clipped = {}
        for axis in axes:
            sides = [
                limit
                for limit in find_limits(channels[:, axis], step_s)
                if abs(limit.level) >= LIMITS.least_clip[axis]
            ]
            if sides:
                # a channel may be clipped at both ends of its range; the larger one is named
                level = max((side.level for side in sides), key=abs)
                clipped[axis] = level, np.any([side.at for side in sides], axis=0)
        if clipped:
            return clipped
        axes = range(3, 6)  # forces are the same about any point
    return {}


def _dead(channels: Array) -> Mask:
    """Find channels that are constant, or show noise alone while others are loaded, (6,)."""
    # a channel that never changes
    constant = np.ptp(channels, axis=0) == 0
    # moments as forces at a usual lever, to be compared with forces
    load = np.abs(channels) / [1.0, 1.0, 1.0, LIMITS.lever, LIMITS.lever, LIMITS.lever]
    load[:, constant] = 0.0
    dead = constant.copy()
    for axis in np.flatnonzero(~constant):
        # the largest of the other channels shows when the plate is loaded
        others = load[:, np.arange(6) != axis].max(axis=1)
        largest = others.max()
        with_load = channels[others > LIMITS.loaded * largest, axis]
        without = channels[others < LIMITS.unloaded * largest, axis]
        if largest > LIMITS.dead_load and min(len(with_load), len(without)) > LIMITS.fewest_samples:
            # dead: neither its spread nor its level changes with the load of the others
            noise = LIMITS.alive * without.std()
            dead[axis] = with_load.std() < noise and (
                abs(np.median(with_load) - np.median(without)) < noise
            )
    # a plate that nobody is on is silent; one that is constant does not measure
    return dead if load.max() > LIMITS.dead_load or constant.all() else np.zeros(6, bool)
