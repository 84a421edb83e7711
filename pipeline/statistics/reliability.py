"""Repeatability of values that were recorded several times, in one session or in several."""

import warnings
from collections.abc import Iterator
from math import nan, sqrt
from typing import Final

import numpy as np
import pandas as pd

from pipeline.statistics.design import MIN_SUBJECTS

KEYS: Final = ["condition", "compensated", "name", "unit"]
MIN_VALUES: Final = 5
"""Of an intraclass correlation."""
COLUMNS: Final = (
    *KEYS,
    *("repeated", "n_subjects", "n_repeats", "mean", "sd_within", "icc", "icc_low", "icc_high"),
    *("sem", "smallest_detectable_change"),
)


def reliability(values: pd.DataFrame) -> pd.DataFrame:
    """Summarise how well values repeat.

    Parameters
    ----------
    values
        A row per recording: subject, session (empty where there is one), recording, condition,
        compensated, name, unit, value.

    Returns
    -------
    pandas.DataFrame
        A row per condition, compensation and name that is repeated in two subjects or more.

        repeated, n_subjects, n_repeats
            What is repeated, "session" (the mean of its recordings) or "recording"; subjects with
            two repeats or more, and the repeats that all of these have.
        mean, sd_within
            Mean, and within-subject standard deviation: the root mean square over subjects.
        icc, icc_low, icc_high
            Intraclass correlation of single repeats, absolute agreement, with 95 % interval.
        sem, smallest_detectable_change
            Standard error of measurement, and the change that exceeds it in one person (95 %).

    Notes
    -----
    ICC(A,1) of McGraw and Wong 1996 (Psychol Methods 1:30), by pingouin; the standard error of
    measurement is the total standard deviation times √(1 − ICC), the smallest detectable change
    1.96 √2 of it (Weir 2005, J Strength Cond Res 19:231).

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> names = {"session": "", "condition": "walk", "compensated": False, "name": "Fx"}
    >>> table = [
    ...     {**names, "unit": "N", "subject": s, "recording": r, "value": s + 0.1 * rng.normal()}
    ...     for s in range(9) for r in ("01", "02")
    ... ]
    >>> row = reliability(pd.DataFrame(table)).iloc[0]
    >>> (row["repeated"], int(row["n_subjects"]), bool(row["icc"] > 0.99))
    ('recording', 9, True)
    """
    rows, several_of = [], values.duplicated([*KEYS, "subject"], keep=False)
    for key, own in values[several_of].groupby(KEYS, sort=False):
        sessions = own.groupby("subject")["session"].nunique()
        of_session = bool((sessions > 1).sum() >= MIN_SUBJECTS)
        unit = "session" if of_session else "recording"
        each = own.groupby(["subject", unit], sort=True)["value"].mean()
        counts = each.groupby("subject").size()
        several = counts.index[counts > 1]
        if len(several) >= MIN_SUBJECTS:
            repeats = each[each.index.get_level_values("subject").isin(several)]
            of_repeats = [*_of_repeats(repeats, int(counts[several].min()))]
            rows.append((*key, unit, len(several), int(counts[several].min()), *of_repeats))
    return pd.DataFrame(rows, columns=COLUMNS)


def _of_repeats(repeats: pd.Series, count: int) -> Iterator[float]:
    """Give the numbers of one value, indexed by subject and repeat, from the mean on."""
    of_subject = repeats.groupby("subject")
    within = sqrt(float(np.average(of_subject.var(), weights=of_subject.size() - 1)))
    yield float(of_subject.mean().mean())
    yield within
    first = of_subject.head(count)
    repeat = first.groupby("subject").cumcount().to_numpy()
    table = first.reset_index(name="value").assign(repeat=repeat)
    icc, (low, high) = _agreement(table)
    yield from (icc, low, high)
    sem = float(first.std()) * sqrt(max(1 - icc, 0.0))
    yield from (sem, 1.96 * sqrt(2) * sem)


def _agreement(table: pd.DataFrame) -> tuple[float, tuple[float, float]]:
    """Give the intraclass correlation of single repeats with its interval.

    NaN without variance, and of two repeats of two subjects.
    """
    import pingouin

    if not table["value"].std() > 0 or len(table) < MIN_VALUES:
        return nan, (nan, nan)
    with warnings.catch_warnings():  # of pandas' deprecations, and of subjects who are all alike
        warnings.simplefilter("ignore")
        found = pingouin.intraclass_corr(table, "subject", "repeat", "value")
    row = found.set_index("Type").loc["ICC(A,1)"]
    low, high = row["CI95"]
    return float(row["ICC"]), (float(low), float(high))
