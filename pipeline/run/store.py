"""A processed trial on disk: one Parquet file, written whole or not at all, and read back.

Each frame is a row of the file. What a trial has besides its frames stands in the file's metadata,
as JSON that is made from the types of `TrialResult` and read by them.
"""

import hashlib
import json
import mmap
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, BinaryIO, Final, Union, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel

from compensation.platform import PlatformPose
from hbm.coordinates import COORDINATES, HBM_ORDER
from hbm.dynamics import Dynamics
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.spatial import Array, Indices, Mask, frozen
from hbm.spelling import short
from pipeline.io.input_file import NO_MEMORY, open_file, read_text
from pipeline.io.recording import Event, Plate
from pipeline.io.write import open_parquet, whole_file, write_text
from pipeline.trial.residuals import AXES, reported
from pipeline.trial.result import TrialResult

FORMAT_VERSION: Final = 12
"""Of stored trials; raised with every change of what they hold."""
METADATA: Final = b"hbm"
DIGEST: Final = b"hbm.sha256"
"""Keys of the trial without its frames, and of the checksum, in the file's metadata."""
NO_DIGEST: Final = b"0" * 64
DIGEST_START: Final = DIGEST + b"\x18\x40"
"""How a Parquet file stores that key, with type and length of the 64 characters that follow."""
COMPRESSION: Final = "snappy"
"""Half the time of zstd for 7 % more."""
COMPRESSED: Final = ("observed.", "quality", "time_s", "event")
"""What columns begin with that compress well. Computed numbers do not, and of markers' positions a
quarter would be saved, 9 % of a file, for half the time that it takes to write it."""
MAX_EXPANSION: Final = 10
"""Of a file in memory; most of its columns are not compressed at all."""
MAX_REASON: Final = 120
"""Characters of a library's message, or of a file's name, within ours."""
RUN: Final = "run.json"
WRENCH: Final = ("fx", "fy", "fz", "mx", "my", "mz")
POSE: Final = (*(f"r{row}{column}" for row in "123" for column in "123"), "x", "y", "z")
"""Rotation matrix, row by row, and position of the platform."""
OF_FRAMES: Final = frozenset(
    {"markers", "motion", "variants", "ground", "platform", "quality", "uncertainty"}
)
"""Fields of a result that have a value in each frame."""
Column = Array | Indices | Mask | Sequence[str]


def write_trial(result: TrialResult, path: Path) -> None:
    """Write a trial as Parquet; the file appears whole or not at all.

    `frame_table` says what its columns are.
    """
    table = frame_table(result)
    with whole_file(path) as temporary:
        with (
            temporary.open("r+b") as sink,  # ext4 writes to the disk at once what was truncated
            pq.ParquetWriter(
                sink,
                table.schema,
                compression={
                    n: COMPRESSION for n in table.column_names if n.startswith(COMPRESSED)
                },
                use_dictionary=["event"],
                write_statistics=False,
                store_schema=False,  # it would hold the metadata a second time
            ) as file,
        ):
            file.write_table(table)
            file.add_key_value_metadata({METADATA: _metadata(result), DIGEST: NO_DIGEST})
        with temporary.open("r+b") as written:
            write_digest(written)


def write_digest(file: BinaryIO) -> None:
    """Put the SHA-256 of all bytes of a stored trial but those of the digest itself into it."""
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = content.rfind(DIGEST_START)
        if start < 0:
            raise ValueError(f"{file.name}: no place for the checksum in the file")
        place = start + len(DIGEST_START)
        digest = _digest(content, place)
    file.seek(place)
    file.write(digest)


def _digest(content: bytes | mmap.mmap, place: int) -> bytes:
    """Hash everything but the digest at a place."""
    with memoryview(content) as view:
        digest = hashlib.sha256(view[:place])
        digest.update(view[place + len(NO_DIGEST) :])
    return digest.hexdigest().encode()


