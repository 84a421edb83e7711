"""XDF files, as LabRecorder writes them from streams of Lab Streaming Layer.

The format is that of https://github.com/sccn/xdf/wiki/Specifications; pyxdf reads samples and
brings their time stamps onto the recorder's clock. Here is found whether a file is whole, which
streams it holds, and what they are.
"""

import io
import logging
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element, tostring

import numpy as np
import pyxdf

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.columns import (
    DFLOW_PLATE,
    PlateColumns,
    dflow_plates,
    file_markers,
    recording_of,
)
from pipeline.io.input_file import open_file
from pipeline.io.labels import require_unique
from pipeline.io.recording import Analog, Fact, Recording
from pipeline.io.stated import Stated, impossible_samples, without_impossible
from pipeline.io.streams import (
    Channel,
    Clock,
    PlateChannels,
    find_clock,
    find_plates,
    has_markers,
    marker_channels,
    parse_channels,
    parse_xml,
    si_units,
)

MAGIC: Final = b"XDF:"
STREAM_HEADER: Final = 2
SAMPLES: Final = 3
CLOCK_OFFSET: Final = 4
STREAM_FOOTER: Final = 6
OF_NO_STREAM: Final = (1, 5)
"""The file's header, and boundaries."""
BOUNDARY: Final = bytes.fromhex("43a546dccbf5410fb30ed5467383cbe4")
"""In chunks that recorders write now and then, so that damage can be told from an end."""
LENGTHS: Final = {1: "<B", 4: "<I", 8: "<Q"}
"""Bytes of a length -> how it is packed."""
SAMPLE_BYTES: Final = {"double64": 8, "float32": 4, "int64": 8, "int32": 4, "int16": 2, "int8": 1}
"""Formats of numbers; streams of text are left out."""
STAMP_BYTES: Final = 8
MAX_RATE_HZ: Final = 1e6
MAX_TIME_S: Final = 1e11
"""Clocks count from the start of a computer, or from 1970."""
MAX_CHANNELS: Final = 100_000


@dataclass(slots=True)
class Stream:
    """One stream, of numbers or of text.

    Attributes
    ----------
    name, content_type
        As the sender states them.
    info
        Its description.
    rate_hz
        Nominal sampling rate [Hz]; 0 where samples come irregularly.
    channels, format
        Number of channels, and the type of their samples.
    samples, footer
        Number of samples in the file, and as counted at its end; None without an end.
    stamps
        Time stamps on the recorder's clock, (N,) [s].
    values
        (N, K).
    described
        What its K channels are.
    """

    name: str
    content_type: str
    info: Element
    rate_hz: float
    channels: int
    format: str
    samples: int = 0
    footer: int | None = None
    stamps: Array = field(default_factory=lambda: np.empty(0))
    values: Array = field(default_factory=lambda: np.empty((0, 0)))
    described: tuple[Channel, ...] = ()


def read_streams(content: bytes) -> tuple[list[Stream], list[str], bool]:
    """Give the streams of an XDF file.

    Parameters
    ----------
    content
        The file's bytes.

    Returns
    -------
    streams
        Those of numbers, in the file's order.
    texts
        Names of the streams of text.
    whole
        Whether the recording was ended and the file is not cut short.

    Raises
    ------
    ValueError
        The file is damaged.
    """
    streams, end = _walk(content)
    numbers = {k: stream for k, stream in streams.items() if stream.format in SAMPLE_BYTES}
    for stream in streams.values():
        if stream.footer is not None and stream.samples < stream.footer:
            raise ValueError(
                f"damaged: stream {short(stream.name)!r} holds {stream.samples} samples, but its "
                f"end counts {stream.footer}"
            )
    for k, (stamps, values) in _load(content[:end], list(numbers)).items():
        if not (np.abs(stamps) < MAX_TIME_S).all():
            raise ValueError(f"damaged: stream {short(numbers[k].name)!r} has impossible times")
        numbers[k].stamps, numbers[k].values = stamps, values
    whole = end == len(content) and all(s.footer is not None for s in streams.values())
    texts = [stream.name for k, stream in streams.items() if k not in numbers]
    return list(numbers.values()), texts, whole


def _walk(content: bytes) -> tuple[dict[int, Stream], int]:
    """Give the streams' headers, and where the last complete chunk ends."""
    streams: dict[int, Stream] = {}
    at = len(MAGIC)
    while at < len(content):
        try:
            length, start = _length(content, at)
            body = content[start : start + length]
            (tag,) = struct.unpack_from("<H", body)
            number = struct.unpack_from("<I", body, 2)[0] if tag not in OF_NO_STREAM else -1
        except struct.error:
            break
        if start + length > len(content):
            break
        try:
            if tag == STREAM_HEADER:
                streams[number] = _header(body[6:])
            elif tag not in OF_NO_STREAM:
                _count(streams[number], tag, body[6:])
        except (ValueError, KeyError, struct.error) as error:
            raise ValueError(f"damaged: the chunk at byte {at}: {short(error, 120)}") from error
        at = start + length
    if BOUNDARY in content[at:]:
        raise ValueError(f"damaged: the chunk at byte {at} does not end where the next one begins")
    if not streams:
        raise ValueError("it holds no streams")
    return streams, at


