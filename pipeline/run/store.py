"""A processed trial on disk: one Parquet file, written whole or not at all, and read back.

Each frame is a row. The first row also holds what has no frames, as JSON. Columns that follow from
others within milliseconds are not stored: `read_trial` computes them as the chain did. A checksum
is of the whole file, for a damaged footer can end the process that reads it.
"""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any, Final
from zlib import crc32

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, create_model
from pydantic_core import to_json

from compensation.platform import PlatformPose
from hbm.body import Body
from hbm.coordinates import COORDINATES, N_Q
from hbm.dynamics import Dynamics, filter_motion, inverse_dynamics_variants
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.poses import marker_positions
from hbm.spatial import Array, Indices, frozen
from hbm.spelling import short
from pipeline.config.schema import Settings
from pipeline.io.input_file import NO_MEMORY, open_file, read_text
from pipeline.io.read import is_recording
from pipeline.io.recording import Event
from pipeline.io.write import open_parquet, whole_file, write_text
from pipeline.trial.residuals import AXES, reported
from pipeline.trial.result import TrialResult
from pipeline.trial.stages import known_forces

FORMAT_VERSION: Final = 14
"""Of stored trials; raised with every change of what they hold."""
VERSION: Final = b"hbm"
"""Key of the format's version in the file's metadata."""
SEAL: Final = b"hbm crc32"
"""Stands before the checksum of the file. Parquet's own are of single pages, not of the footer."""
TRIAL: Final = "trial"
"""Column of what has no frames, in the first row."""
LOST: Final = 1e-9
"""Of a column's peak: what rounding on disk and computing again may change at most."""
STEPS: Final = {"solved": 2e-13, "ground": 5e-12}
"""Of the peaks of columns, to which they are rounded; the others to `LOST`. What is computed from
these is 1,000 times less exact: accelerations are second derivatives."""
MAX_REASON: Final = 120
"""Characters of a library's message, or of a file's name, within ours."""
AGAIN: Final = "'hbm run' makes it again; otherwise delete it"
RUN: Final = "run.json"
OF_FRAMES: Final = frozenset(
    {"markers", "motion", "variants", "ground", "platform", "quality", "uncertainty", "solved"}
)
"""Fields of a result that have a value in each frame."""
BITS: Final = 2 ** np.arange(N_Q)
"""Of the coordinates that were observed."""
Blocks = dict[str, tuple[Sequence[str], Any]]
"""What columns begin with -> how they go on, K names, and values, (K, T)."""


def write_trial(result: TrialResult, path: Path) -> None:
    """Write a trial as Parquet; the file appears whole or not at all.

    Its columns are ``time_s``; per variant ``residual.measured.Fx`` … ``Mz`` [N, N·m] as reported
    (x forward, y right, z up, about the pelvis origin); ``event``, such as "left foot_strike", on
    the frame nearest to it; ``converged`` of the inverse kinematics, and ``observed``, a bit for
    each coordinate; ``quality``, the sum of the flags of `pipeline.trial.quality.Quality` that say
    why the frame does not count or is doubtful; ``solved.NAME``, coordinates before the filter [m
    or rad]. In lab axes (X forward, Y left, Z up): ``ground.measured.left_foot.Fx`` … ``Mz`` [N,
    N·m] about the lab origin, ``marker_mm.NAME.x`` as measured, ``platform.r11`` … ``z`` [m], and
    the standard uncertainty ``uncertainty.Fx`` … ``Mz``. ``trial`` is JSON in the first row.
    """
    content = sealed(_table(result))
    with whole_file(path) as temporary, temporary.open("r+b") as written:
        # ext4 writes to the disk at once what was truncated
        written.write(content)


def sealed(table: pa.Table, version: bytes = str(FORMAT_VERSION).encode()) -> bytes:
    """Give a table as a Parquet file with a checksum."""
    sink = pa.BufferOutputStream()
    with parquet_writer(sink, table.schema, write_statistics=False) as file:
        file.write_table(table)
        file.add_key_value_metadata({VERSION: version})
    content: bytes = sink.getvalue().to_pybytes()
    place = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    pages, footer = content[:place], content[place:]
    return pages + SEAL + _checksum(pages, footer) + footer


def parquet_writer(sink: Any, schema: pa.Schema, **options: Any) -> pq.ParquetWriter:
    """Compress what is not a number with decimals by a dictionary; texts are read as texts."""
    numbers = [column.name for column in schema if pa.types.is_floating(column.type)]
    options["use_dictionary"] = others = [name for name in schema.names if name not in numbers]
    # numbers hardly shrink: zstd is 2 % shorter than LZ4 and takes four times as long
    options["compression"] = dict.fromkeys(numbers, "lz4") | dict.fromkeys(others, "zstd")
    options |= {"use_byte_stream_split": numbers, "store_schema": False}
    return pq.ParquetWriter(sink, schema, **options)


