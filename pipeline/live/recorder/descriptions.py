"""What recorded streams carry, in XML as XDF has it, so that the file says it all itself."""

from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element, SubElement

from pipeline.config.live import Live
from pipeline.io.recording import Plate
from pipeline.io.xdf.channels import AXES
from pipeline.io.xdf.plates import COMPONENTS, PLACE
from pipeline.live.stream import LAB_AXES, StreamDescription


def described_streams(
    streams: Sequence[StreamDescription], live: Live, plates: Sequence[Plate]
) -> list[Element]:
    """Describe streams that are received, as `pipeline.io.xdf.read.read_xdf` reads them.

    Parameters
    ----------
    streams
        What is received: positions in lab axes [m], forces in N, moments in N·m.
    live
        Which channels are a plate's.
    plates
        Their places.

    Returns
    -------
    list of Element
        One ``info`` per stream.
    """
    return [_described(stream, live, plates) for stream in streams]


def _described(stream: StreamDescription, live: Live, plates: Sequence[Plate]) -> Element:
    channels = list(
        _markers(stream) if stream.kind == "markers" else _signals(stream, live, plates)
    )
    info = Element("info")
    content = "MoCap" if stream.kind == "markers" else "Analog"
    for part, text in (
        ("name", stream.name),
        ("type", content),
        ("channel_count", str(len(channels))),
        ("nominal_srate", repr(stream.rate_hz)),
        ("channel_format", "double64"),
    ):
        SubElement(info, part).text = text
    desc = SubElement(info, "desc")
    inside = SubElement(desc, "channels")
    for channel in channels:
        one = SubElement(inside, "channel")
        for part, text in channel.items():
            SubElement(one, part).text = text
    if stream.kind == "markers":
        SubElement(desc, "axes").text = LAB_AXES
    own = [p for p in plates if set(live.channels_of(p.number)) <= set(stream.labels)]
    if own and stream.kind == "analog":
        of_plates = SubElement(desc, "plates")
        for plate in own:
            one = SubElement(of_plates, "plate")
            SubElement(one, "number").text = str(plate.number)
            for part in PLACE:
                numbers = getattr(plate, part).ravel().tolist()
                SubElement(one, part).text = " ".join(map(repr, numbers))
    return info


def _markers(stream: StreamDescription) -> Iterator[dict[str, str]]:
    for name in stream.labels:
        for axis in AXES:
            label = f"{name}_{axis}"
            yield {"label": label, "marker": name, "type": f"Position{axis}", "unit": "meters"}


def _signals(
    stream: StreamDescription, live: Live, plates: Sequence[Plate]
) -> Iterator[dict[str, str]]:
    of_plate = {
        channel: {"type": component, "plate": str(plate.number)}
        for plate in plates
        for channel, component in zip(live.channels_of(plate.number), COMPONENTS, strict=True)
    }
    for label, unit in zip(stream.labels, stream.units, strict=True):
        yield {"label": label, "unit": unit, **of_plate.get(label, {})}