def read_trial(path: str | Path, *, frames: bool = True) -> TrialResult:
    r"""Read a trial's result back, as it was written.

    Parameters
    ----------
    path
        What `write_trial` wrote.
    frames
        Whether with the frames; without, every array over frames is of none.

    Returns
    -------
    TrialResult
        Equal to what was written, to the last bit; of ``source`` the name alone.

    Raises
    ------
    ValueError
        If the file is damaged, not a trial's result, or written by another version.
    OSError
        If it cannot be opened.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> _ = Path("study.toml").write_text("[conditions.level]")
    >>> trials = '[trials.level]\nfile = "walk.c3d"'
    >>> _ = Path("sub01.toml").write_text(f'id = "sub01"\nsex = "male"\n{trials}')
    >>> (outcome,) = pipeline.run_study(pipeline.read_study("."), "results")
    >>> outcome.job.target.name
    'sub01_level.parquet'
    >>> f"{pipeline.read_trial(outcome.job.target).body.mass:.1f} kg"
    '74.6 kg'
    """
    path = Path(path)
    with _readable(path):
        with open_file(path) as opened:
            content = opened.read()
        place = content.rfind(DIGEST_START) + len(DIGEST_START)
        digested = place >= len(DIGEST_START)
        if digested and content[place : place + len(NO_DIGEST)] != _digest(content, place):
            raise _DamagedError("its bytes are not those that were written")
        file = open_parquet(pa.BufferReader(content), MAX_EXPANSION * len(content))
        metadata: dict[bytes, bytes] = file.metadata.metadata or {}
    if METADATA not in metadata:
        raise ValueError(f"{short(path.name, MAX_REASON)} is not the result of a trial")
    with _readable(path):
        stored = _of_this_format(metadata[METADATA])
        if not digested:
            raise _DamagedError("it has no checksum")
        rows = file.metadata.num_rows
        if rows != stored["frames"]:
            raise _DamagedError(f"it has {rows} frames, expected {stored['frames']}")
        table = file.read(use_threads=False) if frames else file.schema_arrow.empty_table()
        result = _result(table, stored)
        if not (result.shortage or result.span or any(map(len, result.cycles.values()))):
            raise _DamagedError("it has residuals without the gait cycles or span that they are of")
        return result


def _metadata(result: TrialResult) -> bytes:
    """Give what a trial has besides its frames as JSON; numbers come back exactly."""
    rest = {f.name: getattr(result, f.name) for f in fields(result) if f.name not in OF_FRAMES}
    first = {"version": FORMAT_VERSION, "frames": len(result.motion.time), "engine": result.engine}
    text = json.dumps(first | rest, ensure_ascii=False, separators=(",", ":"), default=_plain)
    return text.encode()


def _of_this_format(text: bytes) -> dict[str, Any]:
    """Read that JSON; a ValueError says that it is none, or of another format."""
    stored: dict[str, Any] = json.loads(text)
    if (found := stored["version"]) != FORMAT_VERSION:
        raise ValueError(
            f"written by another version of hbm (format {found}; this one reads format "
            f"{FORMAT_VERSION})"
        )
    return stored


def _plain(value: Any) -> Any:
    """Give what JSON does not know in types that it knows."""
    if isinstance(value, Note):
        return value.to_dict()
    if isinstance(value, BaseModel):
        return value.model_dump()
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return value.name
    raise TypeError(f"no place in JSON for {type(value).__name__}")


def _typed(kind: Any, stored: Any) -> Any:
    """Make a value of a type from what `_plain` gave, whose bytes the checksum has confirmed."""
    origin, inner = get_origin(kind), get_args(kind)
    if stored is None:
        return None
    if origin in (Union, UnionType):
        return _typed(next(each for each in inner if each is not NoneType), stored)
    if kind is Note:
        return Note.from_dict(stored)
    if kind is Plate:  # no samples have no shape in JSON
        stored = stored | {"wrench_in_plate": np.empty((0, 6))}
    if is_dataclass(kind):
        record: Any = kind
        return record(**{name: _typed(own, stored[name]) for name, own in _types(record).items()})
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind.model_validate(stored)
    if origin is Mapping or origin is dict:
        return {name: _typed(inner[1], value) for name, value in stored.items()}
    if origin is np.ndarray:
        return np.array(stored, float)
    if origin is tuple:
        kinds = inner[:1] * len(stored) if inner[1:] == (...,) else inner
        return tuple(_typed(own, value) for own, value in zip(kinds, stored, strict=True))
    return Path(stored) if kind is Path else stored


