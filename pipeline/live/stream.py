"""Streams of samples as the live chain takes them, whatever sends them."""

from dataclasses import dataclass
from typing import Final, Literal, Protocol

from hbm.spatial import Array

LAB_AXES: Final = "forward,left,up"
"""Axes of all positions, as descriptions state them."""


@dataclass(frozen=True, slots=True)
class StreamDescription:
    """What a stream carries.

    Attributes
    ----------
    name
        The stream's name.
    kind
        "markers" or "analog".
    labels
        Names of markers or of channels.
    units
        One per label; "m" for markers. Forces are in N and moments in N·m; other channels have the
        unit that the sender states.
    rate_hz
        Nominal sampling rate [Hz].

    Examples
    --------
    >>> heels = StreamDescription("Markers", "markers", ("LHEE", "RHEE"), ("m", "m"), 100.0)
    >>> heels.kind
    'markers'
    """

    name: str
    kind: Literal["markers", "analog"]
    labels: tuple[str, ...]
    units: tuple[str, ...]
    rate_hz: float


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples of one stream, in the order in which they arrived.

    Attributes
    ----------
    stream
        The stream's name.
    time
        (N,) [s], one clock for all streams.
    values
        (N, K). Of markers (N, 3 M), x y z of each in lab axes [m]; NaN where one is not seen.
    """

    stream: str
    time: Array
    values: Array


class Source(Protocol):
    """Where samples come from."""

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """What is received, known from the start."""
        ...

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give whatever has arrived; an empty list if nothing does within the timeout [s]."""
        ...

    def close(self) -> None:
        """Stop receiving."""
        ...
