"""Markers, plates and analog channels of Qualisys Track Manager, by the vendor's client qtm-rt.

The protocol is that of https://docs.qualisys.com/qtm-rt-protocol/.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from hbm.spatial import Array
from hbm.spelling import printable, short
from pipeline.io.stated import Stated
from pipeline.io.xdf.channels import AXES, Channel
from pipeline.live.description import Convert, describe_markers, describe_signals
from pipeline.live.network import import_extra
from pipeline.live.stream import Samples, StreamDescription

PORT: Final = 22223
"""Of the protocol with the low byte first."""
MARKERS: Final = "Markers"
RETRY_S: Final = 1.0
"""Between attempts to reach a computer that has gone away."""
MAX_WAITING: Final = 10_000
"""Pieces kept for a receiver that is busy; then the oldest are lost."""
SAME_START_S: Final = 0.05
"""Sample numbers and time stamps count from the same start if they agree within it."""
RESTART_S: Final = 0.5
"""A time stamp that is earlier by more belongs to another measurement."""
LOADED_N: Final = 100.0
CHECKED_SAMPLES: Final = 20
MAX_MISFIT_M: Final = 0.01
"""As for recordings: moments of one plate agree with its centres of pressure within millimetres."""
WRENCH: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


@dataclass(slots=True)
class _Signals:
    """One analog device or force plate: its description, and where its sample numbers begin."""

    description: StreamDescription
    convert: Convert
    origin_s: float | None = None
    misfits: list[float] = field(default_factory=list)

    def time(self, number: int, count: int, frame_s: float) -> Array:
        """Give the times of samples on the clock of the frames, (count,) [s]."""
        rate = self.description.rate_hz
        own = (number + np.arange(count)) / rate
        if self.origin_s is None:
            ahead = frame_s - float(own[-1])
            self.origin_s = 0.0 if abs(ahead) < SAME_START_S else ahead
        return np.asarray(own + self.origin_s)

    def check_moments(self, forces: Array) -> None:
        """Refuse moments that are not about the centre of the plate's surface.

        Parameters
        ----------
        forces
            Force, moment and point of application as sent, (N, 9) [N, N·m, mm].

        Raises
        ------
        ValueError
            In the first loaded samples moments and points disagree by more than 1 cm.
        """
        force, moment, point = forces[:, :3], forces[:, 3:6], forces[:, 6:] / 1e3
        loaded = np.abs(force[:, 2]) > LOADED_N
        if len(self.misfits) >= CHECKED_SAMPLES or not loaded.any():
            return
        tilt = (moment - np.cross(point, force))[loaded, :2]
        self.misfits += list(np.linalg.norm(tilt, axis=1) / np.abs(force[loaded, 2]))
        if len(self.misfits) >= CHECKED_SAMPLES:
            misfit = float(np.median(self.misfits))
            if not misfit < MAX_MISFIT_M:
                raise ValueError(
                    f"plate {short(self.description.name)!r}: moments and points of application "
                    f"disagree by {1000 * misfit:.0f} mm about the centre of its surface, expected "
                    f"less than {1000 * MAX_MISFIT_M:.0f} mm; let forces be sent in the plate's axes"
                )


@dataclass(slots=True)
class _Setup:
    """What Qualisys Track Manager sends, from its parameters; ``sent`` is its number of markers."""

    sent: int
    markers: StreamDescription
    convert: Convert
    devices: dict[int, _Signals]
    plates: dict[int, _Signals]

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        signals = (*self.plates.values(), *self.devices.values())
        return (self.markers, *(each.description for each in signals))


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
        self._setup: _Setup | None = None
        self._fault: Exception | None = None
        self._waiting: deque[Samples] = deque(maxlen=MAX_WAITING)
        self._arrived, self._ready = threading.Event(), threading.Event()
        self._base_s, self._last_s = 0.0, -np.inf
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
        return self._setup.streams if self._setup is not None else ()

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give whatever has arrived; an empty list if nothing does within the timeout [s].

        A ValueError says that the program came back with other markers or channels.
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
                if self._setup is None:
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
            setup = _setup(written, self._stated)
            if self._setup is not None and setup.streams != self._setup.streams:
                raise ValueError(
                    f"{self._where} came back with other markers or channels; start anew"
                )
            self._setup = setup
            self._ready.set()
            components = ["3d", *["analog"] * bool(setup.devices), *["force"] * bool(setup.plates)]
            while not lost.is_set():
                try:
                    await connection.stream_frames(components=components, on_packet=self._take)
                    await lost.wait()
                except (TimeoutError, self._client.QRTCommandException):
                    await asyncio.sleep(RETRY_S)  # no measurement runs yet
        finally:
            if connection.has_transport():
                connection.disconnect()

    def _take(self, packet: Any) -> None:
        """Take one packet apart."""
        if self._setup is None or self._fault is not None:
            return
        try:
            self._waiting.extend(self._samples_of(packet, self._setup))
        except ValueError as fault:
            self._fault = fault
        self._arrived.set()

    def _samples_of(self, packet: Any, setup: _Setup) -> list[Samples]:
        stamp = packet.timestamp / 1e6
        found: list[Samples] = []
        if (markers := packet.get_3d_markers()) is not None:
            if stamp < self._last_s - RESTART_S:
                self._base_s += self._last_s - stamp + 1 / setup.markers.rate_hz
                for signals in (*setup.devices.values(), *setup.plates.values()):
                    signals.origin_s = None
            self._last_s = stamp
            _, positions = markers
            if len(positions) != setup.sent:
                raise ValueError(
                    f"{self._where} sends {len(positions)} markers, but named {setup.sent}; start "
                    "anew"
                )
            values = setup.convert(np.array(positions, float).reshape(1, -1))
            found.append(Samples(MARKERS, np.array([self._base_s + stamp]), values))
        for device, number, channels in _analog(packet):
            if (signals := setup.devices.get(device)) is None:
                continue
            values = signals.convert(channels)
            found.append(self._samples(signals, number, values, stamp))
        for plate, number, forces in _forces(packet):
            if (signals := setup.plates.get(plate)) is None:
                continue
            signals.check_moments(forces)
            values = signals.convert(-forces[:, :6])
            found.append(self._samples(signals, number, values, stamp))
        return found

    def _samples(self, signals: _Signals, number: int, values: Array, stamp: float) -> Samples:
        own = signals.time(number, len(values), stamp)
        return Samples(signals.description.name, self._base_s + own, values)


def _analog(packet: Any) -> list[tuple[int, int, Array]]:
    """Give device, number of the first sample and samples, (N, K), of a packet."""
    found: dict[int, tuple[int, list[Any]]] = {}
    _, channels = packet.get_analog() or (None, [])
    for device, number, channel in channels:
        found.setdefault(device.id, (number.sample_number, []))[1].append(channel.samples)
    return [(k, number, np.array(samples, float).T) for k, (number, samples) in found.items()]


def _forces(packet: Any) -> list[tuple[int, int, Array]]:
    """Give plate, number of the first sample, and forces, moments and points, (N, 9), of each."""
    _, plates = packet.get_force() or (None, [])
    return [
        (plate.id, plate.force_number, np.array(forces, float))
        for plate, forces in plates
        if forces
    ]


def _setup(written: bytes, stated: Stated) -> _Setup:
    """Give what is sent from the program's parameters."""
    try:
        root = ElementTree.fromstring(written)
    except ElementTree.ParseError as error:
        raise ValueError(f"Qualisys Track Manager sends broken parameters: {error}") from error
    rate = _rate(root.find("General"), "the cameras")
    names = [_text(label, "Name") for label in root.iterfind("The_3D/Label")]
    if not names:
        raise ValueError("Qualisys Track Manager has no labelled markers; apply an AIM model")
    channels = [
        Channel(f"{name}_{axis}", "mm", f"Position{axis}", marker=name)
        for name in names
        for axis in AXES
    ]
    markers, convert = describe_markers(MARKERS, channels, rate, stated)
    return _Setup(len(names), markers, convert, _devices(root), _plates(root))


