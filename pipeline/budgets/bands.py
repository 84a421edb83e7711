"""Residuals over time with how sure they are, in files."""

from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.explain.budget import Bands
from pipeline.io.write import whole_file
from pipeline.trial.residuals import AXES

SUFFIX: Final = "_bands.parquet"


def write_bands(bands: Bands, path: Path) -> None:
    """Write residuals over time: a row per frame, whole or not at all.

    Parameters
    ----------
    bands
        Of a trial.
    path
        The file. Its columns are ``time_s``; ``cycle``, the number of the gait cycle; and per axis,
        as reported, ``residual.Fx`` and ``deviation.Fx``, one standard deviation [N, N·m].
    """
    columns: dict[str, np.ndarray] = {"time_s": bands.time, "cycle": bands.cycle}
    for name in ("residual", "deviation"):
        values = getattr(bands, name)
        columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate(AXES)}
    with whole_file(path) as temporary:
        pq.write_table(pa.table(columns), temporary)


def read_bands(path: Path) -> Bands:
    """Read residuals over time back.

    Raises
    ------
    ValueError
        If the file is damaged, or none of `write_bands`.
    OSError
        If it cannot be opened.
    """
    try:
        table = pq.read_table(path)
        six = {
            name: np.column_stack([table[f"{name}.{axis}"].to_numpy() for axis in AXES])
            for name in ("residual", "deviation")
        }
        return Bands(table["time_s"].to_numpy(), table["cycle"].to_numpy(), **six)
    except (pa.ArrowInvalid, KeyError) as error:
        raise ValueError(
            f"{path.name}: no residuals with bands; run 'hbm explain' again"
        ) from error
