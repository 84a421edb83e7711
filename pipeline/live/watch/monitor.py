"""What a laboratory sees of a session: gait cycles, residuals, notes, counts, latency."""

from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from time import monotonic
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from pipeline.io.recording import Plate
from pipeline.live.frames.chain import LiveChain
from pipeline.live.frames.frame import LiveFrame
from pipeline.live.stream import Samples
from pipeline.live.watch.condition import ConditionSoFar, Limits
from pipeline.live.watch.cycles import GaitTracker, LiveCycle
from pipeline.live.watch.delay import DelayWatch
from pipeline.live.watch.fit import FitWatch, FootWatch
from pipeline.live.watch.losses import Losses
from pipeline.live.watch.markers import MarkerGaps
from pipeline.live.watch.plates import PlateWatch
from pipeline.live.watch.weight import WeightWatch
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import AXES, height_of_mass

LATENCIES: Final = 6000
"""Of the newest frames, a minute at 100 Hz."""
MAX_NOTES: Final = 200
"""That are kept; a session of hours repeats itself."""
SHOWN_NOTES: Final = 8
SILENT_S: Final = 1.0
"""Without samples a stream has gone."""


@dataclass(frozen=True, slots=True)
class TimedNote:
    """A note and when it arose on the streams' clock [s]."""

    time: float
    note: Note


