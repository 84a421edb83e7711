"""Markers, plates and analog channels of Qualisys Track Manager, by its real-time protocol.

The protocol is that of https://docs.qualisys.com/qtm-rt-protocol/: packets of size and kind, with
the low byte first; a welcome, commands as text, parameters as XML, frames of components.
"""

import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array
from hbm.spelling import printable, short
from pipeline.io.axes import parse_axes
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.labels import require_unique
from pipeline.io.recording import Plate
from pipeline.io.stated import Stated
from pipeline.io.streams import AXES, Channel, parse_xml
from pipeline.io.units import length_in_m
from pipeline.live.stream import (
    LAB_AXES,
    Convert,
    Samples,
    StatedPlate,
    StreamDescription,
    describe_markers,
    describe_signals,
    require_same,
)

PROGRAM: Final = "Qualisys Track Manager"
MAX_CORNER_ERROR_M: Final = 0.02
"""Corners that are measured miss a rectangle by millimetres, those in no order by decimetres."""


def place_of(plate: Element, number: int, unit: str, to_lab: Array) -> Plate:
    """Give the place of a plate from its element ``Plate`` of the settings, without samples.

    Its ``Location`` has ``Corner1`` to ``Corner4``, in the axes of the markers and in a ``unit`` of
    length. The order of the C3D format, to which the program exports plates, is that of the
    quadrants +x +y, -x +y, -x -y and +x -y of the plate's own axes. The plate's z points down in
    the program's forces, so that corners whose z points up are in another order. A ValueError says
    so, or that there are no corners or that they are no rectangle.
    """
    corners = np.array([_corner(plate, k) for k in range(1, 5)]) * length_in_m(unit) @ to_lab.T
    rotation = plate_axes(corners)
    if np.linalg.norm(corners[0] + corners[2] - corners[1] - corners[3]) > MAX_CORNER_ERROR_M:
        raise ValueError("its corners are no rectangle")
    if rotation[2, 2] >= 0:
        raise ValueError("its corners are in another order than that of the C3D format: z is up")
    empty = np.empty(0)
    return Plate(number, empty, empty.reshape(0, 6), rotation, corners.mean(axis=0), corners)


def _corner(plate: Element, k: int) -> list[float]:
    words = [plate.findtext(f"Location/Corner{k}/{axis}") or "" for axis in AXES]
    try:
        found = list(map(float, words))
    except ValueError:
        found = []
    if not found or not np.isfinite(found).all():
        raise ValueError(f"the program has no corner {k}, but {short(' '.join(words))!r}")
    return found


MARKERS: Final = "Markers"
POSITIONS, ANALOG, FORCE = 1, 3, 4
"""Components of a frame, by their numbers in the protocol."""
COMPONENTS: Final = {POSITIONS: "3D", ANALOG: "Analog", FORCE: "Force"}
"""What commands call them."""
ABSENT_S: Final = 1.0
"""Devices send samples in bursts, so that single frames lack them."""
SAME_START_S: Final = 0.05
"""Sample numbers and time stamps count from the same start if they agree within it."""
RESTART_S: Final = 0.5
"""A time stamp that is earlier by more belongs to another measurement."""
LOADED_N: Final = 100.0
CHECKED_SAMPLES: Final = 20
MAX_MISFIT_M: Final = 0.01
"""As for recordings: moments of one plate agree with its centres of pressure within millimetres."""
Say = Callable[[Note], object]
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
        found = struct.unpack(f"<{count}i", self.part(4 * count))
        if min(found) < 0:
            raise Malformed(f"a packet counts {min(found)} parts")
        return found

    def numbers(self, rows: int, columns: int) -> Array:
        """Take numbers of single precision, (rows, columns)."""
        found = np.frombuffer(self.part(4 * rows * columns), "<f4")
        return found.reshape(rows, columns).astype(float)


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
        force, moment, point = forces[:, :3], forces[:, 3:6], forces[:, 6:] / 1e3
        loaded = np.abs(force[:, 2]) > LOADED_N
        if len(self.misfits) >= CHECKED_SAMPLES or not loaded.any():
            return
        tilt = (moment - np.cross(point, force))[loaded, :2]
        self.misfits += list(np.linalg.norm(tilt, axis=1) / np.abs(force[loaded, 2]))
        misfit = float(np.median(self.misfits))
        if len(self.misfits) >= CHECKED_SAMPLES and not misfit < MAX_MISFIT_M:
            raise ValueError(
                f"plate {short(self.description.name)!r}: moments and points of application "
                f"disagree by {1000 * misfit:.0f} mm about the centre of its surface, expected "
                f"less than {1000 * MAX_MISFIT_M:.0f} mm; send forces in the plate's axes"
            )


