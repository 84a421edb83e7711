"""What a session sends and stores: streams and results, described, as they come."""

import socket
import struct
import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from ipaddress import IPv4Address
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hbm.coordinates import TREE
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.live import LOOPBACK, Live, own_address
from pipeline.io.columns import DFLOW_PLATE
from pipeline.io.recording import Plate
from pipeline.io.streams import COMPONENTS, PARTS, PLACE, Channel
from pipeline.io.write import whole_file
from pipeline.io.xdf import MAGIC, STAMP_BYTES, Tag
from pipeline.live.chain import LiveFrame
from pipeline.live.stream import LAB_AXES, Samples, StreamDescription, marker_channels

FORMAT: Final = "double64"
"""Of all samples: nothing is rounded."""


def describe(
    name: str,
    content_type: str,
    channels: Sequence[Channel],
    rate_hz: float,
    parts: Sequence[tuple[str, str]] = (),
    plates: Sequence[Plate] = (),
) -> Element:
    """Give the ``info`` of a stream that is sent or recorded, as XDF has it.

    Besides its channels it has further parts, and plates that are among the channels; their places
    are in the axes of the markers.

    Examples
    --------
    >>> info = describe("Belts", "", [Channel("Belt", "m/s")], 100.0, [("delay_s", "0.0375")])
    >>> info.findtext("desc/channels/channel/unit"), info.findtext("desc/delay_s")
    ('m/s', '0.0375')
    """
    described = (
        element("channel", *[(part, text) for part in PARTS if (text := getattr(channel, part))])
        for channel in channels
    )
    placed = (
        element("plate", *[(part, _written(getattr(plate, part))) for part in ("number", *PLACE)])
        for plate in plates
    )
    of_plates = [element("plates", *placed)] if plates else []
    about = ("name", name), ("type", content_type), ("channel_count", str(len(channels)))
    numbers = ("nominal_srate", repr(rate_hz)), ("channel_format", FORMAT)
    desc = element("desc", element("channels", *described), *parts, *of_plates)
    return element("info", *about, *numbers, desc)


def _written(numbers: int | Array) -> str:
    return " ".join(map(repr, np.ravel(numbers).tolist()))


def element(tag: str, *inside: Element | tuple[str, str]) -> Element:
    """Give an element of others, or of tags and their texts."""
    made = Element(tag)
    for part in inside:
        if isinstance(part, Element):
            made.append(part)
        else:
            SubElement(made, part[0]).text = part[1]
    return made


def describe_stream(
    stream: StreamDescription, live: Live, plates: Sequence[Plate], prefix: str = ""
) -> Element:
    """Describe a stream that is received, to send or record it under its name after a prefix.

    It has three channels per marker, or one per label. Channels of plates that are named as D-Flow
    names them say by that what they are.
    """
    name, labels, rate_hz = prefix + stream.name, stream.labels, stream.rate_hz
    if stream.kind == "markers":
        channels = marker_channels(labels, "meters")
        return describe(name, "MoCap", channels, rate_hz, [("axes", LAB_AXES)])
    of_plate = {
        label: (component, str(plate.number))
        for plate in plates
        for label, component in zip(live.channels_of(plate.number), COMPONENTS, strict=True)
        if not DFLOW_PLATE.fullmatch(label)
    }
    kinds, numbers = zip(*(of_plate.get(label, ("", "")) for label in labels), strict=True)
    parts = zip(labels, stream.units, kinds, numbers, strict=True)
    channels = tuple(Channel(label, unit, kind, plate=of) for label, unit, kind, of in parts)
    placed = [plate for plate in plates if str(plate.number) in numbers]
    return describe(name, "Analog", channels, rate_hz, plates=placed)


BYTES_OF_COUNT: Final = b"\x04"


