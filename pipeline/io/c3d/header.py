"""What the header of a C3D file says, and how much data the file holds."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np

from hbm.notes import Note
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


@dataclass(frozen=True, slots=True)
class FrameCount:
    """A number of frames as it stands somewhere; in 16 bits it may stop or start over."""

    place: str
    frames: int
    short: bool = False
    stopped: bool = False

    def allows(self, frames: int) -> bool:
        """Whether it may stand for so many frames."""
        return self.equals(frames) or (self.stopped and frames >= self.frames)

    def equals(self, frames: int) -> bool:
        """Whether it is that number, as far as it has bits for it."""
        apart = frames - self.frames
        return apart % (MAX_COUNT + 1) == 0 if self.short else apart == 0


@dataclass(frozen=True, slots=True)
class DataSection:
    """A file from its first frame on: where that is, and how many bytes follow."""

    path: Path
    start: int
    size: int

    def fits(self, frame: FrameSize, frames: int) -> bool:
        """Whether it is as long as so many frames, filled up to a block of the file."""
        return 0 <= self.size - frames * frame.bytes <= BLOCK_BYTES

    def is_whole(self, frame: FrameSize) -> bool:
        """Whether it ends with a frame, or with a block of the file."""
        return not self.size % frame.bytes or not (self.start + self.size) % BLOCK_BYTES

    def written_frames(self, frame: FrameSize) -> int:
        """Give the number of frames up to the last one that is not all zero, or fills a block."""
        held = self.size // frame.bytes
        checked = min(BLOCK_BYTES // frame.bytes + 1, held)
        with self.path.open("rb") as file:
            file.seek(self.start + (held - checked) * frame.bytes)
            tail = np.frombuffer(file.read(checked * frame.bytes), np.uint8)
        written = np.flatnonzero(tail.reshape(checked, frame.bytes).any(axis=1))
        return held - checked + (int(written[-1]) + 1 if len(written) else 0)


def settle_counts(
    section: DataSection, header: FrameSize, limits: tuple[int, int], parameters: Parameters
) -> tuple[FrameSize, int, tuple[Note, ...]]:
    """Settle what a frame and a file hold, between what it states and its size.

    Parameters
    ----------
    section
        Where its frames are.
    header
        What a frame holds by the header.
    limits
        First and last frame number by the header, in 16 bits.
    parameters
        All parameters.

    Returns
    -------
    frame, frames, notes
        ``count_contradicted`` for a count that is not true, ``frames_beyond_count`` where the file
        is longer than its frames.

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
    counts = _frame_counts(limits, parameters)
    points = parameters.integer("POINT", "USED", header.points)
    channels = parameters.integer("ANALOG", "USED", header.channels)
    if (points, channels) == (header.points, header.channels):
        frame, (frames, notes) = header, _frames(section, header, counts)
    else:
        frame, frames, notes = _proven(section, header, points, channels, parameters, counts)
    if frame.channels * frame.per_channel != frame.analog:
        raise ValueError(
            f"{frame.analog} analog samples per frame are not a multiple of {frame.per_channel} "
            "samples per channel"
        )
    wrong = (
        (f"the number of frames in {c.place}", c.frames) for c in counts if not c.allows(frames)
    )
    return frame, frames, (*notes, *(_contradicted(place, n, frames) for place, n in wrong))


def _proven(
    section: DataSection,
    header: FrameSize,
    points: int,
    channels: int,
    parameters: Parameters,
    counts: list[FrameCount],
) -> tuple[FrameSize, int, tuple[Note, ...]]:
    """Choose between header and parameters by the file's size; as `settle_counts`."""
    candidates = {header, *_larger(header, points, channels, parameters)}
    fitting = {
        frame: frames
        for frame in candidates
        if (frames := _fitting_frames(section, frame, counts)) is not None
    }
    if len({frame.bytes for frame in fitting}) != 1:
        raise ValueError(
            f"the header says it has {header.points} points and {header.channels} analog channels, "
            f"POINT:USED and ANALOG:USED say {points} and {channels}, and the file's size fits "
            f"{'both' if fitting else 'neither'}: it is truncated or damaged; {NEXT}"
        )
    frame = max(fitting, key=lambda f: ((f.points, f.channels) == (points, channels), f == header))
    stated = (
        ("the number of points in the header", header.points, frame.points),
        ("POINT:USED", points, frame.points),
        ("the number of analog samples in the header", header.analog, frame.analog),
        ("the number of samples per channel in the header", header.per_channel, frame.per_channel),
        ("ANALOG:USED", channels, frame.channels),
    )
    notes = (_contradicted(place, n, held) for place, n, held in stated if n != held)
    return frame, fitting[frame], tuple(notes)


