"""What Qualisys Track Manager sends: its parameters as streams, its packets as samples."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from hbm.spatial import Array
from hbm.spelling import printable, short
from pipeline.io.axes import parse_axes
from pipeline.io.stated import Stated
from pipeline.io.xdf.channels import AXES, Channel, parse_xml
from pipeline.live.arrival import known
from pipeline.live.sources.changes import change_of_plates, change_of_streams
from pipeline.live.sources.description import Convert, describe_markers, describe_signals
from pipeline.live.sources.qualisys_places import place_of
from pipeline.live.stream import LAB_AXES, Samples, StatedPlate, StreamDescription

MARKERS: Final = "Markers"
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
class Signals:
    """One analog device or force plate.

    Attributes
    ----------
    description, convert
        What it carries, and what turns its samples to SI units.
    origin_s
        When its sample numbers begin [s]; None as long as it is not known.
    misfits
        How far moments and points of application disagreed so far, in loaded samples [m].
    """

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
                    f"less than {1000 * MAX_MISFIT_M:.0f} mm; send forces in the plate's axes"
                )


@dataclass(slots=True)
class Frames:
    """Turns packets to samples.

    Attributes
    ----------
    sent
        Number of markers in every packet.
    markers, convert
        Description of the markers' stream, and what turns positions to lab axes and m.
    devices, plates
        Analog devices and force plates by their numbers.
    stated_plates
        Channels and places of the plates.
    base_s, last_s
        Added to time stamps, so that time goes on when a measurement begins anew, and the latest
        stamp [s].
    """

    sent: int
    markers: StreamDescription
    convert: Convert
    devices: dict[int, Signals]
    plates: dict[int, Signals]
    stated_plates: tuple[StatedPlate, ...] = ()
    base_s: float = 0.0
    last_s: float = -np.inf

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """Markers, then plates, then analog devices."""
        signals = (*self.plates.values(), *self.devices.values())
        return (self.markers, *(each.description for each in signals))

    @property
    def components(self) -> list[str]:
        """What has to be asked for."""
        return ["3d", *["analog"] * bool(self.devices), *["force"] * bool(self.plates)]

    def change_from(self, before: "Frames") -> str:
        """Say what is different; empty where the same is sent, of plates at the same places."""
        return change_of_streams(before.streams, self.streams) or change_of_plates(
            before.stated_plates, self.stated_plates
        )

    def restart(self) -> None:
        """Expect sample numbers from another start."""
        for signals in (*self.devices.values(), *self.plates.values()):
            signals.origin_s = None

    def samples(self, packet: Any) -> list[Samples]:
        """Give the samples of one packet of the vendor's client.

        Raises
        ------
        ValueError
            It has another number of markers, or moments are about another point than the centre of
            a plate's surface.
        """
        stamp = packet.timestamp / 1e6
        found: list[Samples] = []
        if (markers := packet.get_3d_markers()) is not None:
            _, positions = markers
            if len(positions) != self.sent:
                raise ValueError(
                    f"Qualisys Track Manager sends {len(positions)} markers, but named "
                    f"{self.sent}; start anew"
                )
            if stamp < self.last_s - RESTART_S:
                self.base_s += self.last_s - stamp + 1 / self.markers.rate_hz
                self.restart()
            self.last_s = stamp
            values = self.convert(known(np.array(positions, float).reshape(1, -1)))
            found.append(Samples(MARKERS, np.array([self.base_s + stamp]), values))
        for device, number, channels in _analog(packet):
            if device in self.devices:
                found.append(self._samples(self.devices[device], number, channels, stamp))
        for plate, number, forces in _forces(packet):
            if plate in self.plates:
                self.plates[plate].check_moments(forces)
                found.append(self._samples(self.plates[plate], number, -forces[:, :6], stamp))
        return found

    def _samples(self, signals: Signals, number: int, values: Array, stamp: float) -> Samples:
        time = self.base_s + signals.time(number, len(values), stamp)
        return Samples(signals.description.name, time, signals.convert(known(values)))


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


def read_parameters(written: bytes, stated: Stated) -> Frames:
    """Give what is sent, from the program's parameters in XML.

    Raises
    ------
    ValueError
        They are broken, name no markers or state no rate, or as
        `pipeline.live.sources.description.describe_markers`.
    """
    try:
        root = parse_xml(written.decode("utf-8", "replace"))
    except ValueError as error:
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
    plates, described = _plates(root, parse_axes(stated.axes or LAB_AXES))
    return Frames(len(names), markers, convert, _devices(root), plates, described)


def _devices(root: ElementTree.Element) -> dict[int, Signals]:
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


def _plates(
    root: ElementTree.Element, to_lab: Array
) -> tuple[dict[int, Signals], tuple[StatedPlate, ...]]:
    """Give what plates send, and how the program describes them."""
    found, described = {}, []
    force, length = (_text(root.find("Force"), f"Unit_{of}") for of in ("Force", "Length"))
    for plate in root.iterfind("Force/Plate"):
        name = _text(plate, "Name")
        number = int(_text(plate, "Plate_ID") or _text(plate, "Force_Plate_Index"))
        channels = _wrench_channels(name, force)
        found[number] = Signals(*describe_signals(name, channels, _rate(plate, name)))
        labels = found[number].description.labels
        try:
            place = place_of(plate, number, length, to_lab)
            described.append(StatedPlate(str(number), labels, place))
        except ValueError as error:
            described.append(StatedPlate(str(number), labels, problem=str(error)))
    return found, tuple(described)


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
