"""A processed trial on disk: one Parquet file, written whole or not at all, and read back.

Each frame is a row of the file. What a trial has besides its frames stands in the file's metadata,
as JSON that is made from the types of `TrialResult` and read by them. Columns that follow from
others within milliseconds are not stored: `read_trial` computes them as the chain did.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, Union, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel

from compensation.platform import PlatformPose
from hbm.body import Body
from hbm.coordinates import COORDINATES, HBM_ORDER
from hbm.dynamics import Dynamics, filter_motion, inverse_dynamics_variants
from hbm.engines.engine import kernels_engine
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.poses import marker_positions
from hbm.spatial import Array, Indices, Mask, frozen
from hbm.spelling import short
from pipeline.config.schema import Settings
from pipeline.io.input_file import NO_MEMORY, open_file, read_text
from pipeline.io.recording import Event, Plate
from pipeline.io.write import open_parquet, whole_file, write_text
from pipeline.trial.residuals import AXES, reported
from pipeline.trial.result import TrialResult
from pipeline.trial.stages import known_forces

FORMAT_VERSION: Final = 13
"""Of stored trials; raised with every change of what they hold."""
METADATA: Final = b"hbm"
DIGEST: Final = b"hbm.sha256"
"""Keys of the trial without its frames, and of the checksum, in the file's metadata."""
NO_DIGEST: Final = b"0" * 64
DIGEST_START: Final = DIGEST + b"\x18\x40"
"""How a Parquet file stores that key, with type and length of the 64 characters that follow."""
LOST: Final = 1e-9
"""Of a column's peak: what rounding on disk and computing again may change at most."""
STEPS: Final = {"time_s": 0.0, "solved": 2e-13, "ground": 5e-12}
"""Of the peaks of columns, to which they are rounded; the others to `LOST`. What is computed from
these is 1,000 times less exact: accelerations are second derivatives."""
COMPUTED: Final = ("q.", "v.", "a.", "tau.", "marker_error.")
"""What columns begin with that are stored only where they do not follow from the others."""
MARKERS_MM: Final = "marker_mm"
"""What columns of marker positions begin with that are stored as recordings have them."""
MAX_EXPANSION: Final = 40
"""Of a file in memory."""
MAX_REASON: Final = 120
"""Characters of a library's message, or of a file's name, within ours."""
RUN: Final = "run.json"
WRENCH: Final = ("fx", "fy", "fz", "mx", "my", "mz")
POSE: Final = (*(f"r{row}{column}" for row in "123" for column in "123"), "x", "y", "z")
"""Rotation matrix, row by row, and position of the platform."""
OF_FRAMES: Final = frozenset(
    {"markers", "motion", "variants", "ground", "platform", "quality", "uncertainty", "solved"}
)
"""Fields of a result that have a value in each frame."""
Column = Array | Indices | Mask | Sequence[str]


def write_trial(result: TrialResult, path: Path) -> None:
    """Write a trial as Parquet; the file appears whole or not at all.

    Its columns are those of `frame_table` but those that `read_trial` computes, such as ``v``.
    """
    metadata, table = _metadata(result), _stored_columns(result)
    numbers = [name for name in table.column_names if name != "event"]
    sink = pa.BufferOutputStream()
    with pq.ParquetWriter(
        sink,
        table.schema,
        compression="zstd",
        use_dictionary=["event"],
        use_byte_stream_split=[n for n in numbers if pa.types.is_floating(table[n].type)],
        write_statistics=False,
        store_schema=False,  # it would hold the metadata a second time
    ) as file:
        file.write_table(table)
        file.add_key_value_metadata({METADATA: metadata, DIGEST: NO_DIGEST})
    with whole_file(path) as temporary, temporary.open("r+b") as written:
        # ext4 writes to the disk at once what was truncated
        written.write(with_digest(sink.getvalue()))


def with_digest(content: bytes | bytearray | pa.Buffer) -> bytearray:
    """Put the SHA-256 of all bytes of a stored trial but those of the digest itself into it."""
    signed = bytearray(content)
    place = signed.rfind(DIGEST_START) + len(DIGEST_START)
    signed[place : place + len(NO_DIGEST)] = _digest(signed, place)
    return signed


def _digest(content: bytes | bytearray, place: int) -> bytes:
    """Hash everything but the digest at a place."""
    view = memoryview(content)
    digest = hashlib.sha256(view[:place])
    digest.update(view[place + len(NO_DIGEST) :])
    return digest.hexdigest().encode()