def _devices(root: ElementTree.Element) -> dict[int, _Signals]:
    found = {}
    for device in root.iterfind("Analog/Device"):
        name = _text(device, "Device_Name")
        channels = [
            Channel(_text(channel, "Label"), _text(channel, "Unit"))
            for channel in device.iterfind("Channel")
        ]
        described = describe_signals(name, channels, _rate(device, name))
        found[int(_text(device, "Device_ID"))] = _Signals(*described)
    return found


def _plates(root: ElementTree.Element) -> dict[int, _Signals]:
    found = {}
    force = _text(root.find("Force"), "Unit_Force")
    for plate in root.iterfind("Force/Plate"):
        name = _text(plate, "Name")
        number = int(_text(plate, "Plate_ID") or _text(plate, "Force_Plate_Index"))
        channels = _wrench_channels(name, force)
        found[number] = _Signals(*describe_signals(name, channels, _rate(plate, name)))
    return found


def _wrench_channels(name: str, force: str) -> Sequence[Channel]:
    return [
        Channel(f"{name}.{component}", force if component[0] == "F" else "Nm")
        for component in WRENCH
    ]


def _rate(element: ElementTree.Element | None, what: str) -> float:
    text = _text(element, "Frequency")
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0 < rate < np.inf:
        raise ValueError(f"Qualisys Track Manager states no rate of {short(what)}, but {text!r}")
    return rate


def _text(element: ElementTree.Element | None, tag: str) -> str:
    return printable((element.findtext(tag) or "").strip()) if element is not None else ""