class Packets:
    """What the program sends by its parameters in XML, and its frames as samples.

    A ValueError says that parameters are broken, name no markers or state no rate, or as
    `pipeline.live.stream.describe_markers`.
    """

    def __init__(self, written: bytes, stated: Stated, say: Say = lambda note: None) -> None:
        try:
            root = parse_xml(written.decode("utf-8", "replace"))
        except ValueError as error:
            raise ValueError(f"{PROGRAM} sends broken parameters: {error}") from error
        names = [_text(label, "Name") for label in root.iterfind("The_3D/Label")]
        if not names:
            raise ValueError(f"{PROGRAM} has no labelled markers; apply an AIM model")
        self._sent, self._say = len(names), say
        channels = [
            Channel(f"{name}_{axis}", "mm", f"Position{axis}", marker=name)
            for name in names
            for axis in AXES
        ]
        rate_hz = _number(root.find("General"), "Frequency", "the cameras")
        self.markers, self._convert = describe_markers(MARKERS, channels, rate_hz, stated)
        self._plates, self.plates = _plates(root, parse_axes(stated.axes or LAB_AXES))
        self._devices = _devices(root)
        signals = (*self._plates.values(), *self._devices.values())
        self.streams = (self.markers, *(each.description for each in signals))
        require_unique([stream.name for stream in self.streams], f"{PROGRAM}: streams of one name")
        sent = {POSITIONS: True, ANALOG: bool(self._devices), FORCE: bool(self._plates)}
        self.components = [component for component, is_sent in sent.items() if is_sent]
        self._base_s, self._last_s = 0.0, -np.inf
        self._seen_s = dict[int, float]()

    def restart(self) -> None:
        """Expect sample numbers from another start."""
        self._seen_s.clear()
        for signals in (*self._devices.values(), *self._plates.values()):
            signals.origin_s = None

    def samples(self, data: bytes) -> list[Samples]:
        """Give the samples of a frame.

        Time goes on when a measurement begins anew. A ValueError says that a frame has another
        number of markers, or that moments are about another point than the centre of a plate's
        surface; `Malformed`, that it is not of the protocol.
        """
        frame = _Bytes(data)
        stamp_us, number, count = struct.unpack("<qII", frame.part(16))
        parts = dict[int, _Bytes]()
        while len(parts) < count:
            size, component = frame.counts(2)
            parts[component] = _Bytes(frame.part(size - 8))
        stamp_s, number_s, found = stamp_us / 1e6, number / self.markers.rate_hz, list[Samples]()
        if POSITIONS in parts:
            found.append(self._markers_of(parts[POSITIONS], stamp_s))
        for component, read in ((ANALOG, self._of_devices), (FORCE, self._of_plates)):
            for signals, first, values in read(parts[component]) if component in parts else ():
                rate_hz = signals.description.rate_hz
                own_s = (first + np.arange(len(values))) / rate_hz
                if signals.origin_s is None:
                    signals.origin_s = self._origin_s(signals, stamp_s, number_s, own_s[-1])
                times = self._base_s + (own_s + signals.origin_s)
                found.append(Samples(signals.description.name, times, signals.convert(values)))
        for component in self.components:
            self._seen_s.setdefault(component, stamp_s)
            if component in parts:
                self._seen_s[component] = stamp_s
            elif stamp_s - self._seen_s[component] > ABSENT_S:
                self._seen_s[component] = np.inf  # is said once
                self._say(Note.of("live_component_absent", component=COMPONENTS[component]))
        return found

    def _markers_of(self, part: _Bytes, stamp_s: float) -> Samples:
        """Give the markers of a frame."""
        (count,) = part.counts(1)
        part.part(4)  # rates of frames that the program lost
        positions = part.numbers(count, 3)
        if count != self._sent:
            raise ValueError(f"{PROGRAM} sends {count} markers, but named {self._sent}; start anew")
        if stamp_s < self._last_s - RESTART_S:
            self._base_s += self._last_s - stamp_s + 1 / self.markers.rate_hz
            self.restart()
        self._last_s = stamp_s
        time = np.array([self._base_s + stamp_s])
        return Samples(MARKERS, time, self._convert(positions.reshape(1, -1)))

    def _of_devices(self, part: _Bytes) -> Iterator[tuple[Signals, int, Array]]:
        """Give the analog devices of a frame: number of the first sample, and samples, (N, K)."""
        for _ in range(*part.counts(1)):
            number, channels, length = part.counts(3)
            first = part.counts(1)[0] if length else 0
            values = part.numbers(channels, length).T
            if length and (device := self._devices.get(number)):
                if channels != (named := len(device.description.labels)):
                    raise Malformed(f"device {number} has {channels} channels, but named {named}")
                yield device, first, values

    def _of_plates(self, part: _Bytes) -> Iterator[tuple[Signals, int, Array]]:
        """Give the plates of a frame: number of the first sample, and samples, (N, 6)."""
        for _ in range(*part.counts(1)):
            number, length, first = part.counts(3)
            forces = part.numbers(length, 9)
            if length and (plate := self._plates.get(number)):
                plate.check_moments(forces)
                yield plate, first, -forces[:, :6]

    def _origin_s(self, signals: Signals, stamp_s: float, number_s: float, last_s: float) -> float:
        """Give where sample numbers begin on the clock of the stamps, from a frame and its samples.

        Where time stamps count from another start, frame numbers may count from that of the
        samples; else these are taken to lie around the frame. Both are doubtful by a frame.
        """
        if abs(stamp_s - last_s) < SAME_START_S:
            return 0.0
        frame_s = 1 / self.markers.rate_hz
        self._say(Note.of("live_start_unknown", stream=signals.description.name, frame_s=frame_s))
        if abs(number_s - last_s) < SAME_START_S:
            return stamp_s - number_s
        return stamp_s + frame_s / 2 - last_s


