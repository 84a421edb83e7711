"""XDF files, as LabRecorder writes them from streams of Lab Streaming Layer.

The format is that of https://github.com/sccn/xdf/wiki/Specifications; pyxdf reads samples and
brings their time stamps onto the recorder's clock. Here is found whether a file is whole, which
streams it holds, and what they are.
"""

import io
import logging
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element, tostring

import numpy as np
import pyxdf

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, short
from pipeline.io.columns import DFLOW_PLATE, PlateColumns, dflow_plates, file_markers, recording_of
from pipeline.io.input_file import open_file
from pipeline.io.read_options import ReadOptions, without_impossible
from pipeline.io.recording import Analog, Fact, Plate, Recording, impossible_samples
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
    text_of,
)

MAGIC: Final = b"XDF:"
SAMPLE_BYTES: Final = {"double64": 8, "float32": 4, "int64": 8, "int32": 4, "int16": 2, "int8": 1}
"""Formats of numbers; streams of text are left out."""
STAMP_BYTES: Final = 8
logging.getLogger("pyxdf").addHandler(logging.NullHandler())  # what it drops is counted here


class Tag(IntEnum):
    """Kinds of chunks."""

    FILE_HEADER = 1
    STREAM_HEADER = 2
    SAMPLES = 3
    CLOCK_OFFSET = 4
    BOUNDARY = 5
    STREAM_FOOTER = 6


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
    if not numbers:
        raise ValueError("it holds no streams of numbers")
    try:
        with np.errstate(all="ignore"):
            loaded, _ = pyxdf.load_xdf(
                io.BytesIO(content[:end]), [*numbers], dejitter_timestamps=False
            )
    except Exception as error:  # whatever it meets in a damaged file
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"damaged: pyxdf cannot read it ({short(reason, 80)})") from error
    for part in loaded:
        stream = numbers[int(part["info"]["stream_id"])]
        stream.stamps = np.asarray(part["time_stamps"], float)
        stream.values = np.asarray(part["time_series"], float)
        held, damaged = len(stream.stamps), f"damaged: stream {short(stream.name)!r} has"
        if held < (expected := stream.samples if stream.footer is None else stream.footer):
            raise ValueError(f"{damaged} {held} samples, expected {expected}")
        # clocks count from the start of a computer, or from 1970
        if not (np.abs(stream.stamps) < 1e11).all():
            raise ValueError(f"{damaged} impossible times")
    whole = end == len(content) and all(s.footer is not None for s in streams.values())
    texts = [stream.name for k, stream in streams.items() if k not in numbers]
    return [*numbers.values()], texts, whole


def _walk(content: bytes) -> tuple[dict[int, Stream], int]:
    """Give the streams' headers, and where the last complete chunk ends."""
    streams: dict[int, Stream] = {}
    at = len(MAGIC)
    while at < len(content):
        length, start = _length(content, at)
        if start + length > len(content):
            break
        body = content[start : start + length]
        tag, number = (int.from_bytes(part, "little") for part in (body[:2], body[2:6]))
        try:
            if tag == Tag.STREAM_HEADER:
                streams[number] = _header(body[6:])
            elif tag not in (Tag.FILE_HEADER, Tag.BOUNDARY):  # which are of no stream
                _count(streams[number], tag, body[6:])
        except (ValueError, KeyError) as error:
            raise ValueError(f"damaged: the chunk at byte {at}: {short(error, 120)}") from error
        at = start + length
    # recorders write these bytes now and then, so that damage can be told from an end
    if bytes.fromhex("43a546dccbf5410fb30ed5467383cbe4") in content[at:]:
        raise ValueError(f"damaged: the chunk at byte {at} does not end where the next one begins")
    return streams, at


def _length(content: bytes, at: int) -> tuple[int, int]:
    """Give a length and where what it measures begins."""
    size = int.from_bytes(content[at : at + 1], "little")
    if size not in (1, 4, 8):
        raise ValueError(f"damaged: at byte {at} no length begins")
    return int.from_bytes(content[at + 1 : at + 1 + size], "little"), at + 1 + size


