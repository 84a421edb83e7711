"""Streams of samples: what they carry, what senders say of them, and how they arrive."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol
from xml.etree.ElementTree import Element

import numpy as np

from hbm.numbers import read_numbers
from hbm.spatial import Array, Mask
from hbm.spelling import short
from pipeline.io.axes import parse_axes
from pipeline.io.columns import DFLOW_PLATE
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Plate
from pipeline.io.streams import (
    AXES,
    Channel,
    Remembered,
    find_plates,
    lost_before,
    marker_layout,
    si_units,
)
from pipeline.io.units import MAX_VALUE

LAB_AXES: Final = "forward,left,up"
"""Axes of all positions, as descriptions state them."""


@dataclass(frozen=True, slots=True)
class StreamDescription:
    """What a stream carries.

    Attributes
    ----------
    name
        The stream's name.
    kind
        "markers" or "analog".
    labels
        Names of markers or of channels.
    units
        One per label; "m" for markers. Forces are in N and moments in N·m; other channels have the
        unit that the sender states.
    rate_hz
        Nominal sampling rate [Hz].
    sender
        Computer that sends it.

    Examples
    --------
    >>> heels = StreamDescription("Markers", "markers", ("LHEE", "RHEE"), ("m", "m"), 100.0)
    >>> heels.kind
    'markers'
    """

    name: str
    kind: Literal["markers", "analog"]
    labels: tuple[str, ...]
    units: tuple[str, ...]
    rate_hz: float
    sender: str = "this computer"


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples of one stream, in the order in which they arrived.

    Attributes
    ----------
    stream
        The stream's name.
    time
        (N,) [s], one clock for all streams.
    values
        (N, K). Of markers (N, 3 M), x y z of each in lab axes [m]; NaN where one is not seen.
    clock_set_s
        By how much the sender's clock was set before one of them [s]; 0 where it went on.
    """

    stream: str
    time: Array
    values: Array
    clock_set_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class DescribedPlate:
    """A plate as a sender describes it.

    Attributes
    ----------
    number
        As the sender writes it.
    channels
        Labels of its Fx Fy Fz Mx My Mz, in its own axes about the centre of its surface; empty
        where they are not stated.
    place
        Where it lies in the lab, without samples; None where that is not stated.
    problem
        Why there is no place.
    """

    number: str
    channels: tuple[str, ...] = ()
    place: Plate | None = None
    problem: str = ""


