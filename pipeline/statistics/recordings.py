"""A subject's value of a condition, where there are several recordings of it."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.statistics.design import Weigh

CELL_COLUMNS: Final = ("subject", "condition", "compensated", "axis", "unit")
"""What has one value."""
MEAN_SQUARES: Final = ("rms", "rms_percent", "expected")
POOLED_COLUMNS: Final = (
    *(*CELL_COLUMNS, "window", *MEAN_SQUARES),
    *("n_recordings", "n_cycles", "n_frames"),
)


def pool_recordings(residuals: pd.DataFrame, weigh: Weigh = "cycle") -> pd.DataFrame:
    """Give each subject one residual per condition: the RMS over all of its recordings.

    Parameters
    ----------
    residuals
        Rows of `pipeline.trial.residuals.residual_table`, one per recording, variant and axis, each
        of the window that its condition asks for.
    weigh
        What is equal: each gait cycle (step, stance; frame where windows differ or are spans of the
        recordings), or each recording.

    Returns
    -------
    pandas.DataFrame
        subject, condition, compensated, axis, unit; window; rms, rms_percent and expected;
        n_recordings, n_cycles and n_frames that they are of. A single recording keeps its values to
        the last bit.

    Examples
    --------
    >>> cell = {"subject": "sub01", "condition": "sway", "compensated": False, "axis": "Fx"}
    >>> cell |= {"unit": "N", "window": "cycle", "n_frames": 900}
    >>> cell |= {"rms_percent": 0.1, "expected": np.nan}
    >>> found = [cell | {"rms": 1.0, "n_cycles": 3}, cell | {"rms": 7.0, "n_cycles": 1}]
    >>> found = pd.DataFrame(found)
    >>> [float(pool_recordings(found, w)["rms"].iloc[0]) for w in ("cycle", "recording")]
    [3.605551275463989, 5.0]
    """
    if not residuals.duplicated([*CELL_COLUMNS]).any():
        return residuals.assign(n_recordings=1)[[*POOLED_COLUMNS]].reset_index(drop=True)
    rows = []
    for cell, of_cell in residuals.groupby([*CELL_COLUMNS], sort=False):
        row: dict[str, object] = dict(zip(CELL_COLUMNS, cell, strict=True))
        row["window"] = " and ".join(of_cell["window"].unique())
        weights = recording_weights(of_cell, weigh)
        if of_cell["expected"].notna().any():  # recordings whose markers show all add nothing
            of_cell = of_cell.fillna({"expected": 0.0})
        row |= {name: root_mean_square(of_cell[name].to_numpy(), weights) for name in MEAN_SQUARES}
        row["n_recordings"] = len(of_cell)
        row |= {name: of_cell[name].sum() for name in ("n_cycles", "n_frames")}
        rows.append(row)
    return pd.DataFrame(rows, columns=POOLED_COLUMNS)


def subject_means(
    cycles: pd.DataFrame,
    columns: Sequence[str],
    weigh: Weigh,
    *,
    within: Sequence[str] = (),
    of_sides: bool = False,
) -> pd.DataFrame:
    """Average curves over gait cycles, or by `weigh` the means of recordings.

    With `of_sides`, the means of both sides. Indexed by condition, compensated, subject, the
    columns `within` which they are averaged, and percent.
    """
    keys = ["condition", "compensated", "subject", *within, "percent"]
    levels = ["side"] * of_sides + ["recording"] * (weigh == "recording")
    # first within a recording of a side, then over recordings, then over sides
    means = cycles.groupby([*keys, *levels], sort=False, observed=True)[[*columns]].mean()
    for count in reversed(range(len(levels))):
        means = means.groupby([*keys, *levels[:count]], sort=False, observed=True).mean()
    return means


def root_mean_square(values: Array, weights: Array) -> Array:
    """Give the RMS over recordings, (R, ...), with weights (R,); a single one as it is."""
    return values[0] if len(values) == 1 else np.sqrt(np.tensordot(weights, values**2, axes=1))


def recording_weights(residuals: pd.DataFrame, weigh: Weigh) -> Array:
    """Give the weight of each row in the mean square of its cell; those of a cell sum to 1."""
    cells = residuals.groupby([*CELL_COLUMNS], sort=False)
    weight = pd.Series(1.0, residuals.index)
    if weigh == "cycle":
        # cycles count only within one kind of window; steps and cycles differ in length
        is_counted = cells["window"].transform("nunique") == 1
        is_counted &= cells["n_cycles"].transform("min") > 0
        weight = residuals["n_cycles"].where(is_counted, residuals["n_frames"]).astype(float)
    return (weight / weight.groupby(cells.ngroup()).transform("sum")).to_numpy(float)
