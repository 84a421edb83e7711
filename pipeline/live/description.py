"""What streams carry, described as `pipeline.io.xdf` and receivers of streams read it."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

from pipeline.config.live import Live
from pipeline.io.recording import Plate
from pipeline.io.xdf.channels import AXES, Channel
from pipeline.io.xdf.plates import COMPONENTS, DFLOW_PLATE, PLACE
from pipeline.live.stream import StreamDescription

PARTS = "label", "unit", "type", "marker", "plate"
"""Of a channel that are described, those that are not empty."""


def describe(
    channels: Sequence[Channel],
    parts: Sequence[tuple[str, str]] = (),
    plates: Sequence[Plate] = (),
) -> Element:
    """Describe a stream.

    Parameters
    ----------
    channels
        What each channel holds.
    parts
        Further parts, such as ``("axes", "forward,left,up")``.
    plates
        Those whose channels are among them; their places are in the axes of the markers.

    Returns
    -------
    Element
        ``desc``.

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

    Parameters
    ----------
    stream
        What it carries.
    live
        Which channels are a plate's.
    plates
        The plates of the session.
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
