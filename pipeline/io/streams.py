"""Streams of samples, as XDF holds and Lab Streaming Layer sends them: channels, plates, clocks.

The conventions are those of XDF's meta-data (https://github.com/sccn/xdf/wiki), which Lab Streaming
Layer shares. Samples have a constant rate, but their time stamps scatter, and some are missing.
"""

import re
from bisect import bisect_right
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import scipy

from hbm.numbers import read_numbers
from hbm.spatial import Array, Indices, Mask
from hbm.spelling import listed, printable, short
from pipeline.io.labels import AGAIN, rename_markers, require_unique, without_prefixes
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Fact, FactKind, Plate
from pipeline.io.units import force_in_n, moment_in_nm

POSITION: Final = re.compile(r"Position([XYZ])", re.IGNORECASE)
"""Type of a channel that holds a coordinate of a position."""
COORDINATE: Final = re.compile(r"(.+?)[._ -](?:Pos)?([XYZ])", re.IGNORECASE)
"""Label of a marker's channel, such as LASIS_X or LASIS.PosX."""
AXES: Final = "XYZ"
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "streams")


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel; what its description does not state is empty.

    Attributes
    ----------
    label, unit
        As the sender writes them.
    type
        What it holds, such as "PositionX".
    marker, plate
        The marker or the number of the plate that it is of.
    """

    label: str
    unit: str = ""
    type: str = ""
    marker: str = ""
    plate: str = ""


def parse_xml(text: str) -> Element:
    """Parse what a stream says of itself, with "?" in place of control characters; a ValueError."""
    # characters that XML may not hold, as they are or by their number
    control = (
        r"[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]"
        r"|&#(0*([0-8]|1[124-9]|2\d|3[01])|x0*([0-8bcef]|1[\da-f]));"
    )
    try:
        return ElementTree.fromstring(re.sub(control, "?", text, flags=re.IGNORECASE))
    except ElementTree.ParseError as error:
        raise ValueError(f"its description is no XML: {error}; correct it in the sender") from error


def text_of(element: Element, path: str) -> str:
    """Give the text of a part of an element, printable; empty where it is absent."""
    return printable((element.findtext(path) or "").strip())


PARTS: Final = ("label", "unit", "type", "marker", "plate")
"""What a description states of a channel."""


def parse_channels(info: Element, count: int) -> tuple[Channel, ...]:
    """Give the channels of a stream.

    Parameters
    ----------
    info
        The stream's description, whose root is ``info``.
    count
        How many channels it sends.

    Returns
    -------
    tuple of Channel
        One per channel sent; where no channel is described, their labels are numbers from 1.

    Raises
    ------
    ValueError
        Another number of channels is described than is sent.

    Examples
    --------
    >>> from xml.etree.ElementTree import fromstring
    >>> channel = "<channel><label>Fz</label><unit>kN</unit></channel>"
    >>> info = fromstring(f"<info><desc><channels>{channel}</channels></desc></info>")
    >>> parse_channels(info, 1)
    (Channel(label='Fz', unit='kN', type='', marker='', plate=''),)
    """
    described = info.findall("desc/channels/channel")
    if not described:
        return tuple(Channel(str(number)) for number in range(1, count + 1))
    if len(described) != count:
        raise ValueError(f"it describes {len(described)} channels, but sends {count}")
    return tuple(Channel(*(text_of(channel, part) for part in PARTS)) for channel in described)


def has_markers(content_type: str, channels: Sequence[Channel]) -> bool:
    """Whether a stream holds positions of markers, by its content type or its channels' types."""
    labelled = any(COORDINATE.fullmatch(channel.label) for channel in channels)
    typed = any(POSITION.fullmatch(channel.type) for channel in channels)
    return typed or (labelled and content_type.lower() == "mocap")


