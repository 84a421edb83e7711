"""Markers, plates and analog channels of Qualisys Track Manager, by its real-time protocol.

The protocol is that of https://docs.qualisys.com/qtm-rt-protocol/: packets of size and kind, with
the low byte first; a welcome, commands as text, parameters as XML, frames of components.
"""

import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from hbm.numbers import read_numbers
from hbm.spatial import WRENCH_COMPONENTS, Array
from hbm.spelling import short
from pipeline.io.axes import parse_axes
from pipeline.io.labels import require_unique
from pipeline.io.qualisys import plate_at
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Plate
from pipeline.io.streams import AXES, Channel, parse_xml, text_of
from pipeline.io.units import length_in_m
from pipeline.live.light import Finding, Kind
from pipeline.live.stream import (
    LAB_AXES,
    Convert,
    DescribedPlate,
    Samples,
    StreamDescription,
    describe_markers,
    describe_signals,
    marker_channels,
    require_same,
)

PROGRAM: Final = "Qualisys Track Manager"


def place_of(plate: Element, number: int, unit: str, to_lab: Array) -> Plate:
    """Give the place of a plate from its element ``Plate`` of the settings, without samples.

    Its ``Location`` has ``Corner1`` to ``Corner4``, in the axes of the markers and in a ``unit`` of
    length. The order of the C3D format, to which the program exports plates, is that of the
    quadrants +x +y, -x +y, -x -y and +x -y of the plate's own axes. The plate's z points down in
    the program's forces, so that corners whose z points up are in another order. A ValueError says
    so, or that there are no corners or that they are no rectangle.
    """
    metre, places = length_in_m(unit), [f"Location/Corner{k}" for k in range(1, 5)]
    words = [[plate.findtext(f"{place}/{axis}") or "" for axis in AXES] for place in places]
    try:
        corners = np.array(words, float) * metre @ to_lab.T
    except ValueError as error:
        raise ValueError("the program has not its four corners") from error
    place = plate_at(number, corners)
    if place.rotation[2, 2] >= 0:
        raise ValueError("its corners are in another order than that of the C3D format: z is up")
    return place


MARKERS: Final = "Markers"
POSITIONS, ANALOG, FORCE = 1, 3, 4
"""Components of a frame, by their numbers in the protocol."""
COMPONENTS: Final = {POSITIONS: "3D", ANALOG: "Analog", FORCE: "Force"}
"""What commands call them."""
LIMITS: Final = read_numbers("pipeline.live", "thresholds.toml", "qualisys")
MOMENTS: Final = read_numbers("pipeline.io", "thresholds.toml", "moments")
"""Of recordings, too: when moments are about another point than the plate's."""
Say = Callable[[Finding], object]
"""Called with what is wrong as it arises."""


class Malformed(Exception):
    """Bytes that are not of the protocol."""


@dataclass(slots=True)
class _Bytes:
    """Bytes of a packet, and how far they are read."""

    data: bytes
    at: int = 0

    def part(self, size: int) -> bytes:
        """Take some of them."""
        start, self.at = self.at, self.at + size
        if not start <= self.at <= len(self.data):
            raise Malformed(f"a packet of {len(self.data)} bytes has a part of {size}")
        return self.data[start : self.at]

    def counts(self, count: int) -> Sequence[int]:
        """Take whole numbers, none of which is negative."""
        counts = struct.unpack(f"<{count}i", self.part(4 * count))
        if min(counts) < 0:
            raise Malformed(f"a packet counts {min(counts)} parts")
        return counts

    def numbers(self, rows: int, columns: int) -> Array:
        """Take numbers of single precision, (rows, columns)."""
        numbers = np.frombuffer(self.part(4 * rows * columns), "<f4")
        return numbers.reshape(rows, columns).astype(float)


