"""A processed trial on disk: one Parquet file, written whole or not at all, and read back."""

import hashlib
import json
import mmap
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import short
from pipeline.io.input_file import open_file
from pipeline.io.write import whole_file, write_text
from pipeline.run.frames import Frames, frame_table, read_frames
from pipeline.run.header import TrialHeader, header_of, plates_of
from pipeline.trial.result import TrialResult
from pipeline.trial.summary import TrialSummary, require_format, summarise

SUMMARY: Final = b"hbm"
HEADER: Final = b"hbm.header"
DIGEST: Final = b"hbm.sha256"
"""Keys of summary, header and checksum in the file's metadata."""
NO_DIGEST: Final = b"0" * 64
DIGEST_START: Final = DIGEST + b"\x18\x40"
"""How a Parquet file stores that key, with type and length of the 64 characters that follow."""
COMPRESSION: Final = "snappy"
"""Half the time of zstd for 7 % more."""
COMPRESSED: Final = ("observed.", "quality", "time_s", "event")
"""What columns begin with that compress well. Computed numbers do not, and of markers' positions a
quarter would be saved, 9 % of a file, for half the time that it takes to write it."""
MAX_REASON: Final = 120
"""Characters of a library's message, or of a file's name, within ours."""
STUDY_POINTER: Final = "run.json"


def write_trial(result: TrialResult, condition: str, key: str, path: Path) -> TrialSummary:
    """Write a trial as Parquet: its frames, and summary and header in the file's metadata.

    Parameters
    ----------
    result, condition, key
        As for `pipeline.trial.summary.summarise`.
    path
        The file; it appears whole or not at all. `pipeline.run.frames.frame_table` says what its
        columns are.

    Returns
    -------
    TrialSummary
        What was written besides the frames.
    """
    table, summary = frame_table(result), summarise(result, condition, key)
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
            stored = {SUMMARY: summary.to_json(), HEADER: header_of(result).to_json()}
            file.add_key_value_metadata(stored | {DIGEST: NO_DIGEST})
        with temporary.open("r+b") as written:
            write_digest(written)
    return summary


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


@dataclass(frozen=True, slots=True)
class StoredTrial:
    """A stored trial, read from the disk once; every byte is as it was written.

    Attributes
    ----------
    path
        The file.
    summary
        What is known of the trial besides its frames.
    """

    path: Path
    summary: TrialSummary
    _header: bytes
    _frames: pq.ParquetFile

    def columns(self, names: Sequence[str]) -> Array:
        """Give columns of numbers, (T, K)."""
        with _readable(self.path):
            table = self._frames.read(columns=list(names))
            return np.column_stack([table.column(name).to_numpy() for name in names])

    def result(self) -> TrialResult:
        """Give the trial as `read_trial` does."""
        with _readable(self.path):
            header = TrialHeader.from_json(self._header)
            frames = read_frames(self._frames.read(), header, self.summary.engine)
            return _result(self.summary, header, frames)


def open_trial(path: Path) -> StoredTrial:
    """Open a stored trial: read the file and see that it is whole.

    Raises
    ------
    ValueError
        If the file is damaged, not a trial's result, or written by another version.
    OSError
        If it cannot be opened.
    """
    with _readable(path):
        with open_file(path) as file:
            content = file.read()
        place = content.rfind(DIGEST_START) + len(DIGEST_START)
        digested = place >= len(DIGEST_START)
        if digested and content[place : place + len(NO_DIGEST)] != _digest(content, place):
            raise _DamagedError("its bytes are not those that were written")
        frames = pq.ParquetFile(pa.BufferReader(content))
        metadata: dict[bytes, bytes] = frames.metadata.metadata or {}
    if SUMMARY not in metadata:
        raise ValueError(f"{short(path.name, MAX_REASON)} is not the result of a trial")
    with _readable(path):
        require_format(metadata[SUMMARY])
        if not digested:
            raise _DamagedError("it has no checksum")
        summary, rows = TrialSummary.from_json(metadata[SUMMARY]), frames.metadata.num_rows
        if rows != summary.frames:
            raise _DamagedError(f"it has {rows} frames, expected {summary.frames}")
        if summary.residuals and not (summary.span or any(summary.cycles.values())):
            raise _DamagedError("it has residuals without the gait cycles or span that they are of")
        return StoredTrial(path, summary, metadata[HEADER], frames)