def marker_channels(channels: Sequence[Channel]) -> tuple[list[str], Indices, str]:
    """Find the coordinates of markers among the channels of a stream.

    Parameters
    ----------
    channels
        Of the stream.

    Returns
    -------
    labels
        Of the M markers in the order of the channels, with `AGAIN` where one occurs again.
    columns
        Of x, y and z of each, (M, 3).
    unit
        As the sender writes it.

    Raises
    ------
    ValueError
        There are no such channels, a coordinate is absent, or units differ.

    Notes
    -----
    Channels of type PositionX, PositionY and PositionZ belong to the marker that they name, or that
    their label names; where no type is stated, labels such as LASIS_X and LASIS.PosX count.
    Positions of rigid bodies do not count where markers are named.
    """
    typed = any(POSITION.fullmatch(channel.type) for channel in channels)
    named = any(channel.marker for channel in channels)
    column_of: dict[tuple[str, str], int] = {}
    for k, channel in enumerate(channels):
        label = COORDINATE.fullmatch(channel.label)
        axis_of = POSITION.fullmatch(channel.type) if typed else label
        if axis_of is None or (typed and named and not channel.marker):
            continue
        stem = channel.marker or (label[1] if label else channel.label)
        axis = axis_of[axis_of.re.groups].upper()
        while (stem, axis) in column_of:
            stem += AGAIN
        column_of[stem, axis] = k
    if not column_of:
        raise ValueError(
            "no markers: no channel of type PositionX and no label such as LASIS_X; labels there: "
            f"{listed([channel.label for channel in channels][:5])}"
        )
    stems = list(dict.fromkeys(stem for stem, _ in column_of))
    for stem, axis in ((stem, axis) for stem in stems for axis in AXES):
        if (stem, axis) not in column_of:
            several = "several channels, but one" if stem.endswith(AGAIN) else "no channel"
            raise ValueError(f"marker {short(stem.rstrip(AGAIN))!r} has {several} for {axis}")
    units = dict.fromkeys(channels[k].unit for k in column_of.values())
    if len(units) > 1:
        raise ValueError(f"the markers' channels have several units: {listed(units)}")
    columns = np.array([[column_of[stem, axis] for axis in AXES] for stem in stems])
    return stems, columns, next(iter(units))


def marker_layout(
    channels: Sequence[Channel], options: ReadOptions
) -> tuple[tuple[str, ...], Callable[[Array], Array]]:
    """Give the markers wanted of a stream whose samples are still to come.

    Also give what turns samples of all channels, (N, K), to positions, (N, M, 3) [m]. A marker at
    exactly the origin was not seen, as most programs write it; it becomes NaN. A ValueError as
    `marker_channels`, `ReadOptions.metre` and those of `pipeline.io.labels`.
    """
    labels, columns, unit = marker_channels(channels)
    bare, _ = without_prefixes([label.rstrip(AGAIN) for label in labels], options)
    require_unique(bare.values(), "several markers have the same label")
    markers, *_ = rename_markers({label: k for k, label in bare.items()}, options)
    coordinates, metre = columns[[*markers.values()]], options.metre(unit)

    def positions(values: Array) -> Array:
        position = np.take(values, coordinates, axis=1) * metre
        position[~position.any(axis=-1)] = np.nan
        return position

    return tuple(markers), positions


def si_units(channels: Sequence[Channel]) -> tuple[tuple[str, ...], Array]:
    """Give the channels' units with forces in N and moments in N·m, and the factors to them, (K,).

    Examples
    --------
    >>> units, factors = si_units([Channel("Fz", "kN"), Channel("Mx", "Nmm"), Channel("A", "V")])
    >>> units, factors.tolist()
    (('N', 'N·m', 'V'), [1000.0, 0.001, 1.0])
    """
    converted = [_si_unit(channel.unit) for channel in channels]
    return tuple(unit for unit, _ in converted), np.array([factor for _, factor in converted])


def _si_unit(unit: str) -> tuple[str, float]:
    for si, convert in (("N", force_in_n), ("N·m", moment_in_nm)):
        with suppress(ValueError):
            return si, convert(unit)
    return unit, 1.0


COMPONENTS: Final = ("ForceX", "ForceY", "ForceZ", "MomentX", "MomentY", "MomentZ")
"""Types of a plate's channels: action on the subject about the centre of its surface."""
PLACE: Final = {"corners": (4, 3), "rotation": (3, 3), "center": (3,)}
"""What a description states of a plate's place, in the axes of the markers [m] -> its shape."""