@dataclass(slots=True)
class Signals:
    """One analog device or force plate: what it carries, and what turns its samples to SI units.

    Its sample numbers begin at ``origin_s``; moments and points of application disagreed so far by
    ``misfits``, in loaded samples [m].
    """

    description: StreamDescription
    convert: Convert
    origin_s: float | None = None
    misfits: list[float] = field(default_factory=list)

    def check_moments(self, forces: Array) -> None:
        """Refuse moments that are not about the centre of the plate's surface.

        Force, moment and point of application are as sent, (N, 9) [N, N·m, mm]; in the first loaded
        samples moments and points may disagree by 1 cm.
        """
        forces = forces[np.abs(forces[:, 2]) > MOMENTS.least_vertical_force]
        if len(self.misfits) >= LIMITS.checked_samples or not len(forces):
            return
        force, moment, point = np.hsplit(forces, 3)
        # about the point of application the force has no moment but the free one about z
        tilt = (moment - np.cross(point / 1e3, force))[:, :2]
        # as a distance, by which the two points differ
        self.misfits += list(np.linalg.norm(tilt, axis=1) / np.abs(force[:, 2]))
        misfit = float(np.median(self.misfits))
        if len(self.misfits) >= LIMITS.checked_samples and not misfit < MOMENTS.largest_misfit:
            raise ValueError(
                f"plate {short(self.description.name)!r}: moments and points of application "
                f"disagree by {1000 * misfit:.0f} mm about the centre of its surface, expected "
                f"less than {1000 * MOMENTS.largest_misfit:.0f} mm; send forces in the plate's axes"
            )


class Packets:
    """What the program sends by its parameters in XML, and its frames as samples.

    A ValueError says that parameters are broken, name no markers or state no rate, or as
    `pipeline.live.stream.describe_markers`.
    """

    def __init__(
        self, written: bytes, options: ReadOptions, say: Say = lambda finding: None
    ) -> None:
        try:
            root = parse_xml(written.decode("utf-8", "replace"))
        except ValueError as error:
            raise ValueError(f"{PROGRAM} sends broken parameters: {error}") from error
        names = [text_of(label, "Name") for label in root.iterfind("The_3D/Label")]
        if not names:
            raise ValueError(f"{PROGRAM} has no labelled markers; apply an AIM model")
        self._sent, self._say = len(names), say
        channels = marker_channels(names, "mm")
        rate_hz = _number(root, "General/Frequency", "the cameras")
        self.markers, self._convert = describe_markers(MARKERS, channels, rate_hz, options)
        self._signals, self.plates = _signals(root, parse_axes(options.axes or LAB_AXES))
        self.streams = (self.markers, *(signals.description for signals in self._signals.values()))
        require_unique([stream.name for stream in self.streams], f"{PROGRAM}: streams of one name")
        sending = {POSITIONS, *(component for component, _ in self._signals)}
        self.components = [component for component in COMPONENTS if component in sending]
        self._base_s, self._last_s = 0.0, -np.inf

    def restart(self) -> None:
        """Expect sample numbers from another start."""
        for signals in self._signals.values():
            signals.origin_s = None

    def samples(self, data: bytes) -> list[Samples]:
        """Give the samples of a frame.

        Time goes on when a measurement begins anew. A ValueError says that a frame has another
        number of markers, or that moments are about another point than the centre of a plate's
        surface; `Malformed`, that it is not of the protocol.
        """
        frame, parts = _Bytes(data), dict[int, _Bytes]()
        stamp_us, number, count = struct.unpack("<qII", frame.part(16))
        while len(parts) < count:
            size, component = frame.counts(2)
            parts[component] = _Bytes(frame.part(size - 8))
        stamp_s, number_s = stamp_us / 1e6, number / self.markers.rate_hz
        samples = [self._markers_of(parts[POSITIONS], stamp_s)] if POSITIONS in parts else []
        for component in {ANALOG, FORCE} & parts.keys():
            for signals, first, values in self._read(component, parts[component]):
                sent = signals.description
                # plates and devices have no stamps: a sample's number over its rate is its time
                taken_s = (first + np.arange(len(values))) / sent.rate_hz
                if signals.origin_s is None:
                    signals.origin_s = self._origin_s(signals, stamp_s, number_s, taken_s[-1])
                times = self._base_s + (taken_s + signals.origin_s)
                samples.append(Samples(sent.name, times, signals.convert(values)))
        return samples

    def _markers_of(self, part: _Bytes, stamp_s: float) -> Samples:
        """Give the markers of a frame."""
        (count,) = part.counts(1)
        part.part(4)  # rates of frames that the program lost
        positions = part.numbers(count, 3)
        if count != self._sent:
            raise ValueError(f"{PROGRAM} sends {count} markers, but named {self._sent}; start anew")
        # a new measurement begins at zero: time goes on a frame after the last one
        if stamp_s < self._last_s - LIMITS.restart:
            self._base_s += self._last_s - stamp_s + 1 / self.markers.rate_hz
            self.restart()
        self._last_s = stamp_s
        time = np.array([self._base_s + stamp_s])
        return Samples(MARKERS, time, self._convert(positions.reshape(1, -1)))

    def _read(self, component: int, part: _Bytes) -> Iterator[tuple[Signals, int, Array]]:
        """Give plates or devices of a frame: number of the first sample, and samples, (N, K)."""
        for _ in range(*part.counts(1)):
            if component == FORCE:
                number, length, first = part.counts(3)
                values = part.numbers(length, 9)
            else:
                number, channels, length = part.counts(3)
                first = part.counts(1)[0] if length else 0
                values = part.numbers(channels, length).T
            if not length or (signals := self._signals.get((component, number))) is None:
                continue
            if component == FORCE:
                signals.check_moments(values)
                values = -values[:, :6]  # on the subject, not on the plate
            elif channels != (named := len(signals.description.labels)):
                raise Malformed(f"device {number} has {channels} channels, but named {named}")
            yield signals, first, values

    def _origin_s(self, signals: Signals, stamp_s: float, number_s: float, last_s: float) -> float:
        """Give where sample numbers begin on the clock of the stamps, from a frame and its samples.

        Where time stamps count from another start, frame numbers may count from that of the
        samples; else these are taken to lie around the frame. Both are doubtful by a frame.
        """
        if abs(stamp_s - last_s) < LIMITS.same_start:
            return 0.0
        frame_s, name = 1 / self.markers.rate_hz, signals.description.name
        self._say(Finding(Kind.START_UNKNOWN, (name,), {"frame_s": frame_s}))
        if abs(number_s - last_s) < LIMITS.same_start:
            return stamp_s - number_s
        return stamp_s + frame_s / 2 - last_s


