"""Streams of samples into one XDF file, appended as they come."""

import struct
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from pipeline.live.stream import Samples

MAGIC: Final = b"XDF:"
FILE_HEADER, STREAM_HEADER, SAMPLES, BOUNDARY, STREAM_FOOTER = 1, 2, 3, 5, 6
"""Tags of chunks."""
BOUNDARY_MARK: Final = bytes.fromhex("43a546dccbf5410fb30ed5467383cbe4")
BOUNDARY_SAMPLES: Final = 10_000
"""Between marks by which readers find the next chunk of a damaged file."""
BYTES_OF_COUNT: Final = b"\x04"
BYTES_OF_STAMP: Final = 8


class XdfWriter:
    """An XDF file that grows with every call, and is complete up to the last one if it is killed.

    Parameters
    ----------
    path
        The file; an existing one is not overwritten.
    descriptions
        One per stream: an ``info`` element with ``name``, ``type``, ``channel_count``,
        ``nominal_srate`` and ``desc``, as streams of Lab Streaming Layer have it.

    Raises
    ------
    OSError
        If it exists or cannot be written.

    Notes
    -----
    The format is that of https://github.com/sccn/xdf/wiki/Specifications. Numbers are written as
    doubles, so that nothing is rounded, and each sample with its own time stamp. All stamps are on
    one clock already, so that there are no clock offsets.
    """

    def __init__(self, path: Path, descriptions: Sequence[Element]) -> None:
        self._numbers: dict[str, int] = {}
        self._counts: list[int] = []
        self._since_boundary = 0
        self._file = path.open("xb")
        self._file.write(MAGIC)
        version = Element("info")
        SubElement(version, "version").text = "1.0"
        self._chunk(FILE_HEADER, tostring(version))
        for number, info in enumerate(descriptions, start=1):
            self._numbers[info.findtext("name", "")] = number
            self._counts.append(0)
            self._chunk(STREAM_HEADER, struct.pack("<I", number) + tostring(info, "utf-8"))
        self._file.flush()

    def write(self, samples: Samples) -> None:
        """Append samples of one stream.

        Raises
        ------
        OSError
            If the disk is full; the file is then closed, and holds what was written before.
        """
        count, channels = samples.values.shape
        if not count:
            return
        number = self._numbers[samples.stream]
        rows = np.empty(
            count,
            dtype=np.dtype([("bytes", "u1"), ("stamp", "<f8"), ("values", "<f8", (channels,))]),
        )
        rows["bytes"], rows["stamp"], rows["values"] = BYTES_OF_STAMP, samples.time, samples.values
        head = struct.pack("<I", number) + BYTES_OF_COUNT + struct.pack("<I", count)
        self._counts[number - 1] += count
        self._since_boundary += count
        try:
            self._chunk(SAMPLES, head + rows.tobytes())
            if self._since_boundary >= BOUNDARY_SAMPLES:
                self._chunk(BOUNDARY, BOUNDARY_MARK)
                self._since_boundary = 0
            self._file.flush()
        except OSError:
            with suppress(OSError):
                self._file.close()
            raise

    def close(self) -> None:
        """Write how many samples each stream has, which tells that the file is complete."""
        if self._file.closed:
            return
        with self._file:
            for number, count in enumerate(self._counts, start=1):
                footer = Element("info")
                SubElement(footer, "sample_count").text = str(count)
                self._chunk(STREAM_FOOTER, struct.pack("<I", number) + tostring(footer))

    def _chunk(self, tag: int, content: bytes) -> None:
        body = struct.pack("<H", tag) + content
        self._file.write(BYTES_OF_COUNT + struct.pack("<I", len(body)) + body)