@dataclass(frozen=True, slots=True)
class PlateChannels:
    """One plate: where its channels are and where it lies.

    Attributes
    ----------
    place
        The plate without samples, in the axes of the markers.
    columns
        Of Fx Fy Fz Mx My Mz in the plate's axes, (6,).
    factors
        One of their units in N and N·m, (6,).
    """

    place: Plate
    columns: tuple[int, ...]
    factors: Array

    def plate(self, time: Array, values: Array) -> Plate:
        """Make the plate from samples of all channels, (N, K), in the axes of the markers."""
        wrench = values[:, list(self.columns)] * self.factors
        return replace(self.place, time=time, wrench_in_plate=wrench)


def find_plates(
    info: Element, channels: Sequence[Channel]
) -> tuple[list[PlateChannels], dict[str, str]]:
    """Find the plates of a stream whose six channels and place are described.

    Parameters
    ----------
    info
        The stream's description.
    channels
        Its channels; those of a plate have its number and one of the types ``COMPONENTS``.

    Returns
    -------
    plates
        Those that are complete.
    left_out
        Number of each of the others, as it is written -> why.
    """
    columns_of: dict[str, list[int]] = {}
    for k, channel in enumerate(channels):
        if channel.plate and channel.type in COMPONENTS:
            columns_of.setdefault(channel.plate, []).append(k)
    plates, left_out = [], {}
    for number, columns in columns_of.items():
        columns.sort(key=lambda k: COMPONENTS.index(channels[k].type))
        elements = info.findall("desc/plates/plate")
        elements = [element for element in elements if text_of(element, "number") == number]
        try:
            if not number.isdecimal():
                raise ValueError("its number is no number")
            if len(elements) != 1:
                raise ValueError(f"the stream has {len(elements)} places of it, expected 1")
            for component in COMPONENTS:
                of_it = [str(k + 1) for k in columns if channels[k].type == component]
                if len(of_it) != 1:
                    there = listed(of_it) or "none"
                    raise ValueError(f"its channels of type {component}: {there}, expected one")
            units, factors = si_units([channels[k] for k in columns])
            if units != ("N",) * 3 + ("N·m",) * 3:
                raise ValueError(f"its units are {listed(units)}, expected N and N·m")
            place = _place(int(number), elements[0])
            plates.append(PlateChannels(place, tuple(columns), factors))
        except ValueError as error:
            left_out[number] = str(error)
    return plates, left_out


def _place(number: int, described: Element) -> Plate:
    """Give a plate without samples by its corners, rotation and centre."""
    numbers = []
    for part, shape in PLACE.items():
        words = (described.findtext(part) or "").split()
        try:
            numbers.append(np.array(words, float).reshape(shape))
        except ValueError:
            raise ValueError(f"its {part} are not {np.prod(shape)} numbers") from None
    corners, rotation, center = numbers
    finite = np.isfinite([*rotation.flat, *center]).all()
    if not finite or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise ValueError("its rotation is no rotation, or its center is not finite")
    return Plate(number, np.empty(0), np.empty((0, 6)), rotation, center, corners)


MIN_STEP_S: Final = 1e-9
"""Time stamps that differ by less do not advance."""


@dataclass(frozen=True, slots=True)
class Clock:
    """Which frame each sample is, and when.

    Attributes
    ----------
    index
        Frame of each sample, from 0, increasing, (N,).
    rate_hz, start_s
        Frame k is at ``start_s + k / rate_hz``.
    scatter_s
        Standard deviation of the time stamps about that.
    samples
        Which of the samples these are, in the order of their frames, (N,).
    facts
        What became of the others, and whether the rate is in doubt.
    """

    index: Indices
    rate_hz: float
    start_s: float
    scatter_s: float
    samples: Indices
    facts: Sequence[Fact]

    @property
    def frames(self) -> int:
        """Number of frames, dropped ones included."""
        return int(self.index[-1]) + 1

    @property
    def time(self) -> Array:
        """Times of all frames, (frames,) [s]."""
        return self.start_s + np.arange(self.frames) / self.rate_hz

    def on_frames(self, values: Array) -> Array:
        """Give samples as they came, at every frame, (frames, K); NaN where one was dropped."""
        held = np.full((self.frames, values.shape[1]), np.nan)
        held[self.index] = values[self.samples]
        return held

    def on_most_frames(self, values: Array) -> Array:
        """Give signals at every frame too, but over short losses interpolated."""
        time, values = self.index / self.rate_hz, values[self.samples]
        time, values = over_short_losses(time, values, self.rate_hz)
        frames = np.rint(time * self.rate_hz).astype(int)
        return replace(self, index=frames, samples=np.arange(len(frames))).on_frames(values)


