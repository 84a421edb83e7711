"""What a stream of Lab Streaming Layer says of itself."""

from dataclasses import dataclass
from typing import Any

from hbm.spelling import printable, short
from pipeline.io.stated import Stated
from pipeline.io.xdf.channels import Channel, parse_channels, parse_xml
from pipeline.live.sources.changes import change_of_channels, change_of_plates, change_of_rate
from pipeline.live.sources.description import (
    Convert,
    describe_markers,
    describe_plates,
    describe_signals,
)
from pipeline.live.stream import StatedPlate, StreamDescription


@dataclass(frozen=True, slots=True, eq=False)
class LslDescription:
    """A stream as its sender and a person describe it.

    Attributes
    ----------
    channels
        As the sender describes them.
    axes
        The markers': those that a person states, else the sender's; None where they are not known.
    stream, plates
        What is received.
    convert
        From samples as sent to those that are received.
    """

    channels: tuple[Channel, ...]
    axes: str | None
    stream: StreamDescription
    plates: tuple[StatedPlate, ...]
    convert: Convert

    def change_from(self, before: "LslDescription") -> str:
        """Say what is different, of what numbers depend on; empty where nothing is."""
        return (
            change_of_channels(before.channels, self.channels)
            or change_of_rate(before.stream.rate_hz, self.stream.rate_hz)
            or (f"axes {self.axes!r}, before {before.axes!r}" if self.axes != before.axes else "")
            or change_of_plates(before.plates, self.plates)
        )


def read_description(info: Any, stated: Stated, *, is_markers: bool) -> LslDescription:
    """Read the description of a stream.

    Parameters
    ----------
    info
        The whole of it, ``pylsl.StreamInfo``.
    stated
        What a person states about it.
    is_markers
        Whether it holds the markers.

    Raises
    ------
    ValueError
        It lacks something or contradicts itself.
    """
    name = info.name()
    try:
        root = parse_xml(info.as_xml())
        if (root.findtext("channel_format") or "") == "string":
            raise ValueError("it sends text, not numbers")
        channels = parse_channels(root, info.channel_count())
        what = name, channels, float(info.nominal_srate())
        if not is_markers:
            stream, convert = describe_signals(*what, stated.axes or "")
            plates = describe_plates(root, channels, stated.axes or "")
            return LslDescription(channels, stated.axes, stream, plates, convert)
        written = printable((root.findtext("desc/axes") or "").strip())
        stream, convert = describe_markers(*what, stated, written)
        return LslDescription(channels, stated.axes or written or None, stream, (), convert)
    except ValueError as error:
        raise ValueError(f"stream {short(name)!r}: {error}") from error
