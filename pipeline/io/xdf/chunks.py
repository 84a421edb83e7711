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
from xml.etree import ElementTree

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
TAGS: Final = range(1, 7)
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
    info: ElementTree.Element
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
    loaded = _load(content[:end], list(numbers))
    for k, stream in numbers.items():
        none = np.empty(0), np.empty((0, stream.channels))
        stream.stamps, stream.values = loaded.get(k, none)
        if not (np.abs(stream.stamps) < MAX_TIME_S).all():
            raise ValueError(f"damaged: stream {short(stream.name)!r} has impossible time stamps")
    whole = end == len(content) and all(s.footer is not None for s in streams.values())
    texts = [stream.name for k, stream in streams.items() if k not in numbers]
    return list(numbers.values()), texts, whole


def _walk(content: bytes) -> tuple[dict[int, Stream], int]:
    """Give the streams' headers, and where the last complete chunk ends."""
    headers: dict[int, Stream] = {}
    at = len(MAGIC)
    while at < len(content):
        try:
            length, start = _length(content, at)
            body = content[start : start + length]
            (tag,) = struct.unpack_from("<H", body)
            stream = struct.unpack_from("<I", body, 2)[0] if tag not in OF_NO_STREAM else -1
        except struct.error:
            break
        if tag not in TAGS or length < 2:
            raise ValueError(f"damaged: at byte {at} no chunk begins")
        if start + length > len(content):
            break
        if tag == STREAM_HEADER:
            headers[stream] = _header(body[6:])
        elif tag not in OF_NO_STREAM and stream not in headers:
            raise ValueError(f"damaged: the chunk at byte {at} is of a stream without description")
        elif tag == SAMPLES:
            headers[stream].samples += _count(headers[stream], body[6:], at)
        elif tag == CLOCK_OFFSET and len(body) != 6 + 16:
            raise ValueError(f"damaged: the clock offset at byte {at} has {len(body) - 6} bytes")
        elif tag == STREAM_FOOTER:
            headers[stream].footer = _footer(body[6:])
        at = start + length
    if BOUNDARY in content[at:]:
        raise ValueError(f"damaged: the chunk at byte {at} does not end where the next one begins")
    if not headers:
        raise ValueError("it holds no streams")
    return headers, at


def _length(content: bytes, at: int) -> tuple[int, int]:
    """Give a length and where what it measures begins."""
    size = content[at] if at < len(content) else 0
    if at < len(content) and size not in LENGTHS:
        raise ValueError(f"damaged: at byte {at} no chunk begins")
    (length,) = struct.unpack_from(LENGTHS.get(size, "<B"), content, at + 1)
    return length, at + 1 + size


def _header(body: bytes) -> Stream:
    info = _xml(body)
    try:
        channels = int(info.findtext("channel_count", ""))
        rate = float(info.findtext("nominal_srate", ""))
    except ValueError as error:
        raise ValueError(f"damaged: the description of a stream: {error}") from error
    kind = info.findtext("channel_format", "").strip()
    if not 0 < channels <= MAX_CHANNELS or not 0 <= rate <= MAX_RATE_HZ:
        raise ValueError(f"damaged: a stream of {channels} channels at {rate:g} Hz")
    if kind not in SAMPLE_BYTES and kind != "string":
        raise ValueError(f"damaged: a stream's samples have the format {short(kind)!r}")
    name, content_type = (printable(info.findtext(tag, "").strip()) for tag in ("name", "type"))
    return Stream(name, content_type, info, rate, channels, kind)


def _footer(body: bytes) -> int | None:
    text = _xml(body).findtext("sample_count")
    return int(text) if text is not None and text.strip().isdecimal() else None


def _xml(body: bytes) -> ElementTree.Element:
    try:
        return parse_xml(body.decode("utf-8", "replace"))
    except ValueError as error:
        raise ValueError(f"damaged: the description of a stream: {error}") from error


def _count(header: Stream, body: bytes, at: int) -> int:
    """Give the number of samples in a chunk, which has to fit the chunk's length."""
    try:
        count, start = _length(body, 0)
    except struct.error:
        count, start = 0, len(body) + 1
    if header.format in SAMPLE_BYTES:
        each = 1 + header.channels * SAMPLE_BYTES[header.format]
        if not 0 <= len(body) - start - count * each <= count * STAMP_BYTES:
            raise ValueError(
                f"damaged: the chunk at byte {at} cannot hold {count} samples of "
                f"{header.channels} channels"
            )
    return count


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