def over_short_losses(time: Array, values: Array, rate_hz: float) -> tuple[Array, Array]:
    """Put interpolated samples, (N,) [s] and (N, K), where a few were lost.

    Examples
    --------
    >>> time = np.array([0.0, 0.01, 0.03, 0.04, 0.09])
    >>> time, values = over_short_losses(time, 2 * time[:, None], 100.0)
    >>> time.round(3).tolist(), values[2].round(3).item()
    ([0.0, 0.01, 0.02, 0.03, 0.04, 0.09], 0.04)
    """
    steps = np.rint(np.diff(time) * rate_hz).astype(int)
    if steps.max(initial=0) <= 1:
        return time, values
    # how many samples are put in after each: none where the loss is long
    lost = np.where(steps <= max(LIMITS.longest_loss * rate_hz, 2), steps - 1, 0).clip(0)
    before = np.repeat(np.arange(len(lost)), lost)
    number = 1 + np.arange(len(before)) - np.searchsorted(before, before)
    # along the straight line from the sample before the loss to that after it
    part = (number / steps[before])[:, None]
    both = np.column_stack([time, values])
    between = (1 - part) * both[before] + part * both[before + 1]
    filled = np.insert(both, before + 1, between, axis=0)
    return filled[:, 0], filled[:, 1:]


def find_clock(
    stamps: Array, nominal_hz: float, values: Array | None = None, of: str = "the stream"
) -> Clock:
    r"""Find the constant rate of samples, and which are missing, from their time stamps.

    Parameters
    ----------
    stamps
        As they came, (N,) [s], N ≥ 2.
    nominal_hz
        The rate that the sender states; 0 where it states none.
    values
        The samples, (N, K), by which repeated ones are recognised.
    of
        What facts are about.

    Returns
    -------
    Clock
        The rate is that of a straight line through the stamps of the samples that count.

    Raises
    ------
    ValueError
        The stamps do not advance, scatter over many frames, or most frames are missing.

    Notes
    -----
    Before a rate is fitted, samples that came late are put in order, and repeated ones and those on
    another clock are left out. A stamp may be late, but not early: of the stamps of a quarter of a
    second some are on time. Where even these come later by a whole number of frames, and stay so,
    frames were dropped. A sample whose stamp contradicts its place, and fills no gap, is left out.

    Examples
    --------
    Ten seconds at 100 Hz, of which the frames 300 to 304 are missing, and one is sent twice:

    >>> import numpy as np
    >>> frames = np.insert(np.delete(np.arange(1000), slice(300, 305)), 500, 504)
    >>> clock = find_clock(7.0 + frames / 100, 100.0, frames[:, None])
    >>> clock.frames, round(clock.rate_hz, 6), bool(np.all(clock.index == np.unique(frames)))
    (1000, 100.0, True)
    >>> print(*clock.facts, sep="\n")
    the stream: joined: 1 of 996 samples came again
    the stream: missing: 5 of 1000 samples
    """
    stamps = np.asarray(stamps, float)
    different = np.arange(len(stamps), dtype=float)[:, None]
    samples, stamps, reasons = _settle(stamps, different if values is None else values, nominal_hz)
    index = _find_frames(stamps, _period(stamps, nominal_hz), nominal_hz)
    if index[-1] + 1 > LIMITS.largest_dropped_ratio * len(stamps):
        raise ValueError(f"its times span {index[-1] + 1} frames, but it holds {len(stamps)}")
    # time = start + index / rate, by least squares
    slope = _slope(stamps, index)
    residual = stamps - index * slope
    scatter = float(np.std(residual))
    if scatter > LIMITS.largest_scatter * slope:
        raise ValueError(f"its time stamps scatter by {scatter:.3g} s about a constant rate")
    if nominal_hz and abs(1 / slope / nominal_hz - 1) > LIMITS.largest_rate_difference:
        doubt = f"its time stamps show {1 / slope:.4g} Hz, its description {nominal_hz:.4g} Hz"
        reasons.append(("in_doubt", f"{doubt}; check its sender"))
    if lost := int(index[-1]) + 1 - len(index):
        reasons.append(("missing", f"{lost} of {index[-1] + 1} samples"))
    facts = tuple(Fact(kind, of, reason) for kind, reason in reasons)
    return Clock(index, 1 / slope, float(np.median(residual)), scatter, samples, facts)