@np.errstate(over="ignore", invalid="ignore")
def _stored_columns(result: TrialResult) -> pa.Table:
    """Give the rounded columns of a trial from which the others follow, and those that do not."""
    whole = _arrays(frame_table(result))
    kept = {n: _rounded(n, column) for n, column in whole.items() if not n.startswith(COMPUTED)}
    # cameras' files hold millimetres in single precision
    in_mm = (1000 * result.markers.position).astype(np.float32)
    if np.array_equal(_metres(in_mm), result.markers.position, equal_nan=True):
        kept = {n: column for n, column in kept.items() if not n.startswith("marker.")}
        for k, name in enumerate(result.markers.names):
            kept |= _columns(f"{MARKERS_MM}.{name}", "xyz", in_mm[:, k])
    # computed again as on reading; what differs is stored
    frames = _frames(
        pa.table(kept), result.body, result.settings, result.engine, result.motion.markers
    )
    again = _following(frames["motion"], frames["variants"])
    differ = (name for name, column in again.items() if not _same(column, whole[name]))
    return pa.table(kept | {name: _rounded(name, whole[name]) for name in differ})


def _arrays(table: pa.Table) -> dict[str, Any]:
    """Give columns by name, without copies."""
    return {
        name: column.to_numpy()
        for name, column in zip(table.column_names, table.columns, strict=True)
    }


def _rounded(name: str, column: Any) -> Any:
    """Round numbers to a power of two of which their peak has so many that little is lost."""
    share = STEPS.get(name.split(".", 1)[0], LOST)
    if column.dtype != float or not share:
        return column
    peak = np.max(np.abs(column), where=np.isfinite(column), initial=0.0)
    step = 2.0 ** np.floor(np.log2(peak * share)) if peak > 0 else 1.0
    return np.rint(column / step) * step


def _same(found: Array, expected: Array) -> bool:
    """Whether a column is another one but for rounding."""
    peak = np.max(np.abs(expected), where=np.isfinite(expected), initial=0.0)
    close = np.abs(found - expected) <= LOST * peak
    return bool(np.all(close | (np.isnan(found) & np.isnan(expected))))


