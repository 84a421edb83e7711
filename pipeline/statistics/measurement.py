"""How sure measured values and their means are: errors that trials share do not average out."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final, Literal, get_args

import numpy as np
import pandas as pd
from scipy import stats

from hbm.spatial import Array
from pipeline.statistics.design import CONFIDENCE

Level = Literal["laboratory", "subject", "trial", "sample"]
"""Within what an error is the same: all trials; those of a subject, who visits once; a trial, with
and without compensation; one value."""
CELL: Final = ("subject", "condition", "compensated")
"""What a value is of."""
LEVELS: Final[tuple[Level, ...]] = get_args(Level)
"""Each has one column of `CELL` more that tells its errors apart than the one before."""
Covariances = Mapping[str, pd.DataFrame]
"""Residual -> covariance of its values by errors of measurement; rows and columns are cells."""


def measurement_covariances(errors: pd.DataFrame) -> Covariances:
    """Compute how errors of measurement vary together in the values of a study.

    Parameters
    ----------
    errors
        One row per value and error: subject, condition, compensated, axis; `error`, its name;
        `level`, a `Level`; and `change`, what one standard deviation of it adds to the value, with
        its sign.

    Returns
    -------
    Mapping
        Axis -> covariance, with rows and columns (subject, condition, compensated). The standard
        deviation of a linear combination w of values is the root of ``w @ covariance @ w``.

    Notes
    -----
    Each error is the change of every value that shares it, times one standard normal variable; all
    others are independent (JCGM 102:2011, 6.2.1, with the changes as sensitivities).

    Examples
    --------
    >>> columns = ["subject", "condition", "compensated", "axis", "error", "level", "change"]
    >>> late = ["plates are late", "laboratory"]
    >>> rows = [["s1", c, False, "Fx", *late, 2.0] for c in ("baseline", "sway")]
    >>> found = measurement_covariances(pd.DataFrame(rows, columns=columns))["Fx"].to_numpy()
    >>> difference = np.array([-1.0, 1.0])
    >>> np.diag(found).tolist(), float(difference @ found @ difference)
    ([4.0, 4.0], 0.0)
    """
    rank = errors["level"].map(LEVELS.index)
    sources = [
        errors[name].astype(str).where(rank > k, "").rename(f"of_{name}")
        for k, name in enumerate(CELL)
    ]
    found = {}
    for axis, own in pd.concat([errors, *sources], axis=1).groupby("axis", sort=False):
        source = ["error", *(column.name for column in sources)]
        changes = own.pivot(index=source, columns=list(CELL), values="change").fillna(0.0)
        found[str(axis)] = changes.T @ changes
    return found


def mean_covariance(
    covariance: pd.DataFrame, subjects: Iterable[str], cells: Sequence[tuple[str, bool]]
) -> Array:
    """Give the covariance of means over the same subjects.

    Parameters
    ----------
    covariance
        Of a residual's values (`measurement_covariances`).
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
    block = covariance.loc[values, values].to_numpy().reshape(*count, *count)
    return np.asarray(block.mean(axis=(1, 3)))


def deviation(covariance: Array, weights: Sequence[float]) -> float:
    """Give the standard deviation of a linear combination of means, by their covariance.

    Examples
    --------
    >>> deviation(np.array([[9.0, 0.0], [0.0, 16.0]]), (1.0, -1.0))
    5.0
    """
    shares = np.asarray(weights)
    return float(np.sqrt(max(shares @ covariance @ shares, 0.0)))


def half_interval(sd: float) -> float:
    """Give half of the 95 % interval of a normally distributed value."""
    return float(stats.norm.isf((1 - CONFIDENCE) / 2)) * sd