class XdfWriter:
    """An XDF file that grows with every call, and is complete up to the last one if it is killed.

    Parameters
    ----------
    path
        The file; an existing one is not overwritten.
    descriptions
        One per stream, as `describe` gives them.

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
        self._names = [info.findtext("name", "") for info in descriptions]
        self._counts, self._file = [0] * len(descriptions), path.open("xb")
        self._file.write(MAGIC)
        self._chunk(Tag.FILE_HEADER, tostring(element("info", ("version", "1.0"))))
        for number, info in enumerate(descriptions, start=1):
            self._chunk(Tag.STREAM_HEADER, struct.pack("<I", number) + tostring(info, "utf-8"))
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
        number = 1 + self._names.index(samples.stream)
        parts = [("bytes", "u1"), ("stamp", "<f8"), ("values", "<f8", (channels,))]
        rows = np.empty(count, np.dtype(parts))
        rows["bytes"], rows["stamp"], rows["values"] = STAMP_BYTES, samples.time, samples.values
        head = struct.pack("<I", number) + BYTES_OF_COUNT + struct.pack("<I", count)
        self._counts[number - 1] += count
        try:
            self._chunk(Tag.SAMPLES, head + rows.tobytes())
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
                footer = element("info", ("sample_count", str(count)))
                self._chunk(Tag.STREAM_FOOTER, struct.pack("<I", number) + tostring(footer))

    def _chunk(self, tag: int, content: bytes) -> None:
        body = struct.pack("<H", tag) + content
        self._file.write(BYTES_OF_COUNT + struct.pack("<I", len(body)) + body)


STREAMS: Final = "streams.xdf"
RESULTS_FOLDER: Final = "results"
SUMMARY: Final = "summary.txt"
MAX_WAITING: Final = 60_000
"""Entries that wait for a disk that stalls, about a minute of them; memory stays bounded."""


def require_new(folder: Path) -> None:
    """Refuse a folder that holds a recording."""
    if (folder / STREAMS).exists() or (folder / RESULTS_FOLDER).exists():
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
        (folder / RESULTS_FOLDER).mkdir(parents=True)
        self._folder, self._columns = folder / RESULTS_FOLDER, tuple(columns)
        self._rows, self._parts, self.lost = list[Array](), 0, 0
        self._waiting, self._stop = SimpleQueue[Samples | Array](), threading.Event()
        self.fault: str | None = None
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def take(self, entry: Samples | Array) -> None:
        """Take samples as they were received, or a frame's results, (K,)."""
        if self.fault is not None or self._waiting.qsize() >= MAX_WAITING:
            self.lost += 1
        else:
            self._waiting.put(entry)

    def close(self) -> None:
        """Write all that was taken, and end the files."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        failed = "stopped"
        try:
            # half a second is missing if the process is killed
            while not self._stop.wait(0.5):
                self._write_waiting()
            self._write_waiting()
            failed = "not ended"
            self._streams.close()
        except OSError as error:
            self.fault = f"recording {failed}: {error.strerror or error}"
            self.lost += self._waiting.qsize()

    def _write_waiting(self) -> None:
        for _ in range(self._waiting.qsize()):
            entry = self._waiting.get()
            if isinstance(entry, Samples):
                self._streams.write(entry)
            else:
                self._rows.append(entry)
        if self._rows:
            values = np.array(self._rows).T.copy()
            self._parts += 1
            with whole_file(self._folder / f"part_{self._parts:06d}.parquet") as temporary:
                pq.write_table(pa.table(dict(zip(self._columns, values, strict=True))), temporary)
            self._rows.clear()


_listening: list[str] = []
"""Where this process listens, once it has begun to; the library reads its settings only once."""


def load_lsl(listen: str = LOOPBACK) -> Any:
    """Import Lab Streaming Layer, with its discovery bound to one address.

    Parameters
    ----------
    listen
        Address of this computer in the laboratory's network, or of the loopback, by default:
        then neither queries nor answers leave this computer.

    Returns
    -------
    module
        ``pylsl``.

    Raises
    ------
    ValueError
        It is not installed, the address is none, or this process listens on another one.

    Notes
    -----
    Settings in a file ``lsl_api.cfg`` are not used. Samples and clocks have ports of their own
    (16572 and following), which the library opens on all interfaces; docs/live.md says how to
    close them to others.
    """
    try:
        address, lsl = IPv4Address(own_address(listen)), import_module("pylsl")
    except ValueError as error:
        raise ValueError(f"listen: {error}") from error
    except ImportError as missing:
        raise ValueError(
            "Lab Streaming Layer needs the extra live: pip install 'hbm-residuals[live]'"
        ) from missing
    except (OSError, RuntimeError) as broken:  # its library, where it has no wheel
        reason = [*str(broken).splitlines(), type(broken).__name__][0]
        raise ValueError(f"Lab Streaming Layer does not load: {reason}") from broken
    if not _listening:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_port:
            try:
                any_port.bind((str(address), 0))
            except OSError as error:
                raise ValueError(
                    f"listen: {address} is not an address of this computer ({error.strerror}); its "
                    "network settings list those that it has"
                ) from error
        scope = "ResolveScope = machine\n" if address.is_loopback else ""
        interfaces = "" if address.is_loopback else f"Interfaces = {{{address}}}\n"
        # three answers of eight make a measurement of a clock: with six, the usual number, a busy
        # computer has none; every 0.02 s: a first one then takes 0.3 s, with the usual 0.064 s 0.65
        lsl.set_config_content(
            "[ports]\nIPv6 = disable\n"
            f"[multicast]\n{scope}{interfaces}ListenAddress = {address}\n"
            "[tuning]\nTimeUpdateMinProbes = 3\nTimeProbeInterval = 0.02\n[log]\nlevel = -3\n"
        )
        _listening.append(str(address))
    if _listening != [str(address)]:
        raise ValueError(
            f"listen: this process listens on {_listening[0]} already, not on {address}; Lab "
            "Streaming Layer can be bound once"
        )
    return lsl


RESULTS: Final = "hbm"
"""Name of the stream of results; it names no person."""


class Outlet:
    """Sends samples of one stream to whoever receives them, and never waits for them.

    Parameters
    ----------
    info
        As `describe` gives it. The stream's name is also its identity, by which receivers find it
        again.
    listen
        As for `pipeline.live.output.load_lsl`, with its errors.

    Notes
    -----
    The library sends the name of this computer with every description. Nothing else identifies
    anyone.
    """

    def __init__(self, info: Element, *, listen: str = LOOPBACK) -> None:
        lsl = load_lsl(listen)
        tags = "name", "type", "channel_count", "nominal_srate"
        name, content_type, count, rate_hz = (info.findtext(tag, "") for tag in tags)
        about = name, content_type, int(count), float(rate_hz), FORMAT, f"hbm-residuals {name}"
        described = lsl.StreamInfo(*about)
        append_description(described.desc(), info.iterfind("desc/*"))
        # ten seconds are kept for a slow receiver; then its oldest samples are lost
        self._outlet: Any = lsl.StreamOutlet(described, 0, 10)

    def push(self, time: Array, values: Array) -> None:
        """Send samples, (N, K), taken at times on this computer's clock, (N,) [s]."""
        if len(time):
            self._outlet.push_chunk(np.ascontiguousarray(values), np.asarray(time, float))

    @property
    def has_receivers(self) -> bool:
        """Whether anyone receives."""
        return bool(self._outlet.have_consumers())

    def close(self) -> None:
        """Stop sending; what receivers have not taken yet is lost."""
        self._outlet = None


