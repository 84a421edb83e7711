"""The header of a C3D file, which says where its sections are; read with the parameters.

All counts and offsets are checked against each other and the file's size as they are read: a
damaged file gives one line of error.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
from pipeline.io.c3d.byte_order import BLOCK_BYTES, BYTE_ORDERS, decoded_text, floats, integer_type
from pipeline.io.c3d.counts import DataSection, FrameSize, settle_counts
from pipeline.io.c3d.parameters import Parameters, parse_parameters
from pipeline.io.input_file import open_file

DATA_STARTS: Final = (("POINT", "DATA_START"), ("ROTATION", "DATA_START"))
"""Parameters that, like the header, say in which block of the file data begin."""
KEY: Final = 0x50
"""Second byte of every C3D file."""
EVENTS_KEY: Final = 12345
"""Of header events with labels of four characters."""
MAX_HEADER_EVENTS: Final = 18


@dataclass(frozen=True, slots=True)
class Header:
    """The first block of a C3D file.

    Attributes
    ----------
    byte_order
        "intel", "dec" or "sgi": how numbers lie in the rest of the file.
    parameter_block, data_block
        First blocks of the parameter and data sections, from 1.
    n_points, n_analog
        Points per frame; analog samples per frame, all channels together.
    analog_per_frame
        Samples of one analog channel per frame.
    frames
        Number of frames.
    first_frame, last_frame
        Frame numbers as stored, in 16 bits: too small for long recordings.
    scale
        Units per integer step; negative where the data are floating point.
    rate_hz
        Frame rate [Hz].
    events
        Old-style events: label and time in the file's clock [s].
    notes
        Which counts the file states wrongly; `settle_counts` gives the true ones.
    """

    byte_order: str
    parameter_block: int
    data_block: int
    n_points: int
    n_analog: int
    analog_per_frame: int
    frames: int
    first_frame: int
    last_frame: int
    scale: float
    rate_hz: float
    events: tuple[tuple[str, float], ...]
    notes: tuple[Note, ...] = ()

    @property
    def frame(self) -> FrameSize:
        """What one frame of the data section holds."""
        word_bytes = 4 if self.scale < 0 else 2
        return FrameSize(self.n_points, self.n_analog, self.analog_per_frame, word_bytes)

    @property
    def channels(self) -> int:
        """Number of analog channels."""
        return self.frame.channels

    @property
    def data_start(self) -> int:
        """Where the data section begins [bytes]."""
        return (self.data_block - 1) * BLOCK_BYTES


def read_header(path: Path) -> tuple[Header, Parameters]:
    """Read the header and parameter sections, and settle how much data the file holds.

    Parameters
    ----------
    path
        A C3D file of any byte order.

    Returns
    -------
    Header, Parameters
        The header block with the counts that `settle_counts` gives, and all parameters.

    Raises
    ------
    ValueError
        The file is empty, not a C3D file, its parameter section is broken, it is shorter than it
        says, or its counts contradict each other.
    OSError
        The file cannot be opened.
    """
    with open_file(path) as file:
        first = file.read(BLOCK_BYTES)
        if not first:
            raise ValueError("the file is empty")
        if len(first) < BLOCK_BYTES or first[1] != KEY or first[0] == 0:
            raise ValueError("not a C3D file: it does not begin with a C3D header block")
        file.seek((first[0] - 1) * BLOCK_BYTES)
        start = file.read(4)
        if len(start) < 4 or start[3] not in BYTE_ORDERS:
            raise ValueError("not a C3D file, or its parameter section is missing")
        byte_order = BYTE_ORDERS[start[3]]
        header = _parse_header(first, byte_order)
        if header.data_block > header.parameter_block:
            section = file.read((header.data_block - header.parameter_block) * BLOCK_BYTES - 4)
        else:
            section = file.read(start[2] * BLOCK_BYTES - 4 if start[2] else 0)
    parameters = parse_parameters(section, byte_order)
    return _with_true_counts(header, path, parameters), parameters


def _with_true_counts(header: Header, path: Path, parameters: Parameters) -> Header:
    size = path.stat().st_size - header.data_start
    if header.data_block <= header.parameter_block:
        size = 0
    frame, frames, notes = settle_counts(
        DataSection(path, header.data_start, size),
        header.frame,
        (header.first_frame, header.last_frame),
        parameters,
    )
    return replace(
        header,
        n_points=frame.points,
        n_analog=frame.analog,
        analog_per_frame=frame.per_channel,
        frames=frames,
        notes=notes,
    )


def _parse_header(block: bytes, byte_order: str) -> Header:
    words = np.frombuffer(block, integer_type(byte_order, signed=False)).astype(int)
    scale, rate = (float(floats(block[k : k + 4], byte_order)[0]) for k in (12, 20))
    if not np.isfinite(scale):
        raise ValueError("the header's scale of points is not a number")
    events = []
    if words[149] == EVENTS_KEY:
        times = floats(block[304:376], byte_order)
        for k in range(min(int(words[150]), MAX_HEADER_EVENTS)):
            label = decoded_text(block[396 + 4 * k : 400 + 4 * k])
            events.append((label, float(times[k])))
    return Header(
        byte_order=byte_order,
        parameter_block=block[0],
        data_block=int(words[8]),
        n_points=int(words[1]),
        n_analog=int(words[2]),
        analog_per_frame=int(words[9]),
        frames=0,
        first_frame=int(words[3]),
        last_frame=int(words[4]),
        scale=scale,
        rate_hz=rate,
        events=tuple(events),
    )