def read_summary(path: Path) -> TrialSummary:
    """Read a trial's summary without its frames; raises as `open_trial`."""
    return open_trial(path).summary


def read_trial(path: Path) -> TrialResult:
    r"""Read a trial's result back, as it was written.

    Parameters
    ----------
    path
        What `write_trial` wrote.

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
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> _ = Path("study.toml").write_text("[conditions.level]")
    >>> trials = '[trials.level]\nfile = "walk.c3d"'
    >>> _ = Path("sub01.toml").write_text(f'id = "sub01"\nsex = "male"\n{trials}')
    >>> (outcome,) = pipeline.run_study(pipeline.read_study("."), Path("results"))
    >>> outcome.job.target.name
    'sub01_level.parquet'
    >>> f"{pipeline.read_trial(outcome.job.target).body.mass:.1f} kg"
    '74.6 kg'
    """
    return open_trial(path).result()


def _result(summary: TrialSummary, header: TrialHeader, frames: Frames) -> TrialResult:
    return TrialResult(
        source=Path(summary.source),
        subject=summary.subject,
        settings=summary.settings,
        body=header.body.to_body(),
        markers=frames.markers,
        first_frame=header.first_frame,
        plates=plates_of(header),
        motion=frames.motion,
        variants=frames.dynamics,
        ground=frames.ground,
        platform=frames.platform,
        events=header.events,
        cycles={side: np.reshape(spans, (-1, 2)) for side, spans in summary.cycles.items()},
        found_cycles=summary.found_cycles,
        span=summary.span,
        quality=frames.quality,
        delay_s=np.nan if summary.delay_s is None else summary.delay_s,
        delay_uncertainty_s=(
            np.nan if summary.delay_uncertainty_s is None else summary.delay_uncertainty_s
        ),
        notes=summary.notes,
        overridden_segments=summary.overridden_segments,
        onsets=header.onsets,
        part=summary.part,
        uncertainty=frames.uncertainty,
    )


class _DamagedError(Exception):
    """A file that is not as it was written, or no trial could be written so."""


UNLIKE_A_TRIAL: Final = (
    *(_DamagedError, pa.ArrowException),
    *(ArithmeticError, AttributeError, IndexError, RecursionError, TypeError),
)
"""What is raised by content of another shape than a trial's."""


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn every fault of a stored trial into one line that names the file."""
    name, again = short(path.name, MAX_REASON), "'hbm run' makes it again; otherwise delete it"
    try:
        yield
    except KeyError as error:
        missing = short(error.args[0], MAX_REASON)
        raise ValueError(f"{name} is damaged: no {missing}; {again}") from error
    except (OSError, *UNLIKE_A_TRIAL) as error:
        if isinstance(error, OSError) and error.errno is not None:
            # the file cannot be opened; without a number, it cannot be decompressed
            raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
        reason = short(" ".join(str(error).split()), MAX_REASON)
        raise ValueError(f"{name} is damaged: {reason}; {again}") from error
    except ValueError as error:
        reason = short(" ".join(str(error).split()), MAX_REASON)
        raise ValueError(f"{name}: {reason}; {again}") from error


def record_study_folder(folder: Path, study: Path, of_calibration: Iterable[Note] = ()) -> None:
    """Note in a results folder its study, relative to the folder, and doubts on calibrations."""
    try:
        where = os.path.relpath(study.resolve(), folder.resolve())
    except ValueError:
        where = str(study.resolve())
    write_text(
        json.dumps(
            {"study": where, "calibration": [note.to_dict() for note in of_calibration]},
            ensure_ascii=False,
        ),
        folder / STUDY_POINTER,
    )


def recorded_study_folder(folder: Path) -> Path | None:
    """Give the study that a results folder comes from; None if it is unknown or gone."""
    try:
        where = json.loads((folder / STUDY_POINTER).read_text(encoding="utf-8"))["study"]
        study = Path(os.path.normpath(folder / where))
        return study if (study / "study.toml").is_file() else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