class Source(Protocol):
    """Where samples come from."""

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """What is received, known from the start."""

    @property
    def plates(self) -> tuple[DescribedPlate, ...]:
        """Plates as the streams' descriptions state them; empty where they state none."""

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give whatever has arrived; an empty list if nothing does within the timeout [s]."""

    def close(self) -> None:
        """Stop receiving."""


LIMITS: Final = read_numbers("pipeline.live", "thresholds.toml", "clock")
STREAMS: Final = read_numbers("pipeline.io", "thresholds.toml", "streams")
"""Of recordings, too: a session and its recording use the same samples."""


def known(values: Array) -> Array:
    """Give samples with NaN in place of numbers that no instrument gives."""
    return np.where(np.abs(values) < MAX_VALUE, values, np.nan)


@dataclass(slots=True, eq=False)
class StreamClock:
    """One stream's: what is added to its time stamps, its newest time, and samples in doubt.

    Counted are samples that ``came``, those ``given`` on, those ``unordered`` that came late or
    twice, and those ``lost`` before the ``recent`` times, (N,) [s], so far. The stamp of the
    ``last`` one came ``alike`` times, that before it ``before`` times; ``seen`` are samples of the
    last seconds.
    """

    rate_hz: float
    added_s: float = 0.0
    newest_s: float = -np.inf
    heard_s: float = 0.0
    doubtful: list[tuple[float, Array]] = field(default_factory=list)
    came: int = 0
    given: int = 0
    unordered: int = 0
    lost: int = 0
    recent: Array = field(default_factory=lambda: np.empty(0))
    last: tuple[float, bytes] = (np.nan, b"")
    alike: int = 1
    before: int = 1
    seen: Remembered = field(default_factory=Remembered)

    @property
    def unused(self) -> int:
        """Samples that came late, twice, or without a sure time."""
        return self.came - self.given - len(self.doubtful)

    @property
    def missing(self) -> int:
        """Samples that have not come; those without a sure time are not among them."""
        lost = self.lost + int(lost_before(self.recent, self.rate_hz)[-1:].sum())
        return max(lost - (self.unused - self.unordered), 0)

    def spread(self, stamp: float, value: Array) -> float:
        """Give the time stamp of a sample [s]; NaN where stamp and values came before.

        Samples of one stamp, as senders stamp a chunk, are spread about it, as the offline clock
        places them; where they are more than those of half a second, their clock stands still.
        """
        sample, most = (stamp, value.tobytes()), LIMITS.remembered * self.rate_hz
        # a signal that does not change repeats its values within a chunk of one stamp
        steady = sample == self.last and max(self.alike, self.before) > 1
        if self.seen.again(stamp, value, most) and not steady:
            self.unordered += 1
            return np.nan
        again, self.last = stamp == self.last[0], sample
        self.before, self.alike = (self.before, self.alike + 1) if again else (self.alike, 1)
        # a chunk is taken to be as long as the one before: its middle is at the stamp
        place = (self.alike - (1 + max(self.alike, self.before)) / 2) / (self.rate_hz or 1)
        return stamp + place if self.alike <= 1 + STREAMS.out_of_order * self.rate_hz else np.nan

    def in_order(self, time: Array) -> Mask:
        """Find samples at times, (N,) [s], that are later than all before them; count the others.

        What is missing is judged of so many samples at once that jitter does not count.
        """
        newest = np.maximum.accumulate(np.append(self.recent.max(initial=-np.inf), time))
        later: Mask = np.asarray(time > newest[:-1])
        self.given += int(later.sum())
        self.unordered += int((~later).sum())
        self.recent = np.unique(np.append(self.recent, time))
        kept = int(max(LIMITS.counted, self.rate_hz))
        if len(self.recent) > 2 * kept:
            self.lost += int(lost_before(self.recent, self.rate_hz)[-kept])
            self.recent = self.recent[-kept:]
        return later


class Arrivals:
    """Brings the samples of each stream into order, on a clock that goes on when it is set.

    Parameters
    ----------
    streams
        What is received.

    Attributes
    ----------
    of
        Stream -> its clock, and what is missing or left out of it.

    Notes
    -----
    The first sample after the clock was set follows the last one before it by one sampling
    interval, or, after a pause, it is as late as the newest sample of another stream. Streams of
    one sender are moved alike, so that they stay together. Samples that are no later than one
    before them have come late or twice; they are left out and counted. Those that never came are
    counted as `pipeline.io.streams.find_clock` does: what its clock expects less what came.

    Examples
    --------
    >>> heels = StreamDescription("Markers", "markers", ("LHEE",), ("m",), 100.0)
    >>> arrivals, values = Arrivals([heels]), np.zeros((5, 3))
    >>> before = arrivals.take(Samples("Markers", 10 + np.arange(5) / 100, values), 0.0)
    >>> after = arrivals.take(Samples("Markers", 2 + np.arange(5) / 100, values), 0.05)
    >>> after.time.round(3).tolist(), round(after.clock_set_s, 3)
    ([10.05, 10.06, 10.07, 10.08, 10.09], -8.05)
    >>> arrivals.of["Markers"].missing, arrivals.of["Markers"].unused
    (0, 0)
    """

    def __init__(self, streams: Sequence[StreamDescription]) -> None:
        self.of = {stream.name: StreamClock(stream.rate_hz) for stream in streams}

    def take(self, samples: Samples, arrived_s: float) -> Samples:
        """Take what arrived of a stream at a time of this computer [s]; give it as it counts.

        Samples without a time are left out. Those that are in doubt are kept until others confirm
        them; if none do, they are left out too.
        """
        clock = self.of[samples.stream]
        passed_s, clock.heard_s = arrived_s - clock.heard_s, arrived_s
        others_s = max((c.newest_s for c in self.of.values() if c is not clock), default=-np.inf)
        # no sample is later than now, by this computer's clock or that of another stream
        latest_s = LIMITS.ahead + max(clock.newest_s + passed_s, others_s)
        before_s, taken = clock.added_s, list[tuple[float, Array]]()
        clock.came += len(samples.time)
        for sent, value in zip(samples.time.tolist(), samples.values, strict=True):
            stamp = clock.spread(sent, value) if np.isfinite(sent) else np.nan
            if not np.isfinite(time := stamp + clock.added_s):
                continue
            if clock.newest_s == -np.inf:
                clock.newest_s, latest_s = time, np.inf
            if clock.newest_s - STREAMS.out_of_order < time < latest_s:
                clock.doubtful.clear()
                clock.newest_s = max(clock.newest_s, time)
                taken.append((time, value))
                continue
            # wrong stamps do not follow one another; those of a clock that was set do
            if clock.doubtful and not 0 < stamp - clock.doubtful[-1][0] < STREAMS.out_of_order:
                clock.doubtful.clear()
            clock.doubtful.append((stamp, value))
            enough = max(LIMITS.fewest_confirmed, LIMITS.confirmed * clock.rate_hz)
            if len(clock.doubtful) >= enough:
                self._set(clock, others_s)
                taken += [(s + clock.added_s, row) for s, row in clock.doubtful]
                clock.newest_s = taken[-1][0]
                latest_s = clock.newest_s + LIMITS.ahead
                clock.doubtful.clear()
        times = np.array([time for time, _ in taken])
        later = clock.in_order(times)
        values = np.array([value for _, value in taken]).reshape(-1, samples.values.shape[1])
        return Samples(samples.stream, times[later], known(values[later]), before_s - clock.added_s)

    def _set(self, clock: StreamClock, others_s: float) -> None:
        """Find what has to be added to the time stamps of a stream whose clock was set."""
        begins_s = clock.doubtful[0][0]
        next_s = clock.newest_s + (1 / clock.rate_hz if clock.rate_hz > 0 else 0.0)
        # streams of one sender are set together: what was added to another one may fit
        others = {0.0, *(other.added_s for other in self.of.values() if other is not clock)}
        near = min(others, key=lambda added_s: abs(begins_s + added_s - next_s))
        if abs(begins_s + near - next_s) < LIMITS.set_together:
            clock.added_s = near
        else:
            # the stream goes on where it stopped, or after a pause with the others
            paused = others_s > next_s + STREAMS.out_of_order
            clock.added_s = (others_s if paused else next_s) - begins_s


def _require_rate(name: str, rate_hz: float) -> None:
    """Refuse a nominal rate that no instrument has; 0 says that it is not stated."""
    slowest, fastest = LIMITS.rates
    if rate_hz != 0 and not slowest <= rate_hz <= fastest:
        raise ValueError(
            f"{short(name)} states {rate_hz:g} Hz, expected {slowest:g} to {fastest:g}; "
            "correct it in the program that sends it"
        )


Convert = Callable[[Array], Array]
"""From samples as sent, (N, K), to samples of a `Samples`."""


def marker_channels(names: Sequence[str], unit: str) -> tuple[Channel, ...]:
    """Give the channels of markers: x, y and z of each."""
    parts = [(name, axis) for name in names for axis in AXES]
    return tuple(Channel(f"{n}_{axis}", unit, f"Position{axis}", marker=n) for n, axis in parts)


def describe_markers(
    name: str, channels: Sequence[Channel], rate_hz: float, options: ReadOptions, axes: str = ""
) -> tuple[StreamDescription, Convert]:
    """Describe a stream of markers, and give what brings its samples to lab axes and m.

    A marker that is not seen becomes NaN. The sender's axes are empty where it does not state them;
    a ValueError says that nobody does, that no instrument has this rate, or as
    `pipeline.io.streams.marker_layout`.
    """
    _require_rate(name, rate_hz)
    names, positions = marker_layout(channels, options)
    axes = options.axes or axes
    if not axes:
        raise ValueError(
            "the axes of its markers are unknown; give them, for example --axes "
            'forward,left,up, or axes = "forward,left,up" in study.toml'
        )
    to_lab = parse_axes(axes).T

    def convert(values: Array) -> Array:
        with np.errstate(invalid="ignore"):  # infinite ones
            return np.asarray(positions(values) @ to_lab).reshape(len(values), -1)

    units = ("m",) * len(names)
    return StreamDescription(name, "markers", names, units, rate_hz), convert


def describe_signals(
    name: str, channels: Sequence[Channel], rate_hz: float, axes: str = ""
) -> tuple[StreamDescription, Convert]:
    """Describe a stream of other signals, and give what brings its samples to N and N·m.

    Vectors of plates that are named as D-Flow names them, such as FP1.ForX, FP1.ForY and FP1.ForZ,
    are in the markers' axes as sent, where these are known, and become lab axes. A ValueError says
    that no instrument has this rate.

    Examples
    --------
    >>> channels = [*(Channel(f"FP1.For{axis}", "kN") for axis in "XYZ"), Channel("EMG", "mV")]
    >>> _, convert = describe_signals("Plates", channels, 1000.0, "right,up,back")
    >>> convert(np.array([[0.0, 0.7, -0.1, np.nan]])).tolist()
    [[100.0, 0.0, 700.0, nan]]
    """
    _require_rate(name, rate_hz)
    units, factors = si_units(channels)
    labels = tuple(channel.label for channel in channels)
    description = StreamDescription(name, "analog", labels, units, rate_hz)
    stems = dict.fromkeys(label[:-1] for label in labels if DFLOW_PLATE.fullmatch(label))
    # only vectors of which x, y and z are there once, in this order, can be turned
    of_stems = ([k for k, label in enumerate(labels) if label[:-1] == stem] for stem in stems)
    triples = [columns for columns in of_stems if [labels[k][-1] for k in columns] == [*AXES]]
    to_lab = parse_axes(axes or LAB_AXES)

    def convert(values: Array) -> Array:
        signals = np.asarray(values * factors, float)
        with np.errstate(invalid="ignore"):  # infinite ones
            for columns in triples:
                signals[:, columns] = signals[:, columns] @ to_lab.T
        return signals

    return description, convert


def describe_plates(
    info: Element, channels: Sequence[Channel], axes: str
) -> tuple[DescribedPlate, ...]:
    """Describe the plates of a stream, from its description, whose root is ``info``.

    They are those that channels name, as `pipeline.io.streams.find_plates` finds them, and those
    whose channels are named as D-Flow names them: these are about the lab's origin, in lab axes as
    `describe_signals` gives them. The axes, in which places are stated, are the markers'. A
    ValueError says that channels of a plate have no labels of their own, by which they are found.
    """
    placed, left_out = find_plates(info, channels)
    all_labels, to_lab = [channel.label for channel in channels], parse_axes(axes)
    plates = list[DescribedPlate]()
    for plate in placed:
        number = str(plate.place.number)
        labels = tuple(all_labels[column] for column in plate.columns)
        for label in labels:
            if not label or all_labels.count(label) > 1:
                raise ValueError(
                    f"plate {number}: the label {short(label)!r} of a channel is "
                    f"{'that of another one too' if label else 'empty'}; rename it"
                )
        plates.append(DescribedPlate(number, labels, plate.place.turned(to_lab)))
    described = {plate.number for plate in plates}
    plates += [plate for plate in _dflow_plates(all_labels) if plate.number not in described]
    return (*plates, *(DescribedPlate(number, problem=why) for number, why in left_out.items()))


def _dflow_plates(labels: Sequence[str]) -> Iterator[DescribedPlate]:
    """Find plates all of whose channels are named as D-Flow names them."""
    for number in dict.fromkeys(m[1] for m in map(DFLOW_PLATE.fullmatch, labels) if m):
        six = tuple(f"FP{number}.{quantity}{axis}" for quantity in ("For", "Mom") for axis in AXES)
        if all(labels.count(label) == 1 for label in six):
            place = Plate.at_origin(int(number), np.empty(0), np.empty((0, 6)))
            yield DescribedPlate(str(int(number)), six, place)


def require_same(
    sender: str,
    described: Mapping[str, tuple[object, object]],
    before: Sequence[DescribedPlate],
    after: Sequence[DescribedPlate],
) -> None:
    """Refuse a sender that came back and describes something or its plates otherwise than before.

    Examples
    --------
    >>> require_same("stream 'Plates'", {"rate": (1000.0, 500.0)}, (), ())
    Traceback (most recent call last):
    ValueError: stream 'Plates' came back with another rate; begin a new session
    """
    different = [what for what, (old, new) in described.items() if old != new]
    if len(before) != len(after) or not all(map(_same_plate, before, after)):
        different.append("description of its plates")
    if different:
        raise ValueError(f"{sender} came back with another {different[0]}; begin a new session")


def _same_plate(before: DescribedPlate, after: DescribedPlate) -> bool:
    named = (before.number, before.channels) == (after.number, after.channels)
    places = (before.place, after.place)
    old, new = (np.vstack([p.corners, p.rotation, p.center]) if p else np.empty(0) for p in places)
    # a place that is written anew differs by rounding alone
    same = old.shape == new.shape and np.allclose(old, new, rtol=0, atol=1e-6, equal_nan=True)
    return named and same
