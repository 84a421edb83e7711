"""Write markers, plates, analog channels and events as common lab software does.

Files are floating-point, Intel, of any length: the true number of frames is in TRIAL and
POINT:LONG_FRAMES, since the header's 16 bits end at 65535. There is no ROTATION group, at which
some readers stop.
"""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array, rotate_wrench, shift_wrench
from pipeline.io.axes import parse_axes
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.c3d.parameters import BLOCK_BYTES, MAX_ENTRIES, Groups, Value, parameter_section
from pipeline.io.recording import Analog, Event, Metadata, Plate
from pipeline.io.write import whole_file

MM_PER_M: Final = 1000.0
MAX_COUNT: Final = 65535
"""Of a 16-bit number."""


def write_c3d(
    path: str | Path,
    markers: Markers,
    plates: Sequence[Plate] = (),
    *,
    analog: Analog | None = None,
    events: Sequence[Event] = (),
    axes: str = "left,back,up",
    first_frame: int = 1,
    metadata: Metadata | None = None,
) -> None:
    """Write one trial as a C3D file.

    Parameters
    ----------
    path
        Where to write.
    markers
        Trajectories in lab axes [m]; gaps become invalid points.
    plates
        Force plates; written as TYPE 2 with the transducer at the centre of the surface, in N and
        N·mm. Their samples must be a whole number per frame.
    analog
        Further channels, at the plates' sampling rate where there are plates.
    events
        Foot strikes and foot offs of either side.
    axes
        Lab directions of the x, y and z axis on disk.
    first_frame
        Number of the first frame.
    metadata
        Of it body mass and stature are written.

    Raises
    ------
    ValueError
        There is only one frame, sampling rates do not fit each other, a plate has no surface, or
        something does not fit the format.

    Notes
    -----
    `read_c3d` gives the same trial back to the precision of 4-byte numbers.
    """
    path, metadata = Path(path), metadata or Metadata()
    if len(markers.time) < 2:
        raise ValueError("a C3D file needs at least two frames, since it has a frame rate")
    to_file = parse_axes(axes).T
    channels = _channels(markers, plates, analog, to_file)
    height_mm = metadata.height_m and metadata.height_m * MM_PER_M
    body = {"Bodymass": metadata.mass_kg, "Height": height_mm}
    groups = _marker_groups(markers, to_file, first_frame) | {
        "ANALOG": _analog(channels, markers),
        "FORCE_PLATFORM": _force_platform(plates, to_file),
        "EVENT": _events(events, (first_frame - 1) / markers.rate_hz),
        "MANUFACTURER": {"SOFTWARE": "hbm-residuals"},
        "PROCESSING": {n: np.array([float(size)]) for n, size in body.items() if size is not None},
    }
    data_block = 2 + -(-len(parameter_section(groups, 0)) // BLOCK_BYTES)
    section = parameter_section(groups, data_block)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        file.write(_header(markers, channels, first_frame, data_block))
        file.write(section.ljust((data_block - 2) * BLOCK_BYTES, b"\0"))
        file.write(_samples(markers.position @ to_file.T * MM_PER_M, channels.values))
        file.write(bytes(-file.tell() % BLOCK_BYTES))


def _channels(
    markers: Markers, plates: Sequence[Plate], analog: Analog | None, to_file: Array
) -> Analog:
    n_frames = len(markers.time)
    sources = [(f"plate {p.number}", p.time) for p in plates]
    sources += [("analog", analog.time)] if analog is not None else []
    n_samples = len(sources[0][1]) if sources else 0
    for name, time in sources:
        if len(time) != n_samples or n_samples % n_frames:
            raise ValueError(
                f"{name} has {len(time)} samples, expected the same whole number per frame "
                f"as all others for {n_frames} frames"
            )
    names, units, values = [], [], [np.empty((n_samples, 0))]
    for plate in plates:
        names += [f"{q}.{q[0]}{axis}{plate.number}" for q in ("Force", "Moment") for axis in "xyz"]
        units += ["N"] * 3 + ["Nmm"] * 3
        rotation = to_file.T @ plate_axes(plate.corners @ to_file.T)
        about_centre = shift_wrench(plate.wrench, plate.corners.mean(axis=0))
        values.append(rotate_wrench(about_centre, rotation.T) * ([1.0] * 3 + [MM_PER_M] * 3))
    if analog is not None:
        names += analog.names
        units += analog.units
        values.append(analog.values)
    time = sources[0][1] if sources else np.empty(0)
    return Analog(time, tuple(names), tuple(units), np.hstack(values))


def _marker_groups(markers: Markers, to_file: Array, first_frame: int) -> Groups:
    """Give the groups TRIAL and POINT."""
    frames, names = len(markers.time), list(markers.names)
    first, last = (
        np.array(divmod(frame, MAX_COUNT + 1)[::-1])
        for frame in (first_frame, first_frame + frames - 1)
    )
    screen = []
    for direction in to_file.T[[0, 2]]:  # forward and up
        k = int(np.argmax(np.abs(direction)))
        screen.append(f"{'+' if direction[k] > 0 else '-'}{'XYZ'[k]}")
    return {
        "TRIAL": {
            "ACTUAL_START_FIELD": first,
            "ACTUAL_END_FIELD": last,
            "CAMERA_RATE": np.array([markers.rate_hz]),
        },
        "POINT": {
            "USED": np.array([len(names)]),
            "FRAMES": np.array([min(frames, MAX_COUNT)]),
            "LONG_FRAMES": np.array([float(frames)]),
            "SCALE": np.array([-1.0]),
            "RATE": np.array([markers.rate_hz]),
            "X_SCREEN": screen[0],
            "Y_SCREEN": screen[1],
            "UNITS": "mm",
            **_paged("LABELS", names),
            **_paged("DESCRIPTIONS", [""] * len(names)),
        },
    }


def _analog(channels: Analog, markers: Markers) -> dict[str, Value]:
    count, per_frame = len(channels.names), len(channels.time) // len(markers.time)
    return {
        "USED": np.array([count]),
        "RATE": np.array([markers.rate_hz * per_frame]),
        "GEN_SCALE": np.array([1.0]),
        **_paged("SCALE", np.ones(count)),
        **_paged("OFFSET", np.zeros(count, int)),
        **_paged("UNITS", list(channels.units)),
        **_paged("LABELS", list(channels.names)),
        **_paged("DESCRIPTIONS", [""] * count),
    }


def _force_platform(plates: Sequence[Plate], to_file: Array) -> dict[str, Value]:
    count = len(plates)
    corners = [plate.corners @ to_file.T * MM_PER_M for plate in plates]
    return {
        "USED": np.array([count]),
        "TYPE": np.full(count, 2),
        "ZERO": np.array([1, 0]),
        "CORNERS": np.reshape(corners, (count, 4, 3)).T.astype(float),
        "ORIGIN": np.zeros((3, count)),
        "CHANNEL": np.arange(1, 6 * count + 1).reshape(count, 6).T,
    }


def _events(events: Sequence[Event], start: float) -> dict[str, Value]:
    seconds = np.array([event.time + start for event in events])
    return {
        "USED": np.array([len(events)]),
        **_paged("CONTEXTS", [event.side.capitalize() for event in events]),
        **_paged("LABELS", [event.label.replace("_", " ").title() for event in events]),
        **_paged("TIMES", np.array([np.zeros(len(events)), seconds])),
    }


def _paged(name: str, values: Sequence[str] | Array) -> dict[str, Value]:
    """Give a list in NAME, NAME2, NAME3, … of as many entries as a parameter may have."""
    array = values if isinstance(values, np.ndarray) else np.array(values, object)
    pages: dict[str, Value] = {}
    for page, start in enumerate(range(0, max(array.shape[-1], 1), MAX_ENTRIES), start=1):
        part = array[..., start : start + MAX_ENTRIES]
        pages[name + str(page) * (page > 1)] = part if array is values else part.tolist()
    return pages


def _header(markers: Markers, channels: Analog, first_frame: int, data_block: int) -> bytes:
    frames, per_frame = len(markers.time), len(channels.time) // len(markers.time)
    counts = len(markers.names), len(channels.names) * per_frame
    limits = min(first_frame, MAX_COUNT), min(first_frame + frames - 1, MAX_COUNT)
    words = *counts, *limits, 0, -1.0, data_block, per_frame, markers.rate_hz
    return struct.pack("<BBHHHHHfHHf", 2, 0x50, *words).ljust(BLOCK_BYTES, b"\0")


def _samples(position: Array, analog: Array) -> bytes:
    frames, points = position.shape[:2]
    is_finite = ~np.isnan(position.sum(axis=-1, keepdims=True))
    words = np.concatenate([np.where(is_finite, position, 0), np.where(is_finite, 0, -1)], axis=-1)
    rows = words.reshape(frames, 4 * points), analog.reshape(frames, analog.size // frames)
    return np.hstack(rows, dtype="<f4", casting="same_kind").tobytes()
