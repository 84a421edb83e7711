"""Gait cycles and steps as soon as they are known, and the residuals of a condition so far."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.spatial import Array, Indices
from pipeline.config.schema import Unit
from pipeline.live.chain import LiveFrame
from pipeline.trial.gait.contact import LIMITS as CONTACT
from pipeline.trial.gait.cycles import LIMITS as CYCLES
from pipeline.trial.gait.cycles import shortage
from pipeline.trial.gait.events import LIMITS as EVENTS
from pipeline.trial.gait.events import SIDES
from pipeline.trial.quality import DOES_NOT_COUNT, Quality, free_of

LIMITS: Final = read_numbers("pipeline.live", "thresholds.toml", "cycles")


@dataclass(frozen=True, slots=True, eq=False)
class LiveCycle:
    """A stride, or a step to the other foot's strike, that has just ended.

    Attributes
    ----------
    side
        "left" or "right".
    start_s, stop_s
        From foot strike to foot strike, half-open [s].
    whole
        Whether it is a gait cycle: the other foot has struck a plate once in it. Otherwise that
        foot was beside the plates, or its plate does not measure.
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
    quality
        Flags of its frames, lost ones included, (M,).
    unit
        "cycle" or "step".
    """

    side: str
    start_s: float
    stop_s: float
    whole: bool
    time: Array
    residual: Mapping[str, Array]
    peak_ground_n: Mapping[str, float]
    curve: Mapping[str, Array]
    vertical_n: float = np.nan
    quality: Indices = field(default_factory=lambda: np.zeros(1, int))
    unit: Unit = "cycle"


@dataclass(slots=True)
class _Foot:
    """What is known of a foot: the state that is sure, and since when another one shows."""

    loaded: bool | None = None
    changed_s: float = np.inf
    strike_s: float = -np.inf
    others_strikes: int = 0

    def change(self, loaded: bool, time: float) -> float | None:
        """Give when the foot changed between ground and air, once that is sure."""
        same = self.loaded is None or loaded == self.loaded
        at = self.changed_s = np.inf if same else min(self.changed_s, time)
        # noise crosses the threshold for less than a contact or a swing lasts
        if same or time - at >= CONTACT.shortest_stance:
            self.loaded, self.changed_s = loaded, np.inf
            return None if same else at
        return None


@dataclass(slots=True)
class GaitTracker:
    """Finds gait cycles and steps frame by frame.

    A contact and its loss count once they last 0.1 s, as in trials, and are
    known that much later. A stride takes 0.4 to 2.5 s and 0.6 to 1.5 of the median of the last ten;
    it is a gait cycle if the other foot has struck once in it, if that foot strikes at all. A step,
    from one foot's strike to the other's, takes half as long.
    Contacts are those of the filtered forces, and as late as these. Filters go on from one frame to
    the next within ``longest_s``.

    Examples
    --------
    >>> from dataclasses import replace
    >>> nothing = {"measured": np.zeros(6)}
    >>> still = LiveFrame(0.0, np.zeros(46), {}, nothing, {"measured": np.zeros((2, 6))},
    ...                   np.zeros(2, bool), np.zeros(1), Quality(0), 0.0)
    >>> tracker, strides = GaitTracker(0.042), []
    >>> for k in range(250):
    ...     right = k % 100 < 60
    ...     frame = replace(still, time=k / 100, contact=np.array([False, right]))
    ...     strides += tracker.add(frame)
    >>> [(stride.side, round(stride.start_s, 2), round(stride.stop_s, 2)) for stride in strides]
    [('right', 1.0, 2.0)]
    """

    longest_s: float
    _frames: deque[LiveFrame] = field(default_factory=deque)
    _feet: tuple[_Foot, _Foot] = field(default_factory=lambda: (_Foot(), _Foot()))
    _durations: dict[Unit, deque[float]] = field(
        default_factory=lambda: {u: deque(maxlen=LIMITS.usual_of) for u in ("cycle", "step")}
    )

    def add(self, frame: LiveFrame) -> list[LiveCycle]:
        """Take a frame and give the strides and steps that it ends."""
        self._frames.append(frame)
        # the longest stride, and what its strikes are known later
        while (
            frame.time - self._frames[0].time > LIMITS.longest_stride + 2 * CONTACT.shortest_stance
        ):
            self._frames.popleft()
        ended = []
        for side, other_side, foot, other, loaded in zip(
            SIDES, SIDES[::-1], self._feet, self._feet[::-1], frame.contact.tolist(), strict=True
        ):
            at = foot.change(loaded, frame.time)
            if at is None or not loaded:
                continue
            other.others_strikes += 1
            # from strike to strike of one foot; the other one strikes once in it, if it strikes
            if self._is_usual("cycle", foot.strike_s, at):
                whole = other.strike_s == -np.inf or foot.others_strikes == 1
                ended.append(self._cycle("cycle", side, foot.strike_s, at, whole))
            others_s = other.strike_s
            if foot.strike_s < others_s and self._is_usual("step", others_s, at):
                ended.append(self._cycle("step", other_side, others_s, at, True))
            foot.strike_s, foot.others_strikes = at, 0
        return ended

    def _is_usual(self, unit: Unit, start_s: float, stop_s: float) -> bool:
        duration, past = stop_s - start_s, self._durations[unit]
        usual = float(np.median(past)) if past else duration
        part = 1.0 if unit == "cycle" else 0.5
        if not part * EVENTS.shortest_stride <= duration <= part * LIMITS.longest_stride:
            return False
        past.append(duration)
        kept = self._frames[0].time <= start_s  # not so after a gap in the stream
        return kept and CYCLES.shortest_duration <= duration / usual <= CYCLES.longest_duration

    def _cycle(
        self, unit: Unit, side: str, start_s: float, stop_s: float, whole: bool
    ) -> LiveCycle:
        inside = [f for f in self._frames if start_s <= f.time < stop_s]
        time, quality = (np.array([getattr(f, of) for f in inside]) for of in ("time", "quality"))
        counts = free_of(quality)
        percent = 100 * (time - start_s) / (stop_s - start_s)
        residual, curve, peak = {}, {}, {}
        for variant in inside[0].residual:
            # NaN spreads to the percents around it, so that a curve has gaps where frames have
            residuals = np.array([f.residual[variant] for f in inside])
            residuals[~counts] = np.nan
            residual[variant] = residuals[counts]
            components = [np.interp(np.arange(101), percent, x) for x in residuals.T]
            curve[variant] = np.array(components).T
            force = np.array([f.by_foot[variant][:, :3].sum(axis=0) for f in inside])
            peak[variant] = np.linalg.norm(force[counts], axis=1).max(initial=0.0)
        # a foot beside the plates makes the mean force small: that is what weighing shall find
        is_weighed = free_of(quality, DOES_NOT_COUNT & ~Quality.NOT_CARRIED).all()
        # frames that never came have a flag too: those that filters bridge count as if known
        steps = np.diff(time)
        lost = np.rint(steps / np.median(steps)).astype(int) - 1 if len(steps) else []
        gap = np.where(steps > self.longest_s, Quality.POSE_UNKNOWN, Quality.BRIDGED)
        vertical_n = float(force[:, 2].mean()) if is_weighed else np.nan
        flags = np.append(quality, np.repeat(gap, lost))
        of_frames = time[counts], residual, peak, curve, vertical_n, flags
        return LiveCycle(side, start_s, stop_s, whole, *of_frames, unit)


@dataclass(slots=True)
class ConditionSoFar:
    """Summarises the gait cycles, or steps, of a condition as they end, in memory that stays.

    A frame that is in a cycle of either foot counts once; trials count the cycles of one foot.

    Attributes
    ----------
    min_valid_share
        Of a gait cycle's frames that count: with less the cycle does not, as in trials.
    unit
        "cycle" or "step".
    cycles
        Those that are used, of both sides.
    left_out
        Why others are not -> how many.
    recent
        The last ten that are used.
    peaks
        Variant -> largest residual force [N], residual moment [N·m] and ground reaction force [N].
    """

    min_valid_share: float
    unit: Unit = "cycle"
    cycles: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    recent: deque[LiveCycle] = field(default_factory=lambda: deque(maxlen=LIMITS.shown_of))
    peaks: dict[str, Array] = field(default_factory=dict)
    _sides: Counter[str] = field(default_factory=Counter)
    _counted_s: float = -np.inf
    _frames: int = 0
    _squares: dict[str, Array] = field(default_factory=dict)

    def add(self, cycle: LiveCycle) -> None:
        """Take a cycle that has ended."""
        if reason := shortage(cycle.quality, self.min_valid_share):
            self.left_out[reason] += 1
            return
        self.cycles += 1
        self._sides[cycle.side] += 1
        self.recent.append(cycle)
        # cycles of the two feet overlap; each frame counts once
        new = cycle.time > self._counted_s
        self._counted_s = max(self._counted_s, float(cycle.time[-1]))
        self._frames += int(np.count_nonzero(new))
        for variant, residual in cycle.residual.items():
            squares = (residual[new] ** 2).sum(axis=0)
            self._squares[variant] = self._squares.get(variant, 0.0) + squares
            # the largest force and the largest moment, as vectors
            size = np.linalg.norm(residual.reshape(-1, 2, 3), axis=2).max(axis=0)
            peaks = np.append(size, cycle.peak_ground_n[variant])
            self.peaks[variant] = np.maximum(self.peaks.get(variant, 0.0), peaks)

    @property
    def used(self) -> int:
        """Those of one foot, as of trials: of the right one, else of the left."""
        return self._sides["right"] or self._sides["left"]

    @property
    def recent_rms(self) -> Mapping[str, Array]:
        """Variant -> root mean square over the last ten cycles, (6,) [N, N·m]; empty before."""
        variants = self.recent[-1].residual if self.recent else ()
        frames = {v: np.concatenate([c.residual[v] for c in self.recent]) for v in variants}
        return {v: np.sqrt(np.mean(residual**2, axis=0)) for v, residual in frames.items()}

    @property
    def rms(self) -> Mapping[str, Array]:
        """Variant -> root mean square over all frames of all cycles, (6,) [N, N·m]."""
        return {v: np.sqrt(sums / self._frames) for v, sums in self._squares.items()}
