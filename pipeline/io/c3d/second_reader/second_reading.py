"""The second reading of a file: by ezc3d, or by c3d where ezc3d cannot."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pipeline.io.c3d.header import Header
from pipeline.io.c3d.second_reader.process import read_with
from pipeline.io.c3d.second_reader.reading import Reading, Refusal

LIBRARIES: Final = ("ezc3d", "c3d")
"""In the order in which they are tried."""


@dataclass(frozen=True, slots=True)
class SecondReading:
    """A second reading of a file.

    Attributes
    ----------
    reading
        By the first library that read the file; None where none did.
    refusals
        Why those before it did not.
    """

    reading: Reading | None
    refusals: tuple[Refusal, ...]


def second_reading(
    path: Path, header: Header, libraries: Sequence[str] = LIBRARIES
) -> SecondReading:
    """Read a C3D file with a library other than ours.

    Parameters
    ----------
    path
        The file.
    header
        What `read_header` gave for it.
    libraries
        Those to try, in this order.

    Returns
    -------
    SecondReading
        The reading of the first library that reads as many points, channels and frames as the
        file's header states and its size confirms, and why the others before it did not.

    Notes
    -----
    ezc3d 1.7.2 stops at 65,535 frames where a file has a ROTATION group, reads no channel and
    wrong points where ANALOG:RATE is absent, and nothing where there is no POINT group.
    """
    refusals: list[Refusal] = []
    for library in libraries:
        found = read_with(library, path)
        if isinstance(found, Refusal):
            refusals.append(found)
        elif wrong := miscount(found, header):
            name, read, held = wrong
            reason = f"it reads {read} of {held} {name}"
            refusals.append(Refusal(found.reader, reason, miscount=wrong))
        else:
            return SecondReading(found, tuple(refusals))
    return SecondReading(None, tuple(refusals))


def miscount(reading: Reading, header: Header) -> tuple[str, int, int] | None:
    """Name the first number of a reading that is not the file's; None where all are.

    Parameters
    ----------
    reading
        The reading.
    header
        What `read_header` gave for the file.

    Returns
    -------
    tuple[str, int, int] | None
        What was counted, how many were read, how many the file holds.
    """
    frames, channels = header.frames, header.channels
    samples = frames * header.analog_per_frame
    counts = (
        ("frames", len(reading.points) if header.n_points else frames, frames),
        ("points", reading.points.shape[1], header.n_points),
        ("analog channels", reading.analog.shape[1], channels),
        ("samples of a channel", len(reading.analog) if channels else samples, samples),
    )
    return next((count for count in counts if count[1] != count[2]), None)
