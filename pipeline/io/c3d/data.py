"""What a C3D file holds: its header, how much data there is, and the samples with their scales.

Samples are decoded in slices straight from the file, so that the memory needed is that of the
arrays that are returned, for a trial of any length.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hbm.numbers import read_numbers
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
from pipeline.io.read_options import without_impossible
from pipeline.io.recording import Fact

MAX_COUNT: Final = 65535
"""Of a 16-bit number: frame counts stop there or start over."""
NEXT: Final = "copy it from its source again, or export it again"
BY_HEADER: Final = "frames by the header"
BY_TRIAL: Final = "frames by TRIAL:ACTUAL_END_FIELD"
"""Where a file states the numbers of its first and last frame."""
DATA_STARTS: Final = (("POINT", "DATA_START"), ("ROTATION", "DATA_START"))
"""Parameters that, like the header, say in which block of the file data begin."""
KEY: Final = 0x50
"""Second byte of every C3D file."""
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "c3d")


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


def correction(place: str, written: object, used: object) -> Fact:
    """Say what the file states somewhere, and what is used instead."""
    return Fact("corrected", place, f"{written} there, {used} used")


def settle_counts(
    path: Path, start: int, header: FrameSize, limits: tuple[int, int], parameters: Parameters
) -> tuple[FrameSize, int, list[Fact]]:
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
        The file is shorter than its counts say, or they contradict each other and its size does not
        prove one of them.

    Notes
    -----
    Of all that the counts may mean together, the file holds what fits its size and contradicts the
    fewest of them. Counts that are larger by more than one may not outnumber those that agree with
    the size: then the file is truncated.

    Header and POINT:FRAMES have 16 bits: they stop at 65535 or start over. TRIAL:ACTUAL_*_FIELD
    and POINT:LONG_FRAMES hold the true number where a program wrote them; otherwise the size of the
    data section decides between the numbers that 16 bits may stand for. A file may be longer than
    its frames, if all its counts agree.
    """
    points = parameters.integer("POINT", "USED", header.points)
    channels = parameters.integer("ANALOG", "USED", header.channels)
    rates = [parameters.number(group, "RATE", 0.0) for group in ("ANALOG", "POINT")]
    ratio = rates[0] / rates[1] if min(rates) > 0 else np.nan
    by_rates = int(ratio) if ratio % 1 == 0 else header.per_channel
    # what a frame may hold, by all that header and parameters say
    sizes = [
        FrameSize(p, samples, per if samples else header.per_channel, header.word_bytes)
        for p, per in product((header.points, points), (header.per_channel, by_rates))
        for samples in (header.analog, channels * per)
    ]
    whole = (size for size in sizes if size.channels * size.per_channel == size.analog)
    data_bytes = max(path.stat().st_size - start, 0)
    held = {frame: data_bytes // frame.bytes for frame in whole if frame.bytes}
    counts = _frame_counts(limits, parameters)
    settled = list[tuple[int, bool, int, FrameSize, list[Fact]]]()
    for frame in held:
        places = [
            ("points in the header", header.points, frame.points),
            ("POINT:USED", points, frame.points),
            ("analog samples in the header", header.analog, frame.analog),
            ("ANALOG:USED", channels, frame.channels),
        ]
        if frame.channels:
            per_channel = header.per_channel, frame.per_channel
            places.append(("samples per channel in the header", *per_channel))
        wrong = [correction(*place) for place in places if place[1] != place[2]]
        # frame_rate_hz says which rate is wrong
        wrong_rates = bool(frame.channels) and by_rates != frame.per_channel
        written = _written_frames(path, start, frame, held[frame])
        complete = not data_bytes % frame.bytes or not (start + data_bytes) % BLOCK_BYTES
        for frames in {written, held[frame], *(count.frames for count in counts)}:
            facts = [*wrong]
            apart = [count for count in counts if not count.allows(frames)]
            facts += [correction(c.place, c.frames, frames) for c in apart]
            # programs fill the last block; a longer rest is of something else
            rest = data_bytes - frames * frame.bytes
            if rest > BLOCK_BYTES and len({size.bytes for size in held}) == 1:
                facts.append(correction("frames by the file's size", held[frame], frames))
                possible = not apart and not all(count.stopped for count in counts)
            else:
                possible = 0 <= rest <= BLOCK_BYTES and _agree(counts, frames, complete)
            if possible and frames > 0:
                settled.append((len(facts) + wrong_rates, frames != written, -frames, frame, facts))
    # the fewest wrong counts, and no other size of a frame with as few
    best = min(settled, key=lambda candidate: candidate[:3], default=None)
    if best and all(other[3] == best[3] for other in settled if other[:2] == best[:2]):
        return best[3], -best[2], best[4]
    numbers = [c.frames for c in counts], (header.points, points), (header.channels, channels)
    counted = (" or ".join(map(str, sorted({*n}))) for n in (*numbers, held.values()))
    n_frames, n_points, n_channels, fitting = counted
    raise ValueError(
        f"the file says it has {n_frames} frames of {n_points} points and {n_channels} analog "
        f"channels, but its size holds {fitting or 'none'}: it is truncated or damaged; {NEXT}"
    )


@dataclass(frozen=True, slots=True)
class _FrameCount:
    """A number of frames as it stands somewhere; in 16 bits it may stop or start over."""

    place: str
    frames: int
    short: bool = False
    stopped: bool = False

    def confirms(self, frames: int) -> bool:
        """Whether it says that there are so many frames, or as many in 16 bits."""
        apart = frames - self.frames
        return not apart or (self.short and not self.stopped and apart % (MAX_COUNT + 1) == 0)

    def allows(self, frames: int) -> bool:
        """Whether it may stand for so many frames."""
        return self.confirms(frames) or (self.stopped and frames > self.frames)


def _frame_counts(limits: tuple[int, int], parameters: Parameters) -> list[_FrameCount]:
    """Give every number of frames that a file states."""
    first, last = limits
    in_header = (last - first + 1) % (MAX_COUNT + 1) or MAX_COUNT + 1
    frames = parameters.integer("POINT", "FRAMES", 0)
    counts = [
        _FrameCount(BY_HEADER, in_header, short=True, stopped=last == MAX_COUNT),
        _FrameCount("frames by POINT:FRAMES", frames, short=True, stopped=frames == MAX_COUNT),
        _FrameCount("frames by POINT:LONG_FRAMES", parameters.integer("POINT", "LONG_FRAMES", 0)),
    ]
    start, end = (
        parameters.integers("TRIAL", f"ACTUAL_{limit}_FIELD").ravel() for limit in ("START", "END")
    )
    counts = [count for count in counts if count.frames > 0]
    if start.size == 2 and end.size == 2:
        frames = int((end - start) @ [1, MAX_COUNT + 1]) + 1
        counts.append(_FrameCount(BY_TRIAL, frames))
    return counts


def _agree(counts: list[_FrameCount], frames: int, complete: bool) -> bool:
    """Whether counts agree on a number of frames; if most are larger, the file is truncated.

    Of a file that ends with a frame or block, counts that are larger by one are errors in counting.
    """
    agreeing = sum(count.confirms(frames) for count in counts)
    larger = sum(not c.allows(frames) and c.frames - frames > complete for c in counts)
    unending = complete and all(c.short for c in counts) and any(c.stopped for c in counts)
    return larger <= agreeing and (agreeing > 0 or unending)


def _written_frames(path: Path, start: int, frame: FrameSize, held: int) -> int:
    """Give the number of frames up to the last one that is not all zero, or fills a block."""
    checked = min(BLOCK_BYTES // frame.bytes + 1, held)
    with path.open("rb") as file:
        file.seek(start + (held - checked) * frame.bytes)
        tail = np.frombuffer(file.read(checked * frame.bytes), np.uint8)
    written = np.flatnonzero(tail.reshape(checked, frame.bytes).any(axis=1))
    return held - checked + (int(written[-1]) + 1 if len(written) else 0)


@dataclass(frozen=True, slots=True)
class Header:
    """What a C3D file says of itself.

    Attributes
    ----------
    path, parameters
        The file, and its parameter section.
    byte_order
        "intel", "dec" or "sgi": how numbers lie in the rest of the file.
    parameter_block, data_block
        First blocks of the parameter and data sections, from 1.
    frame, frames
        What one frame holds, and how many there are.
    corrections
        Which counts the file states wrongly; `settle_counts` gives the true ones.
    first_frame
        Its number as stored, in 16 bits: too small for long recordings.
    scale
        Units per integer step; negative where the data are floating point.
    rate_hz
        Frame rate [Hz].
    events
        Old-style events: label and time in the file's clock [s].
    """

    path: Path
    parameters: Parameters
    byte_order: str
    parameter_block: int
    data_block: int
    frame: FrameSize
    frames: int
    corrections: list[Fact]
    first_frame: int
    scale: float
    rate_hz: float
    events: tuple[tuple[str, float], ...]

    @property
    def channels(self) -> list[tuple[str, str]]:
        """Label and unit of each analog channel; a number and nothing where there are none."""
        count = self.frame.channels
        names, units = (self.parameters.texts("ANALOG", of)[:count] for of in ("LABELS", "UNITS"))
        names += [f"channel_{k + 1}" for k in range(len(names), count)]
        return list(zip(names, units + [""] * (count - len(units)), strict=True))

    @property
    def data_start(self) -> int:
        """Where the data section begins [bytes]."""
        return (self.data_block - 1) * BLOCK_BYTES


def read_header(path: Path) -> Header:
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
    data_start = (data_block - 1) * BLOCK_BYTES
    in_header = FrameSize(words[1], words[2], words[9], 4 if scale < 0 else 2)
    counts = settle_counts(path, data_start, in_header, (words[3], words[4]), parameters)
    # 12345 says that header events have labels of four characters
    n_events = words[150] if words[149] == 12345 else 0
    times = floats(first[304:376], byte_order).tolist()[:n_events]
    events = tuple(
        (decoded_text(first[396 + 4 * k : 400 + 4 * k]), time) for k, time in enumerate(times)
    )
    places = byte_order, first[0], data_block
    return Header(path, parameters, *places, *counts, words[3], scale, rate_hz, events)


@dataclass(frozen=True, slots=True)
class Samples:
    """Raw samples in the file's own units and axes.

    Attributes
    ----------
    points
        Coordinates of the wanted points, (T, P, 3); missing samples are NaN.
    analog
        Scaled analog samples, (T · samples per frame, channels).
    rate_hz, analog_rate_hz
        Sampling rates [Hz].
    corrections
        What the file states wrongly or not at all about rates, offsets and scales.
    impossible
        How many samples of each channel cannot have been measured; they are NaN.
    """

    points: NDArray[np.float64]
    analog: NDArray[np.float64]
    rate_hz: float
    analog_rate_hz: float
    corrections: list[Fact]
    impossible: NDArray[np.int_]


def read_samples(header: Header) -> Samples:
    """Read all points and analog channels.

    Parameters
    ----------
    header
        What `read_header` gave.

    Returns
    -------
    Samples
        Points with gaps as NaN, and scaled analog samples.

    Raises
    ------
    ValueError
        Rates, counts or sizes contradict each other, or the file is truncated.

    Notes
    -----
    A point is missing where its residual is negative or all three coordinates are exactly zero.
    Analog value = (sample − OFFSET) · SCALE · GEN_SCALE, for integer and real files alike.
    """
    frame = header.frame
    n_points, per_frame, channels = frame.points, frame.per_channel, frame.channels
    rate, rate_corrections = frame_rate_hz(header)
    point_scale = header.parameters.number("POINT", "SCALE", header.scale)
    apart = abs(point_scale / header.scale - 1) if header.scale > 0 else 0.0
    if point_scale * header.scale <= 0 or apart > LIMITS.largest_scale_difference:
        raise ValueError(
            f"the header scales points by {header.scale:.5g}, but POINT:SCALE says "
            f"{point_scale:.5g}: one of them is wrong, and with it all positions; export the file "
            "again"
        )
    frames, real, order = header.frames, header.scale < 0, header.byte_order
    offset, scale, scale_corrections = analog_scaling(header)
    # every coordinate and channel in one piece of memory, as markers have it
    points = np.moveaxis(np.empty((n_points, 3, frames)), -1, 0)
    analog = np.empty((channels, frames, per_frame))
    offset, scale = offset[:, None, None], scale[:, None, None]
    impossible = np.zeros(channels, int)
    with header.path.open("rb") as file, np.errstate(invalid="ignore", over="ignore"):
        file.seek(header.data_start)
        # half a megabyte at a time: much for NumPy, and little for a processor's cache
        for start in range(0, frames, 512):
            stop = min(start + 512, frames)
            data = file.read((stop - start) * frame.bytes)
            numbers = floats(data, order) if real else np.frombuffer(data, integer_type(order))
            words: NDArray[np.number] = numbers.reshape(stop - start, -1)
            raw = words[:, : 4 * n_points].reshape(stop - start, n_points, 4)
            raw_analog = words[:, 4 * n_points :].reshape(stop - start, per_frame, channels)
            if not real:
                raw = raw * np.array([header.scale, header.scale, header.scale, 1])
                raw_analog = raw_analog.view(integer_type(order, signed=not is_unsigned(header)))
            x, y, z, residual = np.moveaxis(raw, -1, 0)
            is_seen = np.isfinite(x + y + z) & ((x != 0) | (y != 0) | (z != 0)) & (residual >= 0)
            points[start:stop] = raw[..., :3]
            points[start:stop][~is_seen] = np.nan
            values = analog[:, start:stop]
            values[:] = np.moveaxis(raw_analog, -1, 0)
            values -= offset
            values *= scale
            impossible += without_impossible(values)
    corrections = [*rate_corrections, *scale_corrections]
    samples = analog.reshape(channels, frames * per_frame).T
    return Samples(points, samples, rate, rate * per_frame, corrections, impossible)


def frame_rate_hz(header: Header) -> tuple[float, list[Fact]]:
    """Give the frame rate, which stands in up to three places, and which of them are wrong.

    It is that of POINT:RATE, else of the header, else of ANALOG:RATE by the samples per frame [Hz];
    where one of them contradicts two that agree, it is theirs. A ValueError where none of them
    states a rate that a camera has, or they contradict each other by more than rounding.
    """
    parameters = header.parameters
    places = {"the header": header.rate_hz}
    if parameters.numbers("POINT", "RATE").size:
        places = {"POINT:RATE": parameters.number("POINT", "RATE", np.nan), **places}
    if header.frame.channels and parameters.numbers("ANALOG", "RATE").size:
        analog_rate = parameters.number("ANALOG", "RATE", np.nan)
        places["ANALOG:RATE and the samples per frame"] = analog_rate / header.frame.per_channel
    shown = {k: f"{hz:g} Hz" if np.isfinite(hz) else "no number" for k, hz in places.items()}
    by_place = ", ".join(f"{text} by {place}" for place, text in shown.items())
    (lowest, highest), same = LIMITS.rates, LIMITS.largest_rate_difference
    rates = [hz for hz in places.values() if lowest <= hz <= highest]
    agreeing = [sum(abs(hz / other - 1) <= same for hz in rates) for other in rates]
    if len(rates) != 1 and 2 * max(agreeing, default=0) <= len(rates):
        raise ValueError(
            f"the frame rate is {by_place}, expected one between {lowest:g} and "
            f"{highest:g} Hz on which most places agree; export the file again"
        )
    rate = rates[agreeing.index(max(agreeing))]
    wrong = [k for k, hz in places.items() if not abs(hz / rate - 1) <= LIMITS.rounded_rate]
    return rate, [correction(f"rate by {k}", shown[k], f"{rate:g} Hz") for k in wrong]


def is_unsigned(header: Header) -> bool:
    """Whether integer samples of analog channels have no sign."""
    return header.parameters.text("ANALOG", "FORMAT").upper() == "UNSIGNED"


def analog_scaling(header: Header) -> tuple[NDArray[np.float64], NDArray[np.float64], list[Fact]]:
    """Give offset and scale of each channel: value = (sample − offset) · scale, (channels,) each.

    An absent ANALOG:OFFSET is taken as 0, an absent ANALOG:SCALE as 1 where samples are real and
    every channel has a unit, which corrections say. A ValueError where either is absent otherwise,
    or has fewer values than there are channels.
    """
    channels, unsigned, parameters = header.frame.channels, is_unsigned(header), header.parameters
    real, general = header.scale < 0, parameters.number("ANALOG", "GEN_SCALE", 1.0)
    with_units = len([*filter(None, parameters.texts("ANALOG", "UNITS")[:channels])]) == channels
    settled, corrections = [], []
    for name, usual, may_lack in (
        ("OFFSET", 0, real or not unsigned),
        ("SCALE", 1, real and with_units and general == 1),
    ):
        signless = unsigned and name == "OFFSET"
        values = (parameters.integers if signless else parameters.numbers)("ANALOG", name).ravel()
        if may_lack and channels and not values.size:
            values = np.full(channels, usual)
            corrections.append(correction(f"ANALOG:{name}", "absent", usual))
        if values.size < channels:
            raise ValueError(
                f"ANALOG:{name} has {values.size} values for {channels} analog channels, so that "
                "their size is unknown; export the file again"
            )
        settled.append(values[:channels].astype(float))
    return settled[0], settled[1] * general, corrections
