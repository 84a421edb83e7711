"""Gait events and cycles as soon as they are known, and the residuals of a condition so far."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.io.recording import Event
from pipeline.live.frames.chain import LiveFrame
from pipeline.trial.gait.cycles import MAX_DURATION, MIN_DURATION
from pipeline.trial.gait.events import MIN_CONTACT_S, MIN_STRIDE_S, SIDES
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import MAX_FORCE_SHARE, MAX_MOMENT_SHARE

MAX_CYCLE_S: Final = 2.5
"""Beyond it, the subject has stood still."""
TYPICAL_OF: Final = 10
"""Cycles whose median duration is the usual one."""
PERCENT: Final = np.arange(101)


@dataclass(frozen=True, slots=True, eq=False)
class LiveCycle:
    """A gait cycle that has just ended.

    Attributes
    ----------
    side
        "left" or "right".
    start_s, stop_s
        From foot strike to foot strike, half-open [s].
    time
        Of its N frames that count [s].
    residual
        Variant -> residuals of these frames in the reported axes, (N, 6) [N, N·m].
    peak_ground_n
        Largest ground reaction force of both feet in them, by variant [N].
    curve
        Variant -> residuals over 0 to 100 %, (101, 6); NaN where frames do not count.
    vertical_n
        Mean vertical ground reaction force of both feet in it, compensated where plates are [N];
        NaN unless all its frames count, or would if the plates carried the subject.
    carried_share
        Share of its frames in which the plates carry the subject.
    """

    side: str
    start_s: float
    stop_s: float
    time: Array
    residual: Mapping[str, Array]
    peak_ground_n: Mapping[str, float]
    curve: Mapping[str, Array]
    vertical_n: float = np.nan
    carried_share: float = 1.0


@dataclass(slots=True)
class _Foot:
    """What is known of a foot: the state that is sure, and since when another one shows."""

    loaded: bool | None = None
    changed_s: float | None = None
    strike_s: float | None = None
    others_strikes: int = 0


@dataclass(frozen=True, slots=True)
class Gait:
    """What a frame has made known.

    Attributes
    ----------
    events
        Foot strikes and foot offs, each at the frame where it was, not where it became known.
    cycles
        Gait cycles that have ended.
    strides
        The same, and those in which the other foot has not struck a plate once: it was beside them,
        or its plate does not measure.
    """

    events: tuple[Event, ...] = ()
    cycles: tuple[LiveCycle, ...] = ()
    strides: tuple[LiveCycle, ...] = ()


@dataclass(slots=True)
class GaitTracker:
    """Finds gait events and cycles frame by frame.

    A contact and its loss count once they last 0.1 s, as in trials (``MIN_CONTACT_S``), and are
    known that much later. A cycle counts if it takes 0.4 to 2.5 s and 0.6 to 1.5 of the median of
    the last ten, and the other foot has struck once in it, if that foot strikes at all. Contacts
    are those of the filtered forces, and as late as these.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from pipeline.trial.quality import Quality
    >>> still = LiveFrame(0, 0.0, np.zeros(46), {}, {}, {}, np.zeros(2, bool), np.zeros(1),
    ...                   Quality(0), 0.0)
    >>> tracker, events = GaitTracker(), []
    >>> for k in range(100):
    ...     right = 20 <= k < 80
    ...     frame = replace(still, time=k / 100, contact=np.array([False, right]))
    ...     events += tracker.add(frame).events
    >>> [(event.side, event.label, round(event.time, 2)) for event in events]
    [('right', 'foot_strike', 0.2), ('right', 'foot_off', 0.8)]
    """

    _frames: deque[LiveFrame] = field(default_factory=deque)
    _feet: tuple[_Foot, _Foot] = field(default_factory=lambda: (_Foot(), _Foot()))
    _durations: deque[float] = field(default_factory=lambda: deque(maxlen=TYPICAL_OF))

    def add(self, frame: LiveFrame) -> Gait:
        """Take a frame and give what it makes known."""
        self._frames.append(frame)
        while frame.time - self._frames[0].time > MAX_CYCLE_S + 2 * MIN_CONTACT_S:
            self._frames.popleft()
        events, cycles, strides = list[Event](), list[LiveCycle](), list[LiveCycle]()
        for side, foot, other, loaded in zip(
            SIDES, self._feet, self._feet[::-1], frame.contact.tolist(), strict=True
        ):
            at = _change(foot, loaded, frame.time)
            if at is None:
                continue
            events.append(Event(at, "foot_strike" if loaded else "foot_off", side))
            if not loaded:
                continue
            other.others_strikes += 1
            if foot.strike_s is not None and self._is_stride(foot.strike_s, at):
                strides.append(self._cycle(side, foot.strike_s, at))
                if other.strike_s is None or foot.others_strikes == 1:
                    cycles.append(strides[-1])
            foot.strike_s, foot.others_strikes = at, 0
        return Gait(tuple(events), tuple(cycles), tuple(strides))

    def _is_stride(self, start_s: float, stop_s: float) -> bool:
        duration = stop_s - start_s
        usual = float(np.median(self._durations)) if self._durations else duration
        if not MIN_STRIDE_S <= duration <= MAX_CYCLE_S:
            return False
        self._durations.append(duration)
        kept = self._frames[0].time <= start_s  # not so after a gap in the stream
        return kept and MIN_DURATION <= duration / usual <= MAX_DURATION

    def _cycle(self, side: str, start_s: float, stop_s: float) -> LiveCycle:
        inside = [f for f in self._frames if start_s <= f.time < stop_s]
        counted = [f for f in inside if f.quality.counts]
        time = np.array([f.time for f in inside])
        counts = np.array([f.quality.counts for f in inside])
        percent = 100 * (time - start_s) / (stop_s - start_s)
        residual, curve, peak = {}, {}, {}
        for variant in inside[0].residual:
            every = np.array([f.residual[variant] for f in inside])
            every[~counts] = np.nan
            residual[variant] = every[counts]
            columns = [np.interp(PERCENT, percent, column) for column in every.T]
            curve[variant] = np.column_stack(columns)
            forces = [np.linalg.norm(f.by_foot[variant][:, :3].sum(axis=0)) for f in counted]
            peak[variant] = float(max(forces, default=np.nan))
        best = list(inside[0].by_foot)[-1]
        qualities = [f.quality for f in inside]
        known = all((each & ~Quality.NOT_CARRIED).counts for each in qualities)
        vertical = np.mean([f.by_foot[best][:, 2].sum() for f in inside])
        return LiveCycle(
            side,
            start_s,
            stop_s,
            time[counts],
            residual,
            peak,
            curve,
            float(vertical) if known else np.nan,
            1 - sum(bool(each & Quality.NOT_CARRIED) for each in qualities) / len(inside),
        )


def _change(foot: _Foot, loaded: bool, time: float) -> float | None:
    """Give when a foot changed between ground and air, once that is sure."""
    if foot.loaded is None:
        foot.loaded = loaded
    if loaded == foot.loaded:
        foot.changed_s = None
        return None
    if foot.changed_s is None:
        foot.changed_s = time
    if time - foot.changed_s < MIN_CONTACT_S:
        return None
    at, foot.loaded, foot.changed_s = foot.changed_s, loaded, None
    return at


@dataclass(frozen=True, slots=True)
class Limits:
    """Peak residuals beside their published limits (Hicks et al. 2015, J Biomech Eng 137:020905).

    Attributes
    ----------
    force_n, moment_nm
        Largest magnitude of the residual force and moment.
    max_force_n, max_moment_nm
        5 % of the largest ground reaction force, and 1 % of the height of the centre of mass times
        that force.
    """

    force_n: float
    moment_nm: float
    max_force_n: float
    max_moment_nm: float


@dataclass(slots=True)
class ConditionSoFar:
    """Summarises the gait cycles of a condition as they end, in memory that does not grow.

    A frame that is in a cycle of either foot counts once; trials count the cycles of one foot.

    Attributes
    ----------
    min_valid_share
        Of a gait cycle's frames in which the plates carry the subject: with less it does not count.
    cycles
        Gait cycles that count, of both sides.
    not_carried
        Gait cycles that do not, since the plates carried the subject in less than
        ``min_valid_share`` of them.
    """

    min_valid_share: float
    cycles: int = 0
    not_carried: int = 0
    _counted_s: float = -np.inf
    _frames: int = 0
    _squares: dict[str, Array] = field(default_factory=dict)
    _peaks: dict[str, Array] = field(default_factory=dict)
    _ground_n: dict[str, float] = field(default_factory=dict)

    def add(self, cycle: LiveCycle) -> None:
        """Take a cycle that has ended."""
        if cycle.carried_share < self.min_valid_share:
            self.not_carried += 1
            return
        if not len(cycle.time):
            return
        self.cycles += 1
        new = cycle.time > self._counted_s
        self._counted_s = max(self._counted_s, float(cycle.time[-1]))
        self._frames += int(np.count_nonzero(new))
        for variant, residual in cycle.residual.items():
            sums = self._squares.setdefault(variant, np.zeros(6))
            sums += (residual[new] ** 2).sum(axis=0)
            size = np.linalg.norm(residual.reshape(-1, 2, 3), axis=2).max(axis=0)
            self._peaks[variant] = np.maximum(self._peaks.get(variant, np.zeros(2)), size)
            largest = max(self._ground_n.get(variant, 0.0), cycle.peak_ground_n[variant])
            self._ground_n[variant] = largest

    @property
    def rms(self) -> Mapping[str, Array]:
        """Variant -> root mean square over all frames of all cycles, (6,) [N, N·m]."""
        return {v: np.sqrt(sums / self._frames) for v, sums in self._squares.items()}

    def limits(self, center_of_mass_m: float) -> Mapping[str, Limits]:
        """Give the peaks beside their limits, by variant.

        Parameters
        ----------
        center_of_mass_m
            Height of the body's centre of mass above the feet (`height_of_mass`) [m].
        """
        return {
            variant: Limits(
                float(force),
                float(moment),
                MAX_FORCE_SHARE * self._ground_n[variant],
                MAX_MOMENT_SHARE * center_of_mass_m * self._ground_n[variant],
            )
            for variant, (force, moment) in self._peaks.items()
        }
