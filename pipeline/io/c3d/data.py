"""The data section of a C3D file: the number of frames that it really holds, and their samples.

Samples are decoded in slices straight from the file, so that the memory needed is that of the
arrays that are returned, for a trial of any length.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.byte_order import BLOCK_BYTES, floats, integer_type
from pipeline.io.c3d.header import Header
from pipeline.io.c3d.parameters import Parameters

FRAMES_PER_SLICE: Final = 4096
"""Some megabytes at a time: large enough for NumPy, small beside the result."""
MIN_RATE_HZ: Final = 0.1
MAX_RATE_HZ: Final = 100_000.0
"""Wider than any camera or analog system; beyond it the header is damaged."""
MAX_COUNT: Final = 65535
"""Of a 16-bit number: frame counts stop there or start over."""
MAX_SCALE_DIFFERENCE: Final = 1e-3
"""Between the header's scale and POINT:SCALE, which programs round differently."""


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
    """

    points: NDArray[np.float64]
    analog: NDArray[np.float64]
    rate_hz: float
    analog_rate_hz: float


def read_samples(
    path: Path, header: Header, parameters: Parameters, max_frames: int | None = None
) -> Samples:
    """Read all points and analog channels.

    Parameters
    ----------
    path
        The C3D file.
    header, parameters
        What `read_header` gave for it.
    max_frames
        Read no more than these first frames; by default all.

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
    n_points, per_frame = header.n_points, header.analog_per_frame
    channels = header.n_analog // per_frame if per_frame else 0
    if channels * per_frame != header.n_analog:
        raise ValueError(
            f"{header.n_analog} analog samples per frame are not a multiple of "
            f"{per_frame} samples per channel"
        )
    if n_points == 0 and channels == 0:
        raise ValueError("the file holds neither points nor analog channels")
    rate = frame_rate_hz(header, parameters)
    _check_scale(header, parameters)
    unsigned = is_unsigned(parameters)
    frames = count_frames(path, header, parameters)
    frames = frames if max_frames is None else min(frames, max_frames)
    offset, scale = analog_scaling(parameters, channels)
    points = np.empty((frames, n_points, 3))
    analog = np.empty((frames, per_frame, channels))
    with path.open("rb") as file, np.errstate(invalid="ignore", over="ignore"):
        file.seek((header.data_block - 1) * BLOCK_BYTES)
        for start in range(0, frames, FRAMES_PER_SLICE):
            stop = min(start + FRAMES_PER_SLICE, frames)
            data = file.read((stop - start) * bytes_per_frame(header))
            raw, raw_analog = _decode(data, header, unsigned, stop - start)
            points[start:stop] = raw[..., :3]
            points[start:stop][_is_missing(raw)] = np.nan
            analog[start:stop] = (raw_analog - offset) * scale
            analog[start:stop][~np.isfinite(analog[start:stop])] = np.nan
    return Samples(points, analog.reshape(frames * per_frame, channels), rate, rate * per_frame)


def missing_share(
    path: Path, header: Header, parameters: Parameters, sampled: int
) -> NDArray[np.float64]:
    """Estimate how often each point is missing, from frames spread evenly over the file.

    Parameters
    ----------
    path
        The C3D file.
    header, parameters
        What `read_header` gave for it.
    sampled
        Number of frames to sample; all if there are fewer.

    Returns
    -------
    ndarray
        Share of the frames in which each point is missing, (P,).

    Raises
    ------
    ValueError
        As `count_frames`.
    """
    frames = count_frames(path, header, parameters)
    chosen = np.unique(np.linspace(0, frames - 1, sampled).round().astype(int))
    size, start = bytes_per_frame(header), (header.data_block - 1) * BLOCK_BYTES
    data = bytearray()
    with path.open("rb") as file:
        for frame in chosen:
            file.seek(start + int(frame) * size)
            data += file.read(size)
    with np.errstate(invalid="ignore", over="ignore"):
        points, _ = _decode(bytes(data), header, False, len(chosen))
        return np.asarray(_is_missing(points).mean(axis=0))


def bytes_per_frame(header: Header) -> int:
    """Give the size of one frame in the data section."""
    return (4 * header.n_points + header.n_analog) * (4 if header.scale < 0 else 2)


