"""What recorded streams carry, in XML as XDF has it, so that the file says it all itself."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

from pipeline.config.live import Live
from pipeline.io.recording import Plate
from pipeline.live.description import describe, stream_channels
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
    channels = stream_channels(stream, live, plates)
    info = Element("info")
    for part, text in (
        ("name", stream.name),
        ("type", "MoCap" if stream.kind == "markers" else "Analog"),
        ("channel_count", str(len(channels))),
        ("nominal_srate", repr(stream.rate_hz)),
        ("channel_format", "double64"),
    ):
        SubElement(info, part).text = text
    if stream.kind == "markers":
        info.append(describe(channels, [("axes", LAB_AXES)]))
    else:
        numbers = {channel.plate for channel in channels}
        own = [plate for plate in plates if str(plate.number) in numbers]
        info.append(describe(channels, plates=own))
    return info