@cache
def _types(kind: type) -> dict[str, Any]:
    """Give the types of a dataclass's fields."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}


def _result(table: pa.Table, stored: Mapping[str, Any]) -> TrialResult:
    """Put a trial together from its frames and the rest."""
    kinds = {name: kind for name, kind in _types(TrialResult).items() if name not in OF_FRAMES}
    rest = {name: _typed(kind, stored[name]) for name, kind in kinds.items()}
    rest["cycles"] = {side: spans.reshape(-1, 2) for side, spans in rest["cycles"].items()}
    return TrialResult(**rest, **_frames(table, stored["engine"]))


def frame_table(result: TrialResult) -> pa.Table:
    """Lay a trial out with one row per frame.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    pyarrow.Table
        ``time_s``; ``q.NAME``, ``v.NAME``, ``a.NAME`` [rad or m, per s, per s²] in the Human Body
        Model's order; per variant ``tau.measured.NAME`` [N·m or N] and ``residual.measured.Fx`` …
        ``Mz`` [N, N·m] as reported (x forward, y right, z up, about the pelvis origin);
        ``marker_error.NAME`` [m]; ``event``, such as "left foot_strike", on the frame nearest to
        it. In lab axes (X forward, Y left, Z up): ``ground.measured.left_foot.fx`` … ``mz`` [N,
        N·m] about the lab origin, ``marker.NAME.x`` [m] as measured, ``platform.r11`` … ``z``.
        ``converged``, ``observed.NAME`` of the inverse kinematics; ``quality``, the sum of the
        flags of `pipeline.trial.quality.Quality` that say why the frame does not count or is
        doubtful, 0 where nothing is. With a calibration of the platform, one standard deviation of
        the residual due to the compensation: ``uncertainty.residual.Fx`` …, lab axes [N, N·m].
    """
    motion, markers, pose = result.motion, result.markers, result.platform
    columns: dict[str, Column] = {"time_s": motion.time}
    for symbol, values in (("q", motion.q), ("v", motion.v), ("a", motion.a)):
        columns |= _by_coordinate(symbol, values)
    for variant, dynamics in result.variants.items():
        columns |= _by_coordinate(f"tau.{variant}", dynamics.tau)
        columns |= _columns(f"residual.{variant}", AXES, reported(dynamics.residual))
    columns |= _columns("marker_error", motion.markers, motion.marker_error)
    columns["event"] = _event_labels(motion.time, result.events)
    for variant, feet in result.ground.items():
        for foot, wrench in feet.items():
            columns |= _columns(f"ground.{variant}.{foot}", WRENCH, wrench)
    if pose is not None:
        both = np.hstack([pose.rotation.reshape(-1, 9), pose.position])
        columns |= _columns("platform", POSE, both)
    if result.uncertainty is not None:
        columns |= _columns("uncertainty.residual", AXES, result.uncertainty)
    for k, name in enumerate(markers.names):
        columns |= _columns(f"marker.{name}", "xyz", markers.position[:, k])
    columns |= _by_coordinate("observed", motion.observed)
    columns |= {"converged": motion.converged, "quality": result.quality}
    return pa.table({name: pa.array(column) for name, column in columns.items()})


def _frames(table: pa.Table, engine: str) -> dict[str, Any]:
    """Read the columns of `frame_table` back, equal to the last bit; KeyError if one is missing."""

    def read(prefix: str, names: Iterable[str]) -> Array:
        found = [table.column(f"{prefix}.{name}").to_numpy() for name in names]
        return frozen(np.column_stack(found) if found else np.empty((table.num_rows, 0)))

    def named(prefix: str, last: str = "") -> tuple[str, ...]:
        columns = (n for n in table.column_names if n.startswith(prefix) and n.endswith(last))
        return tuple(n[len(prefix) : len(n) - len(last)] for n in columns)

    time, names = table.column("time_s").to_numpy(), named("marker.", ".x")
    places = [read(f"marker.{name}", "xyz") for name in names]
    position = np.stack(places, axis=1) if places else np.empty((len(time), 0, 3))
    in_motion = named("marker_error.")
    motion = Motion(
        time=time,
        q=read("q", COORDINATES),
        v=read("v", COORDINATES),
        a=read("a", COORDINATES),
        markers=in_motion,
        marker_error=read("marker_error", in_motion),
        converged=table.column("converged").to_numpy(),
        observed=read("observed", COORDINATES).astype(bool),
    )
    variants, ground = {}, {}
    for name in named("residual.", f".{AXES[0]}"):
        force, residual = read(f"tau.{name}", COORDINATES), reported(read(f"residual.{name}", AXES))
        variants[name] = Dynamics(time, force, frozen(residual), frozen(force * motion.v), engine)
        feet = named(f"ground.{name}.", f".{WRENCH[0]}")
        ground[name] = {foot: read(f"ground.{name}.{foot}", WRENCH) for foot in feet}
    pose = read("platform", POSE) if named("platform.") else None
    return {
        "markers": Markers(time, names, frozen(position)),
        "motion": motion,
        "variants": variants,
        "ground": ground,
        "platform": None
        if pose is None
        else PlatformPose(pose[:, :9].reshape(-1, 3, 3), pose[:, 9:]),
        "quality": table.column("quality").to_numpy(),
        "uncertainty": read("uncertainty.residual", AXES) if named("uncertainty.") else None,
    }


def _columns(prefix: str, names: Iterable[str], values: Array | Mask) -> dict[str, Column]:
    """Name the columns of (T, K) values, each in one piece, which Arrow need not copy."""
    columns = np.ascontiguousarray(values.T)
    return {f"{prefix}.{n}": column for n, column in zip(names, columns, strict=True)}


def _by_coordinate(prefix: str, values: Array | Mask) -> dict[str, Column]:
    """Name the columns of (T, 46) values, in the Human Body Model's order."""
    columns = _columns(prefix, COORDINATES, values)
    return {name: columns[name] for name in (f"{prefix}.{c}" for c in HBM_ORDER)}