def _length(content: bytes, at: int) -> tuple[int, int]:
    """Give a length and where what it measures begins."""
    if at >= len(content):
        raise struct.error("it ends")
    size = content[at]
    if size not in LENGTHS:
        raise ValueError(f"damaged: at byte {at} no length begins")
    (length,) = struct.unpack_from(LENGTHS[size], content, at + 1)
    return length, at + 1 + size


def _header(body: bytes) -> Stream:
    info = parse_xml(body.decode("utf-8", "replace"))
    channels = int(info.findtext("channel_count", ""))
    rate = float(info.findtext("nominal_srate", ""))
    kind = info.findtext("channel_format", "").strip()
    if not 0 < channels <= MAX_CHANNELS or not 0 <= rate <= MAX_RATE_HZ:
        raise ValueError(f"a stream of {channels} channels at {rate:g} Hz")
    if kind not in SAMPLE_BYTES and kind != "string":
        raise ValueError(f"a stream's samples have the format {kind!r}")
    name, content_type = (printable(info.findtext(tag, "").strip()) for tag in ("name", "type"))
    values = np.empty((0, channels))
    return Stream(name, content_type, info, rate, channels, kind, values=values)


def _count(stream: Stream, tag: int, body: bytes) -> None:
    """Count the samples of a chunk, which have to fit its length, or read the count at the end."""
    if tag == SAMPLES:
        count, start = _length(body, 0)
        each = 1 + stream.channels * SAMPLE_BYTES.get(stream.format, 0)
        rest = len(body) - start - count * each
        if stream.format in SAMPLE_BYTES and not 0 <= rest <= count * STAMP_BYTES:
            raise ValueError(f"it cannot hold {count} samples of {stream.channels} channels")
        stream.samples += count
    elif tag == CLOCK_OFFSET and len(body) != 2 * STAMP_BYTES:
        raise ValueError(f"a clock offset of {len(body)} bytes")
    elif tag == STREAM_FOOTER:
        text = parse_xml(body.decode("utf-8", "replace")).findtext("sample_count", "").strip()
        stream.footer = int(text) if text.isdecimal() else None
    elif tag not in (CLOCK_OFFSET, STREAM_FOOTER):
        raise ValueError(f"it is of unknown kind {tag}")


def _load(content: bytes, wanted: list[int]) -> dict[int, tuple[Array, Array]]:
    """Give time stamps, on one clock, and values of each stream."""
    if not wanted:
        return {}
    with _messages() as messages, np.errstate(all="ignore"):
        try:
            streams, _ = pyxdf.load_xdf(
                io.BytesIO(content),
                select_streams=wanted,
                synchronize_clocks=True,
                dejitter_timestamps=False,
            )
        except Exception as error:  # whatever it meets in a damaged file
            reason = f"{type(error).__name__}: {error}"
            raise ValueError(f"damaged: pyxdf cannot read it ({short(reason, 80)})") from error
    if messages:
        raise ValueError(f"damaged: pyxdf says: {short(messages[0], 120)}")
    return {
        int(stream["info"]["stream_id"]): (
            np.asarray(stream["time_stamps"], float),
            np.asarray(stream["time_series"], float),
        )
        for stream in streams
    }


@contextmanager
def _messages() -> Iterator[list[str]]:
    """Collect what pyxdf reports as errors, and keep its messages from the terminal."""
    logger = logging.getLogger("pyxdf")
    found: list[str] = []
    handler = logging.Handler(logging.ERROR)
    handler.emit = lambda record: found.append(record.getMessage())  # type: ignore[method-assign]
    propagated = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield found
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagated


SAME_CLOCK_S: Final = 1e-4
"""Streams whose samples are at the same times within it need no interpolation."""


