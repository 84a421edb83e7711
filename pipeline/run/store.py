"""A processed trial on disk: one Parquet file, written whole or not at all, and read back."""

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hbm.spatial import Array
from pipeline.io.write import whole_file
from pipeline.run.frames import frame_table, read_frames
from pipeline.run.header import TrialHeader, header_of, plates_of
from pipeline.trial.result import TrialResult
from pipeline.trial.summary import TrialSummary, summarise

SUMMARY: Final = b"hbm"
HEADER: Final = b"hbm.header"
"""Keys of summary and header in the file's metadata."""
COMPRESSION: Final = "snappy"
"""Half the time of zstd for 7 % more; floating-point numbers hardly compress."""
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
    with (
        whole_file(path) as temporary,
        pq.ParquetWriter(
            temporary,
            table.schema,
            compression=COMPRESSION,
            use_dictionary=["event"],
            write_statistics=False,
            store_schema=False,  # it would hold the metadata a second time
        ) as file,
    ):
        file.write_table(table)
        stored = {SUMMARY: summary.to_json(), HEADER: header_of(result).to_json()}
        file.add_key_value_metadata(stored)
    return summary


def read_summary(path: Path) -> TrialSummary:
    """Read a trial's summary without its frames.

    Raises
    ------
    ValueError
        If the file is damaged, not a trial's result, or written by another version.
    OSError
        If it cannot be opened.
    """
    metadata = _metadata(path)
    with _readable(path):
        return TrialSummary.from_json(metadata[SUMMARY])


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
    metadata = _metadata(path)
    with _readable(path):
        summary = TrialSummary.from_json(metadata[SUMMARY])
        header = TrialHeader.from_json(metadata[HEADER])
        frames = read_frames(pq.read_table(path), header, summary.engine)
    return TrialResult(
        source=Path(summary.source),
        subject=summary.subject,
        settings=summary.settings,
        body=header.body.to_body(),
        markers=frames.markers,
        first_frame=header.first_frame,
        plates=plates_of(header),
        motion=frames.motion,
        measured=frames.dynamics["measured"],
        compensated=frames.dynamics.get("compensated"),
        ground=frames.ground,
        platform=frames.platform,
        events=header.events,
        cycles={side: np.reshape(spans, (-1, 2)) for side, spans in summary.cycles.items()},
        found_cycles=summary.found_cycles,
        span=summary.span,
        validity=frames.validity,
        delay_s=np.nan if summary.delay_s is None else summary.delay_s,
        delay_uncertainty_s=(
            np.nan if summary.delay_uncertainty_s is None else summary.delay_uncertainty_s
        ),
        ambiguous=frames.ambiguous,
        notes=summary.notes,
        overridden_segments=summary.overridden_segments,
        onsets=header.onsets,
    )


def _metadata(path: Path) -> dict[bytes, bytes]:
    """Read the metadata of a trial's result."""
    with _readable(path):
        metadata: dict[bytes, bytes] = pq.read_metadata(path).metadata or {}
    if SUMMARY not in metadata:
        raise ValueError(f"{path.name} is not the result of a trial")
    return metadata


def read_columns(path: Path, names: Sequence[str]) -> Array:
    """Read columns of numbers of a stored trial, (T, K); raises as `read_trial`."""
    with _readable(path):
        table = pq.read_table(path, columns=list(names))
        return np.column_stack([table.column(name).to_numpy() for name in names])


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn every fault of a stored trial into one line that names the file."""
    again = "'hbm run' makes it again; otherwise delete it"
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            # the file cannot be opened; without a number, it cannot be decompressed
            raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
        raise ValueError(f"{path.name} is damaged: {error}; {again}") from error
    except KeyError as error:
        raise ValueError(f"{path.name} is damaged: no {error.args[0]}; {again}") from error
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}; {again}") from error


def record_study_folder(folder: Path, study: Path) -> None:
    """Note in a results folder which study it comes from, relative to the folder."""
    try:
        where = os.path.relpath(study.resolve(), folder.resolve())
    except ValueError:
        where = str(study.resolve())
    with whole_file(folder / STUDY_POINTER) as temporary:
        temporary.write_text(json.dumps({"study": where}), encoding="utf-8")


def recorded_study_folder(folder: Path) -> Path | None:
    """Give the study that a results folder comes from; None if it is unknown or gone."""
    try:
        where = json.loads((folder / STUDY_POINTER).read_text(encoding="utf-8"))["study"]
    except (OSError, ValueError, KeyError):
        return None
    study = Path(os.path.normpath(folder / where))
    return study if (study / "study.toml").is_file() else None