def _checksum(pages: bytes, footer: bytes) -> bytes:
    """Give the checksum of a Parquet file, which stands between its pages and its footer."""
    return crc32(footer, crc32(pages)).to_bytes(4, "little")


@np.errstate(over="ignore", invalid="ignore")
def _table(result: TrialResult) -> pa.Table:
    """Lay a trial out as it is stored."""
    motion, variants = result.motion, result.variants
    stored = {
        name: (names, _rounded(rows, STEPS.get(name.split(".")[0], LOST)))
        for name, (names, rows) in stored_blocks(result).items()
    }
    # computed again as on reading; what differs is stored
    rows_of = {name: frozen(rows) for name, (_, rows) in stored.items()}
    ground = {
        variant: {foot: rows_of[f"ground.{variant}.{foot}"].T for foot in feet}
        for variant, feet in result.ground.items()
    }
    solved = replace(motion, q=rows_of["solved"].T)
    markers = _markers(motion.time, result.markers.names, rows_of)
    of_trial = result.quality, result.body, result.settings
    computed = following_blocks(*_computed(solved, markers, ground, *of_trial))
    for name, (names, expected) in following_blocks(motion, variants).items():
        if not _same(computed[name][1], expected):
            stored[name] = names, _rounded(expected, LOST)
    rest = {f.name: getattr(result, f.name) for f in fields(result) if f.name not in OF_FRAMES}
    rest |= {
        "source": result.source.name,
        "frames": len(motion.time),
        "engine": result.engine,
        "solved_from": motion.markers,
        "markers": result.markers.names,
        "feet": {variant: [*result.ground.get(variant, ())] for variant in variants},
        "blocks": {name: names for name, (names, _) in stored.items()},
    }
    columns: dict[str, Any] = {"time_s": motion.time, "converged": motion.converged}
    columns |= {"quality": result.quality, "observed": motion.observed @ BITS}
    columns |= by_column(stored)
    as_json = to_json(rest, fallback=_plain).decode()
    texts = {
        "event": event_labels(motion.time, result.events),
        TRIAL: [as_json, *[""] * (len(motion.time) - 1)],
    }
    arrays = {name: number_column(column) for name, column in columns.items()}
    return pa.table(arrays | {name: _texts(column) for name, column in texts.items()})


def number_column(column: Any) -> pa.Array:
    """Give a column without a copy; `pyarrow.array` would load pandas to do so."""
    column = np.ascontiguousarray(column)
    kind = pa.from_numpy_dtype(column.dtype)
    buffer = np.packbits(column, bitorder="little") if kind == pa.bool_() else column
    return pa.Array.from_buffers(kind, len(column), [None, pa.py_buffer(buffer)])


def _texts(column: Sequence[str]) -> pa.Array:
    """Give a column of texts."""
    builder = pa.lib.StringBuilder()
    builder.append_values(column)
    return builder.finish()


@np.errstate(over="ignore", invalid="ignore")
def stored_blocks(result: TrialResult) -> Blocks:
    """Give the columns from which the others follow."""
    blocks: Blocks = {
        f"residual.{variant}": (AXES, reported(dynamics.residual).T)
        for variant, dynamics in result.variants.items()
    }
    blocks["solved"] = COORDINATES, result.solved.T
    position = np.moveaxis(result.markers.position, 0, -1).reshape(-1, len(result.quality))
    places = [f"{name}.{axis}" for name in result.markers.names for axis in "xyz"]
    # cameras' files hold millimetres in single precision
    in_mm = (1000 * position).astype(np.float32)
    exact = np.array_equal(_metres(in_mm), position, equal_nan=True)
    blocks["marker_mm" if exact else "marker"] = places, in_mm if exact else position
    for variant, feet in result.ground.items():
        blocks |= {f"ground.{variant}.{foot}": (AXES, wrench.T) for foot, wrench in feet.items()}
    if (pose := result.platform) is not None:
        # rotation matrix, row by row, and position
        names = *(f"r{row}{column}" for row in "123" for column in "123"), "x", "y", "z"
        blocks["platform"] = names, np.hstack([pose.rotation.reshape(-1, 9), pose.position]).T
    if result.uncertainty is not None:
        blocks["uncertainty"] = AXES, result.uncertainty.T
    return blocks


