"""What the header of a C3D file says, and how much data the file holds."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pipeline.io.c3d.parameters import (
    BLOCK_BYTES,
    BYTE_ORDERS,
    Parameters,
    decoded_text,
    floats,
    integer_type,
    parse_parameters,
)
from pipeline.io.input_file import open_file

MAX_COUNT: Final = 65535
"""Of a 16-bit number: frame counts stop there or start over."""
NEXT: Final = "copy it from its source again, or export it again"
DATA_STARTS: Final = (("POINT", "DATA_START"), ("ROTATION", "DATA_START"))
"""Parameters that, like the header, say in which block of the file data begin."""
KEY: Final = 0x50
"""Second byte of every C3D file."""
EVENTS_KEY: Final = 12345
"""Of header events with labels of four characters."""


@dataclass(frozen=True, slots=True)
class FrameSize:
    """What one frame holds.

    Attributes
    ----------
    points
        Number of points.
    analog
        Analog samples of all channels together.
    per_channel
        Analog samples of one channel.
    word_bytes
        Bytes of a number: 4 where samples are real, 2 where they are whole.
    """

    points: int
    analog: int
    per_channel: int
    word_bytes: int

    @property
    def channels(self) -> int:
        """Number of analog channels."""
        return self.analog // self.per_channel if self.per_channel else 0

    @property
    def bytes(self) -> int:
        """Size of the frame."""
        return (4 * self.points + self.analog) * self.word_bytes


def correction(place: str, stated: object, used: object) -> str:
    """Say what the file states somewhere, and what is used instead."""
    return f"{place}: {stated}, used: {used}"


def settle_counts(
    path: Path, start: int, header: FrameSize, limits: tuple[int, int], parameters: Parameters
) -> tuple[FrameSize, int, list[str]]:
    """Settle what a frame and a file hold, between what it states and its size.

    Parameters
    ----------
    path, start
        The file, and where its data section begins [bytes].
    header
        What a frame holds by the header.
    limits
        First and last frame number by the header, in 16 bits.
    parameters
        All parameters.

    Returns
    -------
    frame, frames, corrections
        What is true, and which counts are not.

    Raises
    ------
    ValueError
        The file is shorter than any of its counts says, or they contradict each other and its size
        does not prove one of them.

    Notes
    -----
    Header and POINT:FRAMES have 16 bits: they stop at 65535 or start over. TRIAL:ACTUAL_*_FIELD
    and POINT:LONG_FRAMES hold the true number where a program wrote them; otherwise the size of the
    data section decides between the numbers that 16 bits may stand for. A file may be longer than
    its frames, if all its counts agree.
    """
    if not header.bytes:
        raise ValueError("the file holds neither points nor analog channels")
    rates = [parameters.number(group, "RATE", 0.0) for group in ("ANALOG", "POINT")]
    per_channel = rates[0] / rates[1] if min(rates) > 0 else header.per_channel
    per_channel = int(per_channel) if per_channel % 1 == 0 else header.per_channel
    points = parameters.integer("POINT", "USED", header.points)
    channels = parameters.integer("ANALOG", "USED", header.channels)
    stated = header
    if (points, channels) != (header.points, header.channels):
        analog = channels * per_channel
        stated = FrameSize(points, analog, per_channel, header.word_bytes)
    counts = _frame_counts(limits, parameters)
    fitting = [
        (frame, frames)
        for frame in dict.fromkeys((stated, header))
        if (frames := _fitting_frames(path, start, frame, counts)) is not None
    ]
    corrections = []
    if len({frame.bytes for frame, _ in fitting}) == 1:
        frame, frames = fitting[0]
    elif stated == header:
        held = max(path.stat().st_size - start, 0) // header.bytes
        frame, frames = header, _frames_of_longer(held, counts)
        corrections.append(correction("frames by the file's size", held, frames))
    else:
        raise ValueError(
            f"the header says it has {header.points} points and {header.channels} analog channels, "
            f"POINT:USED and ANALOG:USED say {points} and {channels}, and the file's size fits "
            f"{'both' if fitting else 'neither'}: it is truncated or damaged; {NEXT}"
        )
    if frame.channels * frame.per_channel != frame.analog:
        raise ValueError(
            f"{frame.analog} analog samples per frame are not a multiple of {frame.per_channel} "
            "samples per channel"
        )
    compared = (
        ("points in the header", header.points, frame.points),
        ("POINT:USED", points, frame.points),
        ("analog samples in the header", header.analog, frame.analog),
        ("samples per channel in the header", header.per_channel, frame.per_channel),
        ("ANALOG:USED", channels, frame.channels),
    )
    corrections += [correction(*each) for each in compared if each[1] != each[2]]
    corrections += [
        correction(f"frames by {count.place}", count.frames, frames)
        for count in counts
        if not count.allows(frames)
    ]
    return frame, frames, corrections


@dataclass(frozen=True, slots=True)
class _FrameCount:
    """A number of frames as it stands somewhere; in 16 bits it may stop or start over."""

    place: str
    frames: int
    short: bool = False
    stopped: bool = False

    def allows(self, frames: int) -> bool:
        """Whether it may stand for so many frames."""
        apart = frames - self.frames
        started_over = self.short and apart % (MAX_COUNT + 1) == 0
        return apart == 0 or started_over or (self.stopped and apart > 0)


def _frame_counts(limits: tuple[int, int], parameters: Parameters) -> list[_FrameCount]:
    """Give every number of frames that a file states."""
    first, last = limits
    in_header = (last - first + 1) % (MAX_COUNT + 1) or MAX_COUNT + 1
    frames = parameters.integer("POINT", "FRAMES", 0)
    counts = [
        _FrameCount("the header", in_header, short=True, stopped=last == MAX_COUNT),
        _FrameCount("POINT:FRAMES", frames, short=True, stopped=frames == MAX_COUNT),
        _FrameCount("POINT:LONG_FRAMES", parameters.integer("POINT", "LONG_FRAMES", 0)),
    ]
    start, end = (
        parameters.integers("TRIAL", f"ACTUAL_{limit}_FIELD").ravel() for limit in ("START", "END")
    )
    if start.size == 2 and end.size == 2:
        frames = int((end - start) @ [1, MAX_COUNT + 1]) + 1
        counts.append(_FrameCount("TRIAL:ACTUAL_END_FIELD", frames))
    return [count for count in counts if count.frames > 0]


def _fitting_frames(
    path: Path, start: int, frame: FrameSize, counts: list[_FrameCount]
) -> int | None:
    """Give the number of frames that a file states and its size holds; None if they differ."""
    size = path.stat().st_size - start
    held = size // frame.bytes if frame.bytes else 0
    if held <= 0 or any(count.frames > held for count in counts):
        return None
    if held > MAX_COUNT and all(count.short for count in counts):
        written = _written_frames(path, start, frame, held)
        whole = not size % frame.bytes or not (start + size) % BLOCK_BYTES
        stopped = whole and any(count.stopped for count in counts)
        ends = {(count.frames - n) % (MAX_COUNT + 1) for count in counts for n in (written, held)}
        return written if stopped or 0 in ends else None
    lengths = {count.frames: size - count.frames * frame.bytes for count in counts}
    return max((n for n, rest in lengths.items() if 0 <= rest <= BLOCK_BYTES), default=None)


def _written_frames(path: Path, start: int, frame: FrameSize, held: int) -> int:
    """Give the number of frames up to the last one that is not all zero, or fills a block."""
    checked = min(BLOCK_BYTES // frame.bytes + 1, held)
    with path.open("rb") as file:
        file.seek(start + (held - checked) * frame.bytes)
        tail = np.frombuffer(file.read(checked * frame.bytes), np.uint8)
    written = np.flatnonzero(tail.reshape(checked, frame.bytes).any(axis=1))
    return held - checked + (int(written[-1]) + 1 if len(written) else 0)


def _frames_of_longer(held: int, counts: list[_FrameCount]) -> int:
    """Give the number of frames on which all counts of a file agree that is longer than they."""
    frames = max(count.frames for count in counts)
    known = not all(count.stopped for count in counts)
    if known and frames <= held and all(count.allows(frames) for count in counts):
        return frames
    stated = " or ".join(map(str, sorted({count.frames for count in counts})))
    raise ValueError(
        f"the file says it has {stated} frames, but its size holds {held}: it is truncated or "
        f"damaged; {NEXT}"
    )


@dataclass(frozen=True, slots=True)
class Header:
    """The first block of a C3D file.

    Attributes
    ----------
    byte_order
        "intel", "dec" or "sgi": how numbers lie in the rest of the file.
    parameter_block, data_block
        First blocks of the parameter and data sections, from 1.
    frame, frames
        What one frame holds, and how many there are.
    first_frame
        Its number as stored, in 16 bits: too small for long recordings.
    scale
        Units per integer step; negative where the data are floating point.
    rate_hz
        Frame rate [Hz].
    events
        Old-style events: label and time in the file's clock [s].
    corrections
        Which counts the file states wrongly; `settle_counts` gives the true ones.
    """

    byte_order: str
    parameter_block: int
    data_block: int
    frame: FrameSize
    frames: int
    first_frame: int
    scale: float
    rate_hz: float
    events: tuple[tuple[str, float], ...]
    corrections: list[str]

    @property
    def data_start(self) -> int:
        """Where the data section begins [bytes]."""
        return (self.data_block - 1) * BLOCK_BYTES


def read_header(path: Path) -> tuple[Header, Parameters]:
    """Read the header and parameter sections, and settle how much data the file holds.

    All counts and offsets are checked against each other and the file's size as they are read: a
    damaged file gives one line of error (ValueError).
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
        words = np.frombuffer(first, integer_type(byte_order, signed=False)).astype(int).tolist()
        scale, rate_hz = (float(floats(first[k : k + 4], byte_order)[0]) for k in (12, 20))
        data_block = words[8]
        if data_block <= first[0] or not np.isfinite(scale):
            raise ValueError(f"its header names no data section or no scale: damaged; {NEXT}")
        section = file.read((data_block - first[0]) * BLOCK_BYTES - 4)
    parameters = parse_parameters(section, byte_order)
    frame, frames, corrections = settle_counts(
        path,
        (data_block - 1) * BLOCK_BYTES,
        FrameSize(words[1], words[2], words[9], 4 if scale < 0 else 2),
        (words[3], words[4]),
        parameters,
    )
    events = _header_events(first, words, byte_order)
    header = Header(
        byte_order,
        first[0],
        data_block,
        frame,
        frames,
        words[3],
        scale,
        rate_hz,
        events,
        corrections,
    )
    return header, parameters


def _header_events(
    block: bytes, words: list[int], byte_order: str
) -> tuple[tuple[str, float], ...]:
    """Give label and time of the events that old programs write into the header."""
    if words[149] != EVENTS_KEY:
        return ()
    times = floats(block[304:376], byte_order).tolist()[: words[150]]
    return tuple(
        (decoded_text(block[396 + 4 * k : 400 + 4 * k]), time) for k, time in enumerate(times)
    )
