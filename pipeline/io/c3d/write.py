"""Write markers, plates, analog channels and events as common lab software does.

Files are floating-point, Intel, of any length: the true number of frames is in TRIAL and
POINT:LONG_FRAMES, since the header's 16 bits end at 65535. There is no ROTATION group, at which
some readers stop.
"""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array, rotate_wrench, shift_wrench
from pipeline.io.axes import parse_axes
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.c3d.parameters import BLOCK_BYTES, MAX_ENTRIES, Groups, Value, parameter_section
from pipeline.io.recording import Analog, Event, Metadata, Plate
from pipeline.io.write import whole_file

FRAMES_PER_SLICE: Final = 4096
"""Some megabytes at a time: large enough for NumPy, small beside the trial."""
MM_PER_M: Final = 1000.0
MAX_COUNT: Final = 65535
"""Of a 16-bit number."""
PROGRAM: Final = "hbm-residuals"


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
    groups = _marker_groups(markers, to_file, first_frame) | {
        "ANALOG": _analog(channels, markers),
        "FORCE_PLATFORM": _force_platform(plates, to_file),
        "EVENT": _events(events, (first_frame - 1) / markers.rate_hz),
        "MANUFACTURER": {"SOFTWARE": PROGRAM},
        "PROCESSING": {
            name: np.array([float(value)])
            for name, value in (
                ("Bodymass", metadata.mass_kg),
                ("Height", metadata.height_m and metadata.height_m * MM_PER_M),
            )
            if value is not None
        },
    }
    data_block = 2 + -(-len(parameter_section(groups, 0)) // BLOCK_BYTES)
    section = parameter_section(groups, data_block)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        file.write(_header(markers, channels, first_frame, data_block))
        file.write(section.ljust((data_block - 2) * BLOCK_BYTES, b"\0"))
        _write_samples(file, markers.position @ to_file.T * MM_PER_M, channels.values)
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
        values.append(_wrench_on_disk(plate, to_file) * ([1.0] * 3 + [MM_PER_M] * 3))
    if analog is not None:
        names += analog.names
        units += analog.units
        values.append(analog.values)
    time = sources[0][1] if sources else np.empty(0)
    return Analog(time, tuple(names), tuple(units), np.hstack(values))


def _wrench_on_disk(plate: Plate, to_file: Array) -> Array:
    try:
        rotation = to_file.T @ plate_axes(plate.corners @ to_file.T)
    except ValueError as error:
        raise ValueError(f"plate {plate.number}: {error}") from error
    return rotate_wrench(shift_wrench(plate.wrench, plate.corners.mean(axis=0)), rotation.T)


def _marker_groups(markers: Markers, to_file: Array, first_frame: int) -> Groups:
    """Give the groups TRIAL and POINT."""
    frames, names = len(markers.time), list(markers.names)
    last_frame = first_frame + frames - 1
    ends = (np.array(divmod(frame, MAX_COUNT + 1)[::-1]) for frame in (first_frame, last_frame))
    screen = [to_file @ direction for direction in np.eye(3)[[0, 2]]]
    largest = [int(np.argmax(np.abs(vector))) for vector in screen]
    forward, up = (
        f"{'+' if vector[k] > 0 else '-'}{'XYZ'[k]}"
        for vector, k in zip(screen, largest, strict=True)
    )
    return {
        "TRIAL": {
            **dict(zip(("ACTUAL_START_FIELD", "ACTUAL_END_FIELD"), ends, strict=True)),
            "CAMERA_RATE": np.array([markers.rate_hz]),
        },
        "POINT": {
            "USED": np.array([len(names)]),
            "FRAMES": np.array([min(frames, MAX_COUNT)]),
            "LONG_FRAMES": np.array([float(frames)]),
            "SCALE": np.array([-1.0]),
            "RATE": np.array([markers.rate_hz]),
            "X_SCREEN": forward,
            "Y_SCREEN": up,
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
    per_frame = len(channels.time) // len(markers.time)
    last = min(first_frame + len(markers.time) - 1, MAX_COUNT)
    block = struct.pack(
        "<BBHHHHHfHHf",
        2,
        0x50,
        len(markers.names),
        len(channels.names) * per_frame,
        min(first_frame, MAX_COUNT),
        last,
        0,
        -1.0,
        data_block,
        per_frame,
        markers.rate_hz,
    )
    return block.ljust(BLOCK_BYTES, b"\0")


def _write_samples(file: BinaryIO, position: Array, analog: Array) -> None:
    n_frames, n_points = position.shape[:2]
    per_frame = analog.size // n_frames
    analog = analog.reshape(n_frames, per_frame)
    for start in range(0, n_frames, FRAMES_PER_SLICE):
        part = slice(start, start + FRAMES_PER_SLICE)
        points = position[part]
        gap = np.isnan(points.sum(axis=-1))
        block = np.empty((len(points), 4 * n_points + per_frame), "<f4")
        words = block[:, : 4 * n_points].reshape(len(points), n_points, 4)
        words[..., :3] = np.where(gap[:, :, np.newaxis], 0, points)
        words[..., 3] = np.where(gap, -1, 0)
        block[:, : 4 * n_points] = words.reshape(len(points), -1)
        block[:, 4 * n_points :] = analog[part]
        file.write(block.tobytes())
