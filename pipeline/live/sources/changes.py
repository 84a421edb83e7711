"""What is different about a sender that comes back after it was gone."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Final

import numpy as np

from hbm.spelling import listed, short
from pipeline.io.recording import Plate
from pipeline.io.xdf.channels import Channel
from pipeline.live.stream import StatedPlate, StreamDescription

PLACE_M: Final = 1e-6
"""Numbers of a place that are written anew differ by less."""


def came_back(sender: str, change: str) -> ValueError:
    """Give the error that ends a session: a sender came back, and this is different.

    Examples
    --------
    >>> print(came_back("stream 'Plates'", "a rate of 500 Hz, before 1000 Hz"))
    stream 'Plates' came back with a rate of 500 Hz, before 1000 Hz; begin a new session
    """
    return ValueError(f"{sender} came back with {change}; begin a new session")


def change_of_channels(before: Sequence[Channel], after: Sequence[Channel]) -> str:
    """Say how the channels of a stream differ; empty where they do not.

    Examples
    --------
    >>> change_of_channels([Channel("Fx", "N")], [Channel("Fx", "kN")])
    "'kN' as unit of channel 1, before 'N'"
    """
    if len(before) != len(after):
        return f"{len(after)} channels, before {len(before)}"
    for k, (old, new) in enumerate(zip(before, after, strict=True), 1):
        for name in (field.name for field in fields(Channel)):
            was, has = getattr(old, name), getattr(new, name)
            if was != has:
                return f"{short(has)!r} as {name} of channel {k}, before {short(was)!r}"
    return ""


def change_of_rate(before_hz: float, after_hz: float) -> str:
    """Say how the nominal rates of a stream differ; empty where they do not."""
    if before_hz == after_hz:
        return ""
    return f"a rate of {after_hz:g} Hz, before {before_hz:g} Hz"


def change_of_plates(before: Sequence[StatedPlate], after: Sequence[StatedPlate]) -> str:
    """Say how plates and their places differ; empty where they do not."""
    if (was := [plate.number for plate in before]) != (has := [plate.number for plate in after]):
        return f"plates {listed(has)}, before {listed(was)}"
    for old, new in zip(before, after, strict=True):
        if not _same_place(old.place, new.place):
            return f"another place of plate {new.number}"
        if old.channels != new.channels:
            return f"other channels of plate {new.number}"
    return ""


def change_of_streams(
    before: Sequence[StreamDescription], after: Sequence[StreamDescription]
) -> str:
    """Say how streams of one sender differ; empty where they do not."""
    if (was := [stream.name for stream in before]) != (has := [stream.name for stream in after]):
        return f"{listed(has)}, before {listed(was)}"
    for old, new in zip(before, after, strict=True):
        change = change_of_channels(_channels(old), _channels(new))
        if change := change or change_of_rate(old.rate_hz, new.rate_hz):
            return f"{change}, of {short(new.name)}"
    return ""


def _channels(stream: StreamDescription) -> list[Channel]:
    return [Channel(*each) for each in zip(stream.labels, stream.units, strict=True)]


def _same_place(before: Plate | None, after: Plate | None) -> bool:
    if before is None or after is None:
        return before is after
    return all(
        np.allclose(getattr(before, part), getattr(after, part), rtol=0, atol=PLACE_M)
        for part in ("corners", "rotation", "center")
    )
