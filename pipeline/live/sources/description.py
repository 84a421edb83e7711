"""What a sender says of its channels, and how their samples become SI units and lab axes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from hbm.spatial import Array
from hbm.spelling import short
from pipeline.io.axes import parse_axes
from pipeline.io.columns import DFLOW_PLATE
from pipeline.io.recording import Plate
from pipeline.io.stated import Stated
from pipeline.io.streams import AXES, Channel, find_plates, marker_layout, si_units
from pipeline.live.stream import StatedPlate, StreamDescription

Convert = Callable[[Array], Array]
"""From samples as sent, (N, K), to samples of a `Samples`."""


def describe_markers(
    name: str, channels: Sequence[Channel], rate_hz: float, stated: Stated, axes: str = ""
) -> tuple[StreamDescription, Convert]:
    """Describe a stream of markers, and give what brings its samples to lab axes and m.

    A marker that is not seen becomes NaN. The sender's axes are empty where it does not state them;
    a ValueError says that nobody does, or as `pipeline.io.streams.marker_layout`.
    """
    layout = marker_layout(channels, stated)
    known = stated.axes or axes
    if not known:
        raise ValueError(
            "the axes of its markers are not known; state them, for example --axes "
            'forward,left,up, or axes = "forward,left,up" in study.toml'
        )
    to_lab = parse_axes(known)

    def convert(values: Array) -> Array:
        with np.errstate(invalid="ignore"):  # infinite ones
            found = layout.positions(values).reshape(-1, 3) @ to_lab.T
        return np.asarray(found).reshape(len(values), -1)

    units = ("m",) * len(layout.names)
    return StreamDescription(name, "markers", layout.names, units, rate_hz), convert


def describe_signals(
    name: str, channels: Sequence[Channel], rate_hz: float, axes: str = ""
) -> tuple[StreamDescription, Convert]:
    """Describe a stream of other signals, and give what brings its samples to N and N·m.

    Vectors of plates that are named as D-Flow names them, such as FP1.ForX, FP1.ForY and FP1.ForZ,
    are in the markers' axes as sent, where these are known, and become lab axes.

    Examples
    --------
    >>> channels = [Channel(f"FP1.For{axis}", "kN") for axis in "XYZ"]
    >>> _, convert = describe_signals("Plates", channels, 1000.0, "right,up,back")
    >>> convert(np.array([[0.0, 0.7, -0.1]])).tolist()
    [[100.0, 0.0, 700.0]]
    """
    units, factors = si_units(channels)
    labels = tuple(channel.label for channel in channels)
    description = StreamDescription(name, "analog", labels, units, rate_hz)
    vectors: dict[str, list[int]] = {}
    for k, label in enumerate(labels):
        if DFLOW_PLATE.fullmatch(label):
            vectors.setdefault(label[:-1], []).append(k)
    if not vectors or not axes:
        return description, lambda values: np.asarray(values * factors, float)
    to_si, to_lab = np.diag(factors), parse_axes(axes)
    for stem, columns in vectors.items():
        if [labels[k] for k in columns] == [f"{stem}{axis}" for axis in AXES]:
            to_si[np.ix_(columns, columns)] = np.diag(factors[columns]) @ to_lab.T

    def convert(values: Array) -> Array:
        with np.errstate(invalid="ignore"):  # infinite ones
            return np.asarray(values @ to_si, float)

    return description, convert


def describe_plates(
    info: Element, channels: Sequence[Channel], axes: str
) -> tuple[StatedPlate, ...]:
    """Describe the plates of a stream, from its description, whose root is ``info``.

    They are those that channels name, as `pipeline.io.streams.find_plates` finds them, and those
    whose channels are named as D-Flow names them: these are about the lab's origin, in lab axes as
    `describe_signals` gives them. The axes, in which places are stated, are the markers'. A
    ValueError says that channels of a plate have no labels of their own, by which they are found.
    """
    found, left_out = find_plates(info, channels)
    every, to_lab = [channel.label for channel in channels], parse_axes(axes)
    no_time, no_values = np.empty(0), np.empty((0, len(channels)))
    plates = []
    for plate in found:
        labels = tuple(every[column] for column in plate.columns)
        if doubtful := [label for label in labels if not label or every.count(label) > 1]:
            raise ValueError(
                f"plate {plate.number}: the label {short(doubtful[0])!r} of a channel is "
                f"{'that of another one too' if doubtful[0] else 'empty'}; give each its own"
            )
        place = plate.plate(no_time, no_values, to_lab)
        plates.append(StatedPlate(str(plate.number), labels, place))
    described = {plate.number for plate in plates}
    plates += [plate for plate in _dflow_plates(every) if plate.number not in described]
    return (*plates, *(StatedPlate(number, problem=why) for number, why in left_out.items()))


def _dflow_plates(labels: Sequence[str]) -> Iterator[StatedPlate]:
    """Find plates all of whose channels are named as D-Flow names them."""
    matches = [match for label in labels if (match := DFLOW_PLATE.fullmatch(label))]
    for number in dict.fromkeys(match[1] for match in matches):
        six = tuple(f"FP{number}.{quantity}{axis}" for quantity in ("For", "Mom") for axis in AXES)
        if all(labels.count(label) == 1 for label in six):
            empty = np.empty(0)
            place = Plate.at_origin(int(number), empty, empty.reshape(0, 6))
            yield StatedPlate(str(int(number)), six, place)


PLACE_M: Final = 1e-6
"""Numbers of a place that are written anew differ by less."""


def require_same(
    sender: str,
    described: Mapping[str, tuple[object, object]],
    before: Sequence[StatedPlate],
    after: Sequence[StatedPlate],
) -> None:
    """Refuse a sender that came back and describes something or its plates otherwise than before.

    Examples
    --------
    >>> require_same("stream 'Plates'", {"rate": (1000.0, 500.0)}, (), ())
    Traceback (most recent call last):
    ValueError: stream 'Plates' came back with another rate; begin a new session
    """
    different = [what for what, (old, new) in described.items() if old != new]
    if len(before) != len(after) or not all(map(_same_plate, before, after)):
        different.append("description of its plates")
    if different:
        raise ValueError(f"{sender} came back with another {different[0]}; begin a new session")


def _same_plate(before: StatedPlate, after: StatedPlate) -> bool:
    old, new = before.place, after.place
    if (before.number, before.channels) != (after.number, after.channels):
        return False
    if old is None or new is None:
        return old is new
    return all(
        np.allclose(getattr(old, part), getattr(new, part), rtol=0, atol=PLACE_M)
        for part in ("corners", "rotation", "center")
    )
