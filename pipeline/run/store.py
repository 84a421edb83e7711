"""What one processed trial leaves on disk: per-frame Parquet, CSV, provenance."""

import json
import os
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from hbm.coordinates import HBM_ORDER, INDEX
from pipeline.io.write import whole_file
from pipeline.trial.residuals import (
    AXES,
    hicks_table,
    marker_table,
    reported,
    residual_table,
    variants,
)
from pipeline.trial.result import TrialResult

PACKAGES: Final = ("hbm-residuals", "casadi", "numpy", "scipy", "pandas", "pyarrow")
FACTS: Final = b"hbm"


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


def trial_facts(result: TrialResult, condition: str, key: str) -> dict[str, Any]:
    """Say what made a trial's result and what a report needs of it besides the frames.

    Parameters
    ----------
    result
        The trial.
    condition
        Its condition.
    key
        Digest of everything that went into it.

    Returns
    -------
    dict
        Plain values, ready for JSON.
    """
    return {
        "key": key,
        "source": result.source.name,
        "condition": condition,
        "subject": result.subject.model_dump(),
        "settings": result.settings.model_dump(),
        "versions": {name: version(name) for name in PACKAGES},
        "body_mass_kg": result.body.mass,
        "height_m": result.body.height_m,
        "marker_set": result.body.marker_set.name,
        "locked": list(result.body.locked),
        "segments": list(result.segments),
        "notes": list(result.notes),
        "delay_s": result.delay_s if np.isfinite(result.delay_s) else None,
        "delay_uncertainty_s": (
            result.delay_uncertainty_s if np.isfinite(result.delay_uncertainty_s) else None
        ),
        "unsolved_frames": int(np.count_nonzero(~result.motion.converged)),
        "frames": len(result.motion.time),
        "cycles": {side: spans.tolist() for side, spans in result.cycles.items()},
        "residuals": residual_table(result, condition).to_dict("records"),
        "hicks": hicks_table(result).to_dict("records"),
        "markers": marker_table(result).to_dict("records"),
    }


def write_trial(result: TrialResult, condition: str, key: str, path: Path) -> None:
    """Write a trial as Parquet: `frame_table`, and `trial_facts` in the file's metadata.

    Parameters
    ----------
    result, condition, key
        As for `trial_facts`.
    path
        The file; it appears whole or not at all.
    """
    table = pa.Table.from_pandas(frame_table(result), preserve_index=False)
    facts = json.dumps(trial_facts(result, condition, key), ensure_ascii=False).encode()
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), FACTS: facts})
    with whole_file(path) as temporary:
        pq.write_table(table, temporary, compression="zstd", use_dictionary=["event"])


def read_facts(path: Path) -> dict[str, Any]:
    """Read a trial's facts back without its frames.

    Raises
    ------
    ValueError
        If the file is damaged or not a trial's result.
    OSError
        If it cannot be opened.
    """
    try:
        metadata = pq.read_schema(path).metadata or {}
    except pa.ArrowInvalid as error:
        raise ValueError(f"{path.name} is damaged: {error}; 'hbm run' makes it again") from error
    if FACTS not in metadata:
        raise ValueError(f"{path.name} is not the result of a trial")
    facts: dict[str, Any] = json.loads(metadata[FACTS])
    return facts


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