def _header(body: bytes) -> Stream:
    info = parse_xml(body.decode("utf-8", "replace"))
    channels = int(info.findtext("channel_count", ""))
    rate = float(info.findtext("nominal_srate", ""))
    kind = info.findtext("channel_format", "").strip()
    possible = 0 < channels <= 100_000 and 0 <= rate <= 1e6
    if not possible or kind not in (*SAMPLE_BYTES, "string"):
        raise ValueError(f"a stream of {channels} channels of {kind!r} at {rate:g} Hz")
    return Stream(text_of(info, "name"), text_of(info, "type"), info, rate, channels, kind)


def _count(stream: Stream, tag: int, body: bytes) -> None:
    """Count the samples of a chunk, which have to fit its length, or read the count at the end."""
    if tag == Tag.SAMPLES:
        count, start = _length(body, 0)
        size = SAMPLE_BYTES.get(stream.format, 0)
        # a byte of each sample says whether it has a stamp; the rest are stamps
        rest = len(body) - start - count * (1 + stream.channels * size)
        if rest < 0 or (size and rest > count * STAMP_BYTES):
            raise ValueError(f"it cannot hold {count} samples of {stream.channels} channels")
        stream.samples += count
    elif tag == Tag.STREAM_FOOTER:
        text = parse_xml(body.decode("utf-8", "replace")).findtext("sample_count", "").strip()
        stream.footer = int(text) if text.isdecimal() else None
    elif tag != Tag.CLOCK_OFFSET or len(body) != 2 * STAMP_BYTES:
        raise ValueError(f"{len(body)} bytes of kind {tag}")


Signals = tuple[str, list[Channel], Array, Array]
"""Of one stream: its name, channels, times, (N,) [s], and samples, (N, K)."""