@dataclass(slots=True, eq=False)
class Remembered:
    """Samples that came, so that one that comes again is recognised."""

    newer: set[int] = field(default_factory=set)
    older: set[int] = field(default_factory=set)

    def again(self, stamp: float, value: Array, most: float = np.inf) -> bool:
        """Whether stamp and values came before, among so many samples at least; remember them."""
        sample = hash((stamp, value.tobytes()))
        if sample in self.newer or sample in self.older:
            return True
        self.newer.add(sample)
        if len(self.newer) > most:
            self.newer, self.older = set(), self.newer
        return False


def _settle(
    stamps: Array, values: Array, nominal_hz: float
) -> tuple[Indices, Array, list[tuple[FactKind, str]]]:
    """Give which samples count, in order, (M,), their time stamps [s], and what became of others.

    Most samples advance; late ones fill a gap of these, others are on another clock.
    """
    count, steps = len(stamps), np.diff(stamps)
    if not (steps > MIN_STEP_S).any():
        raise ValueError("its time stamps do not advance")
    # in frames: where every sample is later than the one before, all count
    steps *= nominal_hz or 1 / float(np.median(steps[steps > MIN_STEP_S]))
    if ((steps > 0.5) & (steps < count)).all():
        return np.arange(count), stamps, []
    again = np.array(list(map(Remembered().again, stamps.tolist(), values)))
    period = 1 / nominal_hz if nominal_hz else _period(np.sort(stamps[~again]), 0.0)
    repeated = _repeated(stamps, values, again, period)
    there = np.flatnonzero(~repeated)
    # the longest series that advances is the clock, to which the others are compared
    times = _in_order(stamps[there], period)
    advancing = _longest_advance(times)
    period = _period(times[advancing], nominal_hz)
    # a step over more frames than there are samples is to another clock
    far = np.diff(times[advancing]) > count * period
    pieces = np.split(advancing, 1 + np.flatnonzero(far))
    if 2 * len(longest := max(pieces, key=len)) > len(there):
        advancing = longest
    time, k = times[advancing], np.arange(len(there))
    # by how much each is off the time that its place in the file shows, also beyond the series
    beyond = np.minimum(k - advancing[0], 0) + np.maximum(k - advancing[-1], 0)
    off_s = times - np.interp(k, advancing, time) - beyond * period
    # a sample that is off by little came late: it belongs where the series has a gap
    gap_s = np.diff(time, prepend=-np.inf, append=np.inf)[np.searchsorted(time, times, "right")]
    strange = (np.abs(off_s) > LIMITS.out_of_order) | (gap_s < LIMITS.longest_step * period)
    strange[advancing] = False
    frames = np.diff(time) / period
    first = np.append(True, frames >= LIMITS.same_time)
    is_clear = np.median(np.abs(frames - np.rint(frames))) < LIMITS.clear_steps
    if is_clear and np.mean(~first) < LIMITS.most_at_same_time:
        # those of a chunk fill the frames that are missing before their time
        before = np.diff(time[first], prepend=time[0])[np.cumsum(first) - 1]
        chunk = (before > LIMITS.longest_step * period) & (before < LIMITS.burst)
        strange[advancing[~first & ~chunk]] = True
    if 2 * np.count_nonzero(strange) >= len(there):
        raise ValueError(
            f"time stamps of {np.count_nonzero(strange)} of its {count} samples contradict the "
            "others, so that it has no clock; correct its sender and record again"
        )
    kept = np.flatnonzero(~strange)
    kept = kept[np.argsort(times[kept], kind="stable")]
    late = kept[:-1] > np.minimum.accumulate(kept[:0:-1])[::-1]  # a later one came before
    counted: list[tuple[FactKind, int, str]] = [
        ("joined", int(repeated.sum()), "samples came again"),
        ("corrected", int(late.sum()), "samples came late, put in order"),
    ]
    reasons = [(kind, f"{number} of {count} {what}") for kind, number, what in counted if number]
    if strange.any():
        seconds = times - off_s - times[kept[0]]
        left_out = np.flatnonzero(strange)
        blocks = np.split(left_out, 1 + np.flatnonzero(np.diff(left_out) > 1))
        places = listed((f"{seconds[b[0]]:.2f} to {seconds[b[-1]]:.2f} s" for b in blocks), 3)
        same = "with the time stamp of another, but other values"
        off = f"with time stamps {by_s:+.6g} s off" if (by_s := np.median(off_s[strange])) else same
        reasons.append(("left_out", f"{len(left_out)} of {count} samples, {places}, {off}"))
    return there[kept], times[kept], reasons


