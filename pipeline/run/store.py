"""What one processed trial leaves on disk: per-frame Parquet, CSV, provenance."""

import json
import os
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from hbm.coordinates import HBM_ORDER, INDEX
from pipeline.io.write import whole_file
from pipeline.trial.residuals import AXES, reported, variants
from pipeline.trial.result import TrialResult
from pipeline.trial.summary import TrialSummary, summarise

SUMMARY: Final = b"hbm"
"""Key of the summary in the file's metadata."""


def frame_table(result: TrialResult) -> pd.DataFrame:
    """Lay a trial out with one row per frame.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    pandas.DataFrame
        time_s; ``q.NAME``, ``v.NAME``, ``a.NAME`` [rad or m, per s, per s²] and per variant
        ``tau.measured.NAME`` [N·m or N] in the Human Body Model's order; ``residual.measured.Fx``
        … ``Mz`` [N, N·m] (x forward, y right, z up, about the pelvis origin); ``marker_error.NAME``
        [m]; ``event``, such as "left foot_strike", on the frame nearest to it.
    """
    motion = result.motion
    columns: dict[str, object] = {"time_s": motion.time}
    order = [INDEX[name] for name in HBM_ORDER]
    for symbol, values in (("q", motion.q), ("v", motion.v), ("a", motion.a)):
        columns |= {f"{symbol}.{n}": values[:, i] for n, i in zip(HBM_ORDER, order, strict=True)}
    for variant, dynamics in variants(result).items():
        columns |= {
            f"tau.{variant}.{n}": dynamics.tau[:, i] for n, i in zip(HBM_ORDER, order, strict=True)
        }
        values = reported(dynamics.residual)
        columns |= {f"residual.{variant}.{axis}": values[:, k] for k, axis in enumerate(AXES)}
    columns |= {
        f"marker_error.{n}": motion.marker_error[:, k] for k, n in enumerate(motion.markers)
    }
    said = np.full(len(motion.time), "", dtype=object)
    for event in result.events:
        nearest = int(np.argmin(np.abs(motion.time - event.time)))
        said[nearest] = " ".join(filter(None, (said[nearest], f"{event.side} {event.label}")))
    columns["event"] = said
    return pd.DataFrame(columns)


def write_trial(result: TrialResult, condition: str, key: str, path: Path) -> None:
    """Write a trial as Parquet: `frame_table`, and its `TrialSummary` in the file's metadata.

    Parameters
    ----------
    result, condition, key
        As for `pipeline.trial.summary.summarise`.
    path
        The file; it appears whole or not at all.
    """
    table = pa.Table.from_pandas(frame_table(result), preserve_index=False)
    summary = summarise(result, condition, key).to_json()
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), SUMMARY: summary})
    with whole_file(path) as temporary:
        pq.write_table(table, temporary, compression="zstd", use_dictionary=["event"])


def read_summary(path: Path) -> TrialSummary:
    """Read a trial's summary without its frames.

    Raises
    ------
    ValueError
        If the file is damaged, not a trial's result, or written by another version.
    OSError
        If it cannot be opened.
    """
    try:
        metadata = pq.read_schema(path).metadata or {}
    except pa.ArrowInvalid as error:
        raise ValueError(f"{path.name} is damaged: {error}; 'hbm run' makes it again") from error
    if SUMMARY not in metadata:
        raise ValueError(f"{path.name} is not the result of a trial")
    try:
        return TrialSummary.from_json(metadata[SUMMARY])
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}; 'hbm run' makes it again") from error


RUN = "run.json"


def remember_study(folder: Path, study: Path) -> None:
    """Note in a results folder which study it comes from, relative to the folder."""
    try:
        where = os.path.relpath(study.resolve(), folder.resolve())
    except ValueError:
        where = str(study.resolve())
    with whole_file(folder / RUN) as temporary:
        temporary.write_text(json.dumps({"study": where}), encoding="utf-8")


def recall_study(folder: Path) -> Path | None:
    """Give the study that a results folder comes from; None where it does not say or is gone."""
    try:
        where = json.loads((folder / RUN).read_text(encoding="utf-8"))["study"]
    except (OSError, ValueError, KeyError):
        return None
    study = Path(os.path.normpath(folder / where))
    return study if (study / "study.toml").is_file() else None
