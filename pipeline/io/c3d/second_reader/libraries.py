"""Read a C3D file with ezc3d or c3d and leave what they read as arrays in a folder.

A program of its own that imports nothing of this project: a damaged file may take all memory that
the process may have, or end it. Arguments: library, C3D file, folder, bytes of memory, seconds.
"""

import json
import sys
import warnings
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any, Final

Description = dict[str, Any]

LIBRARIES: Final = ("ezc3d", "c3d")


def main() -> None:
    """Read one file as the arguments say."""
    library, source, folder, memory, seconds = sys.argv[1:]
    _limit(int(memory), int(seconds))
    warnings.simplefilter("ignore")
    try:
        description = {"ezc3d": read_ezc3d, "c3d": read_c3d}[library](source, Path(folder))
        text = json.dumps({"reader": f"{library} {version(library)}", **description})
    except MemoryError:
        text = json.dumps({"refused": "std::bad_alloc"})
    except Exception as error:  # of any kind: the file may hold anything
        text = json.dumps({"refused": f"{error}" or type(error).__name__})
    (Path(folder) / "description.json").write_text(text, encoding="utf-8")


def _limit(memory: int, seconds: int) -> None:
    try:
        import resource
    except ImportError:  # Windows has none: only the time is limited there
        return
    for kind, limit in (
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_CPU, seconds),
        (resource.RLIMIT_FSIZE, memory),
        (resource.RLIMIT_AS, memory),
    ):
        try:
            resource.setrlimit(kind, (limit, limit))
        except (ValueError, OSError):  # macOS knows RLIMIT_AS and does not allow it
            continue


def read_ezc3d(source: str, folder: Path) -> Description:
    """Read a file with ezc3d.

    Parameters
    ----------
    source
        The C3D file.
    folder
        Where the arrays are written.

    Returns
    -------
    dict
        Everything that is no array of samples.
    """
    import ezc3d
    import numpy as np

    file = ezc3d.c3d(source)
    data, header = file["data"], file["header"]
    residual = data["meta_points"]["residuals"][0].T
    masks = data["meta_points"]["camera_masks"]
    _save(
        folder,
        points=data["points"][:3].transpose(2, 1, 0),
        residuals=residual,
        cameras=np.tensordot(2 ** np.arange(len(masks)), masks, 1).T,
        analog=data["analogs"][0].T,
        rotations=np.moveaxis(data["rotations"], -1, 0),
    )
    assumed = ezc3d.c3d()["parameters"]
    parameters: Description = {}
    descriptions: dict[str, str] = {}
    for group, members in file["parameters"].items():
        about = members["__METADATA__"]
        group = _text(group).upper()
        descriptions[group] = f"{about['DESCRIPTION']} {about['IS_LOCKED']}"
        for name, parameter in members.items():
            if name != "__METADATA__":
                key = f"{group}:{_text(name).upper()}"
                parameters.setdefault(key, _plain(parameter["value"]))
                descriptions[key] = f"{parameter['description']} {parameter['is_locked']}"
    return {
        "first_frame": header["points"]["first_frame"] + 1,
        "rate_hz": header["points"]["frame_rate"],
        "analog_per_frame": file.c3d_swig.header().nbAnalogByFrame(),
        "events": [
            (_text(label), time)
            for label, time in zip(
                header["events"]["events_label"], header["events"]["events_time"], strict=True
            )
            if _text(label)
        ],
        "parameters": parameters,
        "descriptions": descriptions,
        "assumed": [
            key
            for group, members in assumed.items()
            for name, parameter in members.items()
            if name != "__METADATA__"
            and parameters.get(key := f"{group}:{name}") == _plain(parameter["value"])
        ],
    }


def read_c3d(source: str, folder: Path) -> Description:
    """Read a file with the package c3d; parameters and result are `read_ezc3d`'s."""
    import c3d
    import numpy as np

    with Path(source).open("rb") as handle:
        file = c3d.Reader(handle)
        counts = file.point_used, file.analog_used, file.analog_per_frame
        n_points, channels, per_frame = map(int, counts)
        words = max(4 * n_points + channels * per_frame, 1)
        frames = min(int(file.frame_count), Path(source).stat().st_size // words)
        points = np.zeros((frames, n_points, 5), np.float32)
        analog = np.zeros((frames, per_frame, channels))
        read = 0
        for _, frame_points, frame_analog in islice(file.read_frames(copy=False), frames):
            points[read] = frame_points
            if analog.size:
                analog[read] = frame_analog.T
            read += 1
    missing = points[:read, :, 3] < 0
    _save(
        folder,
        points=np.where(missing[..., np.newaxis], np.nan, points[:read, :, :3]),
        residuals=points[:read, :, 3],
        cameras=points[:read, :, 4],
        analog=analog[:read].reshape(read * per_frame, channels),
        rotations=np.empty(0),
    )
    parameters: Description = {}
    descriptions: dict[str, str] = {}
    for name, members in file.group_items():
        group = _text(name)
        descriptions[group] = _text(members.desc)
        for name, parameter in members.param_items():
            key = f"{group}:{_text(name)}"
            parameters[key] = _c3d_values(parameter)
            descriptions[key] = _text(parameter.desc)
    header = file.header
    return {
        "first_frame": header.first_frame,
        "rate_hz": float(file.point_rate),
        "analog_per_frame": header.analog_per_frame,
        "events": [(_text(label), float(time)) for time, label in header.events],
        "parameters": parameters,
        "descriptions": descriptions,
        "assumed": [],
    }


def _c3d_values(parameter: Any) -> list[str] | list[float]:
    import numpy as np

    count = parameter.num_elements
    if not count:
        return []
    kind = parameter.bytes_per_element
    if kind == -1:
        width = parameter.dimensions[0] if parameter.dimensions else 1
        data = parameter.bytes
        return [_text(data[k : k + width]) for k in range(0, len(data), width)]
    parameter.dimensions = parameter.dimensions or [1]  # its scalars are not zero in DEC files
    values = parameter.float_array if kind == 4 else parameter.int_array
    return [float(value) for value in np.ravel(values)]


def _plain(value: Any) -> list[str] | list[float]:
    import numpy as np

    if isinstance(value, list):
        return [_text(text) for text in value]
    return [float(number) for number in np.ravel(value, order="F")]


def _text(data: Any) -> str:
    if isinstance(data, str):
        data = data.encode("utf-8", "surrogateescape")
    return bytes(data or b"").decode("utf-8", "replace").split("\0", 1)[0].strip()


def _save(folder: Path, **arrays: Any) -> None:
    import numpy as np

    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", np.ascontiguousarray(array), allow_pickle=False)


if __name__ == "__main__":
    main()