def _event_labels(time: Array, events: Sequence[Event]) -> list[str]:
    """Give the events of each frame as text."""
    labels, between = [""] * len(time), (time[1:] + time[:-1]) / 2
    frames = np.searchsorted(between, [event.time for event in events])
    for nearest, event in zip(frames.tolist(), events, strict=True):
        labels[nearest] = " ".join(filter(None, (labels[nearest], f"{event.side} {event.label}")))
    return labels


class _DamagedError(Exception):
    """A file that is not as it was written, or no trial could be written so."""


DAMAGED: Final = (
    *(_DamagedError, pa.ArrowException, LookupError, RecursionError),
    *(ArithmeticError, AttributeError, TypeError),
)
"""What is raised by content of another shape than a trial's."""


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn every fault of a stored trial into one line that names the file."""
    name, again = short(path.name, MAX_REASON), "'hbm run' makes it again; otherwise delete it"
    try:
        yield
    except MemoryError as error:
        raise ValueError(f"{name}: {NO_MEMORY}") from error
    except (OSError, *DAMAGED) as error:
        if isinstance(error, OSError) and error.errno is not None:
            # the file cannot be opened; without a number, it cannot be decompressed
            raise OSError(error.errno, error.strerror, str(path)) from error
        text = f"no {error.args[0]}" if isinstance(error, KeyError) else str(error)
        reason = short(" ".join(text.split()), MAX_REASON)
        raise ValueError(f"{name} is damaged: {reason}; {again}") from error
    except ValueError as error:
        reason = short(" ".join(str(error).split()), MAX_REASON)
        raise ValueError(f"{name}: {reason}; {again}") from error


def record_run(folder: Path, study: Path) -> None:
    """Note in a results folder where its study is, relative to the folder."""
    try:
        where = os.path.relpath(study.resolve(), folder.resolve())
    except ValueError:  # on another drive
        where = str(study.resolve())
    write_text(json.dumps({"study": where}), folder / RUN)


def recorded_study_folder(folder: Path) -> Path | None:
    """Give the study that a results folder comes from; None if it is unknown or gone."""
    try:
        where = dict(json.loads(read_text(folder / RUN)))["study"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    study = Path(os.path.normpath(folder / str(where)))
    return study if (study / "study.toml").is_file() else None
