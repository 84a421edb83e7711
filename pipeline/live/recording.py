"""What is received and computed, on disk as it comes."""

import struct
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Final
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hbm.spatial import Array
from pipeline.config.live import Live
from pipeline.io.columns import DFLOW_PLATE
from pipeline.io.recording import Plate
from pipeline.io.streams import AXES, COMPONENTS, PLACE, Channel
from pipeline.io.write import whole_file
from pipeline.live.stream import LAB_AXES, Samples, StreamDescription

PARTS = "label", "unit", "type", "marker", "plate"
"""Of a channel that are described, those that are not empty."""


def describe(
    channels: Sequence[Channel],
    parts: Sequence[tuple[str, str]] = (),
    plates: Sequence[Plate] = (),
) -> Element:
    """Give the ``desc`` of a stream: its channels, further parts, and plates that are among them.

    Their places are in the axes of the markers.

    Examples
    --------
    >>> desc = describe([Channel("Belt", "m/s")], [("filter_delay_s", "0.0375")])
    >>> desc.findtext("channels/channel/unit"), desc.findtext("filter_delay_s")
    ('m/s', '0.0375')
    """
    desc = Element("desc")
    inside = SubElement(desc, "channels")
    for channel in channels:
        one = SubElement(inside, "channel")
        for part in PARTS:
            if text := getattr(channel, part):
                SubElement(one, part).text = text
    for part, text in parts:
        SubElement(desc, part).text = text
    if plates:
        of_plates = SubElement(desc, "plates")
        for plate in plates:
            one = SubElement(of_plates, "plate")
            SubElement(one, "number").text = str(plate.number)
            for part in PLACE:
                numbers = getattr(plate, part).ravel().tolist()
                SubElement(one, part).text = " ".join(map(repr, numbers))
    return desc


def stream_channels(
    stream: StreamDescription, live: Live, plates: Sequence[Plate]
) -> tuple[Channel, ...]:
    """Give the channels of a stream: three per marker, or one per label.

    Channels of plates that are named as D-Flow names them say by that what they are.
    """
    if stream.kind == "markers":
        return tuple(
            Channel(f"{name}_{axis}", "meters", f"Position{axis}", marker=name)
            for name in stream.labels
            for axis in AXES
        )
    of_plate = {
        label: (component, str(plate.number))
        for plate in plates
        for label, component in zip(live.channels_of(plate.number), COMPONENTS, strict=True)
        if not DFLOW_PLATE.fullmatch(label)
    }
    return tuple(
        Channel(label, unit, kind, plate=number)
        for label, unit in zip(stream.labels, stream.units, strict=True)
        for kind, number in [of_plate.get(label, ("", ""))]
    )


def described_streams(
    streams: Sequence[StreamDescription], live: Live, plates: Sequence[Plate]
) -> list[Element]:
    """Describe streams that are received, one ``info`` each, as XDF has it."""
    described = []
    for stream in streams:
        channels = stream_channels(stream, live, plates)
        is_markers = stream.kind == "markers"
        info = Element("info")
        SubElement(info, "name").text = stream.name
        SubElement(info, "type").text = "MoCap" if is_markers else "Analog"
        SubElement(info, "channel_count").text = str(len(channels))
        SubElement(info, "nominal_srate").text = repr(stream.rate_hz)
        SubElement(info, "channel_format").text = "double64"
        numbers = {channel.plate for channel in channels}
        own = [plate for plate in plates if str(plate.number) in numbers]
        info.append(describe(channels, [("axes", LAB_AXES)] if is_markers else [], own))
        described.append(info)
    return described


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


PART: Final = "part_{number:06d}.parquet"


STREAMS: Final = "streams.xdf"
RESULTS: Final = "results"
EVERY_S: Final = 0.5
"""Between writings: what is missing if the process is killed."""
MAX_WAITING: Final = 60_000
"""Entries that wait for a disk that stalls, about a minute of them; memory stays bounded."""


def require_new(folder: Path) -> None:
    """Refuse a folder that holds a recording."""
    if (folder / STREAMS).exists() or (folder / RESULTS).exists():
        raise ValueError(f"{folder} holds a recording already; choose another folder")


class Recorder:
    """Records streams and results without ever making their sender wait.

    Parameters
    ----------
    folder
        A new or empty folder: ``streams.xdf`` takes the streams, which every command reads like any
        other recording, and ``results`` small Parquet files.
    descriptions
        Of the streams, as for `XdfWriter`.
    columns
        Names of the numbers of a frame's results.

    Raises
    ------
    ValueError
        If the folder holds a recording already.
    OSError
        If the folder cannot be written to.

    Attributes
    ----------
    fault
        Why nothing is recorded any more, in words; None as long as all is well.
    lost
        Entries that could not be written.
    """

    def __init__(
        self, folder: Path, descriptions: Sequence[Element], columns: Sequence[str]
    ) -> None:
        require_new(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self._streams = XdfWriter(folder / STREAMS, descriptions)
        (folder / RESULTS).mkdir(parents=True)
        self._folder, self._columns = folder / RESULTS, tuple(columns)
        self._rows, self._parts = list[Array](), 0
        self._waiting: SimpleQueue[Samples | Array] = SimpleQueue()
        self._stop = threading.Event()
        self.fault: str | None = None
        self.lost = 0
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def samples(self, received: Samples) -> None:
        """Take samples as they were received."""
        self._take(received)

    def frame(self, row: Array) -> None:
        """Take a frame's results, (K,)."""
        self._take(row)

    def close(self) -> None:
        """Write all that was taken, and end the files."""
        self._stop.set()
        self._thread.join()

    def _take(self, entry: Samples | Array) -> None:
        if self.fault is not None or self._waiting.qsize() >= MAX_WAITING:
            self.lost += 1
        else:
            self._waiting.put(entry)

    def _run(self) -> None:
        ending = False
        while not ending:
            ending = self._stop.wait(EVERY_S)
            try:
                self._write_waiting()
            except OSError as error:
                self.fault = f"recording stopped: {error.strerror or error}"
                self.lost += self._waiting.qsize()
                return
        try:
            self._streams.close()
        except OSError as error:
            self.fault = f"recording not ended: {error.strerror or error}"

    def _write_waiting(self) -> None:
        while True:
            try:
                entry = self._waiting.get_nowait()
            except Empty:
                break
            if isinstance(entry, Samples):
                self._streams.write(entry)
            else:
                self._rows.append(entry)
        if self._rows:
            values = np.array(self._rows).T.copy()
            table = pa.table(dict(zip(self._columns, values, strict=True)))
            with whole_file(self._folder / PART.format(number=self._parts + 1)) as temporary:
                pq.write_table(table, temporary)
            self._parts += 1
            self._rows.clear()
