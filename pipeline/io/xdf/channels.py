"""Channels of a stream as its description states them: labels, markers, units.

The conventions are those of XDF's meta-data (https://github.com/sccn/xdf/wiki), which Lab Streaming
Layer shares.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.labels import marker_columns
from pipeline.io.stated import Stated
from pipeline.io.units import force_in_n, moment_in_nm

MOCAP: Final = "mocap"
"""Content type of motion capture, in whatever case."""
POSITION: Final = re.compile(r"Position([XYZ])", re.IGNORECASE)
"""Type of a channel that holds a coordinate of a position."""
COORDINATE: Final = re.compile(r"(.+?)[._ -](?:Pos)?([XYZ])", re.IGNORECASE)
"""Label of a marker's channel, such as LASIS_X or LASIS.PosX."""
AXES: Final = "XYZ"
CONTROL: Final = re.compile(
    r"[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]"
    r"|&#(0*([0-8]|1[124-9]|2\d|3[01])|x0*([0-8bcef]|1[\da-f]));",
    re.IGNORECASE,
)
"""Characters that XML may not hold, as they are or by their number."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel; what its description does not state is empty.

    Attributes
    ----------
    label, unit
        As the sender writes them.
    type
        What it holds, such as "PositionX".
    marker, plate
        The marker or the number of the plate that it is of.
    """

    label: str
    unit: str = ""
    type: str = ""
    marker: str = ""
    plate: str = ""


@dataclass(frozen=True, slots=True)
class MarkerLayout:
    """Where the coordinates of markers are among the channels of a stream.

    Attributes
    ----------
    names
        Of the M markers.
    columns
        Columns of x, y and z of each marker, (3 M,).
    metre, unit
        One of the channels' unit [m], and that unit as the sender writes it.
    subject
        Prefix that was removed from the labels; empty where there was none.
    notes
        On labels.
    """

    names: tuple[str, ...]
    columns: tuple[int, ...]
    metre: float
    unit: str
    subject: str
    notes: Sequence[Note]

    def positions(self, values: Array) -> Array:
        """Give marker positions, (N, 3 M) [m], from samples of all channels, (N, K).

        A marker at exactly the origin was not seen, as most programs write it; it becomes NaN.
        """
        position = np.take(values, self.columns, axis=1).astype(float, copy=False)
        position *= self.metre
        of_marker = position.reshape(len(position), -1, 3)
        of_marker[~of_marker.any(axis=-1)] = np.nan
        return position


def parse_xml(text: str) -> Element:
    """Parse what a stream says of itself, with "?" in place of control characters; a ValueError."""
    try:
        return ElementTree.fromstring(CONTROL.sub("?", text))
    except ElementTree.ParseError as error:
        raise ValueError(f"its description is no XML: {error}; correct it in the sender") from error


def parse_channels(info: Element, count: int) -> tuple[Channel, ...]:
    """Give the channels of a stream.

    Parameters
    ----------
    info
        The stream's description, whose root is ``info``.
    count
        How many channels it sends.

    Returns
    -------
    tuple of Channel
        One per channel sent; where no channel is described, their labels are numbers from 1.

    Raises
    ------
    ValueError
        Another number of channels is described than is sent.

    Examples
    --------
    >>> from xml.etree.ElementTree import fromstring
    >>> channel = "<channel><label>Fz</label><unit>kN</unit></channel>"
    >>> info = fromstring(f"<info><desc><channels>{channel}</channels></desc></info>")
    >>> parse_channels(info, 1)
    (Channel(label='Fz', unit='kN', type='', marker='', plate=''),)
    """
    described = info.findall("desc/channels/channel")
    if not described:
        return tuple(Channel(str(number)) for number in range(1, count + 1))
    if len(described) != count:
        raise ValueError(f"it describes {len(described)} channels, but sends {count}")
    return tuple(
        Channel(
            *(
                printable((channel.findtext(part) or "").strip())
                for part in ("label", "unit", "type", "marker", "plate")
            )
        )
        for channel in described
    )


def has_markers(content_type: str, channels: Sequence[Channel]) -> bool:
    """Whether a stream holds positions of markers, by its content type or its channels' types."""
    by_label = content_type.lower() == MOCAP and any(
        COORDINATE.fullmatch(c.label) for c in channels
    )
    return by_label or any(POSITION.fullmatch(c.type) for c in channels)


def marker_layout(channels: Sequence[Channel], stated: Stated) -> MarkerLayout:
    """Find the coordinates of markers among the channels of a stream.

    Parameters
    ----------
    channels
        Of the stream.
    stated
        What a person states about it: units, labels to rename, the prefix of the subject.

    Returns
    -------
    MarkerLayout
        Markers in the order of the channels. Channels of type PositionX, PositionY and PositionZ
        belong to the marker that they name, or that their label names; where no type is stated,
        labels such as LASIS_X and LASIS.PosX count. Positions of rigid bodies do not count where
        markers are named.

    Raises
    ------
    ValueError
        There are no such channels, a coordinate is absent or doubled, units are unknown or differ,
        or the labels fault as `pipeline.io.labels.marker_columns` says.
    """
    found = _coordinates(channels)
    if not found:
        raise ValueError(
            "no markers: no channel of type PositionX and no label such as LASIS_X; labels there: "
            f"{listed([channel.label for channel in channels][:5])}"
        )
    stems = list(dict.fromkeys(stem for stem, _ in found))
    if absent := [(stem, axis) for stem in stems for axis in AXES if (stem, axis) not in found]:
        stem, axis = absent[0]
        raise ValueError(f"marker {short(stem)!r} has no channel for {axis}")
    units = dict.fromkeys(channels[k].unit for k in found.values())
    if len(units) > 1:
        raise ValueError(f"the markers' channels have several units: {listed(units)}")
    (unit,) = units
    metre = stated.metre(unit)
    markers, subject, notes = marker_columns(stems, stated)
    columns = tuple(found[stems[k], axis] for k in markers.values() for axis in AXES)
    return MarkerLayout(tuple(markers), columns, metre, unit, subject, notes)


def si_units(channels: Sequence[Channel]) -> tuple[tuple[str, ...], Array]:
    """Give the channels' units with forces in N and moments in N·m, and the factors to them, (K,).

    Examples
    --------
    >>> units, factors = si_units([Channel("Fz", "kN"), Channel("Mx", "Nmm"), Channel("A", "V")])
    >>> units, factors.tolist()
    (('N', 'N·m', 'V'), [1000.0, 0.001, 1.0])
    """
    converted = [_si_unit(channel.unit) for channel in channels]
    return tuple(unit for unit, _ in converted), np.array([factor for _, factor in converted])


def _si_unit(unit: str) -> tuple[str, float]:
    for si, convert in (("N", force_in_n), ("N·m", moment_in_nm)):
        try:
            return si, convert(unit)
        except ValueError:
            continue
    return unit, 1.0


def _coordinates(channels: Sequence[Channel]) -> dict[tuple[str, str], int]:
    """Give marker and axis -> column."""
    typed = any(POSITION.fullmatch(channel.type) for channel in channels)
    named = any(channel.marker for channel in channels)
    found: dict[tuple[str, str], int] = {}
    for k, channel in enumerate(channels):
        label = COORDINATE.fullmatch(channel.label)
        axis = POSITION.fullmatch(channel.type) if typed else label
        if axis is None or (typed and named and not channel.marker):
            continue
        stem = channel.marker or (label[1] if label else channel.label)
        key = stem, axis[axis.re.groups].upper()
        if key in found:
            raise ValueError(f"marker {short(stem)!r} has several channels for {key[1]}")
        found[key] = k
    return found
