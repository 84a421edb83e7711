"""Markers, plates and analog channels of Qualisys Track Manager, by the vendor's client qtm-rt.

The protocol is that of https://docs.qualisys.com/qtm-rt-protocol/.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from hbm.spatial import WRENCH_COMPONENTS, Array
from hbm.spelling import printable, short
from pipeline.io.axes import parse_axes
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.recording import Plate
from pipeline.io.stated import Stated
from pipeline.io.streams import AXES, Channel, parse_xml
from pipeline.io.units import length_in_m
from pipeline.live.output import import_extra
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
SAME_START_S: Final = 0.05
"""Sample numbers and time stamps count from the same start if they agree within it."""
RESTART_S: Final = 0.5
"""A time stamp that is earlier by more belongs to another measurement."""
LOADED_N: Final = 100.0
CHECKED_SAMPLES: Final = 20
MAX_MISFIT_M: Final = 0.01
"""As for recordings: moments of one plate agree with its centres of pressure within millimetres."""


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

    def samples(self, first: int, values: Array, stamp_s: float, base_s: float) -> Samples:
        """Give samples, the number of whose first is known, with those of a frame at a stamp."""
        own_s = (first + np.arange(len(values))) / self.description.rate_hz
        if self.origin_s is None:
            ahead_s = stamp_s - float(own_s[-1])
            self.origin_s = 0.0 if abs(ahead_s) < SAME_START_S else ahead_s
        time = base_s + (own_s + self.origin_s)
        return Samples(self.description.name, time, self.convert(values))

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
    """What the program sends by its parameters in XML, and its packets as samples.

    A ValueError says that parameters are broken, name no markers or state no rate, or as
    `pipeline.live.stream.describe_markers`.
    """

    def __init__(self, written: bytes, stated: Stated) -> None:
        try:
            root = parse_xml(written.decode("utf-8", "replace"))
        except ValueError as error:
            raise ValueError(f"Qualisys Track Manager sends broken parameters: {error}") from error
        names = [_text(label, "Name") for label in root.iterfind("The_3D/Label")]
        if not names:
            raise ValueError("Qualisys Track Manager has no labelled markers; apply an AIM model")
        self.sent = len(names)
        channels = [
            Channel(f"{name}_{axis}", "mm", f"Position{axis}", marker=name)
            for name in names
            for axis in AXES
        ]
        rate_hz = _rate(root.find("General"), "the cameras")
        self.markers, self._convert = describe_markers(MARKERS, channels, rate_hz, stated)
        self._plates, self.plates = _plates(root, parse_axes(stated.axes or LAB_AXES))
        self._devices = _devices(root)
        signals = (*self._plates.values(), *self._devices.values())
        self.streams = (self.markers, *(each.description for each in signals))
        self.components = ["3d", *["analog"] * bool(self._devices), *["force"] * bool(self._plates)]
        self._base_s, self._last_s = 0.0, -np.inf

    def restart(self) -> None:
        """Expect sample numbers from another start."""
        for signals in (*self._devices.values(), *self._plates.values()):
            signals.origin_s = None

    def samples(self, packet: Any) -> Iterator[Samples]:
        """Give the samples of one packet of the vendor's client.

        Time goes on when a measurement begins anew. A ValueError says that a packet has another
        number of markers, or that moments are about another point than the centre of a plate's
        surface.
        """
        stamp = packet.timestamp / 1e6
        if (markers := packet.get_3d_markers()) is not None:
            _, positions = markers
            if len(positions) != self.sent:
                raise ValueError(
                    f"Qualisys Track Manager sends {len(positions)} markers, but named "
                    f"{self.sent}; start anew"
                )
            if stamp < self._last_s - RESTART_S:
                self._base_s += self._last_s - stamp + 1 / self.markers.rate_hz
                self.restart()
            self._last_s = stamp
            values = self._convert(np.array(positions, float).reshape(1, -1))
            yield Samples(MARKERS, np.array([self._base_s + stamp]), values)
        _, channels = packet.get_analog() or (None, [])
        of_devices: dict[int, tuple[int, list[Any]]] = {}
        for device, number, channel in channels:
            first = number.sample_number
            of_devices.setdefault(device.id, (first, []))[1].append(channel.samples)
        for number, (first, channels) in of_devices.items():
            if device := self._devices.get(number):
                values = np.array(channels, float).T
                yield device.samples(first, values, stamp, self._base_s)
        _, plates = packet.get_force() or (None, [])
        for sent, forces in plates:
            if forces and (plate := self._plates.get(sent.id)):
                each = np.array(forces, float)
                plate.check_moments(each)
                yield plate.samples(sent.force_number, -each[:, :6], stamp, self._base_s)


def _devices(root: Element) -> dict[int, Signals]:
    found = {}
    for device in root.iterfind("Analog/Device"):
        name = _text(device, "Device_Name")
        channels = [
            Channel(_text(channel, "Label"), _text(channel, "Unit"))
            for channel in device.iterfind("Channel")
        ]
        described = describe_signals(name, channels, _rate(device, name))
        found[int(_text(device, "Device_ID"))] = Signals(*described)
    return found


def _plates(root: Element, to_lab: Array) -> tuple[dict[int, Signals], tuple[StatedPlate, ...]]:
    """Give what plates send, and how the program describes them."""
    found, described = {}, []
    force, length = (_text(root.find("Force"), f"Unit_{of}") for of in ("Force", "Length"))
    for plate in root.iterfind("Force/Plate"):
        name = _text(plate, "Name")
        number = int(_text(plate, "Plate_ID") or _text(plate, "Force_Plate_Index"))
        channels = [
            Channel(f"{name}.{part}", force if part[0] == "F" else "Nm")
            for part in WRENCH_COMPONENTS
        ]
        found[number] = Signals(*describe_signals(name, channels, _rate(plate, name)))
        place, problem = None, ""
        try:
            place = place_of(plate, number, length, to_lab)
        except ValueError as error:
            problem = str(error)
        labels = found[number].description.labels
        described.append(StatedPlate(str(number), labels, place, problem))
    return found, tuple(described)


def _rate(element: Element | None, what: str) -> float:
    text = _text(element, "Frequency")
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0 < rate < np.inf:
        raise ValueError(f"Qualisys Track Manager has no rate of {short(what)}, but {text!r}")
    return rate


def _text(element: Element | None, tag: str) -> str:
    return printable((element.findtext(tag) or "").strip()) if element is not None else ""


PORT: Final = 22223
"""Of the protocol with the low byte first."""
RETRY_S: Final = 1.0
"""Between attempts to reach a computer that has gone away."""
MAX_WAITING: Final = 10_000
"""Pieces kept for a receiver that is busy; then the oldest are lost."""


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

    Raises
    ------
    ValueError
        The extra is missing, or the program's parameters lack markers or something that is needed.
    ConnectionError
        Nothing answers there.

    Notes
    -----
    Time is that of the program's own clock: of markers the time stamp of the frame, of plates and
    analog channels the number of the sample over its rate, from the same start. Markers are in lab
    axes [m]. Forces that the program sends act on the plate, in the plate's own axes with z down
    (https://docs.qualisys.com/qtm/content/qtm_windows/force_data_information.htm); here they act
    on the subject, in the same axes. A connection that is lost is sought again every second.
    """

    def __init__(
        self,
        host: str,
        *,
        stated: Stated,
        port: int = PORT,
        timeout_s: float = 5.0,
    ) -> None:
        self._client = import_extra("qtm_rt", "Qualisys")
        self._where = f"{host}:{port}"
        self._address = host, port
        self._stated, self._timeout_s = stated, timeout_s
        self._packets: Packets | None = None
        self._fault: Exception | None = None
        self._waiting: deque[Samples] = deque(maxlen=MAX_WAITING)
        self._arrived, self._ready = threading.Event(), threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="qualisys", daemon=True)
        self._thread.start()
        answered = self._ready.wait(3 * timeout_s)
        if self._fault is not None or not answered:
            self.close()
            raise self._fault or ConnectionError(f"{self._where} does not answer")

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
        if not self._waiting:
            self._arrived.wait(timeout_s)
        self._arrived.clear()
        if self._fault is not None:
            raise self._fault
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def close(self) -> None:
        """Disconnect."""
        if self._loop.is_running():
            self._loop.call_soon_threadsafe(self._cancel)
        self._thread.join(self._timeout_s)

    def _cancel(self) -> None:
        for task in asyncio.all_tasks(self._loop):
            task.cancel()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except asyncio.CancelledError:
            pass
        except Exception as fault:
            self._fault = fault
        finally:
            self._loop.close()
            self._ready.set()
            self._arrived.set()

    async def _serve(self) -> None:
        """Connect, and again whenever the connection is lost."""
        while True:
            try:
                await self._connection()
            except (OSError, self._client.QRTCommandException):
                if self._packets is None:
                    raise ConnectionError(
                        f"no Qualisys Track Manager answers at {self._where}; is it running, and "
                        "its port for real-time output open?"
                    ) from None
            await asyncio.sleep(RETRY_S)

    async def _connection(self) -> None:
        """Stream until the connection is lost."""
        lost = asyncio.Event()
        connection = await asyncio.wait_for(
            self._client.connect(
                *self._address,
                on_disconnect=lambda _: lost.set(),
                timeout=self._timeout_s,
                loop=self._loop,
            ),
            self._timeout_s,
        )
        if connection is None:
            raise ConnectionError
        try:
            written = await connection.get_parameters(["general", "3d", "analog", "force"])
            packets, before = Packets(written, self._stated), self._packets
            if before is not None:
                sender = f"Qualisys Track Manager at {self._where}"
                streams = {"description of its streams": (before.streams, packets.streams)}
                require_same(sender, streams, before.plates, packets.plates)
                packets = before
            packets.restart()
            self._packets = packets
            self._ready.set()
            while not lost.is_set():
                try:
                    await connection.stream_frames(
                        components=packets.components, on_packet=self._take
                    )
                    await lost.wait()
                except (TimeoutError, self._client.QRTCommandException):
                    await asyncio.sleep(RETRY_S)  # no measurement runs yet
        finally:
            if connection.has_transport():
                connection.disconnect()

    def _take(self, packet: Any) -> None:
        """Take one packet apart."""
        if self._packets is None or self._fault is not None:
            return
        try:
            self._waiting.extend(self._packets.samples(packet))
        except ValueError as fault:
            self._fault = fault
        self._arrived.set()
