"""Read a C3D file with ezc3d and leave its arrays in one file.

A program of its own that imports nothing of this project: a damaged file may take all memory that
the process may have, or end it. Arguments: C3D file, file of arrays (.npz), parameters wanted
(``GROUP:NAME``, separated by commas), bytes of memory.
"""

import sys
from typing import Any


def main() -> None:
    """Read one file as the arguments say; exit with ezc3d's own words where it refuses."""
    source, target, names, memory = sys.argv[1:]
    _limit(int(memory))
    try:
        _read(source, target, names.split(","))
    except Exception as error:  # of any kind: the file may hold anything
        sys.exit(f"{error}" or type(error).__name__)


def _read(source: str, target: str, names: list[str]) -> None:
    import ezc3d
    import numpy as np

    file = ezc3d.c3d(source)
    data, parameters = file["data"], file["parameters"]
    arrays: dict[str, Any] = {
        "points": data["points"][:3].transpose(2, 1, 0),
        "residuals": data["meta_points"]["residuals"][0].T,
        "analog": data["analogs"][0].T,
        "rate_hz": file["header"]["points"]["frame_rate"],
    }
    for key in names:
        group, name = key.split(":")
        value = parameters.get(group, {}).get(name, {"value": []})["value"]
        texts = isinstance(value, list)
        arrays[key] = np.array([_text(v) for v in value] if texts else np.ravel(value, order="F"))
    np.savez(target, **arrays)


def _text(data: Any) -> str:
    if isinstance(data, str):
        data = data.encode("utf-8", "surrogateescape")
    return bytes(data or b"").decode("utf-8", "replace").split("\0", 1)[0].strip()


def _limit(memory: int) -> None:
    try:
        import resource
    except ImportError:  # Windows has none: only the time is limited there
        return
    for kind, limit in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_AS, memory)):
        try:
            resource.setrlimit(kind, (limit, limit))
        except (ValueError, OSError):  # macOS knows RLIMIT_AS and does not allow it
            continue


if __name__ == "__main__":
    main()