def _frame_counts(limits: tuple[int, int], parameters: Parameters) -> list[FrameCount]:
    """Give every number of frames that a file states."""
    first, last = limits
    in_header = (last - first + 1) % (MAX_COUNT + 1) or MAX_COUNT + 1
    counts = [FrameCount("the header", in_header, short=True, stopped=last == MAX_COUNT)]
    if (frames := parameters.integer("POINT", "FRAMES", 0)) > 0:
        counts.append(FrameCount("POINT:FRAMES", frames, short=True, stopped=frames == MAX_COUNT))
    if (frames := parameters.integer("POINT", "LONG_FRAMES", 0)) > 0:
        counts.append(FrameCount("POINT:LONG_FRAMES", frames))
    start, end = (
        parameters.integers("TRIAL", f"ACTUAL_{limit}_FIELD").ravel() for limit in ("START", "END")
    )
    if start.size == 2 and end.size == 2:
        frames = int((end[0] - start[0]) + (MAX_COUNT + 1) * (end[1] - start[1]) + 1)
        if frames > 0:
            counts.append(FrameCount("TRIAL:ACTUAL_END_FIELD", frames))
    return counts


def _larger(
    header: FrameSize, points: int, channels: int, parameters: Parameters
) -> Iterator[FrameSize]:
    """Give what a frame may hold where the header's numbers are too small."""
    analog_rate, rate = (parameters.number(group, "RATE", 0.0) for group in ("ANALOG", "POINT"))
    per_channel = {header.per_channel}
    if rate > 0 and analog_rate > 0 and (analog_rate / rate) % 1 == 0:
        per_channel.add(int(analog_rate / rate))
    analog = {(header.analog, header.per_channel), *((channels * n, n) for n in per_channel)}
    for used, (samples, each) in product(sorted({header.points, points}), sorted(analog)):
        if used >= header.points and samples >= header.analog:
            yield replace(header, points=used, analog=samples, per_channel=each)


def _frames(
    section: DataSection, frame: FrameSize, counts: list[FrameCount]
) -> tuple[int, tuple[Note, ...]]:
    """Give the number of frames of a file whose counts of points and channels agree."""
    held = section.size // frame.bytes if frame.bytes else 0
    if held <= 0:
        raise ValueError(f"the file holds no data section: it is truncated or damaged; {NEXT}")
    frames = _fitting_frames(section, frame, counts)
    if frames is not None:
        return frames, ()
    frames = max(count.frames for count in counts)
    known = not all(count.stopped for count in counts)
    if known and frames <= held and all(count.allows(frames) for count in counts):
        return frames, (Note.of("frames_beyond_count", frames=frames, held=held),)
    stated = " or ".join(map(str, sorted({count.frames for count in counts})))
    raise ValueError(
        f"the file says it has {stated} frames, but its size holds {held}: it is truncated or "
        f"damaged; {NEXT}"
    )


def _fitting_frames(section: DataSection, frame: FrameSize, counts: list[FrameCount]) -> int | None:
    """Give the number of frames that a file states and its size holds; None if they differ."""
    held = section.size // frame.bytes if frame.bytes else 0
    if held <= 0 or any(count.frames > held for count in counts):
        return None
    if held > MAX_COUNT and all(count.short for count in counts):
        written = section.written_frames(frame)
        stopped = section.is_whole(frame) and any(count.stopped for count in counts)
        started_over = any(count.equals(written) or count.equals(held) for count in counts)
        return written if stopped or started_over else None
    fitting = (count.frames for count in counts if section.fits(frame, count.frames))
    return max(fitting, default=None)


def _contradicted(place: str, stated: int, held: int) -> Note:
    return Note.of("count_contradicted", place=place, stated=stated, held=held)


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
    notes
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
    notes: tuple[Note, ...] = ()

    @property
    def n_points(self) -> int:
        """Points per frame."""
        return self.frame.points

    @property
    def analog_per_frame(self) -> int:
        """Samples of one analog channel per frame."""
        return self.frame.per_channel

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
        if not np.isfinite(scale):
            raise ValueError("the header's scale of points is not a number")
        data_block = words[8]
        blocks = data_block - first[0] if data_block > first[0] else start[2]
        section = file.read(blocks * BLOCK_BYTES - 4 if blocks else 0)
    parameters = parse_parameters(section, byte_order)
    data_start = (data_block - 1) * BLOCK_BYTES
    size = path.stat().st_size - data_start if data_block > first[0] else 0
    frame, frames, notes = settle_counts(
        DataSection(path, data_start, size),
        FrameSize(words[1], words[2], words[9], 4 if scale < 0 else 2),
        (words[3], words[4]),
        parameters,
    )
    header = Header(
        byte_order=byte_order,
        parameter_block=first[0],
        data_block=data_block,
        frame=frame,
        frames=frames,
        first_frame=words[3],
        scale=scale,
        rate_hz=rate_hz,
        events=_header_events(first, words, byte_order),
        notes=notes,
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
