"""Where two curves over the gait cycle differ: permutation of signs with the maximum statistic."""

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
import pandas as pd

from hbm.signals.samples import stretches
from hbm.spatial import Array
from pipeline.statistics.design import ALPHA

MAX_EXACT: Final = 12
"""Subjects of whom all changes of signs are tried: 4,096."""
DRAWN: Final = 10_000
"""Changes of signs that are drawn where there are more subjects."""
MIN_SUBJECTS: Final = 6
"""With fewer, the smallest p that there can be is above 0.05."""


@dataclass(frozen=True, slots=True)
class CurveDifference:
    """A part of the gait cycle in which two curves differ.

    Attributes
    ----------
    start, stop
        First and last percent of the part.
    p
        Smallest p in it, corrected for all instants.
    """

    start: int
    stop: int
    p: float


def curve_differences(differences: Array) -> tuple[CurveDifference, ...]:
    """Find the parts of the gait cycle in which paired curves differ.

    Parameters
    ----------
    differences
        Of each subject, (N, 101). Instants that are unknown (NaN) in one are left out.

    Returns
    -------
    tuple of CurveDifference
        Parts in which the difference is significant at 0.05 for all instants together. None with
        fewer than six subjects.

    Notes
    -----
    Without a difference, the signs of a subject's differences are as likely as not. The largest
    |t| over the cycle is found for all changes of signs (for 10,000 drawn ones where there are more
    than 12 subjects); p of an instant is the share of these that reach its |t| (Nichols and Holmes
    2002, Hum Brain Mapp 15:1).

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> noise = 0.1 * rng.normal(size=(9, 101))
    >>> noise[:, 40:61] += 1.0
    >>> [(part.start, part.stop, round(part.p, 3)) for part in curve_differences(noise)]
    [(40, 60, 0.004)]
    """
    subjects = len(differences)
    if subjects < MIN_SUBJECTS:
        return ()
    known = np.isfinite(differences).all(axis=0) & (np.ptp(differences, axis=0) > 0)
    values = np.where(known, differences, 0.0)
    p = np.ones(differences.shape[1])
    if known.any():
        largest = _largest_t(values[:, known], _signs(subjects))
        own = _t(values[:, known].sum(axis=0), np.square(values[:, known]).sum(axis=0), subjects)
        reached = largest[:, None] >= np.abs(own) * (1 - 1e-12)
        p[known] = reached.mean(axis=0)
    return tuple(
        CurveDifference(int(start), int(stop) - 1, float(p[start:stop].min()))
        for start, stop in stretches(p < ALPHA)
    )


def parts_of(table: pd.DataFrame, curve: str, compared: str) -> list[CurveDifference]:
    """Give the parts of one comparison in a table with curve, compared, start, stop and p."""
    own = table[(table["curve"] == curve) & (table["compared"] == compared)]
    rows = own[["start_percent", "stop_percent", "p"]].itertuples(index=False)
    return [CurveDifference(*row) for row in rows]


def _signs(subjects: int) -> Array:
    """Give changes of signs, (K, N), the observed one among them."""
    if subjects <= MAX_EXACT:
        return np.array([*product((1.0, -1.0), repeat=subjects)])
    drawn = np.random.default_rng(0).choice((1.0, -1.0), size=(DRAWN, subjects))
    return np.vstack([np.ones(subjects), drawn[1:]])


def _largest_t(values: Array, signs: Array) -> Array:
    """Give the largest |t| over all instants for each change of signs, (K,)."""
    sums, squares = signs @ values, np.square(values).sum(axis=0)
    return np.asarray(np.abs(_t(sums, squares, len(values))).max(axis=1))


def _t(sums: Array, squares: Array, count: int) -> Array:
    """Give Student's t of values from their sums and sums of squares."""
    variance = (squares - sums**2 / count) / (count - 1)
    return np.asarray(sums / np.sqrt(count * np.maximum(variance, 1e-300)))
