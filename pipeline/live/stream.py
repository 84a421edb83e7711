"""Streams of samples as the live chain takes them, whatever sends them."""

from dataclasses import dataclass
from typing import Final, Literal, Protocol

from hbm.spatial import Array
from pipeline.io.recording import Plate

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
    clock_set_s
        By how much the sender's clock was set before one of them [s]; 0 where it went on.
    """

    stream: str
    time: Array
    values: Array
    clock_set_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class StatedPlate:
    """A plate as a sender describes it.

    Attributes
    ----------
    number
        As the sender writes it.
    channels
        Labels of its Fx Fy Fz Mx My Mz, in its own axes about the centre of its surface; empty
        where they are not stated.
    place
        Where it lies in the lab, without samples; None where that is not stated.
    problem
        Why there is no place.
    """

    number: str
    channels: tuple[str, ...] = ()
    place: Plate | None = None
    problem: str = ""


class Source(Protocol):
    """Where samples come from."""

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """What is received, known from the start."""
        ...

    @property
    def plates(self) -> tuple[StatedPlate, ...]:
        """Plates as the streams' descriptions state them; empty where they state none."""
        ...

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give whatever has arrived; an empty list if nothing does within the timeout [s]."""
        ...

    def close(self) -> None:
        """Stop receiving."""
        ...