def result_outlet(
    rate_hz: float, name: str = RESULTS, listen: str = LOOPBACK, **delays_s: float
) -> Outlet:
    """Open the stream of results, whose samples `pipeline.live.output.result_row` gives.

    Parameters
    ----------
    rate_hz
        Of the cameras [Hz].
    name
        The stream's name.
    listen
        As for `pipeline.live.output.load_lsl`, with its errors.
    delays_s
        ``filter_delay_s`` and ``resampling_delay_s``: by which the filter makes values late, and
        how long a frame waits for samples, as of `pipeline.live.chain.LiveChain` [s]; the
        description states both.
    """
    parts = [(part, repr(float(delay_s))) for part, delay_s in delays_s.items()]
    info = describe(name, "Biomechanics", result_channels(), rate_hz, parts)
    return Outlet(info, listen=listen)


def result_channels() -> tuple[Channel, ...]:
    """Give the channels of the stream of results.

    Returns
    -------
    tuple of Channel
        46 coordinates (``q``) and their 46 generalised forces (``tau``), 6 pelvis residuals as
        measured and 6 compensated (x forward, y right, z up), quality, computing time: 106.

    Examples
    --------
    >>> channels = result_channels()
    >>> len(channels), channels[0].label, channels[92].label, channels[-1].unit
    (106, 'q.PelvisX', 'residual.measured.Fx', 's')
    """
    q = (Channel(f"q.{c.name}", "m" if c.translates else "rad", "Angle") for c in TREE)
    tau = (Channel(f"tau.{c.name}", "N" if c.translates else "N·m", "Moment") for c in TREE)
    residual = (
        Channel(f"residual.{variant}.{name}", "N" if name[0] == "F" else "N·m", "Residual")
        for variant in ("measured", "compensated")
        for name in WRENCH_COMPONENTS
    )
    rest = Channel("quality", "", "Quality"), Channel("computing_time", "s")
    return (*q, *tau, *residual, *rest)


def append_description(desc: Any, described: Iterable[Element]) -> None:
    """Write the parts of a description into that of a stream of the library."""
    for part in described:
        if len(part):
            append_description(desc.append_child(part.tag), part)
        else:
            desc.append_child_value(part.tag, part.text or "")


def result_columns() -> tuple[str, ...]:
    """Name the numbers of a row on disk: its time, then the channels of the stream of results."""
    return ("time_s", *(channel.label for channel in result_channels()))


def result_row(frame: LiveFrame) -> Array:
    """Give a frame's numbers in the order of `pipeline.live.output.result_channels`.

    Parameters
    ----------
    frame
        The frame; its generalised forces are those with the plates compensated, where they are.

    Returns
    -------
    Array
        (106,); a variant that is not computed is NaN.
    """
    *_, tau = frame.tau.values()
    unknown = np.full(6, np.nan)
    residuals = frame.residual["measured"], frame.residual.get("compensated", unknown)
    return np.concatenate([frame.q, tau, *residuals, [float(frame.quality), frame.computing_s]])
