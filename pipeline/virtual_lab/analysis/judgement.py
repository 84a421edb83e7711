"""Simulated laboratories judged by the cells of Table III with compensation."""

from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import t as student

from hbm.spatial import Array
from pipeline.virtual_lab.analysis.printed_table_3 import THESIS_SUBJECTS, removed
from pipeline.virtual_lab.analysis.processed_study import CELLS, KEYS
from pipeline.virtual_lab.analysis.unstated_estimate import CONFIDENCE, FITTED

MAX_SHARE: Final = 0.5
"""Of the thesis' value: where more is allowed, agreement says nothing."""


def judge(
    simulated: Array, printed: pd.DataFrame, error: Array | None = None, freedom: int = 1
) -> pd.DataFrame:
    """Judge a simulated laboratory by the cells with compensation.

    Parameters
    ----------
    simulated
        Cells by subject, (subjects, 36) [N, N·m].
    printed
        Table III: ``condition, compensated, axis, mean, sd``.
    error, freedom
        Standard error of the cells from what was estimated, (36,), and its degrees of freedom;
        none by default.

    Returns
    -------
    pandas.DataFrame
        A row per cell with compensation: ``condition, axis``; ``thesis``; ``simulated``;
        ``tolerance``, by how much the two may differ by chance in 95 % of such cells;
        ``undecided``, whether they do not differ by more but the tolerance exceeds `MAX_SHARE` of
        the thesis' value; ``explained``, whether they do not differ by more and it does not; and
        ``removed`` as `pipeline.virtual_lab.analysis.printed_table_3.removed` says.

    Notes
    -----
    Welch's test; the degrees of freedom are those of Welch and Satterthwaite.
    """
    table = printed.set_index(KEYS).loc[CELLS]
    count = len(simulated)
    variances = np.stack(
        [
            table["sd"].to_numpy() ** 2 / THESIS_SUBJECTS,
            simulated.var(axis=0, ddof=1) / count,
            np.zeros(len(CELLS)) if error is None else error**2,
        ]
    )
    freedoms = np.array([THESIS_SUBJECTS - 1, count - 1, freedom])
    total = variances.sum(axis=0)
    joint = total**2 / (variances**2 / freedoms[:, None]).sum(axis=0)
    tolerance = student.ppf((1 + CONFIDENCE) / 2, joint) * np.sqrt(total)
    mean, thesis = simulated.mean(axis=0), table["mean"].to_numpy()
    near, sharp = np.abs(mean - thesis) <= tolerance, tolerance <= MAX_SHARE * thesis
    cells = CELLS.to_frame(index=False).assign(
        thesis=thesis,
        simulated=mean,
        tolerance=tolerance,
        explained=near & sharp,
        undecided=near & ~sharp,
        removed=CELLS.droplevel("compensated").isin(removed(printed)),
    )
    return cells[~FITTED].drop(columns="compensated").reset_index(drop=True)