def following_blocks(motion: Motion, variants: Mapping[str, Dynamics]) -> Blocks:
    """Give the columns that usually follow from others."""
    blocks: Blocks = {name: (COORDINATES, getattr(motion, name).T) for name in "qva"}
    blocks["marker_error"] = motion.markers, motion.marker_error.T
    return blocks | {f"tau.{name}": (COORDINATES, of.tau.T) for name, of in variants.items()}


def by_column(blocks: Blocks) -> dict[str, Any]:
    """Give blocks as columns of a table, (T,) each."""
    return {
        f"{block}.{name}": row
        for block, (names, rows) in blocks.items()
        for name, row in zip(names, rows, strict=True)
    }


def _rounded(rows: Any, step: float) -> Any:
    """Round numbers in double precision to powers of two, a fraction of the peak of each row."""
    if rows.dtype != float:
        return rows
    lost = step * _peaks(rows)
    lost[lost == 0] = 1.0
    # multiples of a power of two end in zero bits, which compress
    steps = 2.0 ** np.floor(np.log2(lost))
    return np.rint(rows / steps) * steps


def _peaks(rows: Array) -> Array:
    """Give the largest size in each row, (K, 1)."""
    return np.asarray(np.abs(rows).max(axis=1, where=np.isfinite(rows), initial=0.0, keepdims=True))


def _same(computed: Array, expected: Array) -> bool:
    """Whether rows are others but for rounding."""
    apart = np.abs(computed - expected) > LOST * _peaks(expected)
    return not apart.any() and np.array_equal(np.isnan(computed), np.isnan(expected))


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
        If the file is a recording, damaged, not a trial's result, or written by another version.
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
    name = short(path.name, MAX_REASON)
    with _readable(path):
        with open_file(path) as opened:
            content = opened.read()
        pages, seal, rest = content.rpartition(SEAL)
        if seal and rest[:4] != _checksum(pages, rest[4:]):
            raise ValueError("its bytes are not those that were written")
        # a table takes up to forty times its file in memory
        file = open_parquet(pa.BufferReader(content), 40 * len(content))
        version = (file.metadata.metadata or {}).get(VERSION)
    if version is None:
        raise ValueError(f"{name} is not the result of a trial")
    if version != str(FORMAT_VERSION).encode():
        other = f"written by another version of hbm; this one reads format {FORMAT_VERSION}"
        raise ValueError(f"{name}: {other}; {AGAIN}")
    with _readable(path):
        if not seal:
            raise ValueError("it has no checksum")
        texts = file.read(columns=[TRIAL], use_threads=False)[TRIAL]
        stored = json.loads(texts[0].as_py(), object_hook=_array)
        if len(texts) != stored["frames"]:
            raise ValueError(f"it has {len(texts)} frames, expected {stored['frames']}")
        table = file.read(use_threads=False) if frames else file.schema_arrow.empty_table()
        result = _result(table, stored)
        if not (result.shortage or result.span or any(map(len, result.cycles.values()))):
            raise ValueError("it has residuals without the gait cycles or span that they are of")
        return result


def _plain(value: Any) -> Any:
    """Give what JSON does not know in types that it knows."""
    if isinstance(value, np.ndarray):
        return {"shape": value.shape, "values": value.ravel().tolist()}
    return dict(value)


def _array(stored: dict[str, Any]) -> Any:
    """Give an object of JSON, as an array if it is one."""
    if stored.keys() != {"shape", "values"}:
        return stored
    return np.array(stored["values"], float).reshape(stored["shape"])


@cache
def _without_frames() -> type[BaseModel]:
    """Give the type of what a trial has besides its frames."""
    kinds: Any = {f.name: (f.type, ...) for f in fields(TrialResult) if f.name not in OF_FRAMES}
    arrays = ConfigDict(arbitrary_types_allowed=True)
    return create_model("WithoutFrames", __config__=arrays, **kinds)


def _result(table: pa.Table, stored: dict[str, Any]) -> TrialResult:
    """Put a trial together from its frames and the rest."""
    rest = dict(_without_frames().model_validate(stored))
    columns = {n: table[n].to_numpy() for n in table.column_names if n != TRIAL}
    rows_of = {
        block: frozen(np.stack([columns[f"{block}.{name}"] for name in names]))
        for block, names in stored["blocks"].items()
    }
    return TrialResult(**rest, **_frames(columns, rows_of, stored, rest["body"], rest["settings"]))


