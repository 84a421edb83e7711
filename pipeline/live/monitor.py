"""What a laboratory sees of a session: residuals so far, latency, and what is wrong."""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import compress
from time import monotonic
from typing import Final, Protocol

import numpy as np

from compensation import InertiaModel, marker_plate_delay
from compensation.inertia.sensors import sensor_faults
from hbm.coordinates import N_Q
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.converters import find_limits
from hbm.signals.filtering import acceleration_lag_s
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS, Array
from pipeline.config.schema import NOUNS
from pipeline.io.recording import Plate
from pipeline.live.chain import LiveChain, LiveFrame
from pipeline.live.cycles import ConditionSoFar, GaitTracker, LiveCycle
from pipeline.live.ground import Channels
from pipeline.live.light import OF_FRAMES, OF_SENSORS, Finding, Key, Kind, light
from pipeline.live.stream import Samples, StreamDescription
from pipeline.trial.findings.raw import LIMITS as RAW
from pipeline.trial.findings.zeros import LIMITS as ZEROS
from pipeline.trial.findings.zeros import rest_level
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.residuals import (
    AXES,
    HEALTHY_RMS,
    height_of_mass,
    reported,
)
from pipeline.trial.residuals import LIMITS as RESIDUALS
from pipeline.trial.subject import differing_masses
from pipeline.viewer.live import Board

LIMITS: Final = read_numbers("pipeline.live", "thresholds.toml", "session")