@dataclass(frozen=True, slots=True)
class _Signals:
    """One stream of signals at a constant rate."""

    name: str
    channels: tuple[Channel, ...]
    time: Array
    values: Array
    plates: list[PlateChannels]

    def dflow_plates(self) -> Iterator[PlateColumns | Fact]:
        """Give the plates that are named as D-Flow names them."""
        described = {plate.number for plate in self.plates}
        named = {
            f"FP{int(match[1])}.{match[2]}{match[3]}": k
            for k, channel in enumerate(self.channels)
            if (match := DFLOW_PLATE.fullmatch(channel.label)) and int(match[1]) not in described
        }
        units = {name: self.channels[k].unit for name, k in named.items()}
        return dflow_plates(
            {name: self.values[:, k] for name, k in named.items()}, self.time, units
        )

    @property
    def of_no_plate(self) -> list[int]:
        """Columns of the channels that are no plate's."""
        used = {k for plate in self.plates for k in plate.columns}
        named = (bool(DFLOW_PLATE.fullmatch(channel.label)) for channel in self.channels)
        return [k for k, of_plate in enumerate(named) if k not in used and not of_plate]


def read_xdf(path: Path, stated: Stated) -> Recording:
    """Read an XDF file: one stream of markers, and any of plates and other signals.

    Parameters
    ----------
    path
        The file (.xdf).
    stated
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`. Axes are by default those
        of the markers' stream (``desc/axes``), or inferred.

    Returns
    -------
    Recording
        SI units, lab axes; times start at 0 at the first frame of the markers. All streams are on
        the recorder's clock and at constant rates; samples that were lost are gaps (NaN). Analog
        channels are at the times of the fastest stream that has some.

    Raises
    ------
    ValueError
        The file is damaged, no stream holds markers or several do and none is stated, or the file
        contradicts its units or axes. One line.
    OSError
        The file cannot be opened.

    Notes
    -----
    The stream of markers has the content type MoCap or channels of type PositionX, PositionY and
    PositionZ. Plates are channels of the types ForceX … MomentZ with the plate's number, whose
    stream states their place, or channels that are named as D-Flow names them, such as FP1.ForX,
    about the origin of the markers' axes.
    """
    with open_file(path) as file:
        streams, texts, whole = read_streams(file.read())
    streams, facts = _join_restarted([s for s in streams if len(s.stamps) > 1])
    for s in streams:
        facts += _join_columns(s)
    with_markers = [s for s in streams if has_markers(s.content_type, s.described)]
    regular = [
        s for s in streams if s.rate_hz > 0 or s.name == stated.marker_stream or s in with_markers
    ]
    stream = _of_markers(regular, with_markers, stated.marker_stream, [s.name for s in streams])
    clocks: dict[str, Clock] = {
        s.name: _of(s, find_clock, s.stamps, s.rate_hz, s.values, f"stream {short(s.name)}")
        for s in regular
    }
    clock = clocks[stream.name]
    labels, columns, unit = _of(stream, marker_channels, stream.described)
    values = clock.on_frames(stream.values)
    markers = file_markers(
        labels, unit, lambda kept: values[:, columns[kept]].astype(float), stated
    )
    signals, notes = [], []
    for other in regular:
        steady = clocks[other.name]
        rate = {"rate_hz": steady.rate_hz, "scatter_s": steady.scatter_s}
        notes.append(Note.of("sample_clock", of=f"stream {short(other.name)}", **rate))
        facts += steady.facts
        if other is not stream:
            lost = without_impossible(other.values.T)
            notes += impossible_samples([c.label for c in other.described], lost)
            time, values = steady.time - clock.start_s, steady.on_most_frames(other.values)
            plates, absent = find_plates(other.info, other.described)
            facts += [Fact("left_out", f"plate {short(n)}", why) for n, why in absent.items()]
            signals.append(_Signals(other.name, other.described, time, values, plates))
    analog, interpolated = _analog(signals)
    if left := [s.name for s in streams if s not in regular] + texts:
        notes.append(Note.of("parts_left_out", parts=left))
    if not whole:
        notes.append(Note.of("cut_short", file=path.name, sign="the recorder did not end it"))
    return recording_of(
        path,
        stated,
        markers,
        clock.time - clock.start_s,
        [plate for s in signals for plate in s.dflow_plates()],
        axes=printable((stream.info.findtext("desc/axes") or "").strip()),
        program="the stream's description",
        placed=lambda to_lab: [
            plate.plate(s.time, s.values, to_lab) for s in signals for plate in s.plates
        ],
        analog=analog,
        facts=facts,
        notes=[*notes, *interpolated],
    )


