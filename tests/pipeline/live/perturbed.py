"""What goes wrong between devices and receiver, done to any source: for tests."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.live.stream import Samples


@dataclass(frozen=True)
class Faults:
    """How often and how much; of a stream that is not named nothing.

    Attributes
    ----------
    drop, duplicate, reorder
        Share of the samples that are lost, sent twice, or sent after their successor.
    delay_s
        Stream -> how long its samples are under way [s], on the clock of the time stamps.
    jitter_s
        Standard deviation of the time stamps [s].
    drift
        Stream -> relative error of its clock, such as 5e-5.
    absent_s
        Stream -> from when to when it sends nothing [s].
    """

    drop: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_s: Mapping[str, float] = field(default_factory=dict)
    jitter_s: float = 0.0
    drift: Mapping[str, float] = field(default_factory=dict)
    absent_s: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class PerturbedSource:
    """Gives what another source gives, with faults; the counts say what was done."""

    def __init__(self, source, faults, seed=0):
        self._source, self._faults = source, faults
        self._rng = np.random.default_rng(seed)
        self._under_way: list[tuple[float, Samples]] = []
        self._now = -np.inf
        self.dropped = self.duplicated = self.reordered = 0

    @property
    def streams(self):
        return self._source.streams

    @property
    def plates(self):
        return self._source.plates

    @property
    def ended(self):
        return self._source.ended and not self._under_way

    def receive(self, timeout_s):
        arrived = self._source.receive(timeout_s)
        for samples in arrived:
            self._now = max(self._now, float(samples.time[-1]))
            sent = self._perturbed(samples)
            if len(sent.time):
                delay = self._faults.delay_s.get(sent.stream, 0.0)
                self._under_way.append((float(samples.time[-1]) + delay, sent))
        if not arrived:
            self._now = np.inf  # the source has ended: all that is under way arrives
        due = [samples for at, samples in self._under_way if at <= self._now]
        self._under_way = [(at, samples) for at, samples in self._under_way if at > self._now]
        return due

    def close(self):
        self._source.close()

    def _perturbed(self, samples):
        faults, rng = self._faults, self._rng
        time = samples.time
        kept = rng.uniform(size=len(time)) >= faults.drop
        if span := faults.absent_s.get(samples.stream):
            kept &= (time < span[0]) | (time >= span[1])
        self.dropped += np.count_nonzero(~kept)
        order = np.flatnonzero(kept)
        twice = order[rng.uniform(size=len(order)) < faults.duplicate]
        self.duplicated += len(twice)
        order = np.sort(np.concatenate([order, twice]))
        for k in np.flatnonzero(rng.uniform(size=max(len(order) - 1, 0)) < faults.reorder):
            order[[k, k + 1]] = order[[k + 1, k]]
            self.reordered += 1
        stamps = time * (1 + faults.drift.get(samples.stream, 0.0))
        stamps = stamps + rng.normal(0, faults.jitter_s, len(time))
        return replace(samples, time=stamps[order], values=samples.values[order])