def _metres(in_mm: Any) -> Array:
    """Give positions as readers of files do."""
    return np.asarray(in_mm.astype(float) * 0.001)


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
        Equal to what was written: numbers of frames within 1e-9 of the peak of their column, all
        else to the last bit; of ``source`` the name alone.

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
    first = {
        "version": FORMAT_VERSION,
        "frames": len(result.quality),
        "engine": result.engine,
        "solved_from": result.motion.markers,
    }
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
    if stored is None:
        return None
    origin, inner = _parts(kind)
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
def _parts(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """Give what a generic type is of, and its arguments."""
    return get_origin(kind), get_args(kind)


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
    of_motion = stored["engine"], tuple(stored["solved_from"])
    return TrialResult(**rest, **_frames(table, rest["body"], rest["settings"], *of_motion))


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
        Model's order; ``solved.NAME``, ``q`` before the filter; per variant ``tau.measured.NAME``
        [N·m or N] and ``residual.measured.Fx`` … ``Mz`` [N, N·m] as reported (x forward, y right,
        z up, about the pelvis origin);
        ``marker_error.NAME`` [m]; ``event``, such as "left foot_strike", on the frame nearest to
        it. In lab axes (X forward, Y left, Z up): ``ground.measured.left_foot.fx`` … ``mz`` [N,
        N·m] about the lab origin, ``marker.NAME.x`` [m] as measured, ``platform.r11`` … ``z``.
        ``converged``, ``observed.NAME`` of the inverse kinematics; ``quality``, the sum of the
        flags of `pipeline.trial.quality.Quality` that say why the frame does not count or is
        doubtful, 0 where nothing is. With a calibration of the platform, one standard deviation of
        the residual due to the compensation: ``uncertainty.residual.Fx`` …, lab axes [N, N·m].
    """
    motion, markers, pose = result.motion, result.markers, result.platform
    columns: dict[str, Column] = {"time_s": motion.time, **_following(motion, result.variants)}
    columns |= _by_coordinate("solved", result.solved)
    for variant, dynamics in result.variants.items():
        columns |= _columns(f"residual.{variant}", AXES, reported(dynamics.residual))
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


def _following(motion: Motion, variants: Mapping[str, Dynamics]) -> dict[str, Array]:
    """Give the columns that usually follow from others."""
    columns = _columns("marker_error", motion.markers, motion.marker_error)
    for symbol in "qva":
        columns |= _by_coordinate(symbol, getattr(motion, symbol))
    for variant, dynamics in variants.items():
        columns |= _by_coordinate(f"tau.{variant}", dynamics.tau)
    return columns


@np.errstate(over="ignore", invalid="ignore")
def _frames(
    table: pa.Table, body: Body, settings: Settings, engine: str, solved_from: Sequence[str]
) -> dict[str, Any]:
    """Read the columns of `frame_table` back and compute those that are not stored.

    KeyError if one is missing.
    """
    columns = _arrays(table)

    def read(prefix: str, names: Iterable[str], computed: Array | None = None) -> Array:
        values = np.empty((table.num_rows, len(names := [*names])))
        for k, name in enumerate(f"{prefix}.{name}" for name in names):
            values[:, k] = columns[name] if computed is None or name in columns else computed[:, k]
        return frozen(values)

    def named(prefix: str, last: str = "") -> tuple[str, ...]:
        chosen = (n for n in columns if n.startswith(prefix) and n.endswith(last))
        return tuple(n[len(prefix) : len(n) - len(last)] for n in chosen)

    time, prefix = columns["time_s"], MARKERS_MM if named(f"{MARKERS_MM}.") else "marker"
    names = named(f"{prefix}.", ".x")
    position = read(prefix, (f"{name}.{axis}" for name in names for axis in "xyz"))
    position = position.reshape(len(time), len(names), 3)
    markers = Markers(time, names, _metres(position) if prefix == MARKERS_MM else position)
    solved = read("solved", COORDINATES)
    motion = Motion(
        time=time,
        q=solved,
        v=np.full_like(solved, np.nan),
        a=np.full_like(solved, np.nan),
        markers=tuple(solved_from),
        marker_error=_marker_errors(body, solved, markers, solved_from),
        converged=columns["converged"],
        observed=read("observed", COORDINATES).astype(bool),
    )
    feet = {n: named(f"ground.{n}.", f".{WRENCH[0]}") for n in named("residual.", f".{AXES[0]}")}
    ground = {n: {f: read(f"ground.{n}.{f}", WRENCH) for f in feet[n]} for n in feet}
    forces = np.full_like(solved, np.nan)
    dynamics = {n: Dynamics(time, forces, forces[:, :6], forces, engine) for n in feet}
    if len(time):
        motion = filter_motion(motion, cutoff=settings.cutoff_hz, method=settings.filter)
        wrenches = list(ground.values())
        computed = inverse_dynamics_variants(body, motion, wrenches, engine=kernels_engine())
        dynamics = known_forces(dict(zip(feet, computed, strict=True)), columns["quality"])
    q, v, a = (read(name, COORDINATES, getattr(motion, name)) for name in "qva")
    error = read("marker_error", solved_from, motion.marker_error)
    variants = {}
    for name, loads in dynamics.items():
        tau = read(f"tau.{name}", COORDINATES, loads.tau)
        residual = frozen(reported(read(f"residual.{name}", AXES)))
        variants[name] = Dynamics(time, tau, residual, frozen(tau * v), engine)
    pose = read("platform", POSE) if named("platform.") else None
    return {
        "markers": markers,
        "motion": replace(motion, q=q, v=v, a=a, marker_error=error),
        "solved": solved,
        "variants": variants,
        "ground": ground,
        "platform": None
        if pose is None
        else PlatformPose(pose[:, :9].reshape(-1, 3, 3), pose[:, 9:]),
        "quality": columns["quality"],
        "uncertainty": read("uncertainty.residual", AXES) if named("uncertainty.") else None,
    }


def _marker_errors(body: Body, solved: Array, markers: Markers, names: Sequence[str]) -> Array:
    """Give the distance of each of these markers from the model, (T, K) [m]."""
    of_model = marker_positions(body, solved)[:, [body.markers.index(name) for name in names]]
    away = markers.position[:, [markers.names.index(name) for name in names]] - of_model
    return np.asarray(np.sqrt(np.einsum("tki,tki->tk", away, away)))


def _columns(prefix: str, names: Iterable[str], values: Any) -> dict[str, Array]:
    """Name the columns of (T, K) values, each in one piece, which Arrow need not copy."""
    columns = np.ascontiguousarray(values.T)
    return {f"{prefix}.{n}": column for n, column in zip(names, columns, strict=True)}


def _by_coordinate(prefix: str, values: Array | Mask) -> dict[str, Array]:
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