class MarkerGaps:
    """Finds markers that have been hidden for 0.4 s; those that are hidden now are in ``found``.

    Examples
    --------
    >>> gaps = MarkerGaps(["LASIS"])
    >>> gaps.add(np.array([0.0, 0.2, 0.4]), np.full((3, 1, 3), np.nan))
    >>> print(gaps.found[0].note)
    LASIS: hidden for 0.4 s
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names, self._seen_s = names, np.full(len(names), np.nan)
        self.found: list[Finding] = []

    def add(self, time: Array, position: Array) -> None:
        """Take frames, (N,) [s] and (N, M, 3)."""
        self._seen_s[np.isnan(self._seen_s)] = time[0]
        is_seen = np.isfinite(position).all(axis=2)
        last_seen_s = np.where(is_seen, time[:, None], -np.inf).max(axis=0)
        self._seen_s = np.maximum(self._seen_s, last_seen_s)
        gone_s = time[-1] - self._seen_s
        self.found = [
            Finding(Kind.MARKER_GONE, (name,), {"gone_s": hidden_s})
            for name, hidden_s in zip(self._names, gone_s, strict=True)
            if hidden_s >= LIMITS.hidden_marker
        ]


class FitWatch:
    """Finds markers that do not fit the body, and pressure that is mostly under neither foot.

    Judges the frames of two seconds. The body's M markers that are received are at these columns of
    a frame's markers.
    """

    def __init__(self, markers: Sequence[str], columns: Sequence[int]) -> None:
        self._names, self._columns = tuple(markers), list(columns)
        self._frames, self.found = list[LiveFrame](), list[Finding]()

    def add(self, frame: LiveFrame) -> None:
        """Take a frame."""
        frames = self._frames
        frames.append(frame)
        spanned_s = frame.time - frames[0].time
        if len(frames) >= LIMITS.fewest_frames and spanned_s >= LIMITS.judged_together:
            self.found = list(self._judged())
            frames.clear()

    def _judged(self) -> Iterator[Finding]:
        """Find large distances, markers that were seen and not used, and feet beside pressure."""
        error = np.array([frame.marker_error for frame in self._frames])
        quality = np.array([frame.quality for frame in self._frames])
        squared_m2 = error[np.isfinite(error)] ** 2
        rms_m = float(np.sqrt(squared_m2.mean())) if len(squared_m2) else 0.0
        is_seen = np.isfinite([frame.markers[self._columns] for frame in self._frames]).all(axis=2)
        doubtful = ~free_of(quality, Quality.MARKERS_LEFT_OUT)[:, None]
        # seen by cameras and yet without an error: the pose was solved without them
        often = (is_seen & np.isnan(error) & doubtful).mean(axis=0) > LIMITS.most_frames
        if often.any():
            markers = tuple(compress(self._names, often))
            yield Finding(Kind.MARKERS_LEFT_OUT, values={"error_m": rms_m, "markers": markers})
        elif rms_m > LIMITS.marker_error:
            yield Finding(Kind.MARKERS_MISFIT, values={"error_m": rms_m})
        fraction = 1 - float(free_of(quality, Quality.FOOT_UNCERTAIN).mean())
        if fraction > LIMITS.most_frames:
            yield Finding(Kind.FOOT_UNCERTAIN, values={"share": fraction})


class DelayWatch:
    """Finds how much later the plates are than the markers, every ten seconds of walking.

    As `compensation.marker_plate_delay`; the lag of the real-time filter's accelerations is added.
    A delay below 5 ms, or whose 95 % interval contains zero, is none.
    """

    def __init__(self) -> None:
        self._frames, self._judged_s, self.found = deque[LiveFrame](), -np.inf, list[Finding]()

    def add(self, frame: LiveFrame) -> None:
        """Take a frame."""
        self._frames.append(frame)
        while frame.time - self._frames[0].time > LIMITS.delay_window:
            self._frames.popleft()
        if frame.time - max(self._judged_s, self._frames[0].time) < LIMITS.plate_interval:
            return
        self._judged_s = frame.time
        (*_, variant), frames = frame.residual, self._frames
        time = np.array([f.time for f in frames])
        # what the motion needs is what the plates give and the residual, which is the difference
        plate = np.array([f.by_foot[variant][:, :3].sum(axis=0) for f in frames])
        motion = plate + reported(np.array([f.residual[variant] for f in frames]))[:, :3]
        motion[[not f.quality.counts for f in frames]] = np.nan
        try:
            delay = marker_plate_delay(plate, motion, time)
        except ValueError:  # not determined by what is in it
            return
        # accelerations of the real-time filter are half a step older than its values, the forces
        delay_s, error_s = delay.seconds + acceleration_lag_s(time), delay.uncertainty
        values = {"delay_s": delay_s, "uncertainty_s": error_s}
        late = abs(delay_s) > max(LIMITS.least_delay, error_s)
        self.found = [Finding(Kind.PLATES_LATE, values=values)] * late


class WeightWatch:
    """Finds when plates carry another weight than the subject's, (body mass in kg).

    Over a whole stride a body gains no vertical speed, so that the mean vertical force is its
    weight. The median of five strides, on which one step beside a plate has no effect, is compared
    with the body mass as trials compare it (`pipeline.trial.subject.differing_masses`). What two
    such judgements in a row say is found, with the value of the second, in which nothing is left of
    what was before. Strides with frames that are not used are left out.

    Examples
    --------
    >>> watch, empty = WeightWatch(75.0), np.empty(0)
    >>> light = LiveCycle("left", 0.0, 1.1, True, empty, {}, {}, {}, vertical_n=700.0)
    >>> for _ in range(20):
    ...     watch.add(light)
    >>> print(watch.found[0].note)
    plates carry 71.4 kg over five strides, −5 % relative to the body mass of 75.0 kg
    """

    def __init__(self, mass_kg: float) -> None:
        self._mass_kg, self._latest = mass_kg, False
        self._carried_kg, self.found = list[float](), list[Finding]()

    def add(self, stride: LiveCycle) -> None:
        """Take a stride."""
        if np.isfinite(stride.vertical_n):
            self._carried_kg.append(stride.vertical_n / GRAVITY_MPS2)
        if len(self._carried_kg) < LIMITS.weighed_strides:
            return
        carried_kg = float(np.median(self._carried_kg))
        self._carried_kg.clear()
        differs = bool(differing_masses({"of the body": self._mass_kg}, carried_kg))
        before, self._latest = self._latest, differs
        # two judgements in a row: strides of the first may be from before a change
        if differs == before and differs != bool(self.found):
            values = {"carried_kg": carried_kg, "mass_kg": self._mass_kg}
            relative = {"difference": carried_kg / self._mass_kg - 1}
            self.found = [Finding(Kind.WEIGHT_DIFFERS, values=values | relative)] * differs


class SignalWatch:
    """Judges samples of signals that span a time [s], and then the next ones."""

    def __init__(self, span_s: float, judge: Callable[[Array, Array], Iterable[Finding]]) -> None:
        self._span_s, self._judge = span_s, judge
        self._kept, self.found = list[tuple[Array, Array]](), list[Finding]()

    def add(self, time: Array, values: Array) -> None:
        """Take samples, (N,) [s] and (N, K)."""
        self._kept.append((time, values))
        if time[-1] - self._kept[0][0][0] >= self._span_s:
            self.found = [*self._judge(*map(np.concatenate, zip(*self._kept, strict=True)))]
            self._kept.clear()


def plate_watch(number: int, mass_kg: float, up: float = 1, *, moves: bool = False) -> SignalWatch:
    """Find whether a plate is not zero without load, or saturated, ten seconds at a time.

    Its samples are (N, 6), in its own axes. Both are judged as of trials
    (`pipeline.trial.findings.zeros.rest_level`, `hbm.signals.converters.find_limits`). The plate's
    z axis points up (1) or down (-1). What it reads without load on a platform that moves is the
    platform's inertia and weight; where zeros are followed, it is not in the results.
    """
    plate = (str(number),)

    def judge(time: Array, wrench: Array) -> Iterator[Finding]:
        vertical_n, weight_n = up * wrench[:, 2], mass_kg * GRAVITY_MPS2
        rest_n = None if moves else rest_level(vertical_n, time, weight_n)
        if rest_n is not None and abs(rest_n) > ZEROS.largest_reading:
            yield Finding(Kind.PLATE_NOT_ZERO, plate, {"rest_n": rest_n})
        step_s = float(np.median(np.diff(time)))
        for name, channel, least in zip(WRENCH_COMPONENTS, wrench.T, RAW.least_clip, strict=True):
            for level, _ in find_limits(channel, step_s):
                if abs(level) >= least:
                    values = {"component": name, "value": level}
                    yield Finding(Kind.PLATE_SATURATED, plate, values)

    return SignalWatch(LIMITS.plate_interval, judge)


def sensor_watch(model: InertiaModel) -> SignalWatch:
    """Find what makes compensation doubtful in five seconds of accelerometers at a time.

    As of trials, by `compensation.check_trial`; a gap is zero, so that a sensor that sends nothing
    is dead. Samples are (N, K) [m/s²].
    """

    def judge(_: Array, read: Array) -> Iterator[Finding]:
        for fault, values in sensor_faults(model, np.nan_to_num(read)).items():
            yield Finding(OF_SENSORS[fault], values=values)

    return SignalWatch(LIMITS.sensor_interval, judge)


class Watch(Protocol):
    """What is watched: what is wrong with it now."""

    found: list[Finding]


class Monitor:
    """Follows a session.

    Parameters
    ----------
    chain
        The session's.
    plates
        Places of the plates.
    say
        Called with each note as it arises.
    required
        Gait cycles of one foot that the session is for.

    Attributes
    ----------
    chain
        The session's.
    condition
        Residuals so far.
    cycles
        The last ten gait cycles.
    notes
        The newest ones as they arose, each with its time on the streams' clock [s].
    height_m
        Of the centre of mass above the feet in the newest cycle.
    raised
        Kind and subject of findings -> the newest one in words, and how often it arose.
    reasons
        Why frames are not used -> how many.
    during_stop
        Gait cycles that are not used because the light said stop.
    """

    def __init__(
        self,
        chain: LiveChain,
        plates: Sequence[Plate],
        say: Callable[[Note], object] = lambda note: None,
        required: int = LIMITS.required_cycles,
    ) -> None:
        self.chain, self._say, self._required = chain, say, required
        self._gait, self._delay = GaitTracker(chain.motion.longest_s), DelayWatch()
        body, ground, names = chain.body, chain.ground, chain.tracker.markers
        moves = ground.platform is not None or chain.zeros is not None
        self._markers = MarkerGaps(names)
        self._columns = list(chain.tracker.columns)
        self._fit, self._weight = FitWatch(names, self._columns), WeightWatch(body.mass)
        self._signals: list[tuple[Channels, SignalWatch]] = [
            (channels, plate_watch(p.number, body.mass, np.sign(p.rotation[2, 2]), moves=moves))
            for p, channels in zip(plates, ground.plates, strict=True)
        ]
        if ground.sensors is not None:
            self._signals.append((ground.readings, sensor_watch(ground.sensors)))
        of_frames = self._markers, self._fit, self._delay, self._weight
        self._watches: list[Watch] = [*of_frames, *(watch for _, watch in self._signals)]
        self._latency = deque[float](maxlen=6000)  # of a minute at 100 Hz
        together = round(LIMITS.judged_together * chain.stream.rate_hz)
        self._recent = deque[Quality](maxlen=max(1, together))
        self._time = self._steady_s = np.nan
        self.height_m = height_of_mass(body, np.zeros((1, N_Q)))
        streams = (chain.stream.name, *chain.analog.used)
        self._arrived_s = dict.fromkeys(streams, monotonic())
        self._untimed_s = dict.fromkeys(streams, -np.inf)
        self._silent, self._high = list[Finding](), list[Finding]()
        self._held: set[Key] = set()
        least = chain.settings.min_valid_share
        self._so_far = {unit: ConditionSoFar(least, unit) for unit in ("cycle", "step")}
        self.cycles = deque[LiveCycle](maxlen=self._so_far["cycle"].recent.maxlen)
        self.reasons = Counter[str]()
        self.notes = deque[tuple[float, Note]](maxlen=200)  # a session of hours repeats itself
        self._stopped, self.during_stop = False, 0
        self.raised: dict[Key, tuple[Note, int]] = {}
        if absent := tuple(name for name in body.markers if name not in chain.tracker.markers):
            values = {"markers": absent}
            self.hear(Finding(Kind.MARKERS_ABSENT, (chain.stream.name,), values))

    def samples(self, received: Samples) -> None:
        """Take samples as they were received, in order; none where none had a time of its own."""
        name, time, values = received.stream, received.time, received.values
        if not len(time):
            self._untimed_s[name] = monotonic()
            return
        self._time = float(time[-1])
        if received.clock_set_s:
            self.hear(Finding(Kind.CLOCK_SET, (name,), {"set_s": received.clock_set_s}))
        self._arrived_s[name] = monotonic()
        self._silent = [silent for silent in self._silent if silent.subject != (name,)]
        if name == self.chain.stream.name:
            position = values.reshape(len(time), -1, 3)
            self._markers.add(time, position[:, self._columns])
        for channels, watch in self._signals:
            if channels.stream == name:
                watch.add(time, values[:, channels.columns] * channels.factor)
        self.look()

    def frame(self, frame: LiveFrame, latency_s: float) -> None:
        """Take a frame."""
        self._time = frame.time
        self._latency.append(latency_s)
        # the first two seconds, in which filters settle, are not judged
        self._steady_s = np.fmin(self._steady_s, frame.time + LIMITS.judged_together)
        if frame.time >= self._steady_s:
            self._recent.append(frame.quality)
        self.reasons.update(reason.name or "" for reason in Quality if reason in frame.quality)
        ended = self._gait.add(frame)
        # every stride weighs the subject; only those that are whole are gait cycles
        strides = [part for part in ended if part.unit == "cycle"]
        cycles = [stride for stride in strides if stride.whole]
        for stride in strides:
            self._weight.add(stride)
        if self._stopped:
            self.during_stop += len(cycles)
        else:
            for part in (part for part in ended if part.whole):
                self._so_far[part.unit].add(part)
        if ended:
            self.height_m = height_of_mass(self.chain.body, frame.q[None])
            self._high = self._above_healthy()
        self.cycles.extend(cycles)
        self._delay.add(frame)
        self._fit.add(frame)
        self.look()

    def hear(self, *findings: Finding) -> None:
        """Note findings, such as those of the source of the samples."""
        for finding in findings:
            note, (_, count) = finding.note, self.raised.get(finding.key, (None, 0))
            self.notes.append((self._time, note))
            self.raised[finding.key] = note, count + 1
            self._say(note)

    def look_for_silence(self) -> None:
        """Find streams without a new sample for a second, once all that came was taken."""
        late_s = monotonic() - LIMITS.silence
        late = sorted(name for name, arrived_s in self._arrived_s.items() if arrived_s < late_s)
        # of a sender whose clock stands still samples come, but none with a time of its own
        kinds = Kind.STAMPS_REPEAT, Kind.STREAM_SILENT
        self._silent = [Finding(kinds[self._untimed_s[n] < late_s], (n,)) for n in late]
        self.look()

    def look(self) -> list[Finding]:
        """Give what is wrong now; what is new is noted."""
        findings = [*self._silent, *self._high]
        findings += (finding for watch in self._watches for finding in watch.found)
        self.hear(*(finding for finding in findings if finding.key not in self._held))
        self._held = {finding.key for finding in findings}
        self._stopped = any(finding.kind.stops for finding in findings)
        return findings

    def _above_healthy(self) -> list[Finding]:
        """Find residuals of the best variant whose bars are beyond their lines."""
        *_, rms = [np.zeros(len(AXES)), *self.condition.recent_rms.values()]
        axes = tuple(compress(AXES, rms > HEALTHY_RMS))
        return [Finding(Kind.RESIDUALS_HIGH, values={"axes": axes})] * bool(axes)

    @property
    def condition(self) -> ConditionSoFar:
        """The gait cycles so far or, where plates carry none of them, the steps."""
        cycles, steps = self._so_far.values()
        return steps if steps.cycles and not cycles.cycles else cycles

    def latency_ms(self, percent: float) -> float:
        """Give a percentile of the time from arrival to results over the last minute [ms]."""
        return 1000 * float(np.percentile(self._latency, percent)) if self._latency else np.nan

    def board(self, streams: Sequence[StreamDescription] = ()) -> Board:
        """Give what is read at a glance: light, gait cycles used, bars, and who sends what."""
        recent, condition = list(self._recent), self.condition
        frames = max(len(recent), 1)
        not_used = {r: sum(r in quality for quality in recent) / frames for r in OF_FRAMES}
        used, required = condition.used, self._required
        noun, steady = f"{NOUNS[condition.unit]}s", len(recent) >= LIMITS.fewest_frames
        ended = ": end with Ctrl-C" * (used >= required)
        done = f"{used} of {required} {noun} used{ended}"
        shown = light(self.look(), not_used, done, steady=steady)
        if ended and 0 < len(self._arrived_s) == len(self._silent):
            shown = "look", f"All streams have ended{ended}"
        progress = used / required, f"{used} / {required} {noun}{ended}"
        return Board(*shown, *progress, condition.recent_rms, senders(streams))

    def status(self) -> str:
        """Give one line: light, gait cycles, RMS residuals of the last ten, latency."""
        board = self.board()
        done = [board.done] * (board.colour != "good")  # whose sentence says it
        residuals = [f"RMS {_in_words(rms)}" for rms in board.rms.values()][-1:]
        latency = [f"{self.latency_ms(50):.1f} ms"] * bool(self._latency)
        parts = f"{board.colour.upper()}: {board.sentence}", *done, *residuals, *latency
        return " · ".join(parts)

    def residuals(self) -> Iterator[str]:
        """Say the residuals of each variant so far, and peaks with their published limits.

        The limits are 5 % of the largest ground reaction force, and 1 % of the height of the centre
        of mass times that force (Hicks et al. 2015, J Biomech Eng 137:020905).
        """
        for variant, (force_n, moment_nm, ground_n) in self.condition.peaks.items():
            max_moment_nm = RESIDUALS.largest_moment * self.height_m * ground_n
            yield (
                f"residuals {variant}: RMS {_in_words(self.condition.rms[variant])}; peaks "
                f"{force_n:.0f} N (published limit {RESIDUALS.largest_force * ground_n:.0f} N), "
                f"{moment_nm:.0f} N·m ({max_moment_nm:.0f} N·m)"
            )


def senders(streams: Sequence[StreamDescription]) -> str:
    """Say which streams are received, at which rates, from which computers."""
    return ", ".join(f"{s.name} ({s.rate_hz:g} Hz) from {s.sender}" for s in streams)


def _in_words(rms: Array) -> str:
    """Give residuals in words, such as "Fx 12 Fy 8 Fz 15 N, Mx 2.1 My 3.0 Mz 1.2 N·m"."""
    words = [f"{axis} {x:.{k // 3}f}" for k, (axis, x) in enumerate(zip(AXES, rms, strict=True))]
    return f"{' '.join(words[:3])} N, {' '.join(words[3:])} N·m"