def _signals(
    root: Element, to_lab: Array
) -> tuple[dict[tuple[int, int], Signals], tuple[DescribedPlate, ...]]:
    """Give what plates and devices send, by component and number, and plates as described.

    Where several have one name, they have their numbers in it.
    """
    by_number, plates = dict[tuple[int, int], Signals](), list[DescribedPlate]()
    force, length = (text_of(root, f"Force/Unit_{of}") for of in ("Force", "Length"))
    for component, path, tag in ((FORCE, "Force/Plate", ""), (ANALOG, "Analog/Device", "Device_")):
        elements = root.findall(path)
        counts = Counter(text_of(element, f"{tag}Name") for element in elements)
        for element in elements:
            name = text_of(element, f"{tag}Name")
            what = f"{element.tag} {name}"
            number = int(_number(element, f"{tag or 'Plate_'}ID", what))
            if (component, number) in by_number:
                raise ValueError(f"{PROGRAM} numbers two of {element.tag} {number}; change one")
            if not name or counts[name] > 1:
                name = f"{name} {number}".strip()
            sent = [(text_of(c, "Label"), text_of(c, "Unit")) for c in element.iterfind("Channel")]
            if component == FORCE:
                sent = [(f"{name}.{c}", "Nm" if c[0] == "M" else force) for c in WRENCH_COMPONENTS]
            rate_hz = _number(element, "Frequency", what)
            signals = Signals(*describe_signals(name, [Channel(*part) for part in sent], rate_hz))
            by_number[component, number] = signals
            if component == FORCE:
                of_plate = str(number), signals.description.labels
                try:
                    plates.append(
                        DescribedPlate(*of_plate, place_of(element, number, length, to_lab))
                    )
                except ValueError as error:
                    plates.append(DescribedPlate(*of_plate, problem=str(error)))
    return by_number, tuple(plates)


def _number(element: Element, tag: str, what: str) -> float:
    """Give a positive number of an element."""
    text = text_of(element, tag)
    try:
        number = float(text)
    except ValueError:
        number = np.nan
    if not 0 < number < np.inf:
        raise ValueError(f"{PROGRAM} states no {tag} of {short(what)}, but {short(text)!r}")
    return number