def count_frames(path: Path, header: Header, parameters: Parameters) -> int:
    """Give the number of frames that the file really holds.

    Parameters
    ----------
    path
        The C3D file.
    header, parameters
        What `read_header` gave for it.

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    ValueError
        The file is shorter than it says, or nothing it says fits its size.

    Notes
    -----
    Header and POINT:FRAMES have 16 bits: they stop at 65535 or start over. TRIAL:ACTUAL_*_FIELD
    and POINT:LONG_FRAMES hold the true number where a program wrote them; otherwise the size of the
    data section decides between the numbers that 16 bits may stand for. A file may be longer than
    its frames, if header and parameters agree on points and channels.
    """
    size, data_start = path.stat().st_size, (header.data_block - 1) * BLOCK_BYTES
    per_frame = bytes_per_frame(header)
    held = (size - data_start) // per_frame
    if header.data_block <= header.parameter_block or held <= 0:
        raise ValueError("the file holds no data section: it is truncated or damaged")
    long_counts = []
    if parameters.has("POINT", "LONG_FRAMES"):
        long_counts.append(parameters.integer("POINT", "LONG_FRAMES", 0))
    start, end = (
        parameters.integers("TRIAL", f"ACTUAL_{limit}_FIELD").ravel() for limit in ("START", "END")
    )
    if start.size == 2 and end.size == 2:
        long_counts.append(int((end[0] - start[0]) + (MAX_COUNT + 1) * (end[1] - start[1]) + 1))
    short_counts = [header.last_frame - header.first_frame + 1]
    short_counts.append(parameters.integer("POINT", "FRAMES", short_counts[0]))

    slack = BLOCK_BYTES // per_frame + 1
    fitting = [count for count in long_counts if 0 < count <= held <= count + slack]
    saturated = MAX_COUNT in (header.last_frame, short_counts[1])
    started_over = any((held - count) % (MAX_COUNT + 1) <= slack for count in short_counts)
    if not fitting and held > MAX_COUNT and (saturated or started_over):
        return held - _padding_frames(path, header, held, slack)
    fitting += [count for count in short_counts if 0 < count <= held <= count + slack]
    if fitting:
        return fitting[0]
    declared = {*long_counts, *short_counts}
    if (
        len(declared) == 1
        and 0 < (count := declared.pop()) <= held
        and _counts_agree(header, parameters)
    ):
        return count
    raise ValueError(
        f"the file says it has {_listed(long_counts + short_counts)} frames, but its size holds "
        f"{held}: it is truncated or damaged"
    )


def _counts_agree(header: Header, parameters: Parameters) -> bool:
    """Whether header and parameters state the same numbers of points and analog channels."""
    channels = header.n_analog // max(header.analog_per_frame, 1)
    stated = (("POINT", header.n_points), ("ANALOG", channels))
    return all(parameters.integer(group, "USED", count) == count for group, count in stated)


def _padding_frames(path: Path, header: Header, held: int, slack: int) -> int:
    per_frame, checked = bytes_per_frame(header), min(slack, held)
    with path.open("rb") as file:
        file.seek((header.data_block - 1) * BLOCK_BYTES + (held - checked) * per_frame)
        tail = np.frombuffer(file.read(checked * per_frame), np.uint8).reshape(checked, per_frame)
    written = np.flatnonzero(tail.any(axis=1))
    return checked - 1 - int(written[-1]) if len(written) else checked


def _listed(counts: list[int]) -> str:
    return " or ".join(str(count) for count in sorted(set(counts)))


def _decode(
    data: bytes, header: Header, unsigned: bool, frames: int
) -> tuple[NDArray[np.number], NDArray[np.number]]:
    points: NDArray[np.number]
    per_frame = header.analog_per_frame
    if header.scale < 0:
        block = floats(data, header.byte_order).reshape(frames, -1)
        points = block[:, : 4 * header.n_points].reshape(frames, header.n_points, 4)
        analog = block[:, 4 * header.n_points :]
    else:
        words = np.frombuffer(data, integer_type(header.byte_order)).reshape(frames, -1)
        points = words[:, : 4 * header.n_points].reshape(frames, header.n_points, 4)
        points = points * np.array([header.scale, header.scale, header.scale, 1])
        analog = words[:, 4 * header.n_points :]
        if unsigned:
            analog = analog.view(integer_type(header.byte_order, signed=False))
    return points, analog.reshape(frames, per_frame, header.n_analog // max(per_frame, 1))


def _check_scale(header: Header, parameters: Parameters) -> None:
    scale = float(next(iter(parameters.numbers("POINT", "SCALE").flat), header.scale))
    differs = header.scale > 0 and abs(scale / header.scale - 1) > MAX_SCALE_DIFFERENCE
    if scale * header.scale <= 0 or differs:
        raise ValueError(
            f"the header scales points by {header.scale:.5g}, but POINT:SCALE says {scale:.5g}"
        )


def _is_missing(points: NDArray[np.number]) -> NDArray[np.bool_]:
    position, residual = points[..., :3], points[..., 3]
    invalid: NDArray[np.bool_] = ~np.isfinite(position).all(axis=-1)
    invalid |= ~position.any(axis=-1)
    invalid |= ~np.greater_equal(residual, 0)
    return invalid


def frame_rate_hz(header: Header, parameters: Parameters) -> float:
    """Give the frame rate [Hz]; a ValueError where no camera has it."""
    rate = float(next(iter(parameters.numbers("POINT", "RATE").flat), header.rate_hz))
    if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        raise ValueError(
            f"the frame rate is {rate:g} Hz, expected {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
        )
    return rate


def is_unsigned(parameters: Parameters) -> bool:
    """Whether integer samples of analog channels have no sign."""
    return parameters.text("ANALOG", "FORMAT").upper() == "UNSIGNED"


def analog_scaling(
    parameters: Parameters, channels: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give offset and scale of each analog channel: value = (sample − offset) · scale.

    Raises
    ------
    ValueError
        ANALOG:OFFSET or ANALOG:SCALE has fewer values than there are channels.
    """
    general = float(next(iter(parameters.numbers("ANALOG", "GEN_SCALE").flat), 1.0))
    offset = (parameters.integers if is_unsigned(parameters) else parameters.numbers)(
        "ANALOG", "OFFSET"
    )
    scale = parameters.numbers("ANALOG", "SCALE")
    for name, values in (("OFFSET", offset), ("SCALE", scale)):
        if values.size < channels:
            raise ValueError(
                f"ANALOG:{name} has {values.size} values for {channels} analog channels"
            )
    return offset.ravel()[:channels].astype(float), scale.ravel()[:channels] * general