def read_xdf(path: Path, options: ReadOptions) -> Recording:
    """Read an XDF file: one stream of markers, and any of plates and other signals.

    Parameters
    ----------
    path
        The file (.xdf).
    options
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
    with_markers = [s for s in streams if has_markers(s.content_type, s.described)]
    stream = _of_markers(streams, with_markers, options.marker_stream)
    regular = [s for s in streams if s.rate_hz > 0 or s is stream or s in with_markers]
    clocks: dict[str, Clock] = {
        s.name: _of(s, find_clock, s.stamps, s.rate_hz, s.values, f"stream {short(s.name)}")
        for s in regular
    }
    clock = clocks[stream.name]
    labels, columns, unit = _of(stream, marker_channels, stream.described)
    values = clock.on_frames(stream.values)
    markers = file_markers(
        labels, unit, lambda kept: values[:, columns[kept]].astype(float), options
    )
    signals, notes = list[Signals](), list[Note]()
    placed, named = list[Plate](), list[PlateColumns | Fact]()
    for other in regular:
        steady = clocks[other.name]
        rate = {"rate_hz": steady.rate_hz, "scatter_s": steady.scatter_s}
        notes.append(Note.of("sample_clock", of=f"stream {short(other.name)}", **rate))
        facts += steady.facts
        if other is stream:
            continue
        channels = other.described
        lost = without_impossible(other.values.T)
        facts += impossible_samples([channel.label for channel in channels], lost)
        time, samples = steady.time - clock.start_s, steady.on_most_frames(other.values)
        plates, absent = find_plates(other.info, channels)
        facts += [
            Fact("left_out", f"plate {short(n)}", why, plate=True) for n, why in absent.items()
        ]
        placed += [plate.plate(time, samples) for plate in plates]
        column_of = _of(other, _columns, channels, plates)
        units = {name: channels[k].unit for name, k in column_of.items()}
        by_name = {name: samples[:, k] for name, k in column_of.items()}
        named.extend(dflow_plates(by_name, time, units))
        if rest := [k for name, k in column_of.items() if not DFLOW_PLATE.fullmatch(name)]:
            signals.append((other.name, [channels[k] for k in rest], time, samples[:, rest]))
    analog, interpolated = _analog(signals)
    if left_out := [s.name for s in streams if s not in regular] + texts:
        notes.append(Note.of("parts_left_out", parts=left_out))
    if not whole:
        notes.append(Note.of("cut_short", file=path.name, sign="the recorder did not end it"))
    return recording_of(
        path,
        options,
        markers,
        clock.time - clock.start_s,
        named,
        axes=text_of(stream.info, "desc/axes"),
        program="the stream's description",
        placed=placed,
        analog=analog,
        notes=[*notes, *interpolated, *facts],
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
                f"2 streams called {short(stream.name)!r} ({spans}) overlap in time or are "
                "described differently; rename one in its sender, or record only one"
            )
        before.stamps = np.append(before.stamps, stream.stamps)
        before.values = np.vstack([before.values, stream.values])
        of = f"stream {short(stream.name)}"
        facts.append(Fact("joined", of, f"its sender was restarted: {spans}"))
    return [s for s in streams if joined[s.name] is s], facts


def _description(stream: Stream) -> tuple[object, ...]:
    """Give what has to be the same where streams are joined."""
    described = [tostring(part) for part in stream.info.findall("desc")]
    return stream.content_type, stream.rate_hz, stream.channels, described


def _columns(channels: Sequence[Channel], plates: Sequence[PlateChannels]) -> dict[str, int]:
    """Give the columns of other channels by their labels, or by the names that D-Flow gives."""
    numbers = {plate.place.number for plate in plates}
    used = {k for plate in plates for k in plate.columns}
    column_of: dict[str, int] = {}
    for k, channel in enumerate(channels):
        match = DFLOW_PLATE.fullmatch(channel.label)
        if k in used or (match and int(match[1]) in numbers):
            continue
        name = f"FP{int(match[1])}.{match[2]}{match[3]}" if match else channel.label
        if column_of.setdefault(name, k) != k:
            both = f"channels {column_of[name] + 1} and {k + 1}"
            raise ValueError(f"{both} have the label {short(name)!r}; rename one in its sender")
    return column_of


def _of(stream: Stream, find: Callable[..., Any], *arguments: Any) -> Any:
    """Find something in a stream; what is wrong is said with its name."""
    try:
        return find(*arguments)
    except ValueError as error:
        raise ValueError(f"stream {short(stream.name)!r}: {error}") from error


def _of_markers(
    streams: Sequence[Stream], with_markers: Sequence[Stream], name: str | None
) -> Stream:
    """Give the stream that holds the markers: the one of the wanted name, or the only one."""
    candidates, fault = with_markers, f"{len(with_markers)} streams hold markers"
    if name is not None:
        candidates = [s for s in streams if s.name == name]
        fault = f"no stream is called {short(name)!r} as marker_stream says"
    elif not candidates:
        fault = "no stream holds markers, of content type MoCap or with channels of type PositionX"
    if len(candidates) != 1:
        names = [repr(short(s.name)) for s in candidates or streams]
        first = next(iter(names), "'NAME'")
        raise ValueError(
            f"{fault}; streams there: {listed(names)}; choose one, for example --marker-stream "
            f"{first}, or marker_stream = {first} in study.toml"
        )
    return candidates[0]


def _analog(signals: Sequence[Signals]) -> tuple[Analog | None, list[Note]]:
    """Give all channels that are not a plate's at the times of the fastest stream with some."""
    if not signals:
        return None, []
    # by its rate, samples less one over the time that they span
    fastest, _, time, _ = max(signals, key=lambda of: (len(of[2]) - 1) / np.ptp(of[2]))
    labels, values, interpolated = [], [], []
    units: list[str] = []
    for name, channels, its_time, samples in signals:
        si, factors = si_units(channels)
        # samples at the same times, but for rounding, need no interpolation
        if len(its_time) != len(time) or np.abs(its_time - time).max() > 1e-4:
            resampled = [np.interp(time, its_time, column, np.nan, np.nan) for column in samples.T]
            samples = np.stack(resampled, axis=1)
            interpolated.append(name)
        labels += [(name, channel.label) for channel in channels]
        units += si
        values.append(samples * factors)
    counts = Counter(label for _, label in labels)
    names = tuple(
        f"{stream}.{label}" if counts[label] > 1 or label.isdecimal() else label
        for stream, label in labels
    )
    notes = [Note.of("signals_interpolated", signals=interpolated, fastest=short(fastest))]
    return Analog(time, names, tuple(units), np.hstack(values)), notes if interpolated else []