class Monitor:
    """Follows a session.

    Parameters
    ----------
    chain
        The session's.
    plates
        Places of the plates.

    Attributes
    ----------
    condition
        Residuals so far.
    cycles
        The last ten gait cycles.
    notes, noted
        As they arose, the newest last; how many arose in all.
    reasons
        Why frames do not count -> how many.
    """

    def __init__(self, chain: LiveChain, plates: Sequence[Plate]) -> None:
        self._chain = chain
        self._gait, self._delay = GaitTracker(), DelayWatch()
        self._markers = MarkerGaps(chain.tracker.markers)
        self._columns = list(chain.tracker.columns)
        self._fit = FitWatch(chain.tracker.markers, self._columns)
        self._feet = FootWatch()
        self._losses = Losses([chain.stream, *chain.analog.streams.values()])
        mass_kg = chain.body.mass
        self._weight = WeightWatch(mass_kg)
        moves = chain.ground.platform is not None
        self._plates = [
            (
                chain.live.channels_of(plate.number),
                PlateWatch(plate.number, mass_kg, _up(plate), moves=moves),
            )
            for plate in plates
        ]
        self._latency: deque[float] = deque(maxlen=LATENCIES)
        self._computing: deque[float] = deque(maxlen=LATENCIES)
        self._height_m = np.nan
        streams = (chain.stream.name, *chain.analog.used)
        self._arrived_s = dict.fromkeys(streams, monotonic())
        self._silent: set[str] = set()
        self.condition = ConditionSoFar(chain.settings.min_valid_share)
        self.cycles: deque[LiveCycle] = deque(maxlen=10)
        self.notes: deque[TimedNote] = deque(maxlen=MAX_NOTES)
        self.noted = 0
        self.reasons: Counter[str] = Counter()
        self.last: LiveFrame | None = None
        present = set(chain.tracker.markers)
        if absent := [name for name in chain.body.markers if name not in present]:
            names = ", ".join(absent)
            stream = chain.stream.name
            self._note(np.nan, [Note.of("live_markers_absent", markers=names, stream=stream)])

    def samples(self, received: Samples) -> None:
        """Take samples as they were received; those without a time are nobody's."""
        if received.clock_set_s:
            note = Note.of("live_clock_set", stream=received.stream, set_s=received.clock_set_s)
            self._note(received.time[-1], [note])
        timed = np.isfinite(received.time)
        if not timed.all():
            received = replace(received, time=received.time[timed], values=received.values[timed])
        if not len(received.time):
            return
        self._arrived_s[received.stream] = monotonic()
        self._losses.add(received)
        if received.stream in self._silent:
            self._silent.remove(received.stream)
            self._note(received.time[-1], [Note.of("live_stream_back", stream=received.stream)])
        if received.stream == self._chain.stream.name:
            position = received.values.reshape(len(received.time), -1, 3)
            notes = self._markers.add(received.time, position[:, self._columns])
            self._note(received.time[-1], notes)
            return
        stream = self._chain.analog.streams.get(received.stream)
        for channels, watch in self._plates:
            if stream is not None and set(channels) <= set(stream.labels):
                columns = [stream.labels.index(channel) for channel in channels]
                notes = watch.add(received.time, received.values[:, columns])
                self._note(received.time[-1], notes)

    def frame(self, frame: LiveFrame, latency_s: float) -> tuple[LiveCycle, ...]:
        """Take a frame; give the gait cycles that it ends."""
        self.last = frame
        self._latency.append(latency_s)
        self._computing.append(frame.computing_s)
        self.reasons.update(reason.name or "" for reason in Quality if reason in frame.quality)
        gait = self._gait.add(frame)
        for stride in gait.strides:
            self._note(frame.time, self._weight.add(stride))
        for cycle in gait.cycles:
            self.condition.add(cycle)
            self.cycles.append(cycle)
            self._height_m = height_of_mass(self._chain.body, frame.q[None])
        watched = self._delay.add(frame), self._fit.add(frame), self._feet.add(frame)
        self._note(frame.time, (note for notes in watched for note in notes))
        return gait.cycles

    def look_for_silence(self) -> None:
        """Note streams that have sent nothing for a second, or not yet."""
        now = monotonic()
        for stream, arrived_s in self._arrived_s.items():
            if stream not in self._silent and now - arrived_s > SILENT_S:
                self._silent.add(stream)
                time = self.last.time if self.last is not None else np.nan
                self._note(time, [Note.of("live_stream_silent", stream=stream)])

    @property
    def lost(self) -> dict[str, int]:
        """Stream -> samples that are missing between those that arrived; without those of none."""
        return dict(self._losses.lost)

    @property
    def limits(self) -> dict[str, Limits]:
        """Variant -> peaks beside their published limits; empty before the first cycle."""
        return dict(self.condition.limits(self._height_m))

    def latency_ms(self, percent: float) -> float:
        """Give a percentile of the time from arrival to results over the last minute [ms]."""
        return 1000 * float(np.percentile(self._latency, percent)) if self._latency else np.nan

    def computing_ms(self, percent: float) -> float:
        """Give a percentile of the computing time of a frame over the last minute [ms]."""
        return 1000 * float(np.percentile(self._computing, percent)) if self._computing else np.nan

    def status(self) -> str:
        """Give one line: frames, gait cycles, residuals so far, latency."""
        counts = self._chain.counts
        parts = [f"{counts.received} frames, {counts.marked} of them do not count"]
        if counts.late:
            parts.append(f"{counts.late} late")
        if self.condition.cycles:
            best = list(self.condition.rms)[-1]
            parts.append(f"{self.condition.cycles} gait cycles")
            parts.append(f"RMS {in_words(self.condition.rms[best])}")
        if self.condition.not_carried:
            parts.append(f"{self.condition.not_carried} gait cycles beside the plates")
        parts.append(f"{self.latency_ms(50):.1f} ms (99 %: {self.latency_ms(99):.1f})")
        return " · ".join(parts)

    def page(self) -> str:
        """Give counts, residuals beside their limits and the newest notes as Markdown."""
        counts = self._chain.counts
        lines = [
            f"**{counts.received}** frames, {counts.marked} of them do not count, {counts.late} "
            f"late; {self.condition.cycles} gait cycles, and {self.condition.not_carried} beside "
            "the plates",
            "",
        ]
        if self.condition.cycles:
            lines += [f"| RMS | {' | '.join(AXES)} |", "|---" * 7 + "|"]
            for variant, rms in self.condition.rms.items():
                cells = " | ".join(f"{value:.1f}" for value in rms)
                lines.append(f"| {variant} | {cells} |")
            lines.append("")
            for variant, limit in self.limits.items():
                lines.append(
                    f"- {variant}: peaks {limit.force_n:.0f} N (limit {limit.max_force_n:.0f} N), "
                    f"{limit.moment_nm:.0f} N·m (limit {limit.max_moment_nm:.0f} N·m)"
                )
        lines += [f"- {timed.note}" for timed in list(self.notes)[-SHOWN_NOTES:]]
        lines.append(
            f"\nfrom arrival to results {self.latency_ms(50):.1f} ms, 99 % within "
            f"{self.latency_ms(99):.1f} ms"
        )
        return "\n".join(lines)

    def _note(self, time: float, notes: Iterable[Note]) -> None:
        for note in notes:
            self.notes.append(TimedNote(float(time), note))
            self.noted += 1


def _up(plate: Plate) -> float:
    """Give 1 where a plate's z axis points up, and -1 where it points down."""
    return float(np.sign(plate.rotation[2, 2]))


def in_words(rms: Array) -> str:
    """Give residuals in words, such as "Fx 12 Fy 8 Fz 15 N, Mx 2.1 My 3.0 Mz 1.2 N·m"."""
    forces = " ".join(f"{axis} {value:.0f}" for axis, value in zip(AXES[:3], rms[:3], strict=True))
    moments = " ".join(f"{axis} {value:.1f}" for axis, value in zip(AXES[3:], rms[3:], strict=True))
    return f"{forces} N, {moments} N·m"