PORT: Final = 22223
"""Of the protocol with the low byte first."""
VERSION: Final = "1.25"
ERROR, COMMAND, XML, DATA = range(4)
"""Kinds of packets that are looked at."""
HEADER, HIGH_BYTE_FIRST = struct.Struct("<II"), struct.Struct(">II")
"""Size of a packet, and its kind."""
RETRY_S: Final = 1.0
"""Between attempts to reach a computer that has gone away."""
SILENT_S: Final = 2.0
"""Without a packet, after which the program is asked whether it is there."""
WHY_NOT: Final[Mapping[type[OSError], str]] = {
    socket.gaierror: "is unknown: no computer has this name",
    ConnectionRefusedError: f"refuses the connection; is {PROGRAM} running, and this its port?",
    TimeoutError: "does not answer in time; is the computer on, and its firewall open?",
}
"""What is said of addresses."""
Packet = tuple[int, bytes]
"""Its kind, and what is in it."""


class QualisysSource:
    """Receives what Qualisys Track Manager sends in real time.

    Parameters
    ----------
    host, port
        Where it runs; its port for the low byte first, 22223 by default.
    options
        What a person states: the axes (necessary), labels to rename, the prefix of the subject.
    timeout_s
        How long an answer is waited for.
    say
        Called with findings: frames that are not read, lost connections, what is doubtful.

    Attributes
    ----------
    streams
        What is received: markers, then plates, then analog devices.
    plates
        As the program's settings describe them.

    Raises
    ------
    ValueError
        The program's parameters lack markers or something that is needed.
    ConnectionError
        Nothing answers there, it is another program, or it refuses something. One line.

    Notes
    -----
    Time is that of the program's own clock: of markers the time stamp of the frame, of plates and
    analog channels the number of the sample over its rate, from the same start. Markers are in lab
    axes [m]. Forces that the program sends act on the plate, in the plate's own axes with z down
    (https://docs.qualisys.com/qtm/content/qtm_windows/force_data_information.htm); here they act
    on the subject, in the same axes. A connection that is lost, or silent though it is asked, is
    sought again every second.
    """

    def __init__(
        self,
        host: str,
        *,
        options: ReadOptions,
        port: int = PORT,
        timeout_s: float = 5.0,
        say: Say = lambda finding: None,
    ) -> None:
        self._address, self._where, self._stated = (host, port), f"{host}:{port}", options
        self._say, self._said_s = say, dict[Kind, float]()
        self._socket: socket.socket | None = None
        self._early, self._again_s = list[Packet](), 0.0
        with ExitStack() as failing:
            failing.callback(self.close)
            self._packets = self._connect(timeout_s, None)
            failing.pop_all()
        self.plates = self._packets.plates
        self.streams = tuple(replace(s, sender=self._where) for s in self._packets.streams)

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give whatever has arrived; an empty list if nothing does within the timeout [s].

        A ValueError says that the program came back with other markers, channels or plates.
        """
        try:
            if self._socket is not None:
                arrived = self._early or self._arrived(self._socket, timeout_s)
                self._early = list[Packet]()
                self._look_for_silence(self._socket, bool(arrived))
                return [samples for packet in arrived for samples in self._samples(*packet)]
            time.sleep(max(0.0, min(timeout_s, self._again_s - time.monotonic())))
            if time.monotonic() >= self._again_s:
                self._connect(2.0, self._packets)  # seconds, to answer
        except OSError as reason:
            self.close()
            self._again_s = time.monotonic() + RETRY_S
            self._tell(Kind.CONNECTION_LOST, reason.strerror or str(reason))
        return []

    def close(self) -> None:
        """Disconnect."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def _connect(self, timeout_s: float, before: Packets | None) -> Packets:
        """Connect, and begin to stream; a ConnectionError says what is wrong."""
        self._received, self._until_s = bytearray(), time.monotonic() + timeout_s
        self._heard_s, self._asked = self._until_s, False
        try:
            self._socket = connected = socket.create_connection(self._address, timeout_s)
        except OSError as error:
            other = f"cannot be reached: {error.strerror or error}"
            reason = next((why for kind, why in WHY_NOT.items() if isinstance(error, kind)), other)
            raise ConnectionError(f"{self._where} {reason}") from error
        kind, welcome = self._answer(connected, "takes the connection, but says nothing")
        if kind != COMMAND or _words(welcome) != "QTM RT Interface connected":
            raise ConnectionError(f"{self._where} is no {PROGRAM}: it says {_words(welcome)!r}")
        if _words(self._ask(connected, f"Version {VERSION}")) != f"Version set to {VERSION}":
            raise ConnectionError(f"{self._where} has not version {VERSION} of the protocol")
        written = self._ask(connected, "GetParameters General 3D Analog Force", XML)
        try:
            packets = Packets(written.rstrip(b"\0"), self._stated, self._say)
        except ValueError as error:
            if before is None:
                raise
            raise ConnectionError(str(error)) from error  # it may not be ready yet
        if before is not None:
            streams = {"description of its streams": (before.streams, packets.streams)}
            plates = before.plates, packets.plates
            require_same(f"{PROGRAM} at {self._where}", streams, *plates)
            packets = before
        packets.restart()
        parts = " ".join(COMPONENTS[component] for component in packets.components)
        _send(connected, f"StreamFrames AllFrames {parts}")
        # if streaming is refused, it is within half a second
        self._early = self._arrived(connected, 0.5)
        for kind, words in self._early:
            if kind == ERROR:
                raise ConnectionError(f"{self._where} refuses to stream {parts}: {_words(words)}")
        self._heard_s = time.monotonic()
        return packets

    def _ask(self, connected: socket.socket, command: str, expected: int = COMMAND) -> bytes:
        """Send a command and give its answer."""
        _send(connected, command)
        kind, answer = self._answer(connected, f"does not answer {command!r}")
        if kind != expected:
            raise ConnectionError(f"{self._where} refuses {command!r}: {_words(answer)}")
        return answer

    def _answer(self, connected: socket.socket, silent: str) -> Packet:
        """Give the next packet that answers something."""
        while (remaining_s := self._until_s - time.monotonic()) > 0:
            for kind, words in self._arrived(connected, remaining_s):
                if kind in (ERROR, COMMAND, XML):
                    return kind, words
        raise ConnectionError(f"{self._where} {silent} in time")

    def _arrived(self, connected: socket.socket, timeout_s: float) -> list[Packet]:
        """Give the packets that have arrived; wait for the first bytes."""
        connected.settimeout(max(timeout_s, 0.001))  # 0 would be without waiting
        try:
            piece = connected.recv(1 << 16)
        except TimeoutError:
            return []
        except ConnectionError:
            piece = b""
        if not piece:
            raise ConnectionError(f"{self._where} has closed the connection")
        self._received += piece
        packets, received = list[Packet](), self._received
        while len(received) >= HEADER.size:
            size, kind = HEADER.unpack_from(received)
            if not _is_header(size, kind):
                what = f"sends what is not of its protocol: {bytes(received[:16])!r}"
                if _is_header(*HIGH_BYTE_FIRST.unpack_from(received)):
                    what = "sends the high byte first; the right port is one less"
                raise ConnectionError(f"{self._where} {what}")
            if len(received) < size:
                break
            packets.append((kind, bytes(received[HEADER.size : size])))
            del received[:size]
        return packets

    def _look_for_silence(self, connected: socket.socket, heard: bool) -> None:
        """Ask a program that is silent whether it is there; one that does not answer is not."""
        if heard:
            self._heard_s, self._asked = time.monotonic(), False
        elif time.monotonic() - self._heard_s > SILENT_S:
            if self._asked or self._received:
                raise ConnectionError("it is silent in the middle of a packet, or when asked")
            _send(connected, "QTMVersion")
            self._heard_s, self._asked = time.monotonic(), True

    def _samples(self, kind: int, data: bytes) -> list[Samples]:
        """Take one packet apart."""
        try:
            if kind == ERROR:
                raise Malformed(f"it says {_words(data)!r}")
            return self._packets.samples(data) if kind == DATA else []
        except Malformed as reason:
            self._tell(Kind.FRAMES_UNREAD, str(reason))
            return []

    def _tell(self, kind: Kind, reason: str) -> None:
        """Say something, but not the like of it for a minute."""
        if time.monotonic() - self._said_s.get(kind, -np.inf) > 60.0:
            self._said_s[kind] = time.monotonic()
            self._say(Finding(kind, values={"program": PROGRAM, "reason": reason}))


def _is_header(size: int, kind: int) -> bool:
    # a frame of a large laboratory has a hundredth of 16 MB; the protocol has ten kinds
    return HEADER.size <= size <= 1 << 24 and kind in range(10)


def _send(connected: socket.socket, command: str) -> None:
    words = command.encode() + b"\0"
    connected.sendall(HEADER.pack(HEADER.size + len(words), COMMAND) + words)


def _words(answer: bytes) -> str:
    return short(answer.rstrip(b"\0").decode("utf-8", "replace"), 80)