def _join_restarted(streams: Sequence[Stream]) -> tuple[list[Stream], list[Fact]]:
    """Join streams of one name and description that follow each other: their sender was restarted.

    A ValueError names those that differ or overlap. Also find what their channels are.
    """
    joined, facts = dict[str, Stream](), []
    begin_s = min((s.stamps.min() for s in streams), default=0.0)
    for stream in sorted(streams, key=lambda s: float(s.stamps.min())):
        stream.described = _of(stream, parse_channels, stream.info, stream.values.shape[1])
        before = joined.setdefault(stream.name, stream)
        if before is stream:
            continue
        spans = " and ".join(
            f"{s.stamps.min() - begin_s:.2f} to {s.stamps.max() - begin_s:.2f} s"
            for s in (before, stream)
        )
        differ = _description(before) != _description(stream)
        if differ or stream.stamps.min() <= before.stamps.max():
            raise ValueError(
                f"2 streams called {short(stream.name)!r} ({spans}) "
                f"{'are described differently' if differ else 'overlap in time'}; rename one in "
                "its sender, or record only one"
            )
        before.stamps = np.append(before.stamps, stream.stamps)
        before.values = np.vstack([before.values, stream.values])
        of = f"stream {short(stream.name)}"
        facts.append(Fact("joined", of, f"its sender was restarted: {spans}"))
    return [s for s in streams if joined[s.name] is s], facts


def _description(stream: Stream) -> tuple[object, ...]:
    """Give what has to be the same where streams are joined."""
    parts = map(stream.info.find, ("desc/axes", "desc/plates"))
    places = [tostring(part) for part in parts if part is not None]
    return stream.content_type, stream.rate_hz, stream.described, places


def _join_columns(stream: Stream) -> Iterator[Fact]:
    """Join channels of one description that are the same, or never there at the same time."""
    values, kept, first_of = stream.values, list[int](), dict[Channel, int]()
    for k, channel in enumerate(stream.described):
        first = first_of.setdefault(channel, k)
        there = [np.isfinite(values[:, c]) & (values[:, c] != 0) for c in (first, k)]
        alike = np.array_equal(values[:, first], values[:, k], equal_nan=True)
        if first == k or not channel.label or (np.any(there[0] & there[1]) and not alike):
            kept.append(k)
            continue
        values[:, first] = np.where(there[0], values[:, first], values[:, k])
        of = f"stream {short(stream.name)}, channels {first + 1} and {k + 1}"
        why = "are the same" if alike else "are never there at the same time"
        yield Fact("joined", of, f"both are {short(channel.label)}, and {why}")
    stream.values, stream.described = values[:, kept], tuple(stream.described[k] for k in kept)


def _of(stream: Stream, find: Callable[..., Any], *given: Any) -> Any:
    """Find something in a stream; what is wrong is said with its name."""
    try:
        return find(*given)
    except ValueError as error:
        raise ValueError(f"stream {short(stream.name)!r}: {error}") from error


def _of_markers(
    streams: Sequence[Stream], found: Sequence[Stream], wanted: str | None, names: Sequence[str]
) -> Stream:
    """Give the stream that holds the markers: the one of the wanted name, or the only one."""
    there = f"streams there: {listed(map(repr, names))}"
    if wanted is not None:
        found = [s for s in streams if s.name == wanted]
        if not found:
            raise ValueError(
                f"no stream is called {short(wanted)!r} as marker_stream says; {there}"
            )
    if not found:
        raise ValueError(
            "no stream holds markers: none has the content type MoCap or channels of type "
            f"PositionX; {there}"
        )
    if len(found) > 1:
        several = [s.name for s in found]
        raise ValueError(
            f"{len(found)} streams hold markers ({listed(map(repr, several))}): choose one, for "
            f"example --marker-stream {short(several[0])!r}, or marker_stream = "
            f"{short(several[0])!r} in study.toml"
        )
    return found[0]


def _analog(signals: Sequence[_Signals]) -> tuple[Analog | None, list[Note]]:
    """Give all channels that are not a plate's at the times of the fastest stream with some."""
    rest = [(stream, columns) for stream in signals if (columns := stream.of_no_plate)]
    if not rest:
        return None, []
    fastest, _ = max(rest, key=lambda each: (len(each[0].time) - 1) / np.ptp(each[0].time))
    time = fastest.time
    units: list[str] = []
    values, interpolated = [], []
    for stream, columns in rest:
        si, factors = si_units([stream.channels[k] for k in columns])
        own = stream.values[:, columns] * factors
        units += si
        if len(own) != len(time) or np.abs(stream.time - time).max() > SAME_CLOCK_S:
            own = np.stack([np.interp(time, stream.time, c, np.nan, np.nan) for c in own.T], 1)
            interpolated.append(stream.name)
        values.append(own)
    labels = [(stream.name, stream.channels[k].label) for stream, of in rest for k in of]
    counts = Counter(label for _, label in labels)
    names = tuple(
        f"{stream}.{label}" if counts[label] > 1 or label.isdecimal() else label
        for stream, label in labels
    )
    require_unique(names, "several channels have the same label")
    notes = [Note.of("signals_interpolated", signals=interpolated, fastest=short(fastest.name))]
    analog = Analog(time, names, tuple(units), np.hstack(values))
    return analog, notes if interpolated else []
