"""What one processed trial leaves on disk: per-frame Parquet, CSV, provenance."""

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from hbm.coordinates import HBM_ORDER, INDEX
from pipeline.process import TrialResult
from pipeline.residuals import AXES, reported, variants

PACKAGES: Final = ("hbm-residuals", "pin", "casadi", "numpy", "scipy", "pandas", "pyarrow")


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


def provenance(result: TrialResult) -> dict[str, object]:
    """Say what made a result: settings, subject, versions, and what was noted on the way."""
    return {
        "source": result.source.name,
        "subject": result.subject.model_dump(),
        "settings": result.settings.model_dump(),
        "versions": {name: version(name) for name in PACKAGES},
        "notes": list(result.notes),
    }


def write_frames(result: TrialResult, path: Path) -> None:
    """Write `frame_table` as Parquet with the provenance in its metadata, whole or not at all."""
    table = pa.Table.from_pandas(frame_table(result), preserve_index=False)
    facts = json.dumps(provenance(result), ensure_ascii=False).encode()
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), b"hbm": facts})
    with _whole(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")


def write_csv(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV, whole or not at all."""
    with _whole(path) as temporary:
        table.to_csv(temporary, index=False, float_format="%.6g", encoding="utf-8")


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Give a temporary name beside a file; it takes the file's place once all is written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