def _devices(root: Element) -> dict[int, Signals]:
    """Give what analog devices send, by their numbers."""
    found = dict[int, Signals]()
    devices = root.findall("Analog/Device")
    for device, name in zip(devices, _names(devices, "Device_Name", "Device_ID"), strict=True):
        channels = [
            Channel(_text(channel, "Label"), _text(channel, "Unit"))
            for channel in device.iterfind("Channel")
        ]
        rate_hz = _number(device, "Frequency", f"device {name}")
        described = describe_signals(name, channels, rate_hz)
        found[int(_number(device, "Device_ID", f"device {name}"))] = Signals(*described)
    return _all_of(found, devices)


def _plates(root: Element, to_lab: Array) -> tuple[dict[int, Signals], tuple[StatedPlate, ...]]:
    """Give what plates send, by their numbers, and how the program describes them."""
    found, described = dict[int, Signals](), []
    force, length = (_text(root.find("Force"), f"Unit_{of}") for of in ("Force", "Length"))
    plates = root.findall("Force/Plate")
    for plate, name in zip(plates, _names(plates, "Name", "Plate_ID"), strict=True):
        tag = "Plate_ID" if _text(plate, "Plate_ID") else "Force_Plate_Index"
        number = int(_number(plate, tag, f"plate {name}"))
        channels = [
            Channel(f"{name}.{part}", force if part[0] == "F" else "Nm")
            for part in WRENCH_COMPONENTS
        ]
        rate_hz = _number(plate, "Frequency", f"plate {name}")
        found[number] = Signals(*describe_signals(name, channels, rate_hz))
        place, problem = None, ""
        try:
            place = place_of(plate, number, length, to_lab)
        except ValueError as error:
            problem = str(error)
        labels = found[number].description.labels
        described.append(StatedPlate(str(number), labels, place, problem))
    return _all_of(found, plates), tuple(described)