@np.errstate(over="ignore", invalid="ignore")
def _frames(
    columns: Mapping[str, Any],
    rows_of: Mapping[str, Any],
    stored: Mapping[str, Any],
    body: Body,
    settings: Settings,
) -> dict[str, Any]:
    """Read what has frames back and compute what is not stored; KeyError if anything is missing."""
    time, quality, engine = columns["time_s"], columns["quality"], stored["engine"]
    solved_from = tuple(stored["solved_from"])

    def read(name: str, computed: Array | None = None) -> Array:
        if computed is not None and name not in rows_of:
            return computed
        return frozen(np.ascontiguousarray(rows_of[name].T))

    markers, solved = _markers(time, stored["markers"], rows_of), read("solved")
    motion = Motion(
        time=time,
        q=solved,
        v=solved,
        a=solved,
        markers=solved_from,
        marker_error=np.empty((len(time), len(solved_from))),
        converged=columns["converged"].astype(bool),
        observed=columns["observed"][:, None] & BITS > 0,
    )
    ground = {v: {f: read(f"ground.{v}.{f}") for f in feet} for v, feet in stored["feet"].items()}
    dynamics = {v: Dynamics(time, solved, solved[:, :6], solved, engine) for v in ground}
    if len(time):
        motion, dynamics = _computed(motion, markers, ground, quality, body, settings)
    of_motion: dict[str, Any] = {
        n: read(n, getattr(motion, n)) for n in ("q", "v", "a", "marker_error")
    }
    variants = {}
    for name, loads in dynamics.items():
        tau = read(f"tau.{name}", loads.tau)
        residual = frozen(reported(read(f"residual.{name}")))
        variants[name] = Dynamics(time, tau, residual, frozen(tau * of_motion["v"]), engine)
    pose = None
    if "platform" in rows_of:
        of_platform = read("platform")
        pose = PlatformPose(of_platform[:, :9].reshape(-1, 3, 3), of_platform[:, 9:])
    return {
        "markers": markers,
        "motion": replace(motion, **of_motion),
        "solved": solved,
        "variants": variants,
        "ground": ground,
        "platform": pose,
        "quality": quality,
        "uncertainty": read("uncertainty") if "uncertainty" in rows_of else None,
    }


def _markers(time: Array, names: Sequence[str], rows_of: Mapping[str, Any]) -> Markers:
    """Give the markers whose positions are in these rows."""
    position = _metres(rows_of["marker_mm"]) if "marker_mm" in rows_of else rows_of["marker"]
    by_marker = frozen(position).reshape(len(names), 3, len(time))
    return Markers(time, tuple(names), np.moveaxis(by_marker, -1, 0))


def _computed(
    motion: Motion,
    markers: Markers,
    ground: Mapping[str, Mapping[str, Array]],
    quality: Indices,
    body: Body,
    settings: Settings,
) -> tuple[Motion, dict[str, Dynamics]]:
    """Compute what follows from a solved motion as the chain does, but for the residual."""
    motion = replace(motion, marker_error=_marker_errors(body, motion, markers))
    motion = filter_motion(motion, cutoff=settings.cutoff_hz, method=settings.filter)
    wrenches = list(ground.values())
    variants = inverse_dynamics_variants(body, motion, wrenches)
    return motion, known_forces(dict(zip(ground, variants, strict=True)), quality)


def _marker_errors(body: Body, motion: Motion, markers: Markers) -> Array:
    """Give the distance of each marker of a solved motion from the model, (T, K) [m]."""
    names = motion.markers
    of_model = marker_positions(body, motion.q)[:, [body.markers.index(name) for name in names]]
    away = markers.position[:, [markers.names.index(name) for name in names]] - of_model
    return np.asarray(np.sqrt(np.einsum("tki,tki->tk", away, away)))


def event_labels(time: Array, events: Sequence[Event]) -> list[str]:
    """Give the events of each frame as text."""
    labels, between = [""] * len(time), (time[1:] + time[:-1]) / 2
    frames = np.searchsorted(between, [event.time for event in events])
    for nearest, event in zip(frames.tolist(), events, strict=True):
        labels[nearest] = " ".join(filter(None, (labels[nearest], f"{event.side} {event.label}")))
    return labels


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn every fault of a stored trial into one line that names the file."""
    name = short(path.name, MAX_REASON)
    try:
        yield
    except MemoryError as error:
        raise ValueError(f"{name}: {NO_MEMORY}") from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            # the file cannot be opened; without a number, its content is damaged
            raise OSError(error.errno, error.strerror, str(path)) from error
        if is_recording(path):
            raise ValueError(f"{name} is a recording, no result; read it with hr.read") from None
        text = f"no {error.args[0]}" if isinstance(error, KeyError) else str(error)
        reason = short(" ".join(text.split()), MAX_REASON)
        raise ValueError(f"{name} is damaged: {reason}; {AGAIN}") from error


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
