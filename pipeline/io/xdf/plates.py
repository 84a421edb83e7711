"""Force plates among the channels of streams."""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed
from pipeline.io.columns import PlateColumns, plate_of
from pipeline.io.recording import Plate
from pipeline.io.xdf.channels import Channel, si_units

COMPONENTS: Final = ("ForceX", "ForceY", "ForceZ", "MomentX", "MomentY", "MomentZ")
"""Types of a plate's channels: action on the subject about the centre of its surface."""
PLACE: Final = {"corners": (4, 3), "rotation": (3, 3), "center": (3,)}
"""What a description states of a plate's place, in the axes of the markers [m] -> its shape."""

DFLOW_PLATE: Final = re.compile(r"FP(\d+)\.(For|Mom|Cop)([XYZ])")
"""A plate's channel as D-Flow names it, about the origin of the markers' axes."""


@dataclass(frozen=True, slots=True)
class PlateChannels:
    """One plate: where its channels are and where it lies.

    Attributes
    ----------
    number
        From 1.
    columns
        Of Fx Fy Fz Mx My Mz in the plate's axes, (6,).
    factors
        One of their units in N and N·m, (6,).
    corners, rotation, center
        As in `pipeline.io.recording.Plate`.
    """

    number: int
    columns: tuple[int, ...]
    factors: Array
    corners: Array
    rotation: Array
    center: Array

    def plate(self, time: Array, values: Array, to_lab: Array) -> Plate:
        """Make the plate from samples of all channels, (N, K).

        ``to_lab`` turns the axes in which its place is stated to the lab's, (3, 3).
        """
        return Plate(
            self.number,
            time,
            values[:, list(self.columns)] * self.factors,
            to_lab @ self.rotation,
            to_lab @ self.center,
            self.corners @ to_lab.T,
        )


def find_plates(
    info: Element, channels: Sequence[Channel]
) -> tuple[list[PlateChannels], dict[str, str]]:
    """Find the plates of a stream whose six channels and place are described.

    Parameters
    ----------
    info
        The stream's description.
    channels
        Its channels; those of a plate have its number and one of the types ``COMPONENTS``.

    Returns
    -------
    plates
        Those that are complete.
    left_out
        Number of each of the others, as it is written -> why.
    """
    found: dict[str, dict[str, int]] = {}
    for k, channel in enumerate(channels):
        if channel.plate and channel.type in COMPONENTS:
            found.setdefault(channel.plate, {})[channel.type] = k
    places = {(p.findtext("number") or "").strip(): p for p in info.findall("desc/plates/plate")}
    plates, left_out = [], {}
    for number, columns in found.items():
        try:
            place = _place(places[number]) if number in places else None
            if place is None:
                raise ValueError("the stream does not state its place (desc/plates/plate)")
            if absent := [name for name in COMPONENTS if name not in columns]:
                raise ValueError(f"it has no channel for {listed(absent)}")
            if not number.isdecimal():
                raise ValueError("its number is no number")
            of_plate = [columns[component] for component in COMPONENTS]
            units, factors = si_units([channels[k] for k in of_plate])
            if units != ("N",) * 3 + ("N·m",) * 3:
                raise ValueError(f"its units are {listed(units)}, expected N and N·m")
        except ValueError as error:
            left_out[number] = str(error)
            continue
        plates.append(PlateChannels(int(number), tuple(of_plate), factors, *place))
    return plates, left_out


def dflow_plates(
    channels: Sequence[Channel], time: Array, values: Array, described: Collection[int] = ()
) -> Iterator[PlateColumns | Note]:
    """Find the plates whose channels are named as D-Flow names them, such as FP1.ForX.

    ``values`` are the samples of a stream, (N, K), at times, (N,) [s]; plates that are described
    are not looked for.
    """
    named = {
        f"FP{int(match[1])}.{match[2]}{match[3]}": (int(match[1]), k)
        for k, channel in enumerate(channels)
        if (match := DFLOW_PLATE.fullmatch(channel.label)) and int(match[1]) not in described
    }
    columns = {name: values[:, k] for name, (_, k) in named.items()}
    unit = {name: channels[k].unit for name, (_, k) in named.items()}
    for number in dict.fromkeys(number for number, _ in named.values()):
        stems = [f"FP{number}.{part}" for part in ("For", "Mom", "Cop")]
        units = unit.get(f"{stems[0]}X", ""), unit.get(f"{stems[1]}X", ""), "m"
        if f"{stems[2]}X" in columns:
            units = (*units[:2], unit[f"{stems[2]}X"])
        else:
            stems.pop()
        yield plate_of(number, f"plate {number}", time, columns, stems, units=units)


def _place(described: Element) -> tuple[Array, Array, Array]:
    """Give corners, rotation and centre of a plate."""
    found = []
    for part, shape in PLACE.items():
        words = (described.findtext(part) or "").split()
        try:
            numbers = np.array(words, float).reshape(shape)
        except ValueError:
            raise ValueError(f"its {part} are not {np.prod(shape)} numbers") from None
        if part != "corners" and not np.isfinite(numbers).all():
            raise ValueError(f"its {part} has numbers that are not finite")
        if part == "rotation" and not np.allclose(numbers @ numbers.T, np.eye(3), atol=1e-6):
            raise ValueError("its rotation is no rotation")
        found.append(numbers)
    corners, rotation, center = found
    return corners, rotation, center