def _names(elements: Sequence[Element], tag: str, number: str) -> Iterator[str]:
    """Give the names of plates or devices; where several have one, with their numbers."""
    counts = Counter(_text(element, tag) for element in elements)
    for element in elements:
        name = _text(element, tag)
        yield name if name and counts[name] == 1 else f"{name} {_text(element, number)}".strip()


def _all_of(found: dict[int, Signals], elements: Sequence[Element]) -> dict[int, Signals]:
    if len(found) < len(elements):
        raise ValueError(f"{PROGRAM} numbers two of {elements[0].tag} alike; number them anew")
    return found


def _number(element: Element | None, tag: str, what: str) -> float:
    """Give a positive number of an element."""
    text = _text(element, tag)
    try:
        found = float(text)
    except ValueError:
        found = np.nan
    if not 0 < found < np.inf:
        raise ValueError(f"{PROGRAM} states no {tag} of {short(what)}, but {short(text)!r}")
    return found


def _text(element: Element | None, tag: str) -> str:
    return printable((element.findtext(tag) or "").strip()) if element is not None else ""


PORT: Final = 22223
"""Of the protocol with the low byte first."""
VERSION: Final = "1.25"
WELCOME: Final = "QTM RT Interface connected"
ERROR, COMMAND, XML, DATA = range(4)
"""Kinds of packets that are looked at."""
KINDS: Final = range(10)
HEADER, HIGH_BYTE_FIRST = struct.Struct("<II"), struct.Struct(">II")
"""Size of a packet, and its kind."""
MAX_BYTES: Final = 1 << 24
"""Of a packet: a hundred times those of a frame of a large laboratory."""
RETRY_S: Final = 1.0
"""Between attempts to reach a computer that has gone away."""
SILENT_S: Final = 2.0
"""Without a packet, after which the program is asked whether it is there."""
RETURN_S: Final = 2.0
"""Left to a program that is there again to answer."""
STREAM_S: Final = 0.5
"""Within which streaming is refused, if it is."""
AT_ONCE: Final = 1 << 16
"""Bytes."""
MIN_WAIT_S: Final = 0.001
TELL_AGAIN_S: Final = 60.0
MAX_WORDS: Final = 80
"""Letters of an answer in a message."""


Packet = tuple[int, bytes]
"""Its kind, and what is in it."""