def _repeated(stamps: Array, values: Array, again: Mask, period: float) -> Mask:
    """Find samples, (N,), that came before; equal ones of a chunk with one stamp did not."""
    # a chunk has one stamp: it came again if its first sample did
    begins = np.append(True, np.diff(stamps) != 0)
    repeated = again & again[begins][np.cumsum(begins) - 1]
    order = np.flatnonzero(~repeated)
    order = order[np.argsort(stamps[order], kind="stable")]
    stamps, values, again = stamps[order], values[order], again[order]
    same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    alike = np.append(False, same.all(axis=1))
    frames = np.diff(stamps, prepend=stamps[0]) / period
    is_clear = np.median(np.abs(frames - np.rint(frames))) < LIMITS.clear_steps
    candidate = again | (is_clear & alike & (frames < 0.5))
    # those of a chunk fill the frames that are missing without them
    others = stamps[~candidate]
    gap = np.diff(others, append=others[-1])[np.cumsum(~candidate)[candidate] - 1]
    filling = np.count_nonzero(gap > LIMITS.longest_step * period)
    if filling < LIMITS.fewest_filling or 2 * filling <= len(gap):
        repeated[order[candidate]] = True
    return np.asarray(repeated)


def _in_order(stamps: Array, period: float) -> Array:
    """Give times of samples, (N,) [s]: stamps, or that of the newest where they only jitter.

    Stamps that are whole frames behind show the order, else only those that are behind by more.
    """
    width = max(1, round(LIMITS.burst / period))
    newest = scipy.ndimage.maximum_filter1d(stamps, width, mode="nearest", origin=(width - 1) // 2)
    behind = (newest - stamps) / period
    late = behind[(behind > 0.5) & (behind < width)]
    jitter = 0.5
    # stamps between whole frames jitter: three times what four of five are behind by
    if len(late) and np.median(np.abs(late - np.rint(late))) > LIMITS.clear_steps:
        jitter = np.clip(3 * np.quantile(behind, 0.8), 2, width)
    return np.asarray(np.where(behind <= jitter, newest, stamps))


def _longest_advance(times: Array) -> Indices:
    """Give the places of the longest series of times that never go back, (M,), of (N,) [s]."""
    # of the series of each length that ends first; the place before each in its series
    ends, at, before = list[float](), list[int](), list[int]()
    for k, time in enumerate(times.tolist()):
        length = bisect_right(ends, time)
        ends[length : length + 1], at[length : length + 1] = [time], [k]
        before.append(at[length - 1] if length else -1)
    series = at[-1:]
    while (k := before[series[-1]]) >= 0:
        series.append(k)
    if len(series) < 2:
        raise ValueError("its time stamps do not advance")
    return np.array(series[::-1])


def lost_before(stamps: Array, nominal_hz: float) -> Indices:
    """Give how many samples are lost before each, (N,), as `find_clock` judges.

    Time stamps increase. A rate of less than two thirds of the nominal one is a loss too.

    Examples
    --------
    >>> lost_before(np.array([0.0, 0.01, 0.02, 0.05, 0.06]), 100.0).tolist()
    [0, 0, 0, 2, 2]
    """
    if len(stamps) < 2:
        return np.zeros(len(stamps), np.intp)
    period = _period(stamps, nominal_hz)
    period = period if period * nominal_hz < LIMITS.longest_step else 1 / nominal_hz
    return _find_frames(stamps, period, nominal_hz) - np.arange(len(stamps))


def _find_frames(stamps: Array, period: float, nominal_hz: float) -> Indices:
    """Give the frame of each sample, (N,), from time stamps and about the time per frame [s].

    Where stamps scatter by less than half a frame, each step of their lag counts by itself, at
    whatever rate; else the lag counts as a whole, at the nominal rate, so that steps that jitter
    makes cancel. Of both that one is taken that leaves less scatter with fewer steps.
    """
    steady = max(period / 2, _slope(stamps, _frames(_lag(stamps, period))))
    whole = np.rint(_lag(stamps, 1 / (nominal_hz or 1 / steady)))
    whole = np.minimum.accumulate(whole[::-1])[::-1]  # what stays
    return min(_frames(_lag(stamps, steady)), _frames(whole), key=lambda k: _cost(stamps, k))


def _frames(lag: Array) -> Indices:
    """Give the frame of each sample, (N,), from its lag [frames]: where it steps up, some drop."""
    dropped = np.clip(np.rint(np.diff(lag)), 0, 10**9).astype(int)  # as a whole number can hold
    return np.asarray(np.concatenate([[0], np.cumsum(1 + dropped)]), np.intp)


def _lag(stamps: Array, period: float) -> Array:
    """Give by how many frames the samples that are on time lag behind the first, (N,).

    At the end, where few follow, only what exceeds the usual scatter counts.
    """
    count = len(stamps)
    window = max(2, round(min(LIMITS.burst / period, count)))
    lag = (stamps - stamps[0]) / period - np.arange(count)
    # stamps may be late, but not early: the least lag of those that follow is that of the clock
    on_time = scipy.ndimage.minimum_filter1d(lag, window, mode="nearest", origin=-(window // 2))
    if (last := count - window) > 0:
        usual = on_time[last] + np.max(lag[:last] - on_time[:last])
        on_time[last:] = np.where(on_time[last:] < usual, on_time[last], on_time[last:])
    return np.asarray(on_time - on_time[0])


def _cost(stamps: Array, index: Indices) -> float:
    """Give Bayes' information criterion of a straight line with steps, halved, per sample."""
    scatter = np.std(stamps / _slope(stamps, index) - index) + 0.01  # less says nothing more
    return float(np.log(scatter) + np.mean(np.diff(index) > 1) * np.log(len(index)) / 2)


def _slope(stamps: Array, index: Indices) -> float:
    """Give the time per frame by a straight line through all time stamps [s]."""
    offset = index - index.mean()
    return float(offset @ (stamps - stamps.mean()) / (offset @ offset))


def _period(stamps: Array, nominal_hz: float) -> float:
    """Give the time per frame [s]: of clear steps, else the nominal one where stamps agree."""
    count = len(stamps)
    # over many frames at once, in which the jitter of two stamps counts little
    step = max(1, min(round(LIMITS.burst * (nominal_hz or 100.0)), count // 4))
    usual = float(np.median(stamps[step:] - stamps[:-step])) / step
    mean = float(stamps[-1] - stamps[0]) / (count - 1)
    if min(mean, usual) < MIN_STEP_S:
        raise ValueError("its time stamps do not advance")
    steps, single = np.diff(stamps), 1 / (nominal_hz or 1 / usual)
    for _ in range(5):  # until it is the mean of the steps about it, from one frame to the next
        about = steps[np.abs(steps / single - 1) < 0.5]
        single = float(about.mean()) if len(about) else single
    # where single frames are lost, or chunks sent, few steps are from one frame to the next
    if min(usual, mean) < LIMITS.longest_step * single and 2 * len(about) > len(steps):
        return single
    off = (abs(period * nominal_hz - 1) for period in (usual, mean))
    return 1 / nominal_hz if min(off) < LIMITS.largest_rate_difference else min(usual, mean)
