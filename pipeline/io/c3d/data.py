"""The data section of a C3D file: its samples, their rates and scales.

Samples are decoded in slices straight from the file, so that the memory needed is that of the
arrays that are returned, for a trial of any length.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.header import Header, correction
from pipeline.io.c3d.parameters import Parameters, floats, integer_type

FRAMES_PER_SLICE: Final = 512
"""Half a megabyte at a time: large enough for NumPy, and small enough for a processor's cache."""
MIN_RATE_HZ: Final = 0.1
MAX_RATE_HZ: Final = 100_000.0
"""Wider than any camera or analog system; beyond it the header is damaged."""
MAX_RATE_DIFFERENCE: Final = 2e-3
"""Relative, between the places that state it: some write 60 Hz for the 59.94 Hz of video."""
MIN_RATE_DIFFERENCE: Final = 1e-5
"""Relative: less is rounding."""
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
    corrections
        What the file states wrongly or not at all about rates, offsets and scales.
    """

    points: NDArray[np.float64]
    analog: NDArray[np.float64]
    rate_hz: float
    analog_rate_hz: float
    corrections: list[str]


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
    frame = header.frame
    n_points, per_frame, channels = frame.points, frame.per_channel, frame.channels
    rate, rate_corrections = frame_rate_hz(header, parameters)
    point_scale = parameters.number("POINT", "SCALE", header.scale)
    differs = header.scale > 0 and abs(point_scale / header.scale - 1) > MAX_SCALE_DIFFERENCE
    if point_scale * header.scale <= 0 or differs:
        raise ValueError(
            f"the header scales points by {header.scale:.5g}, but POINT:SCALE says "
            f"{point_scale:.5g}: one of them is wrong, and with it all positions; export the file "
            "again"
        )
    unsigned = is_unsigned(parameters)
    frames = header.frames if max_frames is None else min(header.frames, max_frames)
    offset, scale, scale_corrections = analog_scaling(header, parameters)
    # every coordinate and channel in one piece of memory, as markers have it
    points = np.moveaxis(np.empty((n_points, 3, frames)), -1, 0)
    analog = np.empty((channels, frames, per_frame))
    offset, scale = offset[:, None, None], scale[:, None, None]
    with path.open("rb") as file, np.errstate(invalid="ignore", over="ignore"):
        file.seek(header.data_start)
        for start in range(0, frames, FRAMES_PER_SLICE):
            stop = min(start + FRAMES_PER_SLICE, frames)
            data = file.read((stop - start) * header.frame.bytes)
            raw, raw_analog = _decode(data, header, unsigned, stop - start)
            points[start:stop] = raw[..., :3]
            points[start:stop][_is_missing(raw)] = np.nan
            values = analog[:, start:stop]
            values[:] = np.moveaxis(raw_analog, -1, 0)
            values -= offset
            values *= scale
            values[~np.isfinite(values)] = np.nan
    return Samples(
        points,
        analog.reshape(channels, frames * per_frame).T,
        rate,
        rate * per_frame,
        [*rate_corrections, *scale_corrections],
    )


def missing_share(path: Path, header: Header, sampled: int) -> NDArray[np.float64]:
    """Estimate how often each point is missing, from frames spread evenly over the file.

    Parameters
    ----------
    path
        The C3D file.
    header
        What `read_header` gave for it.
    sampled
        Number of frames to sample; all if there are fewer.

    Returns
    -------
    ndarray
        Share of the frames in which each point is missing, (P,).
    """
    chosen = np.unique(np.linspace(0, header.frames - 1, sampled).round().astype(int))
    size, start = header.frame.bytes, header.data_start
    data = bytearray()
    with path.open("rb") as file:
        for frame in chosen:
            file.seek(start + int(frame) * size)
            data += file.read(size)
    with np.errstate(invalid="ignore", over="ignore"):
        points, _ = _decode(bytes(data), header, False, len(chosen))
        return np.asarray(_is_missing(points).mean(axis=0))


def _decode(
    data: bytes, header: Header, unsigned: bool, frames: int
) -> tuple[NDArray[np.number], NDArray[np.number]]:
    """Give points with their residuals, (T, P, 4), and samples, (T, per channel, channels)."""
    frame, real = header.frame, header.scale < 0
    words: NDArray[np.number] = (
        floats(data, header.byte_order)
        if real
        else np.frombuffer(data, integer_type(header.byte_order))
    )
    words = words.reshape(frames, -1)
    points = words[:, : 4 * frame.points].reshape(frames, frame.points, 4)
    analog = words[:, 4 * frame.points :]
    if not real:
        points = points * np.array([header.scale, header.scale, header.scale, 1])
        analog = analog.view(integer_type(header.byte_order, signed=not unsigned))
    return points, analog.reshape(frames, frame.per_channel, frame.channels)


def _is_missing(points: NDArray[np.number]) -> NDArray[np.bool_]:
    x, y, z, residual = np.moveaxis(points, -1, 0)
    known: NDArray[np.bool_] = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
    known &= (x != 0) | (y != 0) | (z != 0)
    known &= np.greater_equal(residual, 0)
    return ~known


def frame_rate_hz(header: Header, parameters: Parameters) -> tuple[float, list[str]]:
    """Give the frame rate, which stands in up to three places, and which of them are wrong.

    It is that of POINT:RATE, else of the header, else of ANALOG:RATE by the samples per frame [Hz].
    A ValueError where none of them states a rate that a camera has, or they contradict each other
    by more than rounding.
    """
    places = {
        "POINT:RATE": parameters.number("POINT", "RATE", header.rate_hz),
        "the header": header.rate_hz,
    }
    if header.frame.channels and parameters.has("ANALOG", "RATE"):
        analog_rate = parameters.number("ANALOG", "RATE", np.nan)
        places["ANALOG:RATE and the samples per frame"] = analog_rate / header.frame.per_channel
    shown = {k: f"{hz:g} Hz" if np.isfinite(hz) else "no number" for k, hz in places.items()}
    every = ", ".join(f"{text} by {place}" for place, text in shown.items())
    rates = {place: hz for place, hz in places.items() if MIN_RATE_HZ <= hz <= MAX_RATE_HZ}
    if not rates:
        raise ValueError(
            f"no frame rate between {MIN_RATE_HZ:g} and {MAX_RATE_HZ:g} Hz is stated ({every}); "
            "export the file again"
        )
    rate = next(iter(rates.values()))
    apart = {place: abs(hz / rate - 1) for place, hz in rates.items()}
    if max(apart.values()) > MAX_RATE_DIFFERENCE:
        raise ValueError(
            f"the frame rate is {every}: one of them is wrong, and with it all times; export the "
            "file again"
        )
    wrong = [place for place in places if apart.get(place, np.inf) > MIN_RATE_DIFFERENCE]
    return rate, [correction(f"rate by {k}", shown[k], f"{rate:g} Hz") for k in wrong]


def is_unsigned(parameters: Parameters) -> bool:
    """Whether integer samples of analog channels have no sign."""
    return parameters.text("ANALOG", "FORMAT").upper() == "UNSIGNED"


def analog_scaling(
    header: Header, parameters: Parameters
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[str]]:
    """Give offset and scale of each channel: value = (sample − offset) · scale, (channels,) each.

    An absent ANALOG:OFFSET is taken as 0, an absent ANALOG:SCALE as 1 where samples are real and
    every channel has a unit, which corrections say. A ValueError where either is absent otherwise,
    or has fewer values than there are channels.
    """
    channels, unsigned = header.frame.channels, is_unsigned(parameters)
    general = parameters.number("ANALOG", "GEN_SCALE", 1.0)
    offset = (parameters.integers if unsigned else parameters.numbers)("ANALOG", "OFFSET")
    scale = parameters.numbers("ANALOG", "SCALE")
    corrections = []
    if channels and not offset.size and not (unsigned and header.scale > 0):
        offset = np.zeros(channels)
        corrections.append(correction("ANALOG:OFFSET", "absent", 0))
    units = list(filter(None, parameters.texts("ANALOG", "UNITS")[:channels]))
    if not scale.size and header.scale < 0 and len(units) == channels > 0 and general == 1:
        scale = np.ones(channels)
        corrections.append(correction("ANALOG:SCALE", "absent", 1))
    for name, values in (("OFFSET", offset), ("SCALE", scale)):
        if values.size < channels:
            raise ValueError(
                f"ANALOG:{name} has {values.size} values for {channels} analog channels, so that "
                "their size is unknown; export the file again"
            )
    return (
        offset.ravel()[:channels].astype(float),
        scale.ravel()[:channels] * general,
        corrections,
    )
