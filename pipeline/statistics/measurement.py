"""How sure measured values and their means are: errors that trials share do not average out."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
import pandas as pd
import scipy

from hbm.spatial import Array
from pipeline.statistics.design import TAIL

CELL: Final = ("subject", "condition", "compensated")
"""What a value is of."""
Covariances = Mapping[str, pd.DataFrame]
"""Residual -> covariance of its values by errors of measurement; rows and columns are cells."""


def mean_covariance(
    covariance: pd.DataFrame, subjects: Iterable[str], cells: Sequence[tuple[str, bool]]
) -> Array:
    """Give the covariance of means over the same subjects.

    Parameters
    ----------
    covariance
        Of a residual's values, with rows and columns by `CELL`.
    subjects
        Over whom, (N,).
    cells
        Condition and whether compensated, of each mean, (C,).

    Returns
    -------
    Array
        (C, C).
    """
    people = list(subjects)
    values = [(subject, *cell) for cell in cells for subject in people]
    count = len(cells), len(people)
    # errors that subjects share are in the covariances between subjects, which do not average out
    block = covariance.loc[values, values].to_numpy().reshape(*count, *count)
    return np.asarray(block.mean(axis=(1, 3)))


def deviation(covariance: Array, weights: Sequence[float]) -> float:
    """Give the standard deviation of a linear combination of means, by their covariance.

    Examples
    --------
    >>> deviation(np.array([[9.0, 0.0], [0.0, 16.0]]), (1.0, -1.0))
    5.0
    """
    w = np.asarray(weights)
    return float(np.sqrt(max(w @ covariance @ w, 0.0)))


def half_interval(sd: float) -> float:
    """Give half of the 95 % interval of a normally distributed value."""
    return -float(scipy.special.ndtri(TAIL)) * sd