class _Connection:
    """A connection to the program, and what has arrived of the next packet.

    A ConnectionError says, in one line, what is wrong with it.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self._where, self._timeout_s = f"{host}:{port}", timeout_s
        self._deadline_s, self.received = time.monotonic() + timeout_s, bytearray()
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except OSError as error:
            raise ConnectionError(self._why_not(error)) from error

    def _why_not(self, error: OSError) -> str:
        """Say why there is no connection."""
        if isinstance(error, socket.gaierror):
            return f"{self._where}: no computer has this name"
        if isinstance(error, ConnectionRefusedError):
            return (
                f"{self._where} refuses the connection; is {PROGRAM} running there, and its base "
                "port one less?"
            )
        if isinstance(error, TimeoutError):
            return (
                f"{self._where} does not answer within {self._timeout_s:g} s; is the computer on, "
                "and its firewall open?"
            )
        return f"{self._where} cannot be reached: {error.strerror or error}"

    def begin(self) -> bytes:
        """Wait for the welcome, and give the parameters."""
        kind, welcome = self._answer("takes the connection, but says nothing")
        if kind != COMMAND or _words(welcome) != WELCOME:
            raise ConnectionError(f"{self._where} is no {PROGRAM}: it says {_words(welcome)!r}")
        if _words(self._ask(f"Version {VERSION}", COMMAND)) != f"Version set to {VERSION}":
            raise ConnectionError(f"{self._where} has not version {VERSION} of the protocol")
        return self._ask("GetParameters General 3D Analog Force", XML).rstrip(b"\0")

    def stream(self, components: Sequence[int]) -> list[Packet]:
        """Ask for all frames; give what arrives first, of which some may be frames."""
        command = f"StreamFrames AllFrames {' '.join(COMPONENTS[each] for each in components)}"
        self.send(command)
        found = self.packets(STREAM_S)
        for kind, words in found:
            if kind == ERROR:
                raise ConnectionError(self._refusal(command, words))
        return found

    def _ask(self, command: str, expected: int) -> bytes:
        """Send a command and give its answer."""
        self.send(command)
        kind, answer = self._answer(f"does not answer {command!r}")
        if kind != expected:
            raise ConnectionError(self._refusal(command, answer))
        return answer

    def _refusal(self, command: str, words: bytes) -> str:
        return f"{PROGRAM} at {self._where} refuses {command!r}: {_words(words)}"

    def _answer(self, silent: str) -> Packet:
        """Give the next packet that answers something."""
        while (left_s := self._deadline_s - time.monotonic()) > 0:
            for kind, words in self.packets(left_s):
                if kind in (ERROR, COMMAND, XML):
                    return kind, words
        raise ConnectionError(f"{self._where} {silent} within {self._timeout_s:g} s")

    def send(self, command: str) -> None:
        """Send a command."""
        words = command.encode() + b"\0"
        try:
            self._socket.sendall(HEADER.pack(HEADER.size + len(words), COMMAND) + words)
        except OSError as error:
            raise ConnectionError(f"{self._where}: {error.strerror or error}") from error

    def packets(self, timeout_s: float) -> list[Packet]:
        """Give the packets that have arrived; wait for the first bytes."""
        self._socket.settimeout(max(timeout_s, MIN_WAIT_S))
        try:
            piece = self._socket.recv(AT_ONCE)
        except TimeoutError:
            return []
        except OSError as error:
            raise ConnectionError(f"{self._where}: {error.strerror or error}") from error
        if not piece:
            raise ConnectionError(f"{self._where} has closed the connection")
        self.received += piece
        found = list[Packet]()
        while len(self.received) >= HEADER.size:
            size, kind = HEADER.unpack_from(self.received)
            if not HEADER.size <= size <= MAX_BYTES or kind not in KINDS:
                what = f"sends what is not of its protocol: {bytes(self.received[:16])!r}"
                size, kind = HIGH_BYTE_FIRST.unpack_from(self.received)
                if HEADER.size <= size <= MAX_BYTES and kind in KINDS:
                    what = "sends the high byte first; the right port is one less"
                raise ConnectionError(f"{self._where} {what}")
            if len(self.received) < size:
                break
            found.append((kind, bytes(self.received[HEADER.size : size])))
            del self.received[:size]
        return found

    def close(self) -> None:
        """Disconnect."""
        self._socket.close()


def _words(answer: bytes) -> str:
    return short(answer.rstrip(b"\0").decode("utf-8", "replace"), MAX_WORDS)


class QualisysSource:
    """Receives what Qualisys Track Manager sends in real time.

    Parameters
    ----------
    host, port
        Where it runs; its port for the low byte first, 22223 by default.
    stated
        What a person states: the axes (necessary), labels to rename, the prefix of the subject.
    timeout_s
        How long an answer is waited for.
    say
        Called with notes: frames that cannot be read, connections that are lost, what is doubtful.

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
        stated: Stated,
        port: int = PORT,
        timeout_s: float = 5.0,
        say: Say = lambda note: None,
    ) -> None:
        self._address, self._stated, self._say = (host, port), stated, say
        self._packets: Packets | None = None
        self._connection: _Connection | None = None
        self._where = f"{host}:{port}"
        self._told_s, self._again_s = dict[str, float](), 0.0
        self._connect(timeout_s)

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """What is received: markers, then plates, then analog devices."""
        streams = self._packets.streams if self._packets is not None else ()
        return tuple(replace(stream, sender=self._where) for stream in streams)

    @property
    def plates(self) -> tuple[StatedPlate, ...]:
        """Plates as the program's settings describe them."""
        return self._packets.plates if self._packets is not None else ()

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give whatever has arrived; an empty list if nothing does within the timeout [s].

        A ValueError says that the program came back with other markers, channels or plates.
        """
        if self._connection is None:
            time.sleep(max(0.0, min(timeout_s, self._again_s - time.monotonic())))
        try:
            if self._connection is None:
                if time.monotonic() >= self._again_s:
                    self._connect(RETURN_S)
                return []
            arrived = [*self._early, *self._connection.packets(timeout_s)]
            self._early.clear()
            self._look_for_silence(self._connection, bool(arrived))
        except ConnectionError as reason:
            self._lose(str(reason))
            return []
        return [samples for packet in arrived for samples in self._samples(*packet)]

    def close(self) -> None:
        """Disconnect."""
        if self._connection is not None:
            self._connection.close()

    def _connect(self, timeout_s: float) -> None:
        """Connect, and begin to stream."""
        connection, before = _Connection(*self._address, timeout_s), self._packets
        try:
            written = connection.begin()
            try:
                packets = Packets(written, self._stated, self._say)
            except ValueError as error:
                if before is None:
                    raise
                raise ConnectionError(str(error)) from error  # it may not be ready yet
            if before is not None:
                sender = f"{PROGRAM} at {self._where}"
                streams = {"description of its streams": (before.streams, packets.streams)}
                require_same(sender, streams, before.plates, packets.plates)
                packets = before
            packets.restart()
            self._early = connection.stream(packets.components)
        except BaseException:
            connection.close()
            raise
        self._packets, self._connection = packets, connection
        self._heard_s, self._asked = time.monotonic(), False

    def _look_for_silence(self, connection: _Connection, heard: bool) -> None:
        """Ask a program that is silent whether it is there; one that does not answer is not."""
        if heard:
            self._heard_s, self._asked = time.monotonic(), False
        elif time.monotonic() - self._heard_s > SILENT_S:
            if self._asked or connection.received:
                raise ConnectionError("it is silent in the middle of a packet, or when asked")
            connection.send("QTMVersion")
            self._heard_s, self._asked = time.monotonic(), True

    def _lose(self, reason: str) -> None:
        """Leave a connection, and say why once."""
        if self._connection is not None:
            self._connection.close()
        self._connection, self._again_s = None, time.monotonic() + RETRY_S
        self._tell("live_connection_lost", reason)

    def _samples(self, kind: int, data: bytes) -> list[Samples]:
        """Take one packet apart."""
        assert self._packets is not None
        try:
            if kind == ERROR:
                raise Malformed(f"it says {_words(data)!r}")
            return self._packets.samples(data) if kind == DATA else []
        except Malformed as reason:
            self._tell("live_frames_unread", str(reason))
            return []

    def _tell(self, code: str, reason: str) -> None:
        """Say something, but not the like of it for a minute."""
        if time.monotonic() - self._told_s.get(code, -np.inf) > TELL_AGAIN_S:
            self._told_s[code] = time.monotonic()
            self._say(Note.of(code, program=PROGRAM, reason=reason))
