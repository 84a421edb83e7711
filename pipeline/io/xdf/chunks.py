"""The chunks of an XDF file: its streams' samples on one clock, and whether it is whole.

The format is that of https://github.com/sccn/xdf/wiki/Specifications; pyxdf reads samples and
brings their time stamps onto the recorder's clock.
"""

import io
import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np
import pyxdf

from hbm.spatial import Array
from hbm.spelling import printable, short
from pipeline.io.xdf.channels import parse_xml

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
